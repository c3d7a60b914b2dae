// Two Modbus clients in virtual time: one for a serial line, with one question at a time, and one for TCP.
//
// ask(question, done): question has `unit` and `pdu` (bytes), done(outcome) is called with its text. What the client sends
// goes to send(frame, end), with the time of its last bit; what it receives comes in receive(bytes).

import { Refused, parseBytes } from '../hex.mjs';
import { understand } from '../modbus/exchange.mjs';
import { AsciiReceiver, RtuReceiver, TcpReceiver } from '../modbus/receivers.mjs';
import { ENVELOPES } from '../modbus/frames.mjs';

const READS = [1, 2, 3, 4, 23, 24];
const CHARACTER_BITS = 11;

/** What an answer says; null if it is not the answer to this question. */
function outcomeOf({ unit, pdu }, event) {
  if (event.unit !== unit) return null;
  try {
    const message = understand(pdu, parseBytes(event.pdu));
    if ('exception_code' in message) return `exception ${message.exception_code.toString(16).toUpperCase().padStart(2, '0')}`;
    if ('registers' in message) return `registers ${message.registers}`;
    return 'bits' in message && READS.includes(pdu[0]) ? `bits ${message.bits.replaceAll(' ', '')}` : 'done';
  } catch (error) {
    if (error instanceof Refused) return null;
    throw error;
  }
}

export class SerialClient {
  constructor(line, clock, send) {
    const { framing, baud, timeout, retries, echo = false, turnaround = 100000 } = line;
    Object.assign(this, { clock, send, framing, timeout, retries, echo, turnaround });
    this.lateWindow = line.late_window ?? 2 * timeout;
    this.character = (CHARACTER_BITS * 1e6) / baud;
    this.newReceiver = () =>
      framing === 'rtu'
        ? new RtuReceiver({ role: 'client', baud, bits: CHARACTER_BITS, patience: 50000 })
        : new AsciiReceiver({ timeout: 1000000 });
    this.quiet = 0; // nothing is sent before: until then a late answer may come
    this.sent = false; // the request of the present question
  }

  ask(question, done) {
    Object.assign(this, { question, done, unanswered: 0, left: this.retries, sent: false });
    if (question.unit === 0 && READS.includes(question.pdu[0])) this.finish('no answer');
    else this.clock.at(this.quiet, () => this.transmit());
  }

  transmit() {
    const { unit, pdu } = this.question;
    const frame = ENVELOPES[this.framing].wrap(0, unit, pdu);
    const end = Math.ceil(this.clock.now + frame.length * this.character);
    this.sent = true;
    this.receiver = this.newReceiver();
    this.echoed = this.echo ? [...frame] : [];
    this.send(frame, end);
    this.lastEnd = end;
    if (unit === 0) {
      this.clock.at(end + this.turnaround, () => this.finish('sent'));
      return;
    }
    this.unanswered += 1;
    this.cancel = this.clock.at(end + this.timeout, () => this.missed());
  }

  missed() {
    this.left -= 1;
    if (this.left >= 0) this.transmit();
    else this.finish('no answer');
  }

  finish(outcome) {
    // An answer on a serial line does not name its question: the next one is asked when no late answer can come any more.
    this.quiet = this.unanswered > 0 ? this.lastEnd + this.lateWindow : this.clock.now + 4 * this.character;
    this.sent = false;
    this.done(outcome);
  }

  receive(bytes) {
    let own = 0;
    while (own < bytes.length && this.echoed.length && bytes[own] === this.echoed[0]) {
      this.echoed.shift();
      own += 1;
    }
    if (!this.sent || this.question.unit === 0) return;
    for (const event of this.receiver.feed(bytes.slice(own), this.clock.now)) {
      const outcome = 'pdu' in event && this.sent ? outcomeOf(this.question, event) : null;
      if (outcome !== null) {
        this.cancel();
        this.unanswered -= 1;
        this.finish(outcome);
      }
    }
  }
}

export class TcpClient {
  constructor(line, clock, send, reconnect) {
    Object.assign(this, { clock, send, reconnect, timeout: line.timeout, retries: line.retries });
    this.number = line.first_number ?? 1;
    this.open = new Map(); // transaction number -> what was asked
    this.receiver = new TcpReceiver();
  }

  ask(question, done) {
    this.transmit({ question, done, left: this.retries });
  }

  transmit(asked) {
    while (this.open.has(this.number)) this.number = (this.number + 1) % 0x10000;
    const number = this.number;
    this.number = (number + 1) % 0x10000;
    this.open.set(number, asked);
    asked.cancel = this.clock.at(this.clock.now + this.timeout, () => this.missed(number));
    this.send(ENVELOPES.tcp.wrap(number, asked.question.unit, asked.question.pdu), this.clock.now);
  }

  missed(number) {
    const asked = this.open.get(number);
    this.open.delete(number);
    asked.cancel();
    asked.left -= 1;
    if (asked.left >= 0) this.transmit(asked);
    else asked.done('no answer');
  }

  receive(bytes) {
    for (const event of this.receiver.feed(bytes)) {
      if (!('pdu' in event)) {
        this.close();
        return;
      }
      const asked = this.open.get(event.transaction);
      const outcome = asked ? outcomeOf(asked.question, event) : null;
      if (outcome !== null) {
        this.open.delete(event.transaction);
        asked.cancel();
        asked.done(outcome);
      }
    }
  }

  /** Nobody knows where a frame begins any more: a new connection, and what was open is asked again or has failed. */
  close() {
    this.receiver = new TcpReceiver();
    this.reconnect();
    for (const number of [...this.open.keys()]) this.missed(number);
  }
}
