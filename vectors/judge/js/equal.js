'use strict';
// Whether an answer has what a case expects.

const { fitsFrame } = require('./patterns.js');

const HEX = /^[0-9A-Fa-f ]*$/;
const NUMBER = /^([+-]?)([0-9]+)(?:\.([0-9]+))?(?:[eE]([+-]?[0-9]{1,4}))?$/;
const ANY_ORDER = ['device', 'gateway-309-3'];

const isObject = (value) => typeof value === 'object' && value !== null && !Array.isArray(value);

/** Whether an answer has what is wanted. `name` is that of the field, `type` that of a number in it. */
function equal(wanted, answered, name, type, question) {
  if (isObject(wanted)) {
    if ('one_of' in wanted) return wanted.one_of.some((one) => equal(one, answered, name, type, question));
    if ('from' in wanted && 'to' in wanted) return Number.isInteger(answered) && wanted.from <= answered && answered <= wanted.to;
    return isObject(answered) && Object.entries(wanted).every(([key, value]) => Object.hasOwn(answered, key) &&
      (isPadded(key, value, answered[key], question) || equal(value, answered[key], key, type, question)));
  }
  if (Array.isArray(wanted)) {
    if (!Array.isArray(answered) || answered.length !== wanted.length) return false;
    const sorted = ANY_ORDER.includes(question.kind) ? byIdentifier : (list) => list;
    const [left, right] = [sorted(wanted), sorted(answered)];
    const typeAt = (place) => (question.kind === 'pdo' && place < question.entries.length ? question.entries[place].type ?? '' : type);
    return left.every((value, place) => equal(value, right[place], name, typeAt(place), question));
  }
  if (typeof wanted !== 'string' || typeof answered !== 'string') return wanted === answered;
  if (question.kind === 'device' && wanted.includes('..')) return fitsFrame(wanted, answered);
  if (wanted === answered || (name === 'value' && sameNumber(wanted, answered, type))) return true;
  return HEX.test(wanted) && digits(wanted) === digits(answered);
}

const digits = (text) => text.replaceAll(' ', '').toUpperCase();

/** Frames in the order of their identifiers, those of one identifier as they came; other lists unchanged. */
function byIdentifier(list) {
  const frames = list.map((item) => (isObject(item) && Array.isArray(item.one_of) ? item.one_of[0] : item));
  if (!frames.every((frame) => typeof frame === 'string' && frame.includes('#'))) return list;
  const identifier = (place) => frames[place].split('#', 1)[0];
  const compared = (one, other) => (identifier(one) < identifier(other) ? -1 : identifier(one) > identifier(other) ? 1 : one - other);
  return [...list.keys()].sort(compared).map((place) => list[place]);
}

/** Bits of a response that was decoded without its request have up to seven more, all zero. */
function isPadded(name, wanted, answered, question) {
  if (name !== 'bits' || question.kind !== 'pdu' || question.side !== 'response') return false;
  if (typeof wanted !== 'string' || typeof answered !== 'string') return false;
  const [short, long] = [wanted, answered].map((bits) => bits.replaceAll(' ', ''));
  return long.startsWith(short) && /^0{0,7}$/.test(long.slice(short.length));
}

/** Whether two texts are the same number: of floating point the nearest one of that type, others exactly. */
function sameNumber(wanted, answered, type) {
  if (!/^[uibf]/.test(type)) return false;
  const [one, other] = [wanted, answered].map(type[0] === 'f' ? (text) => nearest(text, type) : canonical);
  return one !== undefined && Object.is(one, other);
}

function canonical(text) {
  const [, sign, whole, part = '', exponent = '0'] = NUMBER.exec(text) ?? [];
  if (whole === undefined) return undefined;
  const all = (whole + part).replace(/^0+/, '');
  const kept = all.replace(/0+$/, '');
  return kept && `${sign === '-' ? '-' : ''}${kept}e${Number(exponent) - part.length + all.length - kept.length}`;
}

function nearest(text, type) {
  const named = /^([+-]?)(inf|nan)$/i.exec(text);
  if (named) return named[2].toLowerCase() === 'nan' ? NaN : named[1] === '-' ? -Infinity : Infinity;
  const number = NUMBER.test(text) ? (type === 'f32' ? Math.fround(Number(text)) : Number(text)) : NaN;
  return Number.isFinite(number) ? number : undefined;
}

/** Whether the answer is in a `never` of what is expected: wrong, whatever the standard leaves open. */
function isExcluded(wanted, answered, question) {
  if (isObject(wanted) && 'one_of' in wanted) return (wanted.never ?? []).some((one) => equal(one, answered, '', '', question));
  const isPair = (isObject(wanted) && isObject(answered)) || (Array.isArray(wanted) && Array.isArray(answered));
  return isPair && Object.keys(wanted).some((key) => Object.hasOwn(answered, key) && isExcluded(wanted[key], answered[key], question));
}

module.exports = { equal, isExcluded, isObject };
