// How the questions write bytes, registers and bits, and the two ways not to answer.

export class Refused extends Error {
  constructor(reason, text = reason) {
    super(text);
    this.reason = reason;
  }
}

export class NotOffered extends Error {}

export function refuseUnless(condition, reason, text) {
  if (!condition) throw new Refused(reason, text);
}

/** 0x0A of two digits is "0A". */
export const hex = (number, digits) => number.toString(16).toUpperCase().padStart(digits, '0');

/** "01 0F" is [1, 15]; blanks do not count. */
export const parseBytes = (text) => (text.replaceAll(' ', '').match(/../g) ?? []).map((two) => parseInt(two, 16));
export const showBytes = (bytes) => Array.from(bytes, (byte) => hex(byte, 2)).join(' ');

/** "022B 0000" is [0x22B, 0]. */
export const parseRegisters = (text) => (text.replaceAll(' ', '').match(/..../g) ?? []).map((four) => parseInt(four, 16));
export const showRegisters = (registers) => registers.map((register) => hex(register, 4)).join(' ');

/** "10110011 10" is ten bits, the first bit first. */
export const parseBits = (text) => [...text.replaceAll(' ', '')].map(Number);
export const showBits = (bits) => bits.join('').replace(/(.{8})(?=.)/g, '$1 ');

/** Eight bits in a byte, the first bit is the lowest. */
export function packBits(bits) {
  const bytes = new Array(Math.ceil(bits.length / 8)).fill(0);
  bits.forEach((bit, k) => (bytes[k >> 3] |= bit << (k & 7)));
  return bytes;
}
export const unpackBits = (bytes, count) => Array.from({ length: count }, (_, k) => (bytes[k >> 3] >> (k & 7)) & 1);

/** A number in `size` bytes: the high byte first (Modbus), or the low byte first (CANopen). */
export const big = (number, size) => little(number, size).reverse();
export const little = (number, size) => Array.from({ length: size }, (_, k) => Math.floor(number / 256 ** k) % 256);
export const fromBig = (bytes) => bytes.reduce((sum, byte) => sum * 256 + byte, 0);
export const fromLittle = (bytes) => fromBig([...bytes].reverse());

/** The eight bytes of a CANopen message, filled with zeros. */
export const eight = (bytes) => [...bytes, 0, 0, 0, 0, 0, 0, 0, 0].slice(0, 8);

/** Registers are two bytes each, the high byte first. */
export const toRegisters = (data) => Array.from({ length: data.length / 2 }, (_, k) => fromBig(data.slice(2 * k, 2 * k + 2)));
export const fromRegisters = (registers) => registers.flatMap((register) => big(register, 2));

/** Characters U+0000 to U+00FF are bytes. */
export const characters = (bytes) => String.fromCharCode(...bytes);
export const codes = (text) => Array.from(text, (character) => character.charCodeAt(0));
