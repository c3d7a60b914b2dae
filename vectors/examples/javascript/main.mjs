// The adapter: reads questions as lines of JSON from standard input and writes one line for each (see ../../README.md).
//
// Every module exports an object KINDS: kind -> operation -> function(question) -> the fields of the answer. A function
// refuses by throwing Refused, and says that it has no such thing by throwing NotOffered.

import { createInterface } from 'node:readline';
import { NotOffered, Refused } from './hex.mjs';

const MODULES = [
  ...['numbers', 'checksums'],
  ...['frames', 'pdu', 'exchange', 'talk', 'tls-role'].map((name) => `modbus/${name}`),
  ...['server', 'client', 'gateway'].map((name) => `stations/${name}`),
  ...['frames', 'sdo', 'sdo-talk', 'watch', 'node', 'lss-master', 'drive'].map((name) => `canopen/${name}`),
  ...['device/device'],
];
const modules = await Promise.all(MODULES.map((name) => import(`./${name}.mjs`)));
const kinds = {};
for (const { KINDS } of modules) {
  for (const [kind, operations] of Object.entries(KINDS)) kinds[kind] = { ...kinds[kind], ...operations };
}

function hello() {
  const offered = Object.entries(kinds).map(([kind, operations]) => [kind, Object.keys(operations)]);
  return { name: 'barewire-javascript', version: '1', kinds: Object.fromEntries(offered) };
}

function answer(question) {
  try {
    return { id: question.id, is: kinds[question.kind][question.do](question) };
  } catch (error) {
    if (error instanceof Refused) return { id: question.id, refused: error.reason, text: error.message };
    if (error instanceof NotOffered) return { id: question.id, not_offered: error.message };
    process.stderr.write(`${error.stack.replaceAll('\n', ' ')}\n`);
    return { id: question.id, text: error.message }; // a defect of this program: an answer that says nothing
  }
}

createInterface({ input: process.stdin }).on('line', (line) => {
  const question = JSON.parse(line);
  process.stdout.write(`${JSON.stringify('hello' in question ? hello() : answer(question))}\n`);
});
