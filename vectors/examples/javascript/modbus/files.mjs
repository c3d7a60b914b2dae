// Functions 14 and 15: groups of a reference type 06, a file, a record and registers.

import { big, fromRegisters, parseRegisters, refuseUnless, showRegisters, toRegisters } from '../hex.mjs';
import { Reader } from '../reader.mjs';

const TYPE = 6;
const HIGHEST = 251; // bytes behind a byte count in a PDU

function place({ file, record }) {
  refuseUnless(file >= 1 && file <= 0xffff, 'value', `file ${file}`);
  refuseUnless(record >= 0 && record <= 9999, 'value', `record ${record}`);
  return [TYPE, ...big(file, 2), ...big(record, 2)];
}

/** Groups behind their byte count, which lies between two limits. */
function groups(name, low, high, { write, read, whole = 1, check = () => {} }) {
  return {
    write(message) {
      const data = message[name].flatMap(write);
      check(message[name]);
      refuseUnless(data.length >= low && data.length <= high, 'value', `${data.length} bytes of groups`);
      return [data.length, ...data];
    },
    read(reader) {
      const inside = new Reader(reader.counted(reader.u8()));
      refuseUnless(inside.left % whole === 0, 'length', `byte count ${inside.left}`);
      refuseUnless(inside.left > 0 && inside.left <= high, 'value', `byte count ${inside.left}`);
      const found = [];
      while (inside.left) found.push(read(inside));
      check(found);
      return { [name]: found };
    },
  };
}

function readPlace(inside) {
  const type = inside.u8();
  const found = { file: inside.u16(), record: inside.u16() };
  const length = inside.u16();
  refuseUnless(type === TYPE, 'value', `reference type ${type}`);
  place(found);
  return { ...found, length };
}

/** The registers of all groups fit one response, with two bytes for each group. */
function fits(places) {
  const bytes = places.reduce((sum, { length }) => sum + 2 + 2 * length, 0);
  refuseUnless(bytes <= HIGHEST, 'value', `a response of ${bytes} bytes`);
}

const asked = groups('places', 7, 0xf5, {
  whole: 7,
  check: fits,
  write(one) {
    refuseUnless(one.length >= 1 && one.length <= 0xffff, 'value', `length ${one.length}`);
    return [...place(one), ...big(one.length, 2)];
  },
  read(inside) {
    const one = readPlace(inside);
    refuseUnless(one.length >= 1, 'value', 'no registers');
    return one;
  },
});

const answered = groups('records', 2, HIGHEST, {
  write(one) {
    const registers = parseRegisters(one);
    refuseUnless(registers.length >= 1, 'value', 'no registers');
    return [1 + 2 * registers.length, TYPE, ...fromRegisters(registers)];
  },
  read(inside) {
    const length = inside.u8();
    refuseUnless(length % 2 === 1, 'length', 'half a register');
    refuseUnless(length <= inside.left, 'short', `a group of ${length} bytes`);
    const type = inside.u8();
    refuseUnless(type === TYPE, 'value', `reference type ${type}`);
    refuseUnless(length >= 3, 'value', 'no registers');
    return showRegisters(toRegisters(inside.take(length - 1)));
  },
});

const written = groups('records', 9, 0xfb, {
  write(one) {
    const registers = parseRegisters(one.registers);
    refuseUnless(registers.length >= 1, 'value', 'no registers');
    return [...place(one), ...big(registers.length, 2), ...fromRegisters(registers)];
  },
  read(inside) {
    const { file, record, length } = readPlace(inside);
    refuseUnless(length >= 1, 'value', 'no registers');
    return { file, record, registers: showRegisters(toRegisters(inside.take(2 * length))) };
  },
});

export const files = {
  14: { request: asked, response: answered },
  15: { request: written, response: written },
};
