// Receivers: bytes and the time go in, frames and noise come out, and no byte is lost.
//
// feed(bytes, at) gives the events of these bytes and of the time since the last ones. `at` is in microseconds, and is the
// time at which the last byte was in.

import { Refused, characters, codes, fromBig, showBytes } from '../hex.mjs';
import { silences } from '../checksums.mjs';
import { ascii, rtu, shown, tcp } from './frames.mjs';
import { lengthOf } from './lengths.mjs';
import { decodePdu } from './pdu.mjs';

function attempt(decode) {
  try {
    return { frame: decode() };
  } catch (error) {
    if (error instanceof Refused) return { reason: error.reason };
    throw error;
  }
}

export class RtuReceiver {
  constructor({ role, baud, bits, patience = null, units = [] }) {
    const { character, t15, t35 } = silences(baud, bits);
    this.character = character / 1000;
    this.strict = patience === null;
    this.longest = this.strict ? t15 / 1000 : patience;
    this.silence = this.strict ? t35 / 1000 : patience;
    this.role = role;
    this.units = units;
    this.held = [];
    this.spoiled = false;
    this.last = 0;
  }

  feed(bytes, at) {
    const events = [];
    const begin = at - bytes.length * this.character;
    if (this.held.length && begin - this.last > this.silence) events.push(...this.close());
    else if (this.held.length && bytes.length && begin - this.last > this.longest) this.spoiled = true;
    if (bytes.length) {
      this.held.push(...bytes);
      this.last = at;
    }
    if (!this.strict) events.push(...this.count());
    return events;
  }

  /** Who may have sent this frame: its sides. */
  sides(unit) {
    if (this.role === 'client') return ['response'];
    if (this.role === 'server' && (unit === 0 || this.units.includes(unit))) return ['request'];
    return ['request', 'response'];
  }

  /** The frame at this place whose length is known, complete and confirmed by the CRC; or whether more may come. */
  frameAt(start) {
    const bytes = this.held.slice(start);
    let open = false;
    for (const side of this.sides(bytes[0])) {
      const length = lengthOf(side, bytes.slice(1));
      if (length === null || length === undefined || length + 3 > bytes.length) open = true;
      else {
        const { frame } = attempt(() => rtu.decode(bytes.slice(0, length + 3)));
        if (frame) return { frame, size: length + 3 };
      }
    }
    return { open };
  }

  /** Frames whose count is complete. Where it is and the CRC is wrong, a frame may begin at a later byte. */
  count() {
    const events = [];
    while (this.held.length) {
      const { frame, size, open } = this.frameAt(0);
      if (frame) {
        events.push(shown(frame));
        this.held.splice(0, size);
      } else if (open || !this.search(events, 'checksum')) break;
    }
    return events;
  }

  /** Take the first frame that begins behind the first byte, and the noise before it. */
  search(events, reason) {
    for (let start = 1; start < this.held.length - 3; start += 1) {
      const { frame, size } = this.frameAt(start);
      if (frame) {
        events.push({ noise: showBytes(this.held.splice(0, start)), reason }, shown(frame));
        this.held.splice(0, size);
        return true;
      }
    }
    return false;
  }

  /** Silence: what is held is one frame, or it is noise, with frames in it if the receiver may search. */
  close() {
    const { frame, reason } = attempt(() => rtu.decode(this.held));
    const events = [];
    if (this.spoiled) events.push(this.noise('silence'));
    else if (frame && this.whole(frame)) {
      events.push(shown(frame));
      this.held = [];
    } else if (frame) events.push(this.noise('short'));
    else {
      if (!this.strict && this.search(events, reason)) events.push(...this.count());
      if (this.held.length) events.push(events.length ? this.close()[0] : this.noise(reason));
    }
    this.spoiled = false;
    return events;
  }

  noise(reason) {
    return { noise: showBytes(this.held.splice(0)), reason };
  }

  /** A good CRC may be an accident of a lost last byte: then the fields of a message are missing. */
  whole({ unit, pdu }) {
    return this.strict || this.sides(unit).some((side) => attempt(() => decodePdu(side, pdu)).reason !== 'short');
  }
}

const [COLON, CR, LF] = codes(':\r\n');

export class AsciiReceiver {
  constructor({ timeout, data_bits: bits = 8 }) {
    this.timeout = timeout;
    this.mask = bits === 7 ? 0x7f : 0xff;
    this.held = [];
    this.last = 0;
    this.ends = {}; // unit -> the character that it was given in place of LF
    this.before = {}; // unit -> its last message
  }

  feed(bytes, at) {
    const events = [];
    if (this.held.length && at - this.last > this.timeout) events.push(this.noise(this.held[0] === COLON ? 'silence' : 'delimiter'));
    for (const byte of bytes) events.push(...this.character(byte & this.mask));
    if (bytes.length) this.last = at;
    return events;
  }

  character(byte) {
    const events = [];
    if (byte === COLON && this.held.length) events.push(this.noise('delimiter'));
    this.held.push(byte);
    const unit = parseInt(characters(this.held.slice(1, 3)), 16);
    if (this.held.at(-2) === CR && (byte === LF || byte === this.ends[unit])) events.push(this.end(byte));
    return events;
  }

  end(byte) {
    const { frame, reason } = attempt(() => ascii.decode(this.held, String.fromCharCode(byte)));
    if (!frame) return this.noise(reason);
    this.held = [];
    const message = shown(frame);
    this.follow(message, frame);
    return message;
  }

  /** A message twice is a request and its answer: 08/03 gives the unit another character, 08/01 takes it away. */
  follow({ unit, pdu: text }, { pdu }) {
    const answered = this.before[unit] === text;
    if (answered && text.startsWith('08 00 03')) this.ends[unit] = pdu[3];
    if (answered && text.startsWith('08 00 01')) delete this.ends[unit];
    this.before[unit] = answered ? null : text;
  }

  noise(reason) {
    return { noise: characters(this.held.splice(0)), reason };
  }
}

export class TcpReceiver {
  constructor() {
    this.held = [];
    this.broken = null;
  }

  feed(bytes) {
    const events = [];
    this.held.push(...bytes);
    while (this.held.length) {
      const { frame, reason } = attempt(() => tcp.decode(this.held.slice(0, this.size())));
      if (reason === 'short' && !this.broken) break;
      if (frame && !this.broken) {
        events.push(shown(frame));
        this.held.splice(0, this.size());
      } else {
        this.broken ??= reason; // from here on nobody knows where a frame begins
        events.push({ noise: showBytes(this.held.splice(0)), reason: this.broken });
      }
    }
    return events;
  }

  size() {
    return this.held.length < 6 ? this.held.length : 6 + fromBig(this.held.slice(4, 6));
  }
}

export const showHeld = (receiver) => (receiver instanceof AsciiReceiver ? characters(receiver.held) : showBytes(receiver.held));
