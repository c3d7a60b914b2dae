// Services of an LSS master (CiA 305). A service is a generator: it yields a request and the service of its answer, and
// is given the bytes of that answer, or null after a time-out.

import { eight, fromLittle, hex, little, parseBytes, showBytes } from '../hex.mjs';

const SELECTED = 0x44;
const IDENTIFIED = 0x4f;
const UNCONFIGURED = 0x50;
const NO_NODE = 0xff;
const BEGIN = 0x80;

const four = (text) => little(parseInt(text, 16), 4);
const number = (bytes) => hex(fromLittle(bytes.slice(1, 5)), 8);

/** Requests of several frames: only the last one is answered. */
function* frames(first, numbers, answer) {
  for (const [k, text] of numbers.entries()) {
    const last = k === numbers.length - 1;
    const heard = yield [[first + k, ...four(text)], last ? answer : null];
    if (last) return heard;
  }
}

function* configure(request) {
  const answer = yield [request, request[0]];
  if (!answer) return { no_answer: true };
  return answer[1] === 0 ? { done: true } : { error: answer[1], detail: answer[2] };
}

function* command(request) {
  yield [request, null];
  return { done: true };
}

/** One bit after the other, the highest first: silence says that it is 1. */
function* scan(part, known) {
  let found = known === null ? 0 : parseInt(known, 16);
  for (let bit = 31; known === null && bit >= 0; bit -= 1) {
    const answer = yield [[0x51, ...little(found, 4), bit, part, part], IDENTIFIED];
    if (!answer) found += 2 ** bit;
  }
  const confirmed = yield [[0x51, ...little(found, 4), 0, part, (part + 1) % 4], IDENTIFIED];
  return confirmed ? hex(found, 8) : null;
}

const SERVICES = {
  'switch global': ({ mode }) => command([0x04, mode]),
  'activate bit rate': ({ delay }) => command([0x15, ...little(delay, 2)]),
  'configure node': ({ node }) => configure([0x11, node ?? NO_NODE]),
  'configure bit rate': ({ table, entry }) => configure([0x13, table, entry]),
  store: () => configure([0x17]),
  *'switch selective'({ address }) {
    return { found: (yield* frames(0x40, address, SELECTED)) !== null };
  },
  *identify({ limits }) {
    return { count: (yield* frames(0x46, limits, IDENTIFIED)) ? 1 : 0 };
  },
  *'identify unconfigured'() {
    return { count: (yield [[0x4c], UNCONFIGURED]) ? 1 : 0 };
  },
  *'inquire address'() {
    const address = [];
    for (let service = 0x5a; service <= 0x5d; service += 1) {
      const answer = yield [[service], service];
      if (!answer) return { no_answer: true };
      address.push(number(answer));
    }
    return { address };
  },
  *'inquire node'() {
    const answer = yield [[0x5e], 0x5e];
    if (!answer) return { no_answer: true };
    return { node: answer[1] === NO_NODE ? null : answer[1] };
  },
  *fastscan({ known }) {
    if (!(yield [[0x51, 0, 0, 0, 0, BEGIN, 0, 0], IDENTIFIED])) return { address: null };
    const address = [];
    for (const [part, text] of known.entries()) {
      const found = yield* scan(part, text);
      if (!found) return { address: null };
      address.push(found);
    }
    return { address };
  },
};

const request = (bytes) => `7E5#${showBytes(eight(bytes)).replaceAll(' ', '')}`;

/** The first frame of this service: eight bytes on 7E4h. */
function answerOf(heard, service) {
  const answers = heard.filter((frame) => /^7E4#[0-9A-F]{16}$/.test(frame)).map((frame) => parseBytes(frame.slice(4)));
  return answers.find(([first]) => first === service) ?? null;
}

export const KINDS = {
  'lss-talk': {
    run({ ask, talk }) {
      const service = SERVICES[ask.do](ask);
      const said = [];
      let next = service.next();
      for (const { hear } of talk) {
        if (next.done) break;
        const [frame, awaited] = next.value;
        said.push({ say: request(frame) });
        next = service.next(awaited === null ? null : answerOf(hear, awaited));
      }
      return { talk: said, ends: next.done ? next.value : {} };
    },
  },
};
