"use strict";
// jsmodbus as an adapter: its messages, its RTU and TCP frames.    barewire vectors check --adapter "node vectors/peers/jsmodbus/main.js"

const jsmodbus = require("jsmodbus");
const {NotOffered, bits, bitted, hexed, octets, serve, worded, words} = require("../shared/adapter.js");

const {requests: q, responses: r} = jsmodbus;
const REQUESTS = {
  1: q.ReadCoilsRequestBody, 2: q.ReadDiscreteInputsRequestBody, 3: q.ReadHoldingRegistersRequestBody,
  4: q.ReadInputRegistersRequestBody, 5: q.WriteSingleCoilRequestBody, 6: q.WriteSingleRegisterRequestBody,
  15: q.WriteMultipleCoilsRequestBody, 16: q.WriteMultipleRegistersRequestBody, 0x2b: q.ReadDeviceIdentificationRequestBody,
};
const RESPONSES = {
  1: r.ReadCoilsResponseBody, 2: r.ReadDiscreteInputsResponseBody, 3: r.ReadHoldingRegistersResponseBody,
  4: r.ReadInputRegistersResponseBody, 5: r.WriteSingleCoilResponseBody, 6: r.WriteSingleRegisterResponseBody,
  15: r.WriteMultipleCoilsResponseBody, 16: r.WriteMultipleRegistersResponseBody, 0x2b: r.ReadDeviceIdentificationResponseBody,
};
const registerBytes = (text) => octets(text);
const registersOf = (data) => (data.toString("hex").toUpperCase().match(/.{1,4}/g) || []).join(" ");

function classOf(side, code, pdu) {
  const found = (side === "request" ? REQUESTS : RESPONSES)[code];
  if (found === undefined || (code === 0x2b && pdu[1] !== 0x0e)) throw new NotOffered("no such function");
  return found;
}

function encode({side, function: name, message: m}) {
  const code = octets(name)[0];
  if (code >= 0x80) {
    if (side === "request" || !("exception_code" in m)) throw new NotOffered("no extended exceptions");
    return {pdu: hexed(new r.ExceptionResponseBody(code & 0x7f, m.exception_code).createPayload())};
  }
  const Body = classOf(side, code, octets(name));
  let body;
  if (code === 0x2b) {
    if (side !== "request") throw new NotOffered("the adapter makes no device identification");
    body = new Body(m.read_code, m.object_id);
  } else if (side === "request") {
    if (code <= 4) body = new Body(m.address, m.quantity);
    else if (code <= 6) body = new Body(m.address, m.value);
    else body = new Body(m.address, code === 15 ? bits(m.bits) : registerBytes(m.registers));
  } else if (code <= 2) {
    const packed = bits(m.bits);
    body = new Body(packed, Math.ceil(packed.length / 8)); // as its own fromRequest does
  } else if (code <= 4) {
    const data = registerBytes(m.registers);
    body = new Body(data.length, data);
  } else body = new Body(m.address, code <= 6 ? m.value : m.quantity);
  return {pdu: hexed(body.createPayload())};
}

function decode({side, pdu: text}) {
  const pdu = octets(text);
  if (!pdu.length) throw new NotOffered("the class is chosen by the first byte");
  if (side === "response" && pdu[0] >= 0x80) {
    if (pdu[0] === 0xab && pdu[1] === 0xff) throw new NotOffered("no extended exceptions");
    const found = r.ExceptionResponseBody.fromBuffer(pdu);
    return found && {function: hexed(pdu.subarray(0, 1)), message: {function_code: pdu[0], exception_code: found.code}};
  }
  const found = classOf(side, pdu[0], pdu).fromBuffer(pdu);
  return found && {function: hexed(pdu.subarray(0, pdu[0] === 0x2b ? 2 : 1)), message: messageOf(side, pdu[0], found)};
}

function messageOf(side, code, found) {
  const request = side === "request";
  if (code <= 4 && request) return {address: found.start, quantity: found.count};
  if (code <= 2) return {bits: bitted([...found.valuesAsArray])};
  if (code <= 4) return {registers: registersOf(found.valuesAsBuffer)};
  if (code === 5) return {address: found.address, value: found.value === true || found.value === 0xff00};
  if (code === 6) return {address: found.address, value: found.value};
  if (code === 15 && request) return {address: found.address, bits: bitted([...found.valuesAsArray])};
  if (code === 16 && request) return {address: found.address, registers: registersOf(found.valuesAsBuffer)};
  if (code !== 0x2b) return {address: found.start, quantity: found.quantity};
  if (request) return {read_code: found.readDeviceIdCode, object_id: found.objectId};
  const objects = found.objects.map((one) => ({id: one.id, value: hexed(Buffer.from(one.value))}));
  const {readDeviceIdCode, conformityLevel, moreFollows, nextObjectId} = found;
  return {
    read_code: readDeviceIdCode, conformity: conformityLevel, more_follows: moreFollows === 0xff, next_object: nextObjectId, objects,
  };
}

/** Return a body that gives these bytes: a frame holds any message. */
const raw = (pdu) => ({createPayload: () => pdu, byteCount: pdu.length});

function encodeRtu({unit, pdu}) {
  return {frame: hexed(new jsmodbus.ModbusRTURequest(unit, raw(octets(pdu))).createPayload())};
}

function encodeTcp({transaction, unit, pdu}) {
  const body = raw(octets(pdu));
  return {frame: hexed(new jsmodbus.ModbusTCPRequest(transaction, 0, 1 + body.byteCount, unit, body).createPayload())};
}

serve("jsmodbus", {pdu: {encode, decode}, "rtu-frame": {encode: encodeRtu}, "tcp-frame": {encode: encodeTcp}});
