// Bytes read one field after the other.

import { fromBig, refuseUnless } from './hex.mjs';

export class Reader {
  constructor(bytes) {
    this.bytes = bytes;
    this.at = 0;
  }

  get left() {
    return this.bytes.length - this.at;
  }

  take(count) {
    refuseUnless(this.left >= count, 'short', `${count} bytes expected, ${this.left} left`);
    this.at += count;
    return this.bytes.slice(this.at - count, this.at);
  }

  u8() {
    return this.take(1)[0];
  }

  u16() {
    return fromBig(this.take(2));
  }

  rest() {
    return this.take(this.left);
  }

  /** All that is left, which must be as many bytes as a byte count has said. */
  counted(count) {
    refuseUnless(this.left === count, 'length', `byte count ${count}, ${this.left} bytes follow`);
    return this.rest();
  }

  end() {
    refuseUnless(this.left === 0, 'long', `${this.left} bytes left over`);
  }
}
