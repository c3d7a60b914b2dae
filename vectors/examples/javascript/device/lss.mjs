// The LSS slave of a whole device: its node-ID takes effect, and it can store its configuration.

import { hex } from '../hex.mjs';
import { LssSlave } from '../canopen/node.mjs';

const NO_NODE = 0xff;
const BIT_RATES = [0, 1, 2, 3, 4, 6, 7, 8]; // of table 0
const REFUSED = 1;

export class DeviceLss extends LssSlave {
  constructor(device) {
    const number = (sub) => hex(device.number(0x1018, sub), 8);
    super({ id: device.id, address: [1, 2, 3, 4].map(number) });
    this.device = device;
    this.pending = this.id;
  }

  hear(text) {
    this.device.said.push(...this.feed(text));
  }

  /** A device without a node-ID boots with the new one as it is switched to waiting. */
  switchTo(configuring) {
    const left = this.configuring && !configuring;
    super.switchTo(configuring);
    if (!left || this.id !== NO_NODE || this.pending === NO_NODE) return null;
    this.device.id = this.nodeAfterReset();
    this.device.boot();
    return null;
  }

  nodeAfterReset() {
    this.id = this.pending;
    return this.id === NO_NODE ? null : this.id;
  }

  configure(command, bytes) {
    if (command === 0x13) return [command, bytes[1] === 0 && BIT_RATES.includes(bytes[2]) ? 0 : REFUSED];
    if (command === 0x17) return [command];
    return super.configure(command, bytes);
  }
}
