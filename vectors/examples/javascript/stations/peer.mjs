// The peer of a client, as ../../README.md describes it in the section `client`: units, and what becomes of each request.

import { parseBytes, parseRegisters, showBytes } from '../hex.mjs';
import { ENVELOPES } from '../modbus/frames.mjs';
import { Unit } from './unit.mjs';

const FUNCTIONS = ['01', '02', '03', '04', '05', '06', '0F', '10'];
const ANSWER_AFTER = 2000;
const BETWEEN_ANSWERS = 5000;
const BETWEEN_STRAYS = 10000;

export class Peer {
  /** `deliver(bytes, at)` hands bytes to the client at that time. `questions` have `unit`, `pdu`, `fates`, `open`, `seen`. */
  constructor({ line, units, probes = [] }, questions, deliver) {
    Object.assign(this, { tcp: line.framing === 'tcp', probes: [...probes], questions, deliver, lastPiece: {} });
    this.envelope = ENVELOPES[line.framing];
    this.units = new Map();
    for (const { unit, registers, coils, diagnostics } of units) {
      const one = new Unit({ holding_registers: registers, coils, functions: FUNCTIONS }, line.framing);
      one.tables.input_registers = one.tables.holding_registers;
      one.tables.discrete_inputs = one.tables.coils;
      this.units.set(unit, { unit: one, diagnostics });
    }
  }

  /** Registers get other values, as a question begins. */
  change(unit, changes) {
    const { holding_registers: table } = this.units.get(unit).unit.tables;
    for (const [first, row] of Object.entries(changes)) table.write(Number(first), parseRegisters(row));
  }

  fateOf(unit, pdu) {
    const question = this.questions.find((one) => one.open && one.unit === unit && one.pdu === pdu);
    if (!question) return this.probes.shift() ?? {};
    question.seen += 1;
    return question.fates.shift() ?? {};
  }

  /** A request whose last bit was sent at `now`. */
  hear(frame, now) {
    const { unit, pdu, transaction } = this.envelope.unwrap(frame);
    const fate = this.fateOf(unit, showBytes(pdu));
    if (fate.echo) this.deliver(frame, now);
    if (fate.lost === 'request') return;
    if (unit === 0 && !this.tcp) {
      for (const one of this.units.values()) one.unit.answer(pdu);
      return;
    }
    const answer = this.answer(unit, pdu, fate);
    if (answer && fate.lost !== 'answer') this.say(fate, unit, answer, transaction, now);
  }

  answer(number, pdu, fate) {
    const peer = this.units.get(number);
    if (!peer) return null;
    const given = fate.pdu === undefined ? null : parseBytes(fate.pdu);
    if (given && given[0] & 0x80) return given;
    if (pdu[0] !== 8) {
      const own = peer.unit.answer(pdu);
      return given ?? own;
    }
    if (peer.diagnostics === 'ignores') return null;
    return given ?? (peer.diagnostics === 'declines' ? [0x88, 1] : pdu);
  }

  say(fate, unit, answer, transaction, now) {
    let at = now + (fate.delay ?? ANSWER_AFTER);
    if (!this.tcp) at = Math.max(at, (this.lastPiece[unit] ?? -BETWEEN_ANSWERS) + BETWEEN_ANSWERS);
    for (const item of fate.before ?? []) {
      const stray = () => this.envelope.wrap(transaction ^ (item.number ?? 0), item.unit ?? unit, parseBytes(item.pdu));
      this.deliver(item.bytes === undefined ? stray() : parseBytes(item.bytes), at);
      at += BETWEEN_STRAYS;
    }
    const data = this.data(fate, unit, answer, transaction);
    const repeated = (fate.again ?? []).filter((after) => after === 0);
    let rest = [data, ...repeated.map(() => data)].flat();
    const first = at;
    for (const size of fate.pieces ?? []) {
      this.deliver(rest.slice(0, size), at);
      rest = rest.slice(size);
      at += fate.pause;
    }
    this.deliver(rest, at);
    this.lastPiece[unit] = at;
    for (const after of fate.again ?? []) if (after > 0) this.deliver(data, first + after);
  }

  data(fate, unit, answer, transaction) {
    const data = this.envelope.wrap(transaction ^ (fate.number ?? 0), fate.unit ?? unit, answer);
    if (fate.damage) {
      const [place, mask] = fate.damage;
      data[place < 0 ? data.length + place : place] ^= mask;
    }
    return fate.cut === undefined ? data : data.slice(0, fate.cut);
  }
}
