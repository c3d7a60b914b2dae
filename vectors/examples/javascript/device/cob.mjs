// COB-IDs, frames and the NMT states of a device.

import { parseBytes } from '../hex.mjs';

export const STOPPED = 0x04;
export const OPERATIONAL = 0x05;
export const PRE_OPERATIONAL = 0x7f;

/** A COB-ID of the dictionary: identifier, and bits 29 to 31. */
export function cob(number) {
  const bit = (k) => Math.floor(number / 2 ** k) % 2 === 1;
  const extended = bit(29);
  return { id: number % (extended ? 2 ** 29 : 2 ** 11), extended, bit30: bit(30), bit31: bit(31) };
}

/** A frame as candump writes it. */
export function parseFrame(text) {
  const [id, data] = text.split('#');
  const remote = data.startsWith('R');
  return { id: parseInt(id, 16), extended: id.length === 8, remote, data: remote ? [] : parseBytes(data) };
}

export const matches = ({ id, extended }, frame) => frame.id === id && frame.extended === extended;
