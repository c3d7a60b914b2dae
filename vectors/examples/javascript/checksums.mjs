// CRC-16 and LRC of serial lines, the CRC of SDO blocks, and the times of RTU.

import { hex, parseBytes, refuseUnless, showBytes } from './hex.mjs';

/** The CRC of RTU: register FFFFh, polynomial A001h, the low bit first. `walk` is told every step. */
export function crc16(bytes, walk = null) {
  let register = 0xffff;
  for (const byte of bytes) {
    register ^= byte;
    const step = { byte: hex(byte, 2), xor: hex(register, 4), shifts: [] };
    for (let k = 0; k < 8; k += 1) {
      const out = register & 1;
      register >>= 1;
      const shift = `${hex(register, 4)} ${out}`;
      if (out) register ^= 0xa001;
      step.shifts.push(out ? `${shift} ${hex(register, 4)}` : shift);
    }
    walk?.push(step);
  }
  return register;
}

/** As it is sent: the low byte first. */
export const crcBytes = (bytes) => {
  const crc = crc16(bytes);
  return [crc & 0xff, crc >> 8];
};

export const lrc = (bytes) => -bytes.reduce((sum, byte) => sum + byte, 0) & 0xff;

/** The CRC of an SDO block transfer: register 0, polynomial 1021h, the high bit first. */
export function crcOfBlocks(bytes) {
  let register = 0;
  for (const byte of bytes) {
    register ^= byte << 8;
    for (let k = 0; k < 8; k += 1) register = ((register << 1) ^ (register & 0x8000 ? 0x1021 : 0)) & 0xffff;
  }
  return register;
}

/** The time of a character, t1.5 and t3.5, in nanoseconds; above 19200 bit/s the two silences are fixed. */
export function silences(baud, bits) {
  const character = (bits * 1e9) / baud;
  const [t15, t35] = baud > 19200 ? [750000, 1750000] : [1.5 * character, 3.5 * character];
  return { character, t15, t35 };
}

export const KINDS = {
  crc16: {
    encode({ bytes }) {
      const data = parseBytes(bytes);
      return { crc: hex(crc16(data), 4), wire: showBytes(crcBytes(data)) };
    },
    walk({ bytes }) {
      const walk = [];
      crc16(parseBytes(bytes), walk);
      return { walk };
    },
  },
  lrc: {
    encode: ({ bytes }) => ({ lrc: hex(lrc(parseBytes(bytes)), 2) }),
  },
  'rtu-timing': {
    encode({ baud, bits }) {
      refuseUnless(baud > 0 && bits >= 10 && bits <= 12, 'value');
      const { character, t15, t35 } = silences(baud, bits);
      return { character_ns: Math.round(character), t15_ns: Math.round(t15), t35_ns: Math.round(t35) };
    },
  },
};
