// What may be written into the communication objects of a device. A rule throws Abort; if it gives true, it has done all.

import { NotOffered, characters } from '../hex.mjs';
import { isRestricted } from '../canopen/frames.mjs';
import { Abort } from '../canopen/sdo-server.mjs';
import { cob } from './cob.mjs';

const [INVALID, UNSUPPORTED, UNMAPPABLE, TOO_LONG, CONFLICT] = ['06090030', '06010000', '06040041', '06040042', '06040043'];
const [NOT_STORED, NOT_NOW] = ['08000020', '08000022'];
const RANGES = { 1: [0x1000, 0x9fff], 2: [0x1000, 0x1fff], 3: [0x6000, 0x9fff] };

function refuse(condition, code) {
  if (condition) throw new Abort(code);
}

/** An identifier is free, and is changed only while its service is off, before the write or behind it. */
function checkCob(number, old, isOff) {
  const [now, before] = [cob(number), cob(old)];
  if (!now.extended) {
    refuse(number % 2 ** 29 > 0x7ff, INVALID);
    refuse(isRestricted(now.id), INVALID);
  }
  const changed = now.id !== before.id || now.extended !== before.extended;
  refuse(changed && !isOff(now) && !isOff(before), INVALID);
}

const offByBit31 = ({ bit31 }) => bit31;
const offByBit30 = ({ bit30 }) => !bit30;
const offByBoth = ({ bit30, bit31 }) => !bit30 && !bit31;

export function writeRules(device) {
  const current = (index, sub) => device.number(index, sub);

  function communication(index, sub, number) {
    const sends = index >= 0x1800;
    if (sub === 1) checkCob(number, current(index, 1), offByBit31);
    if (sub === 2) refuse(number >= 241 && number <= (sends ? 251 : 253), INVALID);
    if (sub === 3 || sub === 6) refuse(!isOff(index), INVALID);
  }

  function isOff(index) {
    return !device.dictionary.has(index, 1) || cob(current(index, 1)).bit31;
  }

  function mappingEntry(number, direction) {
    const [index, sub, bits] = [Math.floor(number / 0x10000), Math.floor(number / 0x100) % 0x100, number % 0x100];
    if (index < 0x20) {
      refuse(direction === 'TPDO' || DUMMY_BITS[index] !== bits || sub !== 0, UNMAPPABLE);
      return;
    }
    refuse(!device.dictionary.has(index, sub), UNMAPPABLE);
    const { mapped, size, type } = device.dictionary.entry(index, sub);
    refuse(mapped !== 'both' && mapped !== direction, UNMAPPABLE);
    refuse(size === null || (bits !== size * 8 && !(type === 'BOOLEAN' && bits === 1)), UNMAPPABLE);
  }

  function mapping(index, sub, number) {
    const direction = index >= 0x1a00 ? 'TPDO' : 'RPDO';
    refuse(!isOff(index - 0x200), UNSUPPORTED);
    if (sub > 0) {
      refuse(current(index, 0) !== 0, UNSUPPORTED);
      mappingEntry(number, direction);
      return;
    }
    if (number === 254 || number === 255) throw new NotOffered('no multiplexed PDOs');
    refuse(number > Math.max(...device.dictionary.subs(index)), INVALID);
    let bits = 0;
    for (let k = 1; k <= number; k += 1) {
      mappingEntry(current(index, k), direction);
      bits += current(index, k) % 0x100;
    }
    refuse(bits > 64, TOO_LONG);
  }

  function consumer(sub, number) {
    const node = Math.floor(number / 0x10000);
    if (node === 0 || number % 0x10000 === 0) return;
    for (const other of device.dictionary.subs(0x1016).filter((one) => one > 0 && one !== sub)) {
      const value = current(0x1016, other);
      refuse(Math.floor(value / 0x10000) === node && value % 0x10000 !== 0, CONFLICT);
    }
  }

  function signature(sub, bytes, expected, done) {
    if (sub === 0) return false;
    refuse(characters(bytes) !== expected, NOT_STORED);
    done(RANGES[sub]);
    return true;
  }

  return (index, sub, number, bytes) => {
    if (index === 0x1003) {
      refuse(number !== 0, INVALID);
      device.emergencies.entries = [];
      return true;
    }
    if (index === 0x1005) checkCob(number, current(index, 0), offByBit30);
    if (index === 0x1010) return signature(sub, bytes, 'save', (range) => device.dictionary.save(range));
    if (index === 0x1011) return signature(sub, bytes, 'load', (range) => device.dictionary.forget(range));
    if (index === 0x1012) checkCob(number, current(index, 0), offByBoth);
    if (index === 0x1014) checkCob(number, current(index, 0), offByBit31);
    if (index === 0x1016) consumer(sub, number);
    if (index === 0x1019) {
      refuse(number === 1 || number > 240, INVALID);
      refuse(current(0x1006, 0) !== 0, NOT_NOW);
    }
    if (index >= 0x1200 && index <= 0x12ff) {
      if (sub === 1 || sub === 2) checkCob(number, current(index, sub), offByBit31);
      if (sub === 3) refuse(number < 1 || number > 127, INVALID);
    }
    if ((index >= 0x1400 && index < 0x1600) || (index >= 0x1800 && index < 0x1a00)) communication(index, sub, number);
    if ((index >= 0x1600 && index < 0x1800) || (index >= 0x1a00 && index < 0x1c00)) mapping(index, sub, number);
    return false;
  };
}

/** Data types that a dummy entry may have: BOOLEAN, INTEGER8, 16 and 32, UNSIGNED8, 16 and 32. */
const DUMMY_BITS = { 1: 1, 2: 8, 3: 16, 4: 32, 5: 8, 6: 16, 7: 32 };
