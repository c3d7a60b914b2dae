// The object dictionary of a device: types, access rights, limits, defaults and what was stored.

import { codes, fromLittle, hex, parseBytes } from '../hex.mjs';
import { floatBytes, floatText } from '../floats.mjs';
import { bitsOf } from '../numbers.mjs';
import { Abort } from '../canopen/sdo-server.mjs';

const SIZES = { BOOLEAN: 1, REAL32: 4, REAL64: 8, TIME_OF_DAY: 6, TIME_DIFFERENCE: 6 };
const sizeOf = (type) => SIZES[type] ?? (/^(UNSIGNED|INTEGER)\d+$/.test(type) ? parseInt(type.match(/\d+$/)[0], 10) / 8 : null);

/** The text of a value in a case as the bytes that are transferred. */
export function valueBytes(type, text) {
  const size = sizeOf(type);
  if (type === 'VISIBLE_STRING') return codes(text);
  if (type === 'UNICODE_STRING') return [...Buffer.from(text, 'utf16le')];
  if (size === null || type.startsWith('TIME')) return parseBytes(text);
  if (type.startsWith('REAL')) return floatBytes(size * 8, text).reverse();
  return parseBytes(hex(bitsOf(type.startsWith('INTEGER'), size * 8, text), size * 2)).reverse();
}

/** Bytes as something that can be compared with a limit. */
function comparable(type, bytes) {
  if (type.startsWith('REAL')) return Number(floatText(bytes.length * 8, [...bytes].reverse()));
  const number = BigInt(`0x${[...bytes].reverse().map((byte) => hex(byte, 2)).join('')}`);
  return type.startsWith('INTEGER') ? BigInt.asIntN(bytes.length * 8, number) : number;
}

const key = (index, sub) => `${hex(index, 4)}:${hex(sub, 2)}`;

export class Dictionary {
  /** `computed`: key -> function that gives the bytes; `rules`: called before a write, true if there is nothing left to do; `wrote`: after it. */
  constructor(objects, { computed = {}, rules = () => false, wrote = () => {} } = {}) {
    Object.assign(this, { computed, rules, wrote, entries: new Map(), stored: new Map() });
    this.add({ object: '1000:00', type: 'UNSIGNED32', access: 'ro', value: '0' });
    this.add({ object: '1001:00', type: 'UNSIGNED8', access: 'ro', value: '0' });
    this.add({ object: '1018:01', type: 'UNSIGNED32', access: 'ro', value: '0' });
    for (const object of objects) this.add(object);
    this.completeRecords();
    this.values = new Map([...this.entries].map(([name, { initial }]) => [name, initial]));
  }

  add({ object, type, access, value, low, high, mapped = 'no' }) {
    const [index, sub] = object.split(':').map((part) => parseInt(part, 16));
    const limit = (text) => (text === undefined || text === null ? null : comparable(type, valueBytes(type, text)));
    const entry = { index, sub, type, access, mapped, size: sizeOf(type), low: limit(low), high: limit(high) };
    this.entries.set(key(index, sub), { ...entry, initial: valueBytes(type, value) });
  }

  /** Sub-index 00 of a record is its highest one, if it is not listed. */
  completeRecords() {
    for (const { index } of [...this.entries.values()].filter(({ sub }) => sub > 0)) {
      if (this.entries.has(key(index, 0))) continue;
      const highest = Math.max(...this.subs(index));
      this.add({ object: key(index, 0), type: 'UNSIGNED8', access: 'ro', value: String(highest) });
    }
  }

  subs(index) {
    return [...this.entries.values()].filter((entry) => entry.index === index).map(({ sub }) => sub);
  }

  has(index, sub) {
    return this.entries.has(key(index, sub));
  }

  entry(index, sub) {
    const found = this.entries.get(key(index, sub));
    if (found) return found;
    throw new Abort(this.subs(index).length ? '06090011' : '06020000');
  }

  /** The value for the device itself. */
  bytes(index, sub) {
    return this.computed[key(index, sub)]?.() ?? this.values.get(key(index, sub));
  }

  number(index, sub, otherwise = 0) {
    return this.has(index, sub) ? fromLittle(this.bytes(index, sub)) : otherwise;
  }

  put(index, sub, bytes) {
    this.values.set(key(index, sub), bytes);
  }

  // ------------------------------------------------------------------------------------------------ for an SDO server

  read(index, sub) {
    const { access } = this.entry(index, sub);
    if (access === 'wo') throw new Abort('06010001');
    return this.bytes(index, sub);
  }

  mayWrite(index, sub, size = null) {
    const { access, size: own } = this.entry(index, sub);
    if (access === 'ro' || access === 'const') throw new Abort('06010002');
    if (own !== null && size !== null && size !== own) throw new Abort(size > own ? '06070012' : '06070013');
  }

  write(index, sub, bytes, exact) {
    const { size } = this.entry(index, sub);
    const value = exact || size === null ? bytes : bytes.slice(0, size);
    this.mayWrite(index, sub, value.length);
    this.check(index, sub, value);
    if (!this.rules(index, sub, fromLittle(value), value)) this.store(index, sub, value);
  }

  check(index, sub, bytes) {
    const { type, low, high } = this.entry(index, sub);
    if (type === 'BOOLEAN' && bytes[0] > 1) throw new Abort('06090030');
    if (high !== null && comparable(type, bytes) > high) throw new Abort('06090031');
    if (low !== null && comparable(type, bytes) < low) throw new Abort('06090032');
  }

  store(index, sub, bytes) {
    const old = this.bytes(index, sub);
    this.put(index, sub, bytes);
    this.wrote(index, sub, old.join() !== bytes.join());
  }

  // ------------------------------------------------------------------------------------------- 1010h, 1011h and resets

  inRange([low, high]) {
    return [...this.entries.values()].filter(({ index }) => index >= low && index <= high);
  }

  save(range) {
    for (const { index, sub, access } of this.inRange(range)) {
      if (access === 'rw' || access === 'wo') this.stored.set(key(index, sub), this.values.get(key(index, sub)));
    }
  }

  forget(range) {
    for (const { index, sub } of this.inRange(range)) this.stored.delete(key(index, sub));
  }

  /** What was stored, or the default. */
  reset(range) {
    for (const { index, sub, initial } of this.inRange(range)) {
      this.put(index, sub, this.stored.get(key(index, sub)) ?? initial);
    }
  }
}

