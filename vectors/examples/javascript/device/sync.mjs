// SYNC of a device: 1005h, 1006h, 1019h; produced, consumed, or both.

import { cob } from './cob.mjs';

const WRONG_LENGTH = 0x8240;

export class Sync {
  constructor(device) {
    Object.assign(this, { device, counter: 0, last: null });
  }

  reset() {
    Object.assign(this, { counter: 0, last: null });
    this.stop?.();
  }

  cob() {
    return cob(this.device.number(0x1005, 0, 0x80));
  }

  /** Produce from now on, if bit 30 and a period say so: the first one after a period. */
  restart() {
    this.stop?.();
    const period = this.device.number(0x1006, 0);
    if (!this.cob().bit30 || period === 0) return;
    this.stop = this.device.after(period, () => {
      if (this.device.communicates()) this.produce();
      this.restart();
    });
  }

  produce() {
    const highest = this.device.number(0x1019, 0);
    this.counter = highest === 0 || this.counter >= highest ? 1 : this.counter + 1;
    const data = highest === 0 ? [] : [this.counter];
    this.device.say(this.cob(), data);
    this.happens(data);
  }

  heard(data) {
    const expected = this.device.number(0x1019, 0) === 0 ? 0 : 1;
    if (data.length !== expected) {
      this.device.emergencies.occurs('sync', WRONG_LENGTH);
      return;
    }
    this.device.emergencies.ends('sync');
    this.happens(data);
  }

  happens([counter = null]) {
    this.last = this.device.clock.now;
    this.device.pdos.sync(counter);
  }

  /** Whether the synchronous window 1007h is over. */
  isOver() {
    const window = this.device.number(0x1007, 0);
    return window !== 0 && this.last !== null && this.device.clock.now > this.last + window;
  }
}
