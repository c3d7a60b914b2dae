// How long a PDU must be, as far as its first bytes tell: what lets a receiver of RTU find the end of a frame by counting.

import { fromBig } from '../hex.mjs';

const fixed = (length) => () => length;
/** So many bytes, then a byte count, then as many bytes. */
const counted = (before) => (pdu) => (pdu.length > before ? before + 1 + pdu[before] : undefined);

const REQUESTS = {
  0x07: fixed(1), 0x08: fixed(5), 0x0b: fixed(1), 0x0c: fixed(1), 0x0f: counted(5), 0x10: counted(5), 0x11: fixed(1),
  0x14: counted(1), 0x15: counted(1), 0x16: fixed(7), 0x17: counted(9), 0x18: fixed(3), 0x2b: encapsulatedRequest,
};
const RESPONSES = {
  0x05: fixed(5), 0x06: fixed(5), 0x07: fixed(2), 0x08: fixed(5), 0x0b: fixed(5), 0x0c: counted(1), 0x0f: fixed(5),
  0x10: fixed(5), 0x11: counted(1), 0x14: counted(1), 0x15: counted(1), 0x16: fixed(7), 0x17: counted(1),
  0x18: (pdu) => (pdu.length > 2 ? 3 + fromBig(pdu.slice(1, 3)) : undefined), 0x2b: encapsulatedResponse,
  0xab: (pdu) => (pdu.length < 2 ? undefined : pdu[1] === 0xff ? 10 : 2),
};
for (let code = 1; code <= 6; code += 1) REQUESTS[code] = fixed(5);
for (let code = 1; code <= 4; code += 1) RESPONSES[code] = counted(1);

function reference(pdu, side) {
  const head = pdu[3] === 0 ? 12 : 11; // with the byte 00 of dialect cia309
  if (pdu.length < head) return undefined;
  const hasData = (pdu[2] === 1) === (side === 'request');
  return head + (hasData ? fromBig(pdu.slice(head - 2, head)) : 0);
}

function encapsulatedRequest(pdu) {
  if (pdu.length < 2) return undefined;
  if (pdu[1] === 0x0e) return 4;
  return pdu[1] === 0x0d ? reference(pdu, 'request') : null;
}

function encapsulatedResponse(pdu) {
  if (pdu.length < 2) return undefined;
  if (pdu[1] === 0x0d) return reference(pdu, 'response');
  if (pdu[1] !== 0x0e) return null;
  let at = 7;
  for (let left = pdu[6] ?? 1; left > 0; left -= 1) {
    if (pdu.length < at + 2) return undefined;
    at += 2 + pdu[at + 1];
  }
  return at;
}

/** The length; undefined: more bytes are needed to know it; null: nobody can count this function. */
export function lengthOf(side, pdu) {
  if (pdu.length === 0) return undefined;
  const table = side === 'request' ? REQUESTS : RESPONSES;
  if (pdu[0] in table) return table[pdu[0]](pdu);
  return side === 'response' && pdu[0] > 0x80 ? 2 : null;
}
