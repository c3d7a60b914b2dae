// Two parts of a device: the one that answers node guarding and guards its master, and the LSS slave (CiA 305).

import { eight, fromLittle, hex, little, parseBytes, showBytes } from '../hex.mjs';

const PRE_OPERATIONAL = 0x7f;

class GuardedNode {
  constructor({ id, life_time: lifeTime = 0 }) {
    Object.assign(this, { id: hex(0x700 + id, 3), lifeTime, toggle: 0, deadline: null, lost: false });
  }

  feed(frame, now) {
    const said = [];
    if (this.deadline !== null && this.deadline <= now) {
      said.push('lost');
      Object.assign(this, { deadline: null, lost: true });
    }
    if (frame === null || !frame.startsWith(`${this.id}#R`)) return said;
    if (this.lost) said.push('resolved');
    this.lost = false;
    if (this.lifeTime) this.deadline = now + this.lifeTime;
    said.push(`${this.id}#${hex(PRE_OPERATIONAL | (this.toggle << 7), 2)}`);
    this.toggle ^= 1;
    return said;
  }
}

const NO_NODE = 0xff;
const NOT_SUPPORTED = 1;
const OUT_OF_RANGE = 1;

export class LssSlave {
  constructor({ id, address }) {
    this.id = id ?? NO_NODE;
    this.address = address.map((number) => parseInt(number, 16));
    this.configuring = false;
    this.selected = 0; // how many parts of switch selective have fitted
    this.identified = 0;
    this.scanned = null; // the part that fastscan asks for; null: it has not begun
  }

  feed(frame) {
    if (frame === null || !frame.startsWith('7E5#') || frame.includes('R')) return [];
    const bytes = parseBytes(frame.slice(4));
    const answer = bytes.length === 8 ? this.service(bytes[0], bytes) : null;
    if (!answer) return [];
    const data = showBytes(eight(answer));
    return [`7E4#${data.replaceAll(' ', '')}`];
  }

  service(command, bytes) {
    const number = fromLittle(bytes.slice(1, 5));
    if (command === 0x04) return this.switchTo(bytes[1] === 1);
    if (command >= 0x40 && command <= 0x43) return this.select(command - 0x40, number);
    if (command >= 0x46 && command <= 0x4b) return this.identify(command - 0x46, number);
    if (command === 0x4c) return this.id === NO_NODE ? [0x50] : null;
    if (command === 0x51) return this.scan(number, ...bytes.slice(5));
    return this.configuring ? this.configure(command, bytes) : null;
  }

  switchTo(configuring) {
    Object.assign(this, { configuring, selected: 0 });
    return null;
  }

  select(part, number) {
    if (this.configuring) return null;
    const fits = part === this.selected && number === this.address[part];
    this.selected = fits ? part + 1 : 0;
    if (this.selected < 4) return null;
    Object.assign(this, { configuring: true, selected: 0 });
    return [0x44];
  }

  /** Vendor, product, revision from and to, serial number from and to. */
  identify(part, number) {
    const [vendor, product, revision, serial] = this.address;
    const fits = [
      number === vendor, number === product, number <= revision, number >= revision, number <= serial, number >= serial,
    ][part];
    this.identified = fits && part === this.identified ? part + 1 : 0;
    if (this.identified < 6) return null;
    this.identified = 0;
    return [0x4f];
  }

  scan(number, bit, part, next) {
    if (this.id !== NO_NODE || this.configuring) return null;
    if (bit === 0x80) {
      this.scanned = 0;
      return [0x4f];
    }
    if (bit > 31 || part > 3 || next > 3 || part !== this.scanned) return null;
    if (number >>> bit !== this.address[part] >>> bit) return null;
    this.scanned = next;
    if (bit === 0 && next < part) this.configuring = true;
    return [0x4f];
  }

  configure(command, bytes) {
    if (command >= 0x5a && command <= 0x5d) return [command, ...little(this.address[command - 0x5a], 4)];
    if (command === 0x5e) return [command, this.id];
    if (command === 0x17) return [command, NOT_SUPPORTED];
    if (command !== 0x11) return null;
    if (bytes[1] !== NO_NODE && (bytes[1] < 1 || bytes[1] > 127)) return [command, OUT_OF_RANGE];
    this.pending = bytes[1]; // in force from the next reset of communication on
    return [command];
  }
}

const MACHINES = { 'guarded-node': GuardedNode, 'lss-slave': LssSlave };

export const KINDS = {
  'node-talk': {
    run({ node, talk }) {
      const machine = new MACHINES[node.machine](node);
      return { talk: talk.map(({ at, hear }) => ({ said: machine.feed(hear ?? null, at) })) };
    },
  },
};
