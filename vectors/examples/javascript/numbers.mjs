// Values as bytes: numbers in four orders, rows of bits, parts of a register, texts, values of the object dictionary.

import { NotOffered, characters, fromLittle, hex, little, packBits, parseBits, parseBytes } from './hex.mjs';
import { refuseUnless, showBits, showBytes, unpackBits } from './hex.mjs';
import { floatBytes, floatText } from './floats.mjs';

/** The big-endian bytes in an order; every order is its own inverse. */
function reorder(bytes, order) {
  const paired = order === 'BADC' || order === 'CDAB';
  refuseUnless(!paired || bytes.length === 1 || bytes.length % 2 === 0, 'value', `${bytes.length} bytes have no order ${order}`);
  const result = order === 'DCBA' || order === 'CDAB' ? [...bytes].reverse() : [...bytes];
  if (!paired || bytes.length === 1) return result;
  return result.map((_, k) => result[k ^ 1]);
}

/** The integer that a decimal text is; "1.0" is one, "1.5" is refused. */
export function integer(text) {
  const match = /^([+-]?\d+)(?:\.0*)?$/.exec(text);
  refuseUnless(match, 'value', `${text} is not an integer`);
  return BigInt(match[1]);
}

/** An integer as that many bits, two's complement if it is signed. */
export function bitsOf(signed, bits, value) {
  const number = integer(value);
  const [low, high] = signed ? [-(1n << BigInt(bits - 1)), 1n << BigInt(bits - 1)] : [0n, 1n << BigInt(bits)];
  refuseUnless(low <= number && number < high, 'value', `${value} does not fit ${bits} bits`);
  return BigInt.asUintN(bits, number);
}

/** Big-endian bytes of a value of the type "u16", "i32", "f64". */
export function numberBytes(type, value) {
  const bits = Number(type.slice(1));
  if (type[0] === 'f') return floatBytes(bits, value);
  return parseBytes(hex(bitsOf(type[0] === 'i', bits, value), bits / 4));
}

export function numberText(type, bytes) {
  const bits = Number(type.slice(1));
  if (type[0] === 'f') return floatText(bits, bytes);
  const number = BigInt(`0x${bytes.map((byte) => hex(byte, 2)).join('')}`);
  return (type[0] === 'u' ? number : BigInt.asIntN(bits, number)).toString();
}

function exactly(bytes, size) {
  refuseUnless(bytes.length >= size, 'short');
  refuseUnless(bytes.length <= size, 'long');
  return bytes;
}

const HIGHEST = { ascii: 0x7f, 'latin-1': 0xff };

function encodeText(text, charset) {
  if (charset === 'utf-8') return [...Buffer.from(text, 'utf-8')];
  const points = Array.from(text, (character) => character.codePointAt(0));
  refuseUnless(points.every((point) => point <= HIGHEST[charset]), 'value', `a character is not of ${charset}`);
  return points;
}

function decodeText(bytes, charset) {
  if (charset === 'utf-8') {
    try {
      return new TextDecoder('utf-8', { fatal: true, ignoreBOM: true }).decode(Uint8Array.from(bytes));
    } catch {
      refuseUnless(false, 'character');
    }
  }
  refuseUnless(bytes.every((byte) => byte <= HIGHEST[charset]), 'character');
  return characters(bytes);
}

function partOf(part) {
  if (part === 'L' || part === 'H') return { shift: part === 'L' ? 0 : 8, mask: 0xff };
  return { shift: Number(part.slice('bit '.length)), mask: 1 };
}

const OBJECT_VALUES = {
  BOOLEAN: {
    encode: (value) => [value ? 1 : 0],
    decode(bytes) {
      exactly(bytes, 1);
      refuseUnless(bytes[0] <= 1, 'value');
      return bytes[0] === 1;
    },
  },
  VISIBLE_STRING: {
    encode: (value) => encodeText(value, 'latin-1'),
    decode: characters,
  },
  UNICODE_STRING: {
    encode: (value) => [...Buffer.from(value, 'utf16le')],
    decode(bytes) {
      refuseUnless(bytes.length % 2 === 0, 'short');
      return Buffer.from(bytes).toString('utf16le');
    },
  },
  OCTET_STRING: { encode: parseBytes, decode: showBytes },
  TIME_OF_DAY: {
    encode({ days, milliseconds }) {
      refuseUnless(days >= 0 && days <= 0xffff && milliseconds >= 0 && milliseconds < 86400000, 'value');
      return [...little(milliseconds, 4), ...little(days, 2)];
    },
    decode(bytes) {
      exactly(bytes, 6);
      const milliseconds = fromLittle(bytes.slice(0, 4)) % 2 ** 28; // the upper four bits are reserved
      refuseUnless(milliseconds < 86400000, 'value');
      return { days: fromLittle(bytes.slice(4)), milliseconds };
    },
  },
};
OBJECT_VALUES.DOMAIN = OBJECT_VALUES.OCTET_STRING;
OBJECT_VALUES.TIME_DIFFERENCE = OBJECT_VALUES.TIME_OF_DAY;
export const timeOfDay = OBJECT_VALUES.TIME_OF_DAY;

function objectType(type) {
  if (!(type in OBJECT_VALUES)) throw new NotOffered(`no values of type ${type}`);
  return OBJECT_VALUES[type];
}

export const KINDS = {
  number: {
    encode: ({ type, order, value }) => ({ bytes: showBytes(reorder(numberBytes(type, value), order)) }),
    decode({ type, order, bytes }) {
      const size = Number(type.slice(1)) / 8;
      reorder(new Array(size).fill(0), order);
      return { value: numberText(type, reorder(exactly(parseBytes(bytes), size), order)) };
    },
  },
  bits: {
    encode({ bits }) {
      refuseUnless(/^[01 ]*$/.test(bits), 'value', 'a bit is 0 or 1');
      return { bytes: showBytes(packBits(parseBits(bits))) };
    },
    decode({ bytes, count }) {
      const data = parseBytes(bytes);
      refuseUnless(data.length * 8 >= count, 'short');
      return { bits: showBits(unpackBits(data, count)) };
    },
  },
  'register-part': {
    decode({ register, part }) {
      const { shift, mask } = partOf(part);
      refuseUnless(shift < 16, 'value');
      return { value: (parseInt(register, 16) >> shift) & mask };
    },
    encode({ register, part, write }) {
      const { shift, mask } = partOf(part);
      refuseUnless(shift < 16 && write >= 0 && write <= mask, 'value', `${part} cannot hold ${write}`);
      return { then: hex((parseInt(register, 16) & ~(mask << shift)) | (write << shift), 4) };
    },
  },
  text: {
    encode({ size, charset, pad, text }) {
      const data = encodeText(text, charset);
      refuseUnless(data.length <= size, 'value', `longer than ${size} bytes`);
      return { bytes: showBytes([...data, ...new Array(size - data.length).fill(parseInt(pad, 16))]) };
    },
    decode({ size, charset, pad, bytes }) {
      const data = exactly(parseBytes(bytes), size);
      while (data.length && (data.at(-1) === 0 || data.at(-1) === parseInt(pad, 16))) data.pop();
      return { text: decodeText(data, charset) };
    },
  },
  'object-value': {
    encode: ({ type, value }) => ({ bytes: showBytes(objectType(type).encode(value)) }),
    decode: ({ type, bytes }) => ({ value: objectType(type).decode(parseBytes(bytes)) }),
  },
};
