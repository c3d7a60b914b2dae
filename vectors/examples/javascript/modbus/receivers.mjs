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

const isGood = (bytes) => attempt(() => rtu.decode(bytes)).frame !== undefined;

/** Whether bytes are a frame with one damaged bit. */
function isOneBitOff(bytes) {
  const flipped = (bit) => bytes.map((byte, at) => (at === bit >> 3 ? byte ^ (1 << (bit & 7)) : byte));
  return [...Array(8 * bytes.length).keys()].some((bit) => isGood(flipped(bit)));
}

export class RtuReceiver {
  constructor({ role, baud, bits, patience = null, units = [] }) {
    const { character, t15, t35 } = silences(baud, bits);
    this.character = character / 1000;
    this.strict = patience === null;
    this.silence = Math.max(t35 / 1000, patience ?? 0); // at a low rate t3.5 is longer than the patience
    this.longest = this.strict ? t15 / 1000 : this.silence;
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

  /** The size of the frame that begins with the first byte, if its length is known, and confirmed by the CRC. */
  size() {
    for (const side of this.sides(this.held[0])) {
      const length = lengthOf(side, this.held.slice(1));
      const size = length + 3;
      if (length && size <= this.held.length && isGood(this.held.slice(0, size))) return size;
    }
    return 0;
  }

  /** Frames whose count is complete. Where it is and the CRC is wrong, nothing is a frame before the silence. */
  count() {
    const events = [];
    for (let size = this.held.length && this.size(); size; size = this.held.length && this.size()) {
      events.push(shown(rtu.decode(this.held.splice(0, size))));
    }
    return events;
  }

  /** Silence: what is held is one frame, or several behind stray bytes with nothing left over, or it is noise. */
  close() {
    const { frame, reason } = attempt(() => rtu.decode(this.held));
    const events = [];
    if (this.spoiled) events.push(this.noise('silence'));
    else if (frame && this.whole(frame)) {
      events.push(shown(frame));
      this.held = [];
    } else if (frame) events.push(this.noise('short'));
    else events.push(...(this.strict ? [] : this.divide()));
    if (this.held.length) events.push(this.noise(reason));
    this.spoiled = false;
    return events;
  }

  /** The frames behind up to four bytes 00 or FF. The data of one damaged frame can spell another: that is none. */
  divide() {
    if (isOneBitOff(this.held)) return [];
    for (let strays = 0; strays <= 4 && this.held.slice(0, strays).every((byte) => byte === 0 || byte === 0xff); strays += 1) {
      const sizes = this.sizesFrom(strays);
      if (sizes) {
        const noise = strays ? [{ noise: showBytes(this.held.splice(0, strays)), reason: 'checksum' }] : [];
        return [...noise, ...sizes.map((size) => this.told(this.held.splice(0, size)))];
      }
    }
    return [];
  }

  /** The sizes of frames with good CRCs that fill the bytes from here to the end; null if something is left over. */
  sizesFrom(start) {
    if (start === this.held.length) return [];
    for (let size = 4; start + size <= this.held.length; size += 1) {
      const rest = isGood(this.held.slice(start, start + size)) && this.sizesFrom(start + size);
      if (rest) return [size, ...rest];
    }
    return null;
  }

  /** A frame as an event. A request is noise for a client: it is the echo of its own. */
  told(bytes) {
    const frame = rtu.decode(bytes);
    const isKnown = lengthOf('response', frame.pdu) != null;
    const isEcho = this.role === 'client' && isKnown && !!attempt(() => decodePdu('response', frame.pdu)).reason;
    return isEcho ? { noise: showBytes(bytes), reason: 'checksum' } : shown(frame);
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
