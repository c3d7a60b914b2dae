// Whether a response answers its request, and what it says.

import { fromBig, parseBits, parseBytes, refuseUnless, showBits } from '../hex.mjs';
import { decodePdu, functionOf } from './pdu.mjs';

/** The PDU of the answer to a request: its message, or {exception_code}. Refuses what is not the answer. */
export function understand(request, response) {
  refuseUnless(response.length > 0, 'short');
  refuseUnless((response[0] & 0x7f) === request[0], 'mismatch', 'another function');
  const { message } = decodePdu('response', response);
  if (response[0] & 0x80) return { exception_code: response[1], ...message };
  refuseUnless(functionOf(response) === functionOf(request), 'mismatch', 'another function');
  return compare(functionOf(request), decodePdu('request', request).message, message, request, response);
}

const same = (condition) => refuseUnless(condition, 'mismatch', 'not what was asked for');
const echo = (asked, said, request, response) => {
  same(request.length === response.length && request.every((byte, k) => byte === response[k]));
  return said;
};
const startAndQuantity = (asked, said, request, response) => {
  same(said.address === asked.address && said.quantity === fromBig(request.slice(3, 5)));
  return said;
};
const registers = (count) => (asked, said) => {
  same(said.registers.split(' ').length === count(asked));
  return said;
};

/** The bits that were asked for; those that only fill the last byte are zero. */
function bits(asked, said) {
  const all = parseBits(said.bits);
  same(all.length === 8 * Math.ceil(asked.quantity / 8));
  return { bits: showBits(all.slice(0, asked.quantity)) };
}

const COMPARED = {
  '01': bits,
  '02': bits,
  '03': registers((asked) => asked.quantity),
  '04': registers((asked) => asked.quantity),
  '05': echo,
  '06': echo,
  '08': (asked, said, request, response) => {
    same(asked.sub_function === said.sub_function);
    const echoed = [0x00, 0x01, 0x03, 0x0a, 0x14].includes(asked.sub_function);
    return echoed ? echo(asked, said, request, response) : said;
  },
  '0F': startAndQuantity,
  10: startAndQuantity,
  14: (asked, said) => {
    same(said.records.length === asked.places.length);
    same(said.records.every((record, k) => record.split(' ').length === asked.places[k].length));
    return said;
  },
  15: echo,
  16: echo,
  17: registers((asked) => asked.read_quantity),
  '2B 0E': (asked, said) => {
    same(said.read_code === asked.read_code);
    return said;
  },
  '2B 0D': (asked, said) => {
    same(['write', 'dialect', 'node', 'index', 'sub_index', 'start'].every((name) => asked[name] === said[name]));
    same(asked.write || said.count <= asked.count);
    return said;
  },
};

function compare(code, asked, said, request, response) {
  return COMPARED[code] ? COMPARED[code](asked, said, request, response) : said;
}

export const KINDS = {
  exchange: {
    decode({ request, response }) {
      const message = understand(parseBytes(request), parseBytes(response));
      if ('exception_code' in message) return { exception_code: message.exception_code };
      return { message };
    },
  },
};
