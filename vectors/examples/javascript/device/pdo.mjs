// The PDOs of a device: 1400h and 1600h, what it receives; 1800h and 1A00h, what it sends.

import { hex, little, parseBytes, showBytes } from '../hex.mjs';
import { Abort } from '../canopen/sdo-server.mjs';
import { OPERATIONAL, cob, matches } from './cob.mjs';

const [TOO_SHORT, TOO_LONG, TIMED_OUT] = [0x8210, 0x8220, 0x8250];
const DUMMIES = 0x20; // indices below are data types
const OFF = 0x80000000; // the COB-ID of a PDO that does not exist

/** The mapped objects: index, sub-index and bits of each. */
function mapping(device, index) {
  return Array.from({ length: device.number(index, 0) }, (_, k) => {
    const entry = device.number(index, k + 1);
    return { index: Math.floor(entry / 0x10000), sub: Math.floor(entry / 0x100) % 0x100, bits: entry % 0x100 };
  });
}

const sizeOf = (entries) => Math.ceil(entries.reduce((sum, { bits }) => sum + bits, 0) / 8);
const asNumber = (bytes) => BigInt(`0x0${showBytes([...bytes].reverse()).replaceAll(' ', '')}`);
const asBytes = (number, size) => (size ? parseBytes(hex(number, 2 * size)).reverse() : []);

class Tpdo {
  constructor(device, number) {
    Object.assign(this, { device, index: 0x1800 + number, map: 0x1a00 + number, number });
    this.stop();
  }

  get channel() {
    return cob(this.device.number(this.index, 1, OFF));
  }

  get type() {
    return this.device.number(this.index, 2);
  }

  get works() {
    return this.device.state === OPERATIONAL && !this.channel.bit31;
  }

  stop() {
    this.stopTimer?.();
    this.stopInhibit?.();
    Object.assign(this, { pending: false, inhibited: false, count: 0, started: false, sample: null });
  }

  start() {
    this.stop();
    this.event();
  }

  /** A mapped value has changed, or operational begins. */
  event() {
    if (!this.works) return;
    if (this.type === 0) this.pending = true;
    if (this.type < 254) return;
    if (this.inhibited) this.pending = true;
    else this.send();
  }

  pack() {
    let row = 0n;
    let at = 0n;
    const entries = mapping(this.device, this.map);
    for (const { index, sub, bits } of entries) {
      const value = index < DUMMIES ? 0n : asNumber(this.device.dictionary.bytes(index, sub));
      row |= BigInt.asUintN(bits, value) << at;
      at += BigInt(bits);
    }
    return asBytes(row, sizeOf(entries));
  }

  send(data = this.pack()) {
    const { device } = this;
    this.pending = false;
    if (data.length === 0) return;
    device.say(this.channel, data);
    if (this.type >= 254) this.restartTimers();
  }

  restartTimers() {
    const { device } = this;
    const inhibit = device.number(this.index, 3) * 100;
    if (inhibit) {
      this.inhibited = true;
      this.stopInhibit = device.after(inhibit, () => {
        this.inhibited = false;
        if (this.pending && this.works) this.send();
      });
    }
    this.stopTimer?.();
    const period = device.number(this.index, 5) * 1000;
    if (period) this.stopTimer = device.after(period, () => this.works && this.event());
  }

  sync(counter) {
    if (!this.works) return;
    if (this.type === 252) this.sample = this.pack();
    if (this.type === 0 && this.pending) this.send();
    if (this.type < 1 || this.type > 240 || !this.begun(counter)) return;
    this.count += 1;
    if (this.count < this.type) return;
    this.count = 0;
    this.send();
  }

  /** The SYNC with the start value is the first one that counts. */
  begun(counter) {
    const start = this.device.number(this.index, 6);
    if (start === 0 || counter === null || counter === start) this.started = true;
    return this.started;
  }

  requested() {
    if (!this.works || this.channel.bit30) return;
    if (this.type === 252) this.send(this.sample ?? this.pack());
    if (this.type >= 253) this.send();
  }
}

class Rpdo {
  constructor(device, number) {
    Object.assign(this, { device, index: 0x1400 + number, map: 0x1600 + number, number });
    this.stop();
  }

  get channel() {
    return cob(this.device.number(this.index, 1, OFF));
  }

  stop() {
    this.waiting = null;
    this.stopTimer?.();
  }

  heard(data) {
    const { device } = this;
    const entries = mapping(device, this.map);
    const size = sizeOf(entries);
    const synchronous = device.number(this.index, 2) <= 240;
    if (synchronous && device.sync.isOver()) return;
    const wrong = `length ${this.number}`;
    if (data.length < size) {
      device.emergencies.occurs(wrong, TOO_SHORT, [data.length, size]);
      return;
    }
    if (data.length > size) device.emergencies.occurs(wrong, TOO_LONG, [data.length, size]);
    else device.emergencies.ends(wrong);
    this.restartTimer();
    if (synchronous) this.waiting = data;
    else this.store(entries, data);
  }

  restartTimer() {
    const { device } = this;
    const missing = `missing ${this.number}`;
    device.emergencies.ends(missing);
    this.stopTimer?.();
    const period = device.number(this.index, 5) * 1000;
    if (period) this.stopTimer = device.after(period, () => device.emergencies.occurs(missing, TIMED_OUT, little(this.index, 2)));
  }

  sync() {
    const data = this.waiting;
    this.waiting = null;
    if (data) this.store(mapping(this.device, this.map), data);
  }

  /** Each value that is within its limits. */
  store(entries, data) {
    let row = asNumber(data);
    for (const { index, sub, bits } of entries) {
      const bytes = asBytes(BigInt.asUintN(bits, row), Math.ceil(bits / 8));
      row >>= BigInt(bits);
      if (index >= DUMMIES) this.storeOne(index, sub, bytes);
    }
  }

  storeOne(index, sub, bytes) {
    const { dictionary } = this.device;
    try {
      dictionary.check(index, sub, bytes);
    } catch (error) {
      if (error instanceof Abort) return;
      throw error;
    }
    dictionary.store(index, sub, bytes);
  }
}

export class Pdos {
  constructor(device) {
    this.device = device;
    const numbers = (base) => Array.from({ length: 512 }, (_, k) => k).filter((k) => device.dictionary.has(base + k, 0));
    this.received = numbers(0x1400).map((number) => new Rpdo(device, number));
    this.sent = numbers(0x1800).map((number) => new Tpdo(device, number));
  }

  reset() {
    this.stop();
  }

  stop() {
    for (const one of [...this.received, ...this.sent]) one.stop();
  }

  start() {
    for (const one of this.sent) one.start();
  }

  /** First what was received is stored, then what is sent is sampled. */
  sync(counter) {
    if (this.device.state !== OPERATIONAL) return;
    for (const one of this.received) one.sync();
    for (const one of this.sent) one.sync(counter);
  }

  heard(frame) {
    for (const one of this.received) {
      if (!frame.remote && !one.channel.bit31 && matches(one.channel, frame)) one.heard(frame.data);
    }
    for (const one of this.sent) if (frame.remote && matches(one.channel, frame)) one.requested();
  }

  changed(index, sub) {
    for (const one of this.sent) {
      if (mapping(this.device, one.map).some((entry) => entry.index === index && entry.sub === sub)) one.event();
    }
  }
}
