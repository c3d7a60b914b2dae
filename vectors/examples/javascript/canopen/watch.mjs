// A master that watches nodes: by their heartbeats, or by node guarding (CiA 301, 7.2.8.2).

import { hex, parseBytes } from '../hex.mjs';

/** A frame of error control: its node, and its byte. Null for remote frames, extended identifiers and everything else. */
function errorControl(text) {
  const [id, data] = text.split('#');
  const node = parseInt(id, 16) - 0x700;
  if (id.length !== 3 || node < 1 || node > 127 || data.startsWith('R') || data === '') return null;
  return { node, byte: parseBytes(data)[0] };
}

class Watch {
  constructor({ heartbeat = {}, guard }) {
    this.guarding = guard !== undefined;
    this.nodes = {};
    this.said = [];
    this.events = [];
    for (const [node, time] of Object.entries(heartbeat)) this.node(node).limit = time * 1000;
    for (const [node, { time, factor }] of Object.entries(guard ?? {})) {
      const limit = time * factor * 1000; // a response is missed from the beginning
      Object.assign(this.node(node), { guarded: true, period: time * 1000, asks: 0, limit, deadline: limit });
    }
  }

  node(number) {
    this.nodes[number] ??= { number, state: null, limit: null, deadline: null, toggle: null, guarded: false };
    return this.nodes[number];
  }

  report(node, text) {
    this.events.push(`${node.number} ${text}`);
  }

  /** Let the time pass: the questions of node guarding, and what is missed. */
  pass(now) {
    for (const node of Object.values(this.nodes)) {
      while (node.guarded && node.asks <= now) {
        this.said.push(`${hex(0x700 + Number(node.number), 3)}#R1`);
        node.asks += node.period;
      }
      if (node.deadline !== null && node.deadline <= now) {
        Object.assign(node, { state: null, deadline: null, toggle: null });
        this.report(node, 'lost');
      }
    }
  }

  hear(text, now) {
    const frame = errorControl(text);
    if (!frame) return;
    if (this.guarding && !(frame.node in this.nodes)) return; // it asks only these nodes
    const node = this.node(frame.node);
    if (frame.byte === 0) {
      Object.assign(node, { state: null, toggle: 0 });
      if (!node.guarded) node.deadline = null;
      this.report(node, 'booted');
      return;
    }
    if (node.guarded && !this.alternates(node, frame.byte >> 7)) return;
    this.seen(node, hex(frame.byte & 0x7f, 2), now);
  }

  /** Whether the toggle bit is the expected one; the first response may have either. */
  alternates(node, toggle) {
    if (node.toggle !== null && node.toggle !== toggle) {
      this.report(node, 'toggle');
      return false;
    }
    node.toggle = toggle ^ 1;
    return true;
  }

  seen(node, state, now) {
    if (node.state === null) this.report(node, `active ${state}`);
    else if (node.state !== state) this.report(node, `state ${state}`);
    node.state = state;
    node.deadline = node.limit === null ? null : now + node.limit;
  }

  take() {
    return { say: this.said.splice(0), events: this.events.splice(0) };
  }
}

export const KINDS = {
  'heartbeat-watch': {
    run({ watch, talk }) {
      const master = new Watch(watch);
      const steps = talk.map(({ at, hear }) => {
        master.pass(at);
        for (const frame of hear) master.hear(frame, at);
        return master.take();
      });
      return { talk: steps };
    },
  },
};
