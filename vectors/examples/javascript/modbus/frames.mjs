// The three envelopes of a PDU: RTU, ASCII and TCP.

import { big, codes, characters, fromBig, hex, parseBytes, refuseUnless, showBytes } from '../hex.mjs';
import { crcBytes, lrc } from '../checksums.mjs';

function checked(unit, pdu) {
  refuseUnless(unit >= 0 && unit <= 255, 'value', `unit ${unit}`);
  refuseUnless(pdu.length >= 1 && pdu.length <= 253, 'value', `a PDU of ${pdu.length} bytes`);
  return [unit, ...pdu];
}

const same = (one, other) => one.length === other.length && one.every((byte, k) => byte === other[k]);

export const rtu = {
  encode(unit, pdu) {
    const body = checked(unit, pdu);
    return [...body, ...crcBytes(body)];
  },
  decode(frame) {
    refuseUnless(frame.length >= 4, 'short');
    refuseUnless(frame.length <= 256, 'long');
    const body = frame.slice(0, -2);
    refuseUnless(same(crcBytes(body), frame.slice(-2)), 'checksum');
    return { unit: body[0], pdu: body.slice(1) };
  },
};

/** Frames of ASCII are bytes here too: the codes of their characters. `end` is the character after CR. */
export const ascii = {
  encode(unit, pdu, end = '\n') {
    const body = checked(unit, pdu);
    return codes(`:${[...body, lrc(body)].map((byte) => hex(byte, 2)).join('')}\r${end}`);
  },
  decode(frame, end = '\n') {
    const text = characters(frame);
    refuseUnless(text.startsWith(':') && text.endsWith(`\r${end}`), 'delimiter');
    const digits = text.slice(1, -2);
    refuseUnless(/^[0-9A-Fa-f]*$/.test(digits), 'character');
    refuseUnless(text.length >= 9, 'short');
    refuseUnless(text.length <= 513, 'long');
    refuseUnless(digits.length % 2 === 0, 'short');
    const body = parseBytes(digits);
    const sum = body.pop();
    refuseUnless(lrc(body) === sum, 'checksum');
    return { unit: body[0], pdu: body.slice(1) };
  },
};

export const tcp = {
  encode(transaction, unit, pdu) {
    const body = checked(unit, pdu);
    refuseUnless(transaction >= 0 && transaction <= 0xffff, 'value', `transaction ${transaction}`);
    return [...big(transaction, 2), 0, 0, ...big(body.length, 2), ...body];
  },
  decode(frame) {
    refuseUnless(frame.length >= 6, 'short');
    refuseUnless(fromBig(frame.slice(2, 4)) === 0, 'protocol');
    const length = fromBig(frame.slice(4, 6));
    refuseUnless(length >= 2 && length <= 254, 'length');
    refuseUnless(frame.length >= 6 + length, 'short');
    refuseUnless(frame.length <= 6 + length, 'long');
    return { transaction: fromBig(frame.slice(0, 2)), unit: frame[6], pdu: frame.slice(7) };
  },
};

/** The three by their names; a serial line has no transaction number. */
export const ENVELOPES = {
  rtu: { wrap: (number, unit, pdu) => rtu.encode(unit, pdu), unwrap: (frame) => ({ ...rtu.decode(frame), transaction: 0 }) },
  ascii: { wrap: (number, unit, pdu) => ascii.encode(unit, pdu), unwrap: (frame) => ({ ...ascii.decode(frame), transaction: 0 }) },
  tcp: { wrap: tcp.encode, unwrap: tcp.decode },
};

export const shown = (message) => ({ ...message, pdu: showBytes(message.pdu) });

// The third operation of these kinds, `receive`, is beside the receivers, in talk.mjs.
export const KINDS = {
  'rtu-frame': {
    encode: ({ unit, pdu }) => ({ frame: showBytes(rtu.encode(unit, parseBytes(pdu))) }),
    decode: ({ frame }) => shown(rtu.decode(parseBytes(frame))),
  },
  'ascii-frame': {
    encode: ({ unit, pdu }) => ({ text: characters(ascii.encode(unit, parseBytes(pdu))) }),
    decode: ({ text }) => shown(ascii.decode(codes(text))),
  },
  'tcp-frame': {
    encode: ({ transaction, unit, pdu }) => ({ frame: showBytes(tcp.encode(transaction, unit, parseBytes(pdu))) }),
    decode: ({ frame }) => shown(tcp.decode(parseBytes(frame))),
  },
};
