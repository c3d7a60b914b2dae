// An SDO server. hear(frame) gives the frames that it says; wait() those of a time-out.
//
// Its dictionary has read(index, sub) -> bytes, mayWrite(index, sub, size) and write(index, sub, bytes, exact): all of them
// throw Abort with the code. `size` is null if it is not known yet; not `exact`: the object knows how many bytes count.

import { eight, fromLittle, little } from '../hex.mjs';
import { BlockReceiver, BlockSender } from './sdo-blocks.mjs';

const TOGGLE = 0x10;

export class Abort extends Error {
  constructor(code) {
    super(`abort ${code}`);
    this.code = code;
  }
}

export class SdoServer {
  /** `blksize`: the segments of a block that it asks for; 0: it has no block transfers. */
  constructor(dictionary, blksize = 127) {
    Object.assign(this, { dictionary, blksize });
    this.state = this.idle;
  }

  hear(frame) {
    if (frame.length !== 8) return [];
    if (frame[0] === 0x80) {
      this.state = this.idle;
      return [];
    }
    try {
      return this.state(frame);
    } catch (error) {
      if (error instanceof Abort) return this.abort(error.code);
      throw error;
    }
  }

  wait() {
    return this.state === this.blocksIn && !this.receiver.complete ? [this.receiver.acknowledge()] : [];
  }

  abort(code) {
    this.state = this.idle;
    return [[0x80, ...this.place, ...little(parseInt(code, 16), 4)]];
  }

  idle(frame) {
    this.place = frame.slice(1, 4);
    const begin = { 1: this.download, 2: this.upload, 5: this.blockUpload, 6: this.blockDownload }[frame[0] >> 5];
    if (!begin || (frame[0] >= 0xa0 && this.blksize === 0)) return this.abort('05040001');
    this.object = [fromLittle(this.place.slice(0, 2)), this.place[2]];
    return begin.call(this, frame);
  }

  // ------------------------------------------------------------------------------------------------------- segments

  download(frame) {
    const indicated = (frame[0] & 1) !== 0;
    if (frame[0] & 2) {
      this.dictionary.write(...this.object, frame.slice(4, indicated ? 8 - ((frame[0] >> 2) & 3) : 8), indicated);
    } else {
      Object.assign(this, { announced: indicated ? fromLittle(frame.slice(4)) : null, received: [], toggle: 0 });
      this.dictionary.mayWrite(...this.object, this.announced);
      this.state = this.segmentsIn;
    }
    return [eight([0x60, ...this.place])];
  }

  segmentsIn(frame) {
    if (frame[0] >> 5 !== 0) return this.abort('05040001');
    if ((frame[0] & TOGGLE) !== this.toggle) return this.abort('05030000');
    this.received.push(...frame.slice(1, 8 - ((frame[0] >> 1) & 7)));
    if (this.announced !== null && this.received.length > this.announced) return this.abort('06070012');
    if (frame[0] & 1) {
      if (this.announced !== null && this.received.length < this.announced) return this.abort('06070013');
      this.dictionary.write(...this.object, this.received, true);
      this.state = this.idle;
    }
    this.toggle ^= TOGGLE;
    return [eight([0x20 | (this.toggle ^ TOGGLE)])];
  }

  upload() {
    const value = this.dictionary.read(...this.object);
    const { length } = value;
    if (length >= 1 && length <= 4) return [eight([0x43 | ((4 - length) << 2), ...this.place, ...value])];
    Object.assign(this, { left: value, toggle: 0, state: this.segmentsOut });
    return [[0x41, ...this.place, ...little(length, 4)]];
  }

  segmentsOut(frame) {
    if (frame[0] >> 5 !== 3) return this.abort('05040001');
    if ((frame[0] & TOGGLE) !== this.toggle) return this.abort('05030000');
    const part = this.left.slice(0, 7);
    this.left = this.left.slice(7);
    const last = this.left.length === 0;
    if (last) this.state = this.idle;
    this.toggle ^= TOGGLE;
    return [eight([(this.toggle ^ TOGGLE) | ((7 - part.length) << 1) | last, ...part])];
  }

  // --------------------------------------------------------------------------------------------------------- blocks

  blockDownload(frame) {
    if (frame[0] & 1) return this.abort('05040001');
    this.announced = frame[0] & 2 ? fromLittle(frame.slice(4)) : null;
    this.dictionary.mayWrite(...this.object, this.announced);
    this.receiver = new BlockReceiver(this.blksize, (frame[0] & 4) !== 0);
    this.state = this.blocksIn;
    return [eight([0xa4, ...this.place, this.blksize])];
  }

  blocksIn(frame) {
    if (!this.receiver.complete) return this.receiver.segment(frame);
    if ((frame[0] & 0xe3) !== 0xc1) return this.abort('05040001');
    const { abort, value } = this.receiver.end(frame, this.announced);
    if (abort) return this.abort(abort);
    this.dictionary.write(...this.object, value, true);
    this.state = this.idle;
    return [eight([0xa1])];
  }

  blockUpload(frame) {
    if ((frame[0] & 3) !== 0) return this.abort('05040001');
    const [size, threshold] = frame.slice(4);
    if (size < 1 || size > 127) return this.abort('05040002');
    const value = this.dictionary.read(...this.object);
    if (threshold > 0 && value.length <= threshold) return this.upload();
    this.sender = new BlockSender(value, size, (frame[0] & 4) !== 0);
    Object.assign(this, { state: this.blocksOut, begun: false, ended: false });
    return [[0xc6, ...this.place, ...little(value.length, 4)]];
  }

  blocksOut(frame) {
    if (frame[0] === 0xa3 && !this.begun) {
      this.begun = true;
      return this.sender.block();
    }
    if (frame[0] === 0xa1 && this.ended) {
      this.state = this.idle;
      return [];
    }
    if (frame[0] !== 0xa2 || !this.begun || this.ended) return this.abort('05040001');
    const { abort, say, complete } = this.sender.acknowledged(frame);
    this.ended = complete;
    return abort ? this.abort(abort) : say;
  }
}
