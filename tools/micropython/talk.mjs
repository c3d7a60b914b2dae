// node talk.mjs MODULES EDITION ROLE BAUDRATE: the client or the server of talk.py in MicroPython. The serial line is the
// standard input and output, its clock shows 30 days at the start. The counts of a client are printed on the error output
// when the input ends, and on SIGTERM.
import fs from 'node:fs';
import { load } from './load.mjs';

const [modules, edition, role, baudrate] = process.argv.slice(2);
const python = await load(modules, edition);
python.runPython(`from tools.micropython.talk import begin, hear\nside = begin('${role}', ${baudrate})`);
python.runPython('def sent(now):\n    side.sent(int(now))\ndef heard(text, now):\n    return hear(side, text, now)');
const [heard, sent] = [python.globals.get('heard'), python.globals.get('sent')];

const begun = process.hrtime.bigint();
const now = () => 30n * 86400000000n + (process.hrtime.bigint() - begun) / 1000n;
const milliseconds = (length) => Math.ceil((length * 11000) / Number(baudrate));
let timer, isSending = false;
const arrived = [];

function act() {
  if (isSending) return; // what arrives meanwhile is heard afterwards
  clearTimeout(timer);
  const text = Buffer.concat(arrived.splice(0)).toString('hex');
  const wish = JSON.parse(heard(text, String(now())));
  if ('say' in wish) {
    fs.writeSync(1, Buffer.from(wish.say, 'hex'));
    isSending = true; // a pseudo-terminal takes no time: that of the characters passes here
    timer = setTimeout(() => { isSending = false; sent(String(now())); act(); }, milliseconds(wish.say.length / 2));
  } else {
    timer = setTimeout(act, Math.max(0, Math.ceil(Number(BigInt(wish.until) - now()) / 1000)));
  }
}

function end() {
  python.runPython("counts = __import__('json').dumps(getattr(side, 'counts', {}))");
  console.error(python.globals.get('counts'));
  process.exit(0);
}
process.on('SIGTERM', end);
process.stdin.on('data', (data) => { arrived.push(data); act(); });
process.stdin.on('end', end);
act();
