// An SDO client with one transfer. start() gives its first frame, hear(frame) what it says then, wait() a time-out.

import { eight, fromLittle, little } from '../hex.mjs';
import { BlockReceiver, BlockSender } from './sdo-blocks.mjs';

const TOGGLE = 0x10;

export class SdoClient {
  /** `place`: index and sub-index as three bytes; `block`: {size, crc, switch}, or undefined. */
  constructor({ direction, place, value, indicated = true, block }) {
    Object.assign(this, { direction, place, value, indicated, block, ends: 'running', arrived: null });
  }

  start() {
    return this.direction === 'upload' ? this.startUpload() : this.startDownload();
  }

  startUpload() {
    this.state = this.block ? this.blockUploadBegins : this.uploadBegins;
    if (!this.block) return [eight([0x40, ...this.place])];
    return [eight([0xa0 | (this.block.crc ? 4 : 0), ...this.place, this.block.size, this.block.switch])];
  }

  startDownload() {
    const { length } = this.value;
    const size = this.indicated ? little(length, 4) : [];
    this.state = this.block ? this.blockDownloadBegins : this.downloadBegins;
    if (this.block) return [eight([0xc0 | (this.block.crc ? 4 : 0) | (this.indicated ? 2 : 0), ...this.place, ...size])];
    this.left = length >= 1 && length <= 4 && this.indicated ? null : this.value;
    if (this.left) return [eight([this.indicated ? 0x21 : 0x20, ...this.place, ...size])];
    return [eight([0x23 | ((4 - length) << 2), ...this.place, ...this.value])];
  }

  hear(frame) {
    if (this.ends !== 'running') return [];
    if (frame[0] === 0x80) {
      const code = fromLittle(frame.slice(4));
      // Before the first answer an abort of another object is that of an earlier transfer. Some servers name none.
      if (this.begins() && !this.answers(frame) && frame.slice(1, 4).join() !== '0,0,0') return [];
      if (code === 0x05040001 && (this.state === this.blockUploadBegins || this.state === this.blockDownloadBegins)) {
        this.block = undefined; // a server without blocks: in segments, then
        return this.start();
      }
      this.ends = { abort: code.toString(16).toUpperCase().padStart(8, '0') };
      return [];
    }
    return this.state(frame);
  }

  /** Time passes: a receiver of blocks acknowledges what it has, and any other client has waited in vain. */
  wait() {
    if (this.ends !== 'running') return [];
    return this.state === this.blocksIn && !this.receiver.complete ? [this.receiver.acknowledge()] : this.abort('05040000');
  }

  abort(code) {
    this.ends = { abort: code };
    return [[0x80, ...this.place, ...little(parseInt(code, 16), 4)]];
  }

  done(value = null) {
    this.arrived = value;
    this.ends = 'done';
    return [];
  }

  begins() {
    return [this.uploadBegins, this.downloadBegins, this.blockUploadBegins, this.blockDownloadBegins].includes(this.state);
  }

  answers(frame) {
    return frame.slice(1, 4).join() === this.place.join();
  }

  // ------------------------------------------------------------------------------------------------------- segments

  downloadBegins(frame) {
    if (frame[0] >> 5 !== 3) return this.abort('05040001');
    if (!this.answers(frame)) return []; // the late answer of another transfer
    if (!this.left) return this.done();
    this.toggle = 0;
    this.state = this.segmentsOut;
    return this.segment();
  }

  segment() {
    const part = this.left.slice(0, 7);
    this.left = this.left.slice(7);
    this.last = this.left.length === 0;
    return [eight([this.toggle | ((7 - part.length) << 1) | this.last, ...part])];
  }

  segmentsOut(frame) {
    if (frame[0] >> 5 !== 1) return this.abort('05040001');
    if ((frame[0] & TOGGLE) !== this.toggle) return this.abort('05030000');
    if (this.last) return this.done();
    this.toggle ^= TOGGLE;
    return this.segment();
  }

  uploadBegins(frame) {
    if (frame[0] >> 5 !== 2) return this.abort('05040001');
    if (!this.answers(frame)) return [];
    const indicated = frame[0] & 1;
    if (frame[0] & 2) return this.done(frame.slice(4, indicated ? 8 - ((frame[0] >> 2) & 3) : 8));
    Object.assign(this, { announced: indicated ? fromLittle(frame.slice(4)) : null, received: [], toggle: 0 });
    this.state = this.segmentsIn;
    return [eight([0x60])];
  }

  segmentsIn(frame) {
    if (frame[0] >> 5 !== 0) return this.abort('05040001');
    if ((frame[0] & TOGGLE) !== this.toggle) return this.abort('05030000');
    this.received.push(...frame.slice(1, 8 - ((frame[0] >> 1) & 7)));
    if (this.announced !== null && this.received.length > this.announced) return this.abort('06070012');
    if (frame[0] & 1) {
      if (this.announced !== null && this.received.length < this.announced) return this.abort('06070013');
      return this.done(this.received);
    }
    this.toggle ^= TOGGLE;
    return [eight([0x60 | this.toggle])];
  }

  // --------------------------------------------------------------------------------------------------------- blocks

  blockDownloadBegins(frame) {
    if ((frame[0] & 0xe3) !== 0xa0) return this.abort('05040001');
    if (!this.answers(frame)) return [];
    if (frame[4] < 1 || frame[4] > 127) return this.abort('05040002');
    this.sender = new BlockSender(this.value, frame[4], this.block.crc && (frame[0] & 4) !== 0);
    this.state = this.blocksOut;
    return this.sender.block();
  }

  blocksOut(frame) {
    if (frame[0] === 0xa1 && this.ended) return this.done();
    if (frame[0] !== 0xa2) return this.abort('05040001');
    const { abort, say, complete } = this.sender.acknowledged(frame);
    this.ended = complete;
    return abort ? this.abort(abort) : say;
  }

  blockUploadBegins(frame) {
    if (frame[0] >> 5 === 2) return this.uploadBegins(frame); // the value is below the protocol switch threshold
    if ((frame[0] & 0xe1) !== 0xc0) return this.abort('05040001');
    if (!this.answers(frame)) return [];
    this.announced = frame[0] & 2 ? fromLittle(frame.slice(4)) : null;
    this.receiver = new BlockReceiver(this.block.size, this.block.crc && (frame[0] & 4) !== 0);
    this.state = this.blocksIn;
    return [eight([0xa3])];
  }

  blocksIn(frame) {
    if (!this.receiver.complete) return this.receiver.segment(frame);
    if ((frame[0] & 0xe3) !== 0xc1) return this.abort('05040001');
    const { abort, value } = this.receiver.end(frame, this.announced);
    if (abort) return this.abort(abort);
    this.done(value);
    return [eight([0xa1])];
  }
}
