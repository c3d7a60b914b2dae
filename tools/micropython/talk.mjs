// node talk.mjs MODULES EDITION ROLE BAUDRATE: the client or the server of talk.py in MicroPython. The serial line is the
// standard input and output, its clock shows 30 days at the start. On the error output it says "ready", and at the end of the
// input, or on SIGTERM, the counts.
import fs from 'node:fs';
import { load } from './load.mjs';

const [modules, edition, role, baudrate] = process.argv.slice(2);
const python = await load(modules, edition);
python.runPython(`from tools.micropython.talk import begin, hear, result\nbegin('${role}', ${baudrate})`);
const [hear, result] = ['hear', 'result'].map((name) => python.globals.get(name));

const begun = process.hrtime.bigint();
const now = () => 30n * 86400000000n + (process.hrtime.bigint() - begun) / 1000n;
const milliseconds = (length) => Math.ceil((length * 11000) / Number(baudrate));
let timer, isSending = false;
const arrived = [];

function act(data = arrived.splice(0)) {
  clearTimeout(timer);
  const text = Buffer.concat(data).toString('hex');
  const wish = JSON.parse(hear(text, String(now())));
  if ('say' in wish) {
    fs.writeSync(1, Buffer.from(wish.say, 'hex'));
    // A pseudo-terminal takes no time: that of the characters passes here. What arrives meanwhile is heard afterwards.
    isSending = true;
    setTimeout(() => {
      isSending = false;
      act([]);
    }, milliseconds(wish.say.length / 2));
  } else if (arrived.length) {
    act();
  } else {
    timer = setTimeout(() => act(), Math.max(0, Math.ceil(Number(BigInt(wish.until) - now()) / 1000)));
  }
}

function end() {
  console.error(result());
  process.exit(0);
}
process.on('SIGTERM', end);
process.stdin.on('data', (data) => {
  arrived.push(data);
  if (!isSending) act();
});
process.stdin.on('end', end);
console.error('ready');
act();
