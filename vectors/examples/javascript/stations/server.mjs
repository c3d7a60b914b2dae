// A Modbus server behind a line: whom a request is for, broadcasts, listen only mode, counters and the event log.

import { big, fromBig, hex, parseBytes, showBytes } from '../hex.mjs';
import { Exception, Unit } from './unit.mjs';

const [FUNCTION, VALUE] = [1, 3];
const LOG_SIZE = 64;

/** Events of the log: bit 7 received, bit 6 without it sent. */
const RECEIVED = 0x80;
const DAMAGED = 0x82;
const OVERRUN = 0x90;
const BROADCAST = 0x40;
const LISTENING = 0x20;
const SENT = 0x40;
const EXCEPTION_BITS = { 1: 0x01, 2: 0x01, 3: 0x01, 4: 0x02, 5: 0x04, 6: 0x04, 7: 0x08 };
const [RESTARTED, SILENCED] = [0x00, 0x04];

/** Counters by the sub-function that reads them. */
const [REGISTER, BUS, DAMAGE, EXCEPTIONS, MESSAGES, UNANSWERED, NAK, BUSY, OVERRUNS] = [
  '02', '0B', '0C', '0D', '0E', '0F', '10', '11', '12',
];
const COUNTERS = [REGISTER, BUS, DAMAGE, EXCEPTIONS, MESSAGES, UNANSWERED, NAK, BUSY, OVERRUNS];
const UNCOUNTED = ['0B', '08 01', '08 0A', '08 04'];

class SerialUnit {
  constructor(settings, line) {
    this.unit = new Unit(settings, line);
    this.line = line;
    this.busy = settings.busy === true;
    this.counters = { events: 0 };
    for (const name of COUNTERS) this.counters[name] = 0;
    Object.assign(this.counters, settings.counters);
    this.log = [];
    this.listening = false;
  }

  count(name) {
    this.counters[name] = (this.counters[name] + 1) % 0x10000;
  }

  note(event) {
    this.log.unshift(event);
    this.log.length = Math.min(this.log.length, LOG_SIZE);
  }

  received(event) {
    this.note(event | (this.listening ? LISTENING : 0));
  }

  /** A request for this unit, or for all: the answer, which nobody hears if it was for all; null: silence. */
  hear(pdu, broadcast) {
    this.count(MESSAGES);
    this.received(RECEIVED | (broadcast ? BROADCAST : 0));
    const sub = pdu[0] === 8 ? `08 ${hex(pdu[2] ?? 0xff, 2)}` : hex(pdu[0], 2);
    if (this.listening) {
      if (sub === '08 01') this.unit.answer(pdu, (code, whole) => this.diagnose(code, whole));
      return null;
    }
    const answer = this.unit.answer(pdu, (code, whole) => this.diagnose(code, whole));
    if (this.listening) return null;
    if (answer[0] & 0x80) this.refused(answer[1]);
    else {
      if (!UNCOUNTED.includes(sub)) this.count('events');
      if (sub !== '08 01') this.note(SENT);
    }
    if (broadcast) this.count(UNANSWERED);
    return broadcast ? null : answer;
  }

  refused(code) {
    this.count(EXCEPTIONS);
    if (code === 6) this.count(BUSY);
    if (code === 7) this.count(NAK);
    this.note(SENT | (EXCEPTION_BITS[code] ?? 0));
  }

  clear() {
    for (const name of Object.keys(this.counters)) this.counters[name] = 0;
  }

  status() {
    return this.busy ? [0xff, 0xff] : [0, 0];
  }

  /** 08, 0B and 0C. */
  diagnose(code, pdu) {
    if (code !== '08') {
      if (pdu.length !== 1) throw new Exception(VALUE);
      const events = big(this.counters.events, 2);
      if (code === '0B') return [pdu[0], ...this.status(), ...events];
      return [pdu[0], 6 + this.log.length, ...this.status(), ...events, ...big(this.counters[BUS], 2), ...this.log];
    }
    if (pdu.length < 3) throw new Exception(VALUE);
    const sub = hex(fromBig(pdu.slice(1, 3)), 2);
    const data = pdu.slice(3);
    if (sub === '00') return pdu;
    const known = ['01', '04', '0A', '14', ...COUNTERS].includes(sub) || (sub === '03' && this.line === 'ascii');
    if (!known) throw new Exception(FUNCTION);
    if (data.length !== 2 || !this.allowed(sub, data)) throw new Exception(VALUE);
    if (COUNTERS.includes(sub)) return [...pdu.slice(0, 3), ...big(this.counters[sub], 2)];
    this.command(sub, data);
    return pdu;
  }

  allowed(sub, [high, low]) {
    if (sub === '03') return low === 0;
    return low === 0 && (high === 0 || (sub === '01' && high === 0xff));
  }

  command(sub, [high]) {
    if (sub === '01') {
      this.clear();
      this.listening = false;
      if (high === 0xff) this.log = [];
      this.note(RESTARTED);
    }
    if (sub === '04') {
      this.listening = true;
      this.note(SILENCED);
    }
    if (sub === '0A') this.clear();
    if (sub === '14') this.counters[OVERRUNS] = 0;
  }
}

class SerialServer {
  constructor(units, line) {
    this.units = Object.entries(units).map(([address, settings]) => [Number(address), new SerialUnit(settings, line)]);
  }

  step({ unit, ask, raw, overrun }) {
    for (const [, one] of this.units) {
      if (overrun) {
        one.count(OVERRUNS);
        one.received(OVERRUN);
      } else if (raw !== undefined) {
        one.count(DAMAGE);
        one.received(DAMAGED);
      } else one.count(BUS);
    }
    if (ask === undefined) return null;
    const pdu = parseBytes(ask);
    const heard = this.units.filter(([address]) => address === unit || unit === 0);
    if (pdu[0] & 0x80) return null; // that is an exception response, not a request
    const answers = heard.map(([, one]) => one.hear(pdu, unit === 0));
    return answers[0] ?? null;
  }
}

class TcpServer {
  constructor(units) {
    this.held = [];
    this.units = Object.entries(units).map(([address, settings]) => [Number(address), { unit: new Unit(settings, 'tcp') }]);
  }

  stream(bytes) {
    const held = this.held = [...this.held, ...bytes];
    const sent = [];
    while (held.length >= 6) {
      const end = 6 + (held[4] << 8) + held[5];
      if (held[2] || held[3] || end < 8 || end > 260) held.length = 0;
      if (held.length < end) break;
      const frame = held.splice(0, end);
      const pdu = this.step({ unit: frame[6], ask: showBytes(frame.slice(7)) });
      if (pdu) sent.push(...frame.slice(0, 4), ...big(pdu.length + 1, 2), frame[6], ...pdu);
    }
    return sent.length ? sent : null;
  }

  step({ unit, ask, stream }) {
    if (stream !== undefined) return this.stream(parseBytes(stream));
    if (ask === undefined) return null;
    const found = this.units.find(([address]) => address === unit);
    return found ? found[1].unit.answer(parseBytes(ask)) : null;
  }
}

export const KINDS = {
  server: {
    run({ server: { line, units }, talk }) {
      const server = line === 'tcp' ? new TcpServer(units) : new SerialServer(units, line);
      const said = talk.map((step) => {
        const answer = server.step(step);
        return { say: answer ? showBytes(answer) : null };
      });
      return { talk: said, then: Object.fromEntries(server.units.map(([address, { unit }]) => [address, unit.show()])) };
    },
  },
};
