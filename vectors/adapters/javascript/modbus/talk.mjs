// Lines that are heard over time, and the deliveries of one frame: the receivers, asked step by step.

import { codes, parseBytes } from '../hex.mjs';
import { AsciiReceiver, RtuReceiver, TcpReceiver, showHeld } from './receivers.mjs';

function run(Receiver, parse) {
  return ({ line, talk }) => {
    const receiver = new Receiver(line);
    const heard = talk.map(({ at, hear }) => ({ events: receiver.feed(parse(hear ?? ''), at) }));
    return { talk: heard, held: showHeld(receiver) };
  };
}

const SECOND = 1000000;

/** All pieces without a pause, then silence: the frames that come out. */
function receive(receiverOf, parse) {
  return (question) => {
    const receiver = receiverOf(question);
    const events = [];
    let at = 0;
    for (const piece of question.pieces) {
      const bytes = parse(piece);
      at += bytes.length * CHARACTER;
      events.push(...receiver.feed(bytes, at));
    }
    events.push(...receiver.feed([], at + 10 * SECOND));
    return { frames: events.filter((event) => 'pdu' in event) };
  };
}

const BAUD = 19200;
const BITS = 11;
const CHARACTER = (BITS * SECOND) / BAUD;
const role = (side) => (side === 'request' ? 'server' : 'client');

const rtuReceiver = ({ side, unit }) =>
  new RtuReceiver({ role: role(side), baud: BAUD, bits: BITS, patience: 30000, units: [unit] });

export const KINDS = {
  'rtu-talk': { run: run(RtuReceiver, parseBytes) },
  'ascii-talk': { run: run(AsciiReceiver, codes) },
  'tcp-talk': { run: run(TcpReceiver, parseBytes) },
  'rtu-frame': { receive: receive(rtuReceiver, parseBytes) },
  'ascii-frame': { receive: receive(() => new AsciiReceiver({ timeout: SECOND }), codes) },
  'tcp-frame': { receive: receive(() => new TcpReceiver(), parseBytes) },
};
