// A gateway from Modbus TCP to one RTU line, whose only master it is.

import { Refused, parseBytes, showBytes } from '../hex.mjs';
import { Clock } from '../clock.mjs';
import { rtu, tcp } from '../modbus/frames.mjs';
import { RtuReceiver, TcpReceiver } from '../modbus/receivers.mjs';
import { understand } from '../modbus/exchange.mjs';

const LINE = { role: 'client', baud: 19200, bits: 11, patience: 30000 };
const CHARACTER = (LINE.bits * 1e6) / LINE.baud;
const SILENCE = 3.5 * CHARACTER; // t3.5, before every request
const TURNAROUND = 100000;
const [NO_PATH, NO_RESPONSE] = [0x0a, 0x0b];

class Gateway {
  constructor({ units, timeout, broadcast = false }, clock) {
    Object.assign(this, { units, timeout, broadcast, clock, waiting: [], present: null, up: true, said: [], clients: {} });
    this.silentFrom = 0;
    this.receiver = new RtuReceiver(LINE);
  }

  fromClient(name, bytes) {
    this.clients[name] ??= new TcpReceiver();
    for (const event of this.clients[name].feed(bytes)) {
      if ('pdu' in event) this.waiting.push({ ...event, name, pdu: parseBytes(event.pdu) });
    }
    this.next();
  }

  /** The line has one request at a time. */
  next() {
    while (this.present === null && this.waiting.length) {
      const request = this.waiting.shift();
      const { unit, pdu } = request;
      const toAll = unit === 0 && this.broadcast;
      if (!this.up) this.decline(request, NO_PATH);
      else if (!toAll && !this.units.includes(unit)) this.decline(request, NO_RESPONSE);
      else this.send(request, rtu.encode(unit, pdu), toAll);
    }
  }

  send(request, frame, toAll) {
    this.present = request;
    this.cancel = this.clock.at(this.silentFrom, () => this.transmit(request, frame, toAll));
  }

  transmit(request, frame, toAll) {
    this.said.push({ to: 'line', bytes: showBytes(frame) });
    this.receiver = new RtuReceiver(LINE);
    const sent = this.clock.now + frame.length * CHARACTER;
    this.cancel = toAll
      ? this.clock.at(sent + TURNAROUND, () => this.done())
      : this.clock.at(sent + this.timeout, () => {
          this.decline(request, NO_RESPONSE);
          this.done();
        });
  }

  done() {
    this.cancel();
    this.present = null;
    this.next();
  }

  reply({ name, transaction, unit }, pdu) {
    this.said.push({ to: name, bytes: showBytes(tcp.encode(transaction, unit, pdu)) });
  }

  decline(request, code) {
    this.reply(request, [request.pdu[0] | 0x80, code]);
  }

  fromLine(bytes) {
    this.silentFrom = this.clock.now + SILENCE;
    for (const event of this.receiver.feed(bytes, this.clock.now)) {
      if (this.present && 'pdu' in event && this.answers(event)) {
        this.reply(this.present, parseBytes(event.pdu));
        this.done();
      }
    }
  }

  answers({ unit, pdu }) {
    if (unit !== this.present.unit || unit === 0) return false;
    try {
      understand(this.present.pdu, parseBytes(pdu));
      return true;
    } catch (error) {
      if (error instanceof Refused) return false;
      throw error;
    }
  }

  /** The port of the line. */
  port(up) {
    this.up = up;
    if (up || !this.present) return;
    this.decline(this.present, NO_PATH);
    this.done();
  }
}

function run({ gateway: settings, talk }) {
  const clock = new Clock();
  const gateway = new Gateway(settings, clock);
  const steps = [];
  for (const { at, from, bytes, port } of talk) {
    clock.at(at, () => {
      if (port) gateway.port(port === 'up');
      else if (from === 'line') gateway.fromLine(parseBytes(bytes));
      else if (from) gateway.fromClient(from, parseBytes(bytes));
      clock.at(at, () => steps.push({ say: gateway.said.splice(0) }));
    });
  }
  clock.run();
  return { talk: steps };
}

export const KINDS = { gateway: { run } };
