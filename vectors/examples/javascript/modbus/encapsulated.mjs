// Function 2B: device identification (0E) and the access to a CANopen dictionary (0D) with its long exception (AB FF).

import { big, fromBig, hex, parseBytes, refuseUnless, showBytes } from '../hex.mjs';

const byte = (number, what) => {
  refuseUnless(number >= 0 && number <= 0xff, 'value', `${what} ${number}`);
  return number;
};

function checkCode(code) {
  refuseUnless(code >= 1 && code <= 4, 'value', `read code ${code}`);
}

const identificationRequest = {
  write(message) {
    checkCode(message.read_code);
    return [message.read_code, byte(message.object_id, 'object')];
  },
  read(reader) {
    const message = { read_code: reader.u8(), object_id: reader.u8() };
    reader.end();
    checkCode(message.read_code);
    return message;
  },
};

function checkIdentification(message) {
  checkCode(message.read_code);
  refuseUnless([1, 2, 3, 0x81, 0x82, 0x83].includes(message.conformity), 'value', `conformity ${message.conformity}`);
}

const identificationResponse = {
  write(message) {
    checkIdentification(message);
    const objects = message.objects.flatMap(({ id, value }) => {
      const data = parseBytes(value);
      return [byte(id, 'object'), byte(data.length, 'length'), ...data];
    });
    const head = [message.read_code, message.conformity, message.more_follows ? 0xff : 0];
    return [...head, byte(message.next_object_id ?? message.next_object, 'object'), message.objects.length, ...objects];
  },
  read(reader) {
    const message = { read_code: reader.u8(), conformity: reader.u8() };
    const more = reader.u8();
    const next = reader.u8();
    const number = reader.u8();
    const objects = [];
    for (let k = 0; k < number; k += 1) {
      const id = reader.u8();
      const length = reader.u8();
      objects.push({ id, value: showBytes(reader.take(length)) });
    }
    reader.end();
    checkIdentification(message);
    refuseUnless(more === 0 || more === 0xff, 'value', `more follows ${more}`);
    return { ...message, more_follows: more === 0xff, next_object: next, objects };
  },
};

const WRITE = 1;

/** Data are there in a write request and in a read response; `count` is their number, or how many are asked for. */
function reference(side) {
  const hasData = (write) => write === (side === 'request');
  return {
    write(message) {
      const data = parseBytes(message.data);
      refuseUnless(message.node >= 1 && message.node <= 127, 'value', `node ${message.node}`);
      refuseUnless(data.length === (hasData(message.write) ? message.count : 0), 'value', 'data and count');
      const head = [message.write ? WRITE : 0, ...(message.dialect === 'cia309' ? [0] : []), message.node];
      const place = [...parseBytes(message.index), byte(message.sub_index, 'sub-index')];
      return [...head, ...place, ...big(message.start, 2), ...big(message.count, 2), ...data];
    },
    read(reader) {
      const control = reader.u8();
      let node = reader.u8();
      const dialect = node === 0 ? 'cia309' : 'schneider'; // no node is number 0
      if (node === 0) node = reader.u8();
      const message = { dialect, write: control === WRITE, node, index: hex(reader.u16(), 4), sub_index: reader.u8() };
      Object.assign(message, { start: reader.u16(), count: reader.u16() });
      const data = reader.counted(hasData(message.write) ? message.count : 0);
      refuseUnless(control <= WRITE && node >= 1 && node <= 127, 'value', `control ${control}, node ${node}`);
      return { ...message, data: showBytes(data) };
    },
  };
}

const longException = {
  write: ({ abort_code: code }) => [0, 6, 0x0d, 0xec, ...parseBytes(code)],
  read(reader) {
    const head = reader.take(4);
    const code = reader.take(4);
    reader.end();
    refuseUnless(showBytes(head) === '00 06 0D EC', 'value', 'not six bytes, 0D EC and a code');
    return { abort_code: hex(fromBig(code), 8) };
  },
};

export const encapsulated = {
  '2B 0E': { request: identificationRequest, response: identificationResponse },
  '2B 0D': { request: reference('request'), response: reference('response') },
  'AB FF': { response: longException },
};
