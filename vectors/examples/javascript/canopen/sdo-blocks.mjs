// The two ends of the data of an SDO block transfer; which of them is the server is all the same (CiA 301, 7.2.4.3.9).

import { eight, fromLittle, little } from '../hex.mjs';
import { crcOfBlocks } from '../checksums.mjs';

const LAST = 0x80;

export class BlockSender {
  constructor(value, size, useCrc) {
    Object.assign(this, { value, size, useCrc, done: 0, sent: 0 });
  }

  /** The segments of the next block. An empty value is one segment, too. */
  block() {
    const frames = [];
    for (let at = this.done; frames.length < this.size && (at < this.value.length || at === 0); at += 7) {
      const last = at + 7 >= this.value.length;
      frames.push(eight([(last ? LAST : 0) | (frames.length + 1), ...this.value.slice(at, at + 7)]));
      if (last) break;
    }
    this.sent = frames.length;
    return frames;
  }

  /** A block was acknowledged: the next one, or the end. Null: the sequence number or the size is not allowed. */
  acknowledged([, sequence, size]) {
    if (sequence > this.sent) return { abort: '05040003' };
    if (size < 1 || size > 127) return { abort: '05040002' };
    this.size = size;
    this.done += 7 * sequence;
    const complete = sequence > 0 && this.done >= this.value.length;
    return { say: complete ? [this.end()] : this.block(), complete };
  }

  end() {
    const unused = this.value.length % 7 === 0 && this.value.length > 0 ? 0 : 7 - (this.value.length % 7);
    return eight([0xc1 | (unused << 2), ...little(this.useCrc ? crcOfBlocks(this.value) : 0, 2)]);
  }
}

export class BlockReceiver {
  constructor(size, useCrc) {
    Object.assign(this, { size, useCrc, value: [], sequence: 0, complete: false });
  }

  /** A segment: the acknowledgement if it ends the block. What comes out of order does not count. */
  segment(frame) {
    const number = frame[0] & 0x7f; // 0 and numbers above the block size do not count either
    if (number === this.sequence + 1) {
      this.sequence = number;
      this.value.push(...frame.slice(1));
      this.complete = (frame[0] & LAST) !== 0;
    }
    return number === this.size || frame[0] & LAST ? [this.acknowledge()] : [];
  }

  acknowledge() {
    const frame = eight([0xa2, this.sequence, this.size]);
    this.sequence = 0;
    return frame;
  }

  /** The end frame: the value, or why it is not right. */
  end(frame, announced) {
    this.value.length -= (frame[0] >> 2) & 7;
    if (announced !== null && announced !== this.value.length) {
      return { abort: this.value.length > announced ? '06070012' : '06070013' };
    }
    const right = !this.useCrc || fromLittle(frame.slice(1, 3)) === crcOfBlocks(this.value);
    return right ? { value: this.value } : { abort: '05040004' };
  }
}
