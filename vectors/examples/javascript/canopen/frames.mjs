// Single frames of CANopen (CiA 301, CiA 305), and entries of the object dictionary that name identifiers and nodes.

import { fromLittle, hex, little, parseBytes, refuseUnless, showBytes } from '../hex.mjs';
import { bitsOf, numberBytes, numberText, timeOfDay } from '../numbers.mjs';

const nodeId = (node) => refuseUnless(node >= 1 && node <= 127, 'value', `node ${node}`);

/** The node of an identifier base + node; refuses other identifiers, extended ones among them. */
export function nodeOf(cobId, base) {
  const node = parseInt(cobId, 16) - base;
  refuseUnless(cobId.length === 3 && node >= 1 && node <= 127, 'mismatch', `identifier ${cobId}`);
  return node;
}

function identifier(cobId, expected) {
  refuseUnless(cobId === expected, 'mismatch', `identifier ${cobId}`);
}

function exactly(data, size) {
  const bytes = parseBytes(data);
  refuseUnless(bytes.length >= size, 'short');
  refuseUnless(bytes.length <= size, 'long');
  return bytes;
}

const SERVICES = { NMT: 0x000, SYNC: 0x080, TIME: 0x100, 'LSS answer': 0x7e4, 'LSS request': 0x7e5 };
const NODE_SERVICES = {
  EMCY: 0x080, TPDO1: 0x180, RPDO1: 0x200, TPDO2: 0x280, RPDO2: 0x300, TPDO3: 0x380, RPDO3: 0x400, TPDO4: 0x480,
  RPDO4: 0x500, 'SDO answer': 0x580, 'SDO request': 0x600, 'error control': 0x700,
};

const cobIds = {
  encode({ service, node }) {
    if (service in SERVICES) {
      refuseUnless(node === 0, 'value', `${service} has no node`);
      return { cob_id: hex(SERVICES[service], 3) };
    }
    refuseUnless(service in NODE_SERVICES, 'value', service);
    nodeId(node);
    return { cob_id: hex(NODE_SERVICES[service] + node, 3) };
  },
  decode({ cob_id: cobId }) {
    refuseUnless(cobId.length === 3, 'mismatch', 'an extended identifier');
    const number = parseInt(cobId, 16);
    for (const [service, only] of Object.entries(SERVICES)) if (number === only) return { service, node: 0 };
    for (const [service, base] of Object.entries(NODE_SERVICES)) {
      if (number > base && number <= base + 127) return { service, node: number - base };
    }
    return refuseUnless(false, 'mismatch', `nobody has ${cobId}`);
  },
};

const RESTRICTED = [[0, 0x7f], [0x101, 0x180], [0x581, 0x5ff], [0x601, 0x67f], [0x6e0, 0x6ff], [0x701, 0x7ff]];
export const isRestricted = (number) => RESTRICTED.some(([low, high]) => low <= number && number <= high);

const cobEntries = {
  encode({ identifier: text, extended, bit30, bit31 }) {
    const number = parseInt(text, 16);
    refuseUnless(number < (extended ? 2 ** 29 : 2 ** 11), 'value');
    return { value: hex(number + extended * 2 ** 29 + bit30 * 2 ** 30 + bit31 * 2 ** 31, 8) };
  },
  decode({ value }) {
    const number = parseInt(value, 16);
    const bit = (k) => Math.floor(number / 2 ** k) % 2 === 1;
    const extended = bit(29);
    const text = extended ? hex(number % 2 ** 29, 8) : hex(number % 2 ** 11, 3);
    return { identifier: text, extended, bit30: bit(30), bit31: bit(31) };
  },
};

const canText = {
  encode({ frame: { id, extended, remote, requested, data } }) {
    const bytes = parseBytes(data);
    refuseUnless(id.length === (extended ? 8 : 3), 'value');
    refuseUnless(parseInt(id, 16) < (extended ? 2 ** 29 : 2 ** 11), 'value');
    refuseUnless(bytes.length <= 8 && requested <= 8, 'value');
    return { text: `${id}#${remote ? `R${requested || ''}` : showBytes(bytes).replaceAll(' ', '')}` };
  },
  decode({ text }) {
    const [id, data, ...more] = text.split('#');
    refuseUnless(data !== undefined, 'delimiter');
    refuseUnless(more.length === 0, 'value', 'CAN FD');
    refuseUnless(id.length === 3 || id.length === 8, 'length', 'of the identifier');
    refuseUnless(/^[0-9A-Fa-f]*$/.test(id), 'character');
    const extended = id.length === 8;
    refuseUnless(parseInt(id, 16) < (extended ? 2 ** 29 : 2 ** 11), 'value', 'of the identifier');
    const common = { id: id.toUpperCase(), extended };
    const remote = /^R(\d*)$/.exec(data);
    if (remote) {
      refuseUnless(Number(remote[1]) <= 8, 'value', 'requested bytes');
      return { frame: { ...common, remote: true, requested: Number(remote[1]), data: '' } };
    }
    refuseUnless(data.length % 2 === 0, 'length', 'half a byte');
    refuseUnless(data.length <= 16, 'long');
    refuseUnless(/^[0-9A-Fa-f]*$/.test(data), 'character');
    return { frame: { ...common, remote: false, requested: 0, data: showBytes(parseBytes(data)) } };
  },
};

const COMMANDS = { start: 1, stop: 2, 'enter pre-operational': 0x80, 'reset node': 0x81, 'reset communication': 0x82 };

const nmt = {
  encode({ command, node }) {
    refuseUnless(command in COMMANDS && node >= 0 && node <= 127, 'value');
    return { cob_id: '000', data: showBytes([COMMANDS[command], node]) };
  },
  decode({ cob_id: cobId, data }) {
    identifier(cobId, '000');
    const [code, node] = exactly(data, 2);
    const found = Object.keys(COMMANDS).find((command) => COMMANDS[command] === code);
    refuseUnless(found, 'function', `command ${code}`);
    refuseUnless(node <= 127, 'value', `node ${node}`);
    return { command: found, node };
  },
};

const STATES = { '00': 'boot-up', '04': 'stopped', '05': 'operational', '7F': 'pre-operational' };

const nodeState = {
  encode({ node, state, toggle }) {
    nodeId(node);
    const number = parseInt(state, 16);
    refuseUnless(number <= 0x7f, 'value', `state ${state}`);
    return { cob_id: hex(0x700 + node, 3), data: hex(number | (toggle << 7), 2) };
  },
  decode({ cob_id: cobId, data }) {
    const node = nodeOf(cobId, 0x700);
    const [byte] = exactly(data, 1);
    const state = hex(byte & 0x7f, 2);
    return { node, state, toggle: byte > 0x7f, name: STATES[state] ?? null };
  },
};

const heartbeatConsumer = {
  encode({ node, milliseconds }) {
    refuseUnless(node >= 1 && node <= 127 && milliseconds >= 0 && milliseconds <= 0xffff, 'value');
    const value = node * 2 ** 16 + milliseconds;
    return { value: String(value), bytes: showBytes(little(value, 4)) };
  },
  decode({ bytes }) {
    const [low, high, node] = exactly(bytes, 4);
    const milliseconds = low + high * 256;
    if (node === 0 || node > 127 || milliseconds === 0) return { node: null, milliseconds: null };
    return { node, milliseconds };
  },
};

const emcy = {
  encode({ node, code, register, info }) {
    nodeId(node);
    const number = parseInt(code, 16);
    const bytes = parseBytes(info);
    refuseUnless(number <= 0xffff && parseInt(register, 16) <= 0xff && bytes.length === 5, 'value');
    return { cob_id: hex(0x80 + node, 3), data: showBytes([...little(number, 2), parseInt(register, 16), ...bytes]) };
  },
  decode({ cob_id: cobId, data }) {
    const node = nodeOf(cobId, 0x80);
    const bytes = parseBytes(data);
    refuseUnless(bytes.length >= 8, 'short');
    const code = hex(fromLittle(bytes.slice(0, 2)), 4);
    return { node, code, register: hex(bytes[2], 2), info: showBytes(bytes.slice(3, 8)) };
  },
};

const sync = {
  encode({ counter }) {
    refuseUnless(counter === null || (counter >= 1 && counter <= 240), 'value');
    return { cob_id: '080', data: counter === null ? '' : hex(counter, 2) };
  },
  decode({ cob_id: cobId, data }) {
    identifier(cobId, '080');
    const bytes = parseBytes(data);
    refuseUnless(bytes.length <= 1, 'long');
    const counter = bytes[0] ?? null;
    refuseUnless(counter === null || (counter >= 1 && counter <= 240), 'value');
    return { counter };
  },
};

const time = {
  encode: (fields) => ({ cob_id: '100', data: showBytes(timeOfDay.encode(fields)) }),
  decode({ cob_id: cobId, data }) {
    identifier(cobId, '100');
    return timeOfDay.decode(parseBytes(data));
  },
};

const LSS = { '7E5': 'request', '7E4': 'answer' };
const LSS_SERVICES = {
  request: [0x04, 0x11, 0x13, 0x15, 0x17, 0x40, 0x41, 0x42, 0x43, 0x46, 0x47, 0x48, 0x49, 0x4a, 0x4b, 0x4c, 0x51, 0x5a, 0x5b, 0x5c, 0x5d, 0x5e],
  answer: [0x11, 0x13, 0x17, 0x44, 0x4f, 0x50, 0x5a, 0x5b, 0x5c, 0x5d, 0x5e],
};

const lss = {
  encode({ side, service, body }) {
    const bytes = parseBytes(body);
    refuseUnless(bytes.length === 7 && LSS_SERVICES[side].includes(parseInt(service, 16)), 'value');
    return { cob_id: side === 'request' ? '7E5' : '7E4', data: showBytes([parseInt(service, 16), ...bytes]) };
  },
  decode({ cob_id: cobId, data }) {
    refuseUnless(cobId in LSS, 'mismatch', `identifier ${cobId}`);
    const bytes = parseBytes(data);
    refuseUnless(bytes.length >= 8, 'short');
    refuseUnless(LSS_SERVICES[LSS[cobId]].includes(bytes[0]), 'function', `service ${hex(bytes[0], 2)}`);
    return { side: LSS[cobId], service: hex(bytes[0], 2), body: showBytes(bytes.slice(1)) };
  },
};

const mpdo = {
  encode({ addressing, node, index, sub, data }) {
    const bytes = parseBytes(data);
    refuseUnless(bytes.length <= 4, 'value');
    refuseUnless(node >= (addressing === 'SAM' ? 1 : 0) && node <= 127, 'value', `node ${node}`);
    const head = [node | (addressing === 'DAM' ? 0x80 : 0), ...little(parseInt(index, 16), 2), parseInt(sub, 16)];
    return { bytes: showBytes([...head, ...bytes, 0, 0, 0, 0].slice(0, 8)) };
  },
  decode({ bytes: text }) {
    const bytes = parseBytes(text);
    refuseUnless(bytes.length === 8, 'length');
    const addressing = bytes[0] & 0x80 ? 'DAM' : 'SAM';
    const node = bytes[0] & 0x7f;
    refuseUnless(addressing === 'DAM' || node !== 0, 'value', 'node 0');
    const index = hex(fromLittle(bytes.slice(1, 3)), 4);
    return { addressing, node, index, sub: hex(bytes[3], 2), data: showBytes(bytes.slice(4)) };
  },
};

// ----------------------------------------------------------------------------------------------------------------- PDO

/** The value of a mapped object as bits. An entry may have fewer bits than its integer type, not more. */
function pack({ bits, type, value }) {
  if (type === null) return 0n;
  if (type === 'bool') return bitsOf(false, 1, value);
  const whole = Number(type.slice(1));
  refuseUnless(type[0] === 'f' ? bits === whole : bits <= whole, 'value', `${type} in ${bits} bits`);
  if (type[0] !== 'f') return bitsOf(type[0] === 'i', bits, value);
  return BigInt(`0x${showBytes(numberBytes(type, value)).replaceAll(' ', '')}`);
}

function unpack({ bits, type }, number) {
  if (type === null) return null;
  if (type[0] === 'f') return numberText(type, parseBytes(hex(number, bits / 4)));
  return (type[0] === 'i' ? BigInt.asIntN(bits, number) : number).toString();
}

/** Bits, type and value of each mapped object, and the bytes of all. */
function mapped(entries) {
  const row = entries.map(({ entry, type, value }) => ({ bits: parseInt(entry.slice(6), 16), type, value }));
  const total = row.reduce((sum, { bits }) => sum + bits, 0);
  refuseUnless(total <= 64 && row.every(({ bits }) => bits > 0), 'value', `${total} bits`);
  return { row, size: Math.ceil(total / 8) };
}

const pdo = {
  encode({ entries }) {
    const { row, size } = mapped(entries);
    let packed = 0n;
    let at = 0n;
    for (const one of row) {
      packed |= pack(one) << at;
      at += BigInt(one.bits);
    }
    return { data: size ? showBytes(parseBytes(hex(packed, 2 * size)).reverse()) : '' };
  },
  decode({ entries, data }) {
    const { row, size } = mapped(entries);
    const bytes = exactly(data, size);
    let packed = BigInt(`0x0${[...bytes].reverse().map((byte) => hex(byte, 2)).join('')}`);
    const found = row.map((one) => {
      const number = BigInt.asUintN(one.bits, packed);
      packed >>= BigInt(one.bits);
      return { value: unpack(one, number) };
    });
    return { entries: found };
  },
};

export const KINDS = {
  'cob-id': cobIds,
  'cob-restricted': {
    decode: ({ cob_id: cobId }) => ({ restricted: isRestricted(parseInt(cobId, 16)) }),
  },
  'cob-entry': cobEntries,
  'can-text': canText,
  nmt,
  'node-state': nodeState,
  'heartbeat-consumer': heartbeatConsumer,
  emcy,
  sync,
  time,
  lss,
  mpdo,
  pdo,
};
