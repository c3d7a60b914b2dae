'use strict';
// Fills a case of device-conformance with the values of a device: placeholders, loops and transfers become plain steps.
//
// fill(question, described) returns the steps, or null if the case is not one for this device, or the device is described
// wrongly; `described` is the `device` of an answer. The rules are those of ../../kinds/device-conformance.md.

const PLACE = '(?:[0-9A-F]{4}|[a-z]+(?:[.][a-z]+)?):(?:[0-9A-F]{2}|[a-z]+)';
const TERM = new RegExp(`([-+^|&]?)(${PLACE}|[a-z]+(?:[.][a-z]+)?|[0-9A-F]+)`, 'g');
const OPERATIONS = {
  '': (_, term) => term, '+': (sum, term) => sum + term, '-': (sum, term) => sum - term,
  '^': (sum, term) => sum ^ term, '|': (sum, term) => sum | term, '&': (sum, term) => sum & term,
};

const hex = (number, width) => number.toString(16).toUpperCase().padStart(width, '0');
const number = (bytes) => bytes.reduceRight((sum, byte) => sum * 256n + BigInt(byte), 0n);
const little = (value, size) =>
  Array.from({ length: size }, (_, at) => hex(Number((BigInt(value) >> BigInt(8 * at)) & 0xffn), 2)).join('');
const digitsOf = (bytes) => bytes.map((byte) => hex(byte, 2)).join('');
const pieces = (bytes) => (bytes.length ? Array.from({ length: Math.ceil(bytes.length / 7) }, (_, n) => bytes.slice(7 * n, 7 * n + 7)) : [[]]);

function bytesOf(text) {
  const plain = text.replaceAll(' ', '');
  if (!/^(?:[0-9A-Fa-f]{2})*$/.test(plain)) throw new TypeError(`${text}: no bytes`);
  return (plain.match(/../g) ?? []).map((pair) => parseInt(pair, 16));
}

function placeOf(name) {
  const found = /^([0-9A-Fa-f]{4}):([0-9A-Fa-f]{2})$/.exec(name);
  if (!found) throw new TypeError(`${name}: no object`);
  return `${found[1]}:${found[2]}`.toUpperCase();
}

class Device {
  constructor({ node, has, objects, large }) {
    this.objects = Object.fromEntries(Object.entries(objects).map(([name, value]) => [placeOf(name), bytesOf(value)]));
    if (!Number.isInteger(node) || node < 1 || node > 127 || !this.objects['1000:00']) throw new TypeError('node, objects');
    if (!Array.isArray(has) || !has.every((one) => typeof one === 'string')) throw new TypeError('has');
    Object.assign(this, { node, has, large: has.includes('large object') ? placeOf(large) : '2000:00' });
  }

  read(index, sub) { return this.objects[`${hex(index, 4)}:${hex(sub, 2)}`]; }
  number(index, sub, size = 4) { return Number(number((this.read(index, sub) ?? []).slice(0, size))); }

  /** What placeholders say of the first of four PDOs that is on, has 11 bits and maps something. */
  pdo(first) {
    for (const n of [0, 1, 2, 3]) {
      const [record, mapping] = [first + n, first + 0x200 + n];
      const [word, count] = [this.number(record, 1), this.number(mapping, 0, 1)];
      if (word === 0 || (word >>> 29) & 5 || count < 1 || count > 64) continue;
      const bits = Array.from({ length: count }, (_, at) => this.number(mapping, at + 1, 1));
      const size = Math.ceil(bits.reduce((sum, one) => sum + one, 0) / 8);
      return { record, mapping, word, cob: word & 0x7ff, size, toomany: Math.floor(64 / (bits[0] || 64)) + 1 };
    }
    return null;
  }

  text() {
    return [0x1008, 0x1009, 0x100a].map((index) => [index, this.read(index, 0) ?? []]).find(([, value]) => value.length >= 8);
  }
}

/** What stands for the placeholders of a case; `names` has the variables of loops too. */
class Values {
  constructor(device, names) { Object.assign(this, { device, names }); }

  fill(text) { return text.replace(/<([^<>]+)>/g, (_, inside) => this.word(inside)); }

  word(inside) {
    const [unit, times] = inside.split('*');
    if (times !== undefined) return unit.repeat(Number(this.number(times)));
    const [expression, size] = inside.split('/');
    if (size !== undefined) return little(BigInt.asUintN(8 * parseInt(size, 16), this.number(expression)), parseInt(size, 16));
    return hex(this.number(expression), /^[0-9A-F]*/.exec(expression)[0].length);
  }

  number(expression) {
    const terms = [...expression.matchAll(TERM)];
    const isWhole = terms.map(([term]) => term).join('') === expression && terms.every(([, sign], at) => (sign !== '') === at > 0);
    if (!isWhole || terms.length === 0) throw new TypeError(`placeholder ${expression}`);
    return terms.reduce((sum, [, sign, term]) => OPERATIONS[sign](sum, this.term(term)), 0n);
  }

  term(term) {
    const [index, sub] = term.split(':');
    if (sub !== undefined) return number(this.device.read(Number(this.term(index)), Number(this.term(sub))) ?? []);
    return /^[0-9A-F]+$/.test(term) ? BigInt(`0x${term}`) : BigInt(this.named(term));
  }

  named(name) {
    if (name in this.names) return this.names[name];
    const [group, field] = name.split('.');
    if (group === 'servers' || group === 'clients') {
      const [first, end] = group === 'servers' ? [0x1202, 0x1280] : [0x1281, 0x1300];
      const span = Array.from({ length: end - first }, (_, at) => first + at);
      return span.find((index) => this.device.read(index, 1) && this.device.read(index, 2)) ?? first;
    }
    const [index, text] = this.device.text() ?? [0x1008, Array(14).fill(0)];
    if (group === 'text') return { index, size: text.length, segments: pieces(text).length }[field];
    return this.device.pdo({ rpdo: 0x1400, tpdo: 0x1800 }[group])?.[field] ?? 0;
  }

  hold(conditions = []) { return conditions.every((condition) => this.holds(this.fill(condition))); }

  holds(condition) {
    const [left, right] = condition.split(' is ');
    if (right !== undefined) return right.startsWith('not ') ? left !== right.slice(4) : left === right;
    if (condition.startsWith('no ')) return !this.holds(condition.slice(3));
    if (condition === 'RPDO' || condition === 'TPDO') return this.device.pdo(condition === 'RPDO' ? 0x1400 : 0x1800) !== null;
    const text = this.device.text();
    if (condition.startsWith('text of ')) return text !== undefined && (condition === 'text of 8 bytes' || text[1].length <= 140);
    const [, index, sub = '0'] = /^([0-9A-F]{4})h(?::([0-9A-F]{2}))?$/.exec(condition) ?? [];
    return index === undefined ? this.device.has.includes(condition) : this.device.read(parseInt(index, 16), parseInt(sub, 16)) !== undefined;
  }

  steps(rows) {
    return rows.flatMap((row) => {
      if (row.each === undefined) {
        if (!this.hold(row.if)) return [];
        const [send, accept, ends] = [row.send ?? [], row.accept ?? [''], row.ends ?? []].map((list) => list.map((text) => this.fill(text)));
        return row.transfer === undefined ? [{ ...row, send, accept, ends }] : this.transfer(row);
      }
      return row.in.flatMap((range) => {
        const [first, last] = this.fill(range).split('-').map((text) => parseInt(text, 16));
        const rounds = Array.from({ length: (last ?? first) - first + 1 }, (_, at) => new Values(this.device, { ...this.names, [row.each]: first + at }));
        return rounds.flatMap((round) => (round.hold(row.if) ? round.steps(row.steps) : []));
      });
    });
  }

  /** The steps of a whole SDO transfer. */
  transfer(row) {
    const [index, text] = this.device.text() ?? [0x1008, Array(14).fill(0)];
    const [place, value] = row.of === 'text' ? [`${little(index, 2)}00`, text] : [this.fill(row.of), bytesOf(this.fill(row.value))];
    const [size, cut, { node }] = [little(value.length, 4), pieces(value), this.device];
    const [last, count] = [cut.length, Math.min(row.segments ?? cut.length, cut.length)];
    const request = (sent) => `${hex(0x600 + node, 3)}#${sent.padEnd(16, '0')}`;
    const answer = (start) => `${hex(0x580 + node, 3)}#${start}${'.'.repeat(Math.max(0, 16 - start.replace(/\[.*?\]/g, '.').length))}`;
    const step = (sent, accepted, more) => ({ send: [request(sent)], accept: accepted.length ? accepted.map(answer) : [''], ends: [], ...more });
    const numbers = (first, end) => Array.from({ length: Math.max(0, end - first + 1) }, (_, at) => first + at);
    const segment = (n) => hex((((n - 1) & 1) << 4) | ((7 - cut[n - 1].length) << 1) | Number(n === last), 2) + digitsOf(cut[n - 1]);
    const numbered = (n, begin) => hex((n - begin + 1) | (Number(n === last) << 7), 2) + digitsOf(cut[n - 1]);
    const block = (sent, begin, end) =>
      ({ send: [sent], accept: [numbers(begin, Math.min(end, last)).map((n) => answer(numbered(n, begin))).join(', ')], ends: [] });
    const crc = little(value.reduce((sum, byte) => numbers(1, 8).reduce((one) => (one << 1) ^ (one & 0x8000 ? 0x11021 : 0), sum ^ (byte << 8)), 0), 2);
    const done = hex(0xc1 | ((7 - cut[last - 1].length) << 2), 2);
    const ends = [['01000405', '00000008'].map((code) => answer(`80......${code}`)).join('|')];
    switch (row.transfer) {
      case 'upload':
        return [step(`40${place}`, [`41${place}${size}`, `40${place}`]), ...numbers(1, count).map((n) => step(n % 2 ? '60' : '70', [segment(n)]))];
      case 'download':
        return [step(`21${place}${little(row.size ?? value.length, 4)}`, [`60${place}`]), ...numbers(1, count).map((n) => step(segment(n), [n % 2 ? '20' : '30']))];
      case 'block segments':
        return [block(this.fill(row.send[0]), row.from ?? 1, row.to ?? last)];
      case 'block download':
        return [step(`C6${place}${size}`, [`A[04]${place}`], { ends }),
          { send: numbers(1, last).map((n) => request(numbered(n, 1))), accept: [answer(`A2${hex(last, 2)}`)], ends: [] },
          step(done + crc, ['A1'])];
      case 'block upload': {
        const { crc: withCrc = true, blksize = 20 } = row;
        const steps = [step(`${withCrc ? 'A4' : 'A0'}${place}${hex(blksize, 2)}`, [`C[26]${place}${size}`, `C[04]${place}`], { ends })];
        let sent = 'A3';
        for (let first = 1; first <= last; first += blksize) {
          const end = Math.min(first + blksize - 1, last);
          steps.push(block(request(sent), first, end));
          sent = `A2${hex(end - first + 1, 2)}${hex(blksize, 2)}`;
        }
        steps.push(step(sent, [...(withCrc ? [done + crc] : []), `${done}0000`]), step('A1', [], { wait: 20000 }));
        return steps.slice(0, { begun: 1, sent: -2, ended: -1 }[row.until] ?? steps.length);
      }
      default: throw new TypeError(`transfer ${row.transfer}`);
    }
  }
}

function fill(question, described) {
  try {
    const device = new Device(described);
    const [index, sub] = device.large.split(':').map((text) => parseInt(text, 16));
    const values = new Values(device, { node: device.node, other: device.node === 126 ? 125 : 126, 'large.index': index, 'large.sub': sub });
    return values.hold(question.if) && values.hold(question.needs) ? values.steps(question.steps) : null;
  } catch (error) {
    if (error instanceof TypeError || error instanceof RangeError) return null;
    throw error;
  }
}

module.exports = { fill };
