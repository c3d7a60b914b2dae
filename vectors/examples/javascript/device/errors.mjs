// Emergencies of a device: 1001h, the history 1003h, and the messages, not more often than 1015h allows.

import { hex, little } from '../hex.mjs';
import { Abort } from '../canopen/sdo-server.mjs';
import { cob } from './cob.mjs';

/** The bits of 1001h that an error of a class sets; bit 0 is set with all others. */
function registerBits(code) {
  const classes = { 1: 0x01, 2: 0x03, 3: 0x05, 4: 0x09 };
  if (code >= 0xff00) return 0x81;
  if (code >= 0x8100 && code <= 0x82ff) return 0x11;
  return classes[code >> 12] ?? 0x01;
}

const filled = (info) => [...info, 0, 0, 0, 0, 0].slice(0, 5);

export class Emergencies {
  constructor(device) {
    Object.assign(this, { device, active: new Map(), entries: [], waiting: [], next: 0 });
  }

  get register() {
    return [...this.active.values()].reduce((all, code) => all | registerBits(code), 0);
  }

  reset() {
    this.active.clear();
    Object.assign(this, { entries: [], waiting: [], next: 0 });
  }

  /** The sub-indices of 1003h that a device has: how to read each. */
  history(objects) {
    const subs = objects.filter(({ object }) => object.startsWith('1003:')).map(({ object }) => parseInt(object.slice(5), 16));
    this.room = Math.max(0, ...subs);
    const read = {};
    for (const sub of subs) read[`1003:${hex(sub, 2)}`] = () => this.entry(sub);
    return this.room ? { ...read, '1003:00': () => [this.entries.length] } : {};
  }

  entry(sub) {
    if (sub > this.entries.length) throw new Abort('08000024');
    return little(this.entries[sub - 1], 4);
  }

  occurs(key, code, info = []) {
    if (this.active.has(key)) return;
    this.active.set(key, code);
    const [low, high] = filled(info);
    this.entries.unshift(code + low * 2 ** 16 + high * 2 ** 24);
    this.entries.length = Math.min(this.entries.length, this.room);
    this.send(code, info);
  }

  ends(key) {
    if (this.active.delete(key)) this.send(0, []);
  }

  send(code, info) {
    if (!this.device.communicates()) return;
    this.waiting.push([...little(code, 2), this.register, ...filled(info)]);
    if (this.waiting.length === 1) this.device.after(Math.max(0, this.next - this.device.clock.now), () => this.flush());
    if (this.device.clock.now >= this.next) this.flush();
  }

  flush() {
    if (!this.waiting.length || this.device.clock.now < this.next) return;
    const { device } = this;
    const data = this.waiting.shift();
    const channel = cob(device.number(0x1014, 0, 0x80 + device.id));
    if (!channel.bit31) device.say(channel, data);
    this.next = device.clock.now + device.number(0x1015, 0) * 100;
    if (this.waiting.length) device.after(this.next - device.clock.now, () => this.flush());
  }
}
