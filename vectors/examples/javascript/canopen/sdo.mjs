// SDO: the frames that begin a transfer, and aborts (CiA 301, 7.2.4.3).

import { fromLittle, hex, little, parseBytes, refuseUnless, showBytes } from '../hex.mjs';
import { nodeOf } from './frames.mjs';

const BASE = { request: 0x600, answer: 0x580 };

/** The abort codes that CiA 301 defines. */
const KNOWN = new Set(
  `05030000 05040000 05040001 05040002 05040003 05040004 05040005 06010000 06010001 06010002 06020000 06040041 06040042
   06040043 06040047 06060000 06070010 06070012 06070013 06090011 06090030 06090031 06090032 06090036 060A0023 08000000
   08000020 08000021 08000022 08000023 08000024`.split(/\s+/),
);

const EXPEDITED = 0x02;
const INDICATED = 0x01;

/** Index and sub-index as three bytes. */
export function place({ index, sub }) {
  const [number, subNumber] = [parseInt(index, 16), parseInt(sub, 16)];
  refuseUnless(number <= 0xffff && subNumber <= 0xff, 'value', `${index}:${sub}`);
  return [...little(number, 2), subNumber];
}

/** An expedited frame: `command` with n, e and s. */
function expedited(command, message) {
  const data = parseBytes(message.data);
  refuseUnless(data.length >= 1 && data.length <= 4, 'value', `${data.length} bytes`);
  refuseUnless(message.indicated || data.length === 4, 'value', 'without a size all four bytes count');
  const unused = message.indicated ? ((4 - data.length) << 2) | INDICATED : 0;
  return [command | EXPEDITED | unused, ...place(message), ...data, 0, 0, 0].slice(0, 8);
}

function begins(command, message) {
  const { size = null } = message;
  refuseUnless(size === null || (size >= 0 && size < 2 ** 32), 'value', `size ${size}`);
  return [command | (size === null ? 0 : INDICATED), ...place(message), ...little(size ?? 0, 4)];
}

const plain = (command, message) => [command, ...place(message), 0, 0, 0, 0];

const ENCODERS = {
  request: {
    'initiate-upload': (message) => plain(0x40, message),
    'expedited-download': (message) => expedited(0x20, message),
    'initiate-download': (message) => begins(0x20, message),
  },
  answer: {
    'expedited-upload': (message) => expedited(0x40, message),
    'upload-initiated': (message) => begins(0x40, message),
    'download-initiated': (message) => plain(0x60, message),
  },
};
const abort = (message) => [0x80, ...place(message), ...little(parseInt(message.code, 16), 4)];
ENCODERS.request.abort = abort;
ENCODERS.answer.abort = abort;

/** What the bits 7 to 5 say to each side: the names of an expedited frame, of one that begins segments, of a plain one. */
const COMMANDS = {
  request: { 1: ['expedited-download', 'initiate-download'], 2: ['initiate-upload'], 4: ['abort'] },
  answer: { 2: ['expedited-upload', 'upload-initiated'], 3: ['download-initiated'], 4: ['abort'] },
};

const atLeast = (bytes, size) => refuseUnless(bytes.length >= size, 'short', `${bytes.length} bytes`);

/** The four bytes of data that count. Some devices leave out those that do not. */
function expeditedData(bytes) {
  const indicated = (bytes[0] & INDICATED) !== 0;
  const size = indicated ? 4 - ((bytes[0] >> 2) & 3) : 4;
  atLeast(bytes, 4 + size);
  return { data: showBytes(bytes.slice(4, 4 + size)), indicated };
}

function beginning(bytes) {
  if (!(bytes[0] & INDICATED)) return { size: null };
  atLeast(bytes, 8);
  return { size: fromLittle(bytes.slice(4)) };
}

export function decodeSdo(side, bytes) {
  refuseUnless(bytes.length <= 8, 'long');
  atLeast(bytes, 1);
  const names = COMMANDS[side][bytes[0] >> 5];
  refuseUnless(names, 'function', `command ${hex(bytes[0], 2)}`);
  atLeast(bytes, 4);
  const message = { name: names[0], index: hex(fromLittle(bytes.slice(1, 3)), 4), sub: hex(bytes[3], 2) };
  if (names.length === 2) {
    if (bytes[0] & EXPEDITED) return { ...message, ...expeditedData(bytes) };
    return { ...message, name: names[1], ...beginning(bytes) };
  }
  if (names[0] !== 'abort') return message;
  atLeast(bytes, 8);
  return { ...message, code: hex(fromLittle(bytes.slice(4)), 8) };
}

export const KINDS = {
  sdo: {
    encode({ side, node, message }) {
      refuseUnless(node >= 1 && node <= 127, 'value', `node ${node}`);
      refuseUnless(message.name in ENCODERS[side], 'value', message.name);
      return { cob_id: hex(BASE[side] + node, 3), data: showBytes(ENCODERS[side][message.name](message)) };
    },
    decode({ side, cob_id: cobId, data }) {
      const bytes = parseBytes(data);
      refuseUnless(bytes.length <= 8, 'long');
      const node = nodeOf(cobId, BASE[side]);
      const message = decodeSdo(side, bytes);
      return message.name === 'abort' ? { node, message, known: KNOWN.has(message.code) } : { node, message };
    },
  },
};
