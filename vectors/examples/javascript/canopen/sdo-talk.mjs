// Whole SDO transfers: a client or a server, asked in steps.

import { parseBytes, showBytes } from '../hex.mjs';
import { place } from './sdo.mjs';
import { SdoClient } from './sdo-client.mjs';
import { Abort, SdoServer } from './sdo-server.mjs';

/** The dictionary of these cases: the object 2100h:00, whatever its length. */
class OneObject {
  constructor(value) {
    Object.assign(this, { value, arrived: null });
  }

  mayWrite(index, sub) {
    if (index !== 0x2100) throw new Abort('06020000');
    if (sub !== 0) throw new Abort('06090011');
  }

  read(index, sub) {
    this.mayWrite(index, sub);
    return this.value;
  }

  write(index, sub, bytes) {
    this.mayWrite(index, sub);
    this.arrived = bytes;
  }
}

/** Each step: what is heard, one frame after the other; if nothing is said to it, time passes. */
function run(side, talk, started = []) {
  return talk.map(({ hear }, step) => {
    const said = step === 0 ? [...started] : [];
    for (const frame of hear) said.push(...side.hear(parseBytes(frame)));
    if (said.length === 0) said.push(...side.wait());
    return { say: said.map(showBytes) };
  });
}

const shown = (bytes) => (bytes === null ? null : showBytes(bytes));

export const KINDS = {
  'sdo-talk': {
    client(question) {
      const client = new SdoClient({ ...question, place: place(question), value: parseBytes(question.value ?? '') });
      const talk = run(client, question.talk, client.start());
      return { talk, ends: client.ends, arrived: shown(client.arrived) };
    },
    server({ value = '', blksize = 127, talk }) {
      const object = new OneObject(parseBytes(value));
      return { talk: run(new SdoServer(object, blksize), talk), arrived: shown(object.arrived) };
    },
  },
};
