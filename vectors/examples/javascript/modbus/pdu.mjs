// Modbus messages: function code and data, to the fields of a message and back (MODBUS Application Protocol V1.1b3, 6).
//
// MESSAGES has for each function and side the two halves: write(message) -> the bytes behind the function code, and
// read(reader) -> the message. A reader refuses what is missing (short), left over (long) or contradicts its count (length).

import { big, hex, packBits, parseBits, parseBytes, parseRegisters, refuseUnless } from '../hex.mjs';
import { fromRegisters, showBits, showBytes, showRegisters, toRegisters, unpackBits } from '../hex.mjs';
import { encapsulated } from './encapsulated.mjs';
import { files } from './files.mjs';
import { Reader } from '../reader.mjs';

const within = (number, low, high, what) => refuseUnless(number >= low && number <= high, 'value', `${what} ${number}`);
const word = (number, what) => {
  refuseUnless(Number.isInteger(number), 'value', what);
  within(number, 0, 0xffff, what);
  return big(number, 2);
};

/** A message of named fields of two bytes each; `check` looks at their values. */
function words(names, check = () => {}) {
  return {
    write(message) {
      const data = names.flatMap((name) => word(message[name], name));
      check(message);
      return data;
    },
    read(reader) {
      const message = {};
      for (const name of names) message[name] = reader.u16();
      reader.end();
      check(message);
      return message;
    },
  };
}

const nothing = words([]);
const quantity = (highest) => words(['address', 'quantity'], (message) => within(message.quantity, 1, highest, 'quantity'));

const readBits = {
  request: quantity(2000),
  response: {
    write(message) {
      const bits = parseBits(message.bits);
      within(bits.length, 1, 2000, 'bits');
      const data = packBits(bits);
      return [data.length, ...data];
    },
    read(reader) {
      const data = reader.counted(reader.u8());
      within(data.length, 1, 250, 'byte count');
      return { bits: showBits(unpackBits(data, data.length * 8)) };
    },
  },
};

const registersResponse = {
  write(message) {
    const registers = parseRegisters(message.registers);
    within(registers.length, 1, 125, 'registers');
    return [registers.length * 2, ...fromRegisters(registers)];
  },
  read(reader) {
    const data = reader.counted(reader.u8());
    refuseUnless(data.length % 2 === 0, 'length', 'half a register');
    within(data.length, 2, 250, 'byte count');
    return { registers: showRegisters(toRegisters(data)) };
  },
};

const readRegisters = { request: quantity(125), response: registersResponse };
const both = (half) => ({ request: half, response: half });

const writeCoil = {
  write(message) {
    return [...word(message.address, 'address'), message.value ? 0xff : 0, 0];
  },
  read(reader) {
    const { address, value } = words(['address', 'value']).read(reader);
    refuseUnless(value === 0 || value === 0xff00, 'value', 'neither 0000 nor FF00');
    return { address, value: value === 0xff00 };
  },
};

const diagnostics = {
  write(message) {
    const data = parseBytes(message.data);
    refuseUnless(message.sub_function === 0 || data.length === 2, 'value', 'not two bytes of data');
    return [...word(message.sub_function, 'sub_function'), ...data];
  },
  read(reader) {
    const sub = reader.u16();
    const data = reader.rest();
    refuseUnless(sub === 0 || data.length === 2, 'value', 'not two bytes of data');
    return { sub_function: sub, data: showBytes(data) };
  },
};

const eventLog = {
  write(message) {
    const events = parseBytes(message.events);
    within(events.length, 0, 64, 'events');
    const counters = ['status', 'event_count', 'message_count'].flatMap((name) => word(message[name], name));
    return [6 + events.length, ...counters, ...events];
  },
  read(reader) {
    const inside = new Reader(reader.counted(reader.u8()));
    const message = { status: inside.u16(), event_count: inside.u16(), message_count: inside.u16() };
    within(inside.left, 0, 64, 'events');
    return { ...message, events: showBytes(inside.rest()) };
  },
};

const writeCoils = {
  request: {
    write(message) {
      const bits = parseBits(message.bits);
      within(bits.length, 1, 1968, 'bits');
      const data = packBits(bits);
      return [...word(message.address, 'address'), ...big(bits.length, 2), data.length, ...data];
    },
    read(reader) {
      const [address, count] = [reader.u16(), reader.u16()];
      const data = reader.counted(reader.u8());
      within(count, 1, 1968, 'quantity');
      refuseUnless(data.length === Math.ceil(count / 8), 'length', 'byte count and quantity');
      return { address, bits: showBits(unpackBits(data, count)) };
    },
  },
  response: quantity(1968),
};

/** Fields of two bytes, then a quantity, a byte count and so many registers. */
function writeRegisters(names, highest, check = () => {}) {
  return {
    write(message) {
      const registers = parseRegisters(message.registers);
      within(registers.length, 1, highest, 'registers');
      check(message);
      const head = names.flatMap((name) => word(message[name], name));
      return [...head, ...big(registers.length, 2), registers.length * 2, ...fromRegisters(registers)];
    },
    read(reader) {
      const message = {};
      for (const name of names) message[name] = reader.u16();
      const count = reader.u16();
      const data = reader.counted(reader.u8());
      check(message);
      within(count, 1, highest, 'quantity');
      refuseUnless(data.length === 2 * count, 'length', 'byte count and quantity');
      return { ...message, registers: showRegisters(toRegisters(data)) };
    },
  };
}

const serverId = {
  write(message) {
    const data = parseBytes(message.data);
    within(data.length, 0, 251, 'bytes of data');
    return [data.length, ...data];
  },
  read: (reader) => ({ data: showBytes(reader.counted(reader.u8())) }),
};

const queue = {
  write(message) {
    const registers = parseRegisters(message.registers);
    within(registers.length, 0, 31, 'registers');
    return [...big(2 + 2 * registers.length, 2), ...big(registers.length, 2), ...fromRegisters(registers)];
  },
  read(reader) {
    const [bytes, count] = [reader.u16(), reader.u16()];
    const data = reader.counted(bytes - 2);
    within(count, 0, 31, 'FIFO count');
    refuseUnless(data.length === 2 * count, 'length', 'byte count and FIFO count');
    return { registers: showRegisters(toRegisters(data)) };
  },
};

const exceptionStatus = {
  write({ status }) {
    within(status, 0, 255, 'status');
    return [status];
  },
  read(reader) {
    const status = reader.u8();
    reader.end();
    return { status };
  },
};

export const MESSAGES = {
  '01': readBits,
  '02': readBits,
  '03': readRegisters,
  '04': readRegisters,
  '05': both(writeCoil),
  '06': both(words(['address', 'value'])),
  '07': { request: nothing, response: exceptionStatus },
  '08': both(diagnostics),
  '0B': { request: nothing, response: words(['status', 'event_count']) },
  '0C': { request: nothing, response: eventLog },
  '0F': writeCoils,
  10: { request: writeRegisters(['address'], 123), response: quantity(123) },
  11: { request: nothing, response: serverId },
  ...files,
  16: both(words(['address', 'and_mask', 'or_mask'])),
  17: {
    request: writeRegisters(['read_address', 'read_quantity', 'write_address'], 121, (message) =>
      within(message.read_quantity, 1, 125, 'quantity to read'),
    ),
    response: registersResponse,
  },
  18: { request: words(['address']), response: queue },
  ...encapsulated,
};

const exception = {
  write(message) {
    within(message.exception_code, 0, 255, 'exception code');
    return [message.exception_code];
  },
  read(reader) {
    const code = reader.u8();
    reader.end();
    return { exception_code: code };
  },
};

export function encodePdu(side, code, message) {
  if ('exception_code' in message) {
    refuseUnless(side === 'response', 'value', 'a request is not an exception');
    within(message.function_code, 0x81, 0xff, 'function');
    return [message.function_code, ...exception.write(message)];
  }
  refuseUnless(code in MESSAGES && MESSAGES[code][side], 'value', `function ${code}`);
  const pdu = [...parseBytes(code), ...MESSAGES[code][side].write(message)];
  refuseUnless(pdu.length <= 253, 'value', `${pdu.length} bytes`);
  return pdu;
}

/** The function of a PDU, with the second byte of 2B and of AB FF. */
export function functionOf(pdu) {
  const two = pdu[0] === 0x2b || (pdu[0] === 0xab && pdu[1] === 0xff);
  return showBytes(pdu.slice(0, two ? 2 : 1));
}

export function decodePdu(side, pdu) {
  refuseUnless(pdu.length > 0, 'short');
  const code = functionOf(pdu);
  const reader = new Reader(pdu.slice(code.length > 2 ? 2 : 1));
  if (side === 'response' && pdu[0] > 0x80 && code.length === 2) {
    return { function: code, message: { function_code: pdu[0], ...exception.read(reader) } };
  }
  refuseUnless(code in MESSAGES && MESSAGES[code][side], 'function', `function ${code}`);
  return { function: code, message: MESSAGES[code][side].read(reader) };
}

export const KINDS = {
  pdu: {
    encode({ side, function: code, message }) {
      return { pdu: showBytes(encodePdu(side, code ?? hex(message.function_code, 2), message)) };
    },
    decode: ({ side, pdu }) => decodePdu(side, parseBytes(pdu)),
  },
};
