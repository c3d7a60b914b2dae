// Lines that are heard over time, and the deliveries of one frame: the receivers, asked step by step.

import { codes, parseBytes } from '../hex.mjs';
import { AsciiReceiver, RtuReceiver, TcpReceiver, showHeld } from './receivers.mjs';

const SECOND = 1000000;
const SILENCE = 10 * SECOND;
const framesOf = (events) => events.filter((event) => 'pdu' in event);

/** The two operations of a talk: every event of every step, or the frames alone, with the silence behind the talk. */
function talk(Receiver, parse) {
  const heard = (receiver, steps) => steps.map(({ at, hear }) => ({ events: receiver.feed(parse(hear ?? ''), at) }));
  return {
    run({ line, talk: steps }) {
      const receiver = new Receiver(line);
      return { talk: heard(receiver, steps), held: showHeld(receiver) };
    },
    frames({ line, talk: steps }) {
      const receiver = new Receiver(line);
      const events = heard(receiver, steps).flatMap((step) => step.events);
      return { frames: framesOf([...events, ...receiver.feed([], steps.at(-1).at + SILENCE)]) };
    },
  };
}

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
    events.push(...receiver.feed([], at + SILENCE));
    return { frames: framesOf(events) };
  };
}

const BAUD = 19200;
const BITS = 11;
const CHARACTER = (BITS * SECOND) / BAUD;
const role = (side) => (side === 'request' ? 'server' : 'client');

const rtuReceiver = ({ side, unit }) =>
  new RtuReceiver({ role: role(side), baud: BAUD, bits: BITS, patience: 30000, units: [unit] });

export const KINDS = {
  'rtu-talk': talk(RtuReceiver, parseBytes),
  'ascii-talk': talk(AsciiReceiver, codes),
  'tcp-talk': talk(TcpReceiver, parseBytes),
  'rtu-frame': { receive: receive(rtuReceiver, parseBytes) },
  'ascii-frame': { receive: receive(() => new AsciiReceiver({ timeout: SECOND }), codes) },
  'tcp-frame': { receive: receive(() => new TcpReceiver(), parseBytes) },
};
