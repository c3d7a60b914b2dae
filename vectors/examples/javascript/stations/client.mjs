// A client over time: the questions of a user, one after the other or several at once, and what each of them came to.

import { parseBytes } from '../hex.mjs';
import { Clock } from '../clock.mjs';
import { Peer } from './peer.mjs';
import { SerialClient, TcpClient } from './clients.mjs';

function run({ line, units, probes, ask }) {
  const clock = new Clock();
  const questions = ask.map((one) => ({ ...one, fates: [...(one.fates ?? [])], open: false, seen: 0, outcome: null }));
  let connection = new Map(); // time -> what comes then: one piece
  const deliver = (bytes, at) => {
    const mine = connection;
    if (mine.has(at)) {
      mine.get(at).push(...bytes);
      return;
    }
    mine.set(at, [...bytes]);
    clock.at(at, () => {
      const piece = mine.get(at);
      mine.delete(at);
      if (mine === connection) client.receive(piece);
    });
  };
  const peer = new Peer({ line, units, probes }, questions, deliver);
  const send = (frame, end) => {
    const mine = connection;
    clock.at(end, () => mine === connection && peer.hear(frame, end));
  };
  const client =
    line.framing === 'tcp'
      ? new TcpClient(line, clock, send, () => (connection = new Map()))
      : new SerialClient(line, clock, send);

  const waiting = [...questions];
  let open = 0;
  const next = () => {
    if (waiting.length === 0 || open >= (line.at_once ?? 1)) return;
    const question = waiting.shift();
    open += 1;
    clock.at(question.at, () => {
      if (question.changes) peer.change(question.unit, question.changes);
      question.open = true;
      client.ask({ unit: question.unit, pdu: parseBytes(question.pdu) }, (outcome) => {
        Object.assign(question, { outcome, open: false });
        open -= 1;
        clock.at(clock.now, next);
      });
      next();
    });
  };
  next();
  clock.run();
  return { ask: questions.map(({ outcome, seen }) => ({ outcome, seen })) };
}

export const KINDS = { client: { run } };
