"use strict";
// modbus-pdu as an adapter: its messages.    barewire vectors check --adapter "node vectors/peers/modbus-pdu/main.js"

const modbus = require("modbus-pdu");
const {NotOffered, bits, bitted, hexed, octets, serve, worded, words} = require("../shared/adapter.js");

const blocks = (text) => words(text).map((word) => Buffer.from([word >> 8, word & 0xff]));
const values = (list) => worded(list.map((block) => block.readUInt16BE(0)));
const CLASSES = Object.fromEntries(
  Object.values(modbus).filter((one) => typeof one === "object" && "Code" in one).map((one) => [one.Code, one]),
);
const NAMES = ["VendorName", "ProductCode", "MajorMinorRevision", "VendorUrl", "ProductName", "ModelName", "UserApplicationName"];
const READ = ["", "BasicDeviceIdentification", "RegularDeviceIdentification", "ExtendedDeviceIdentification", "SpecificIdentificationObject"];
const numbered = (names, value) => (typeof value === "string" ? names.indexOf(value) : value);

function classOf(code, pdu) {
  if (!(code in CLASSES) || (code === 0x2b && pdu !== undefined && pdu[1] !== 0x0e)) throw new NotOffered("no such function");
  return CLASSES[code];
}

/** Return the arguments of `build` for a message, without the function code. */
function argumentsOf(code, side, m) {
  const request = side === "request";
  switch (code) {
    case 1: case 2: return request ? [m.address, m.quantity] : [bits(m.bits)];
    case 3: case 4: return request ? [m.address, m.quantity] : [blocks(m.registers)];
    case 5: return [m.address, m.value];
    case 6: return [m.address, Buffer.from([m.value >> 8, m.value & 0xff])];
    case 0x07: return request ? [] : [m.status];
    case 0x0b: return request ? [] : [m.status, m.event_count];
    case 0x0c: return request ? [] : [m.status, m.event_count, m.message_count, octets(m.events)];
    case 0x0f: return request ? [m.address, bits(m.bits)] : [m.address, m.quantity];
    case 0x10: return request ? [m.address, blocks(m.registers)] : [m.address, m.quantity];
    case 0x14:
      return request
        ? [m.places.map((one) => ({file: one.file, address: one.record, length: one.length}))]
        : [m.records.map(blocks)];
    case 0x15: return [m.records.map((one) => ({file: one.file, address: one.record, values: blocks(one.registers)}))];
    case 0x16: return [m.address, m.and_mask, m.or_mask];
    case 0x17:
      return request ? [m.read_address, m.read_quantity, m.write_address, blocks(m.registers)] : [blocks(m.registers)];
    case 0x18: return request ? [m.address] : [blocks(m.registers)];
    case 0x2b: {
      if (request) return [m.read_code, m.object_id];
      const objects = m.objects.map((one) => ({id: one.id, value: octets(one.value)}));
      return [m.read_code, m.conformity, m.more_follows, objects];
    }
  }
}

/** Return the message of what `parse` found. */
function messageOf(code, side, found) {
  const request = side === "request";
  switch (code) {
    case 1: case 2: return request ? {address: found.address, quantity: found.quantity} : {bits: bitted(found)};
    case 3: case 4: return request ? {address: found.address, quantity: found.quantity} : {registers: values(found)};
    case 5: return {address: found.address, value: found.value === 1};
    case 6: return {address: found.address, value: found.value.readUInt16BE(0)};
    case 0x07: return request ? {} : {status: found.data};
    case 0x0b: return request ? {} : {status: found.status, event_count: found.event_count};
    case 0x0c:
      if (request) return {};
      return {
        status: found.status, event_count: found.event_count, message_count: found.message_count, events: hexed(found.events),
      };
    case 0x0f:
      return request
        ? {address: found.address, bits: bitted(found.values.slice(0, found.quantity))}
        : {address: found.address, quantity: found.quantity};
    case 0x10:
      return request
        ? {address: found.address, registers: values(found.values)}
        : {address: found.address, quantity: found.quantity};
    case 0x14:
      return request
        ? {places: found.map((one) => ({file: one.file, record: one.address, length: one.length}))}
        : {records: found.map(values)};
    case 0x15:
      return {records: found.map((one) => ({file: one.file, record: one.address, registers: values(one.values)}))};
    case 0x16:
      return {address: found.address, and_mask: found.andmask.readUInt16BE(0), or_mask: found.ormask.readUInt16BE(0)};
    case 0x17: {
      const {read_address, read_quantity, write_address} = found;
      return request
        ? {read_address, read_quantity, write_address, registers: values(found.values)}
        : {registers: values(found.values)};
    }
    case 0x18: return request ? {address: found.address} : {registers: values(found)};
    case 0x2b:
      if (request) return {read_code: numbered(READ, found.type), object_id: numbered(NAMES, found.id)};
      return {
        read_code: numbered(READ, found.type), conformity: numbered(READ, found.conformity),
        more_follows: found.more, next_object: found.next,
        objects: found.objects.map((one) => ({id: numbered(NAMES, one.id), value: hexed(one.value)})),
      };
  }
}

function encode({side, function: name, message}) {
  const code = octets(name)[0];
  if (code >= 0x80) {
    if (!("exception_code" in message)) throw new NotOffered("no extended exceptions");
    return {pdu: hexed(modbus.Exception.build(code & 0x7f, message.exception_code))};
  }
  const kind = classOf(code, octets(name).length > 1 ? octets(name) : undefined);
  const half = side === "request" ? kind.Request : kind.Response;
  return {pdu: hexed(half.build(...argumentsOf(code, side, message)))};
}

function decode({side, pdu: text}) {
  const pdu = octets(text);
  if (!pdu.length || pdu[0] >= 0x80) throw new NotOffered("exceptions are shown by name");
  const kind = classOf(pdu[0], pdu);
  const found = (side === "request" ? kind.Request : kind.Response).parse(pdu);
  if (found === null) return null;
  return {function: hexed(pdu.subarray(0, pdu[0] === 0x2b ? 2 : 1)), message: messageOf(pdu[0], side, found)};
}

serve("modbus-pdu", {pdu: {encode, decode}});
