// Floating point: the nearest number of 32 or 64 bits to a decimal text.
//
// Math.fround(Number(text)) rounds twice, first to 64 bits and then to 32, which is wrong by one step for some texts.
// So the neighbours of that number are compared with the text exactly, as fractions of two BigInts.

import { refuseUnless } from './hex.mjs';

function fraction(text) {
  const [, sign, whole, part = '', exponent = '0'] = /^([+-]?)(\d*)\.?(\d*)(?:[eE]([+-]?\d+))?$/.exec(text);
  const power = Number(exponent) - part.length;
  const digits = BigInt(`0${whole}${part}`) * (sign === '-' ? -1n : 1n);
  return power >= 0 ? [digits * 10n ** BigInt(power), 1n] : [digits, 10n ** BigInt(-power)];
}

/** A finite number of 64 bits as a fraction. */
function exact(number) {
  let denominator = 1n;
  while (!Number.isInteger(number)) {
    number *= 2;
    denominator *= 2n;
  }
  return [BigInt(number), denominator];
}

function distance([a, b], [c, d]) {
  const difference = a * d - c * b;
  return [difference < 0n ? -difference : difference, b * d];
}

const words = new DataView(new ArrayBuffer(4));

function nearest32(text) {
  const first = Math.fround(Number(text));
  if (!Number.isFinite(first)) return beyond(text) ? first : Math.sign(first) * 3.4028234663852886e38;
  words.setFloat32(0, first);
  const middle = words.getUint32(0);
  let best = first;
  for (const bits of [middle - 1, middle + 1]) {
    words.setUint32(0, bits >>> 0);
    const other = words.getFloat32(0);
    if (!Number.isFinite(other) || Math.sign(other) === -Math.sign(first)) continue;
    const [a, b] = distance(fraction(text), exact(other));
    const [c, d] = distance(fraction(text), exact(best));
    if (a * d < c * b || (a * d === c * b && bits % 2 === 0)) best = other;
  }
  return best;
}

/** Whether a number is so large that its nearest number of 32 bits is infinite. */
function beyond(text) {
  const [a, b] = fraction(text.replace('-', ''));
  return a >= b * (2n ** 128n - 2n ** 103n);
}

const NAMES = { inf: Infinity, '+inf': Infinity, '-inf': -Infinity, nan: NaN };

export function floatBytes(bits, text) {
  const view = new DataView(new ArrayBuffer(bits / 8));
  let number = NAMES[text];
  if (number === undefined) {
    number = bits === 32 ? nearest32(text) : Number(text);
    refuseUnless(Number.isFinite(number), 'value', `${text} does not fit f${bits}`);
    if (number === 0 && text.startsWith('-')) number = -0;
  }
  if (bits === 32) view.setFloat32(0, number);
  else view.setFloat64(0, number);
  return [...new Uint8Array(view.buffer)];
}

export function floatText(bits, bytes) {
  const view = new DataView(Uint8Array.from(bytes).buffer);
  const number = bits === 32 ? view.getFloat32(0) : view.getFloat64(0);
  if (Number.isNaN(number)) return 'nan';
  if (!Number.isFinite(number)) return number > 0 ? 'inf' : '-inf';
  return Object.is(number, -0) ? '-0.0' : String(number);
}
