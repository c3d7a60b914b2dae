"use strict";
// modbus-serial as an adapter: its client on a port that only plays back, and its checksums.
//     barewire vectors check --adapter "node vectors/peers/modbus-serial/main.js"

const {EventEmitter} = require("node:events");
const ModbusRTU = require("modbus-serial");
const crc16 = require("modbus-serial/utils/crc16");
const lrc = require("modbus-serial/utils/lrc");
const {NotOffered, bits, bitted, crcFields, hexed, octets, serve, worded, words} = require("../shared/adapter.js");

/** A port: keeps what is written, and gives the reply. */
class Playback extends EventEmitter {
  constructor() {
    super();
    this.isOpen = true;
    this.sent = null;
    this.reply = null;
  }
  open(done) { done(null); }
  close(done) { done(null); }
  write(data) {
    this.sent = Buffer.from(data);
    if (this.reply) setImmediate(() => this.emit("data", framed(this.reply)));
  }
}

function framed(pdu) {
  const message = Buffer.concat([Buffer.from([1]), pdu]);
  const sum = Buffer.alloc(2);
  sum.writeUInt16LE(crc16(message));
  return Buffer.concat([message, sum]);
}

const port = new Playback();
const client = new ModbusRTU(port);
client.open(() => {});
client.setID(1);

/** Let the client make a request, and answer it. */
async function call(code, m, reply) {
  const calls = {
    1: () => client.readCoils(m.address, m.quantity),
    2: () => client.readDiscreteInputs(m.address, m.quantity),
    3: () => client.readHoldingRegisters(m.address, m.quantity),
    4: () => client.readInputRegisters(m.address, m.quantity),
    5: () => client.writeCoil(m.address, m.value),
    6: () => client.writeRegister(m.address, m.value),
    15: () => client.writeCoils(m.address, m.values),
    16: () => client.writeRegisters(m.address, m.values),
    0x16: () => client.maskWriteRegister(m.address, m.and_mask, m.or_mask),
    0x17: () => client.readWriteRegisters(m.read_address, m.read_quantity, m.write_address, m.values.length, m.values),
    0x2b: () => client.readDeviceIdentification(m.read_code, m.object_id),
  };
  port.sent = null;
  port.reply = reply;
  client.setTimeout(reply ? 1000 : 1);
  try {
    return {result: await calls[code](), sent: port.sent.subarray(1, -2)};
  } catch (error) {
    if (error.modbusCode !== undefined) return {code: error.modbusCode, sent: port.sent.subarray(1, -2)};
    if (reply || port.sent === null) throw error;
    return {sent: port.sent.subarray(1, -2)};
  }
}

const CODES = [1, 2, 3, 4, 5, 6, 15, 16, 0x16, 0x17, 0x2b];

async function encode({side, function: name, message}) {
  const code = octets(name)[0];
  if (side !== "request" || !CODES.includes(code) || name === "2B 0D") throw new NotOffered("the client has no call for this");
  const m = {...message};
  if ("bits" in m) m.values = bits(m.bits);
  if ("registers" in m) m.values = words(m.registers);
  return {pdu: hexed((await call(code, m, null)).sent)};
}

/** Return the arguments with which a client makes this request. */
function argumentsOf(pdu) {
  const at = (place) => pdu.readUInt16BE(place);
  const registers = (from) => Array.from({length: (pdu.length - from) / 2}, (_, k) => at(from + 2 * k));
  switch (pdu[0]) {
    case 1: case 2: case 3: case 4: return {address: at(1), quantity: at(3)};
    case 5: return {address: at(1), value: at(3) === 0xff00};
    case 6: return {address: at(1), value: at(3)};
    case 15: return {address: at(1), values: Array.from({length: at(3)}, (_, k) => Boolean((pdu[6 + (k >> 3)] >> (k & 7)) & 1))};
    case 16: return {address: at(1), values: registers(6)};
    case 0x16: return {address: at(1), and_mask: at(3), or_mask: at(5)};
    case 0x17: return {read_address: at(1), read_quantity: at(3), write_address: at(5), values: registers(10)};
  }
  throw new NotOffered("the client has no call for this");
}

async function exchange({request, response}) {
  const pdu = octets(request);
  const m = argumentsOf(pdu);
  const {result, code, sent} = await call(pdu[0], m, octets(response));
  if (code !== undefined) return {exception_code: code};
  if (!sent.equals(pdu)) throw new NotOffered(`the client sends ${hexed(sent)} instead`);
  if (pdu[0] <= 2) return {message: {bits: bitted(result.data.slice(0, m.quantity))}};
  if (pdu[0] <= 4 || pdu[0] === 0x17) return {message: {registers: worded(result.data)}};
  if (pdu[0] <= 6) return {message: {address: result.address, value: pdu[0] === 6 ? result.value : result.state}};
  if (pdu[0] === 0x16) return {message: {address: result.address, and_mask: result.andMask, or_mask: result.orMask}};
  return {message: {address: result.address, quantity: result.length}};
}

serve("modbus-serial", {
  pdu: {encode},
  exchange: {decode: exchange},
  crc16: {encode: ({bytes}) => crcFields(crc16(octets(bytes)))},
  lrc: {encode: ({bytes}) => ({lrc: hexed([lrc(octets(bytes))])})},
});
