// Read device identification 2B/0E: which objects a response has.

import { hex, parseBytes } from '../hex.mjs';

const LAST = { 1: 0x02, 2: 0x7f, 3: 0xff };
const INDIVIDUAL = 4;
const ROOM = 253 - 7; // a PDU without its header

/** The fields of the response; null: the object does not exist. Basic objects exist, if only empty. */
export function identify(given, code, first) {
  const all = { '00': '', '01': '', '02': '', ...given };
  const ids = Object.keys(all).map((id) => parseInt(id, 16)).sort((one, other) => one - other);
  const highest = ids.at(-1);
  const conformity = 0x80 | (highest >= 0x80 ? 3 : highest > 0x02 ? 2 : 1);
  const object = (id) => ({ id, value: all[hex(id, 2)] });
  const head = { read_code: code, conformity, more_follows: false, next_object: 0 };
  if (code === INDIVIDUAL) return ids.includes(first) ? { ...head, objects: [object(first)] } : null;

  const stream = ids.filter((id) => id <= LAST[code]);
  const from = stream.includes(first) ? stream.indexOf(first) : 0; // an unknown object: from the beginning
  const objects = [];
  let room = ROOM;
  for (const id of stream.slice(from)) {
    room -= 2 + parseBytes(all[hex(id, 2)]).length; // an object is never divided
    if (room < 0) return { ...head, more_follows: true, next_object: id, objects };
    objects.push(object(id));
  }
  return { ...head, objects };
}
