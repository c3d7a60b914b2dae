// node answer.mjs MODULES EDITION: an adapter of the vectors. Questions come as lines of JSON; MicroPython answers them.
import readline from 'node:readline';
import { load } from './load.mjs';

const python = await load(...process.argv.slice(2));
python.runPython('from tools.micropython.answers import answer, kinds');
const [answer, kinds] = [python.globals.get('answer'), python.globals.get('kinds')];
const version = python.runPython('".".join(map(str, sys.implementation.version[:3]))') ?? '1.27';
for await (const line of readline.createInterface({ input: process.stdin })) {
  const hello = { name: 'barewire on MicroPython', version, kinds: JSON.parse(kinds()) };
  console.log('hello' in JSON.parse(line) ? JSON.stringify(hello) : answer(line));
}
