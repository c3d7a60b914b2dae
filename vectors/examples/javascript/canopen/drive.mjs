// The device control of CiA 402: status words, control words, and the state machine from both ends.

import { hex, refuseUnless } from '../hex.mjs';

const STATES = {
  'not ready to switch on': [0x4f, 0x00],
  'switch on disabled': [0x4f, 0x40],
  'ready to switch on': [0x6f, 0x21],
  'switched on': [0x6f, 0x23],
  'operation enabled': [0x6f, 0x27],
  'quick stop active': [0x6f, 0x07],
  'fault reaction active': [0x4f, 0x0f],
  fault: [0x4f, 0x08],
};

const COMMANDS = {
  shutdown: { mask: 0x87, value: 0x06, transitions: [2, 6, 8] },
  'switch on': { mask: 0x8f, value: 0x07, transitions: [3] },
  'disable voltage': { mask: 0x82, value: 0x00, transitions: [7, 9, 10, 12] },
  'quick stop': { mask: 0x86, value: 0x02, transitions: [7, 10, 11] },
  'disable operation': { mask: 0x8f, value: 0x07, transitions: [5] },
  'enable operation': { mask: 0x8f, value: 0x0f, transitions: [4, 16] },
  'fault reset': { mask: 0x80, value: 0x80, transitions: [15] },
};

function stateOf(word, reason) {
  const found = Object.keys(STATES).find((name) => (word & STATES[name][0]) === STATES[name][1]);
  refuseUnless(found, reason, `no state has ${hex(word, 4)}`);
  return found;
}

const row = (mask, value) => ({ mask: hex(mask, 4), masked: hex(value, 4) });
const known = (table, name) => {
  refuseUnless(name in table, 'value', name);
  return table[name];
};

// ------------------------------------------------------------------------------------------------------------ the drive

/** What each command does in each state: the state behind the transition. */
const STEPS = {
  'switch on disabled': { shutdown: 'ready to switch on' },
  'ready to switch on': {
    'switch on': 'switched on', 'enable operation': 'operation enabled', // 000F: the transitions 3 and 4
    'disable voltage': 'switch on disabled', 'quick stop': 'switch on disabled',
  },
  'switched on': {
    'enable operation': 'operation enabled', shutdown: 'ready to switch on', 'disable voltage': 'switch on disabled',
    'quick stop': 'switch on disabled',
  },
  'operation enabled': {
    'disable operation': 'switched on', shutdown: 'ready to switch on', 'disable voltage': 'switch on disabled',
    'quick stop': 'quick stop active',
  },
  'quick stop active': { 'disable voltage': 'switch on disabled' },
};

function drive({ state, before, stays = false, words }) {
  let [now, last] = [state, parseInt(before, 16)];
  known(STATES, now);
  const states = words.map((text) => {
    const word = parseInt(text, 16);
    const edge = (word & 0x80) !== 0 && (last & 0x80) === 0;
    last = word;
    if (now === 'fault') now = edge ? 'switch on disabled' : now;
    else {
      const commands = Object.keys(COMMANDS).filter((name) => (word & COMMANDS[name].mask) === COMMANDS[name].value);
      const steps = { ...STEPS[now] };
      if (now === 'quick stop active' && stays) steps['enable operation'] = 'operation enabled';
      const taken = commands.find((name) => name in steps);
      if (taken) now = steps[taken];
    }
    return now;
  });
  return { states };
}

// ----------------------------------------------------------------------------------------------------------- the master

const ORDER = ['switch on disabled', 'ready to switch on', 'switched on', 'operation enabled'];
const UP = { 'switch on disabled': 0x06, 'ready to switch on': 0x07, 'switched on': 0x0f };
const DOWN = { 'switch on disabled': 0x00, 'ready to switch on': 0x06, 'switched on': 0x07 };

/** The next control word on the way to a goal; null: wait. */
function next(goal, state, stays) {
  if (state === goal || state === 'not ready to switch on' || state === 'fault reaction active') return null;
  if (goal === 'quick stop active') {
    refuseUnless(state === 'operation enabled', 'value', `no quick stop in ${state}`);
    return 0x02;
  }
  if (state === 'fault') return 0x80;
  if (state === 'quick stop active') return stays && goal === 'operation enabled' ? 0x0f : 0x00;
  return ORDER.indexOf(state) < ORDER.indexOf(goal) ? UP[state] : DOWN[goal];
}

function master({ goal, stays = false, seen }) {
  refuseUnless(ORDER.includes(goal) || goal === 'quick stop active', 'value', `no way to ${goal}`);
  let last = 0;
  const words = seen.map((text) => {
    const word = next(goal, stateOf(parseInt(text, 16), 'value'), stays);
    if (word === null) return null;
    last = word === 0x80 && last === 0x80 ? 0x00 : word; // a fault needs a rising edge
    return hex(last, 4);
  });
  return { words };
}

export const KINDS = {
  'drive-state': {
    bits({ word }) {
      const number = parseInt(word, 16);
      return { bits: [...Array(16).keys()].filter((k) => (number >> k) & 1) };
    },
    decode: ({ word }) => ({ state: stateOf(parseInt(word, 16), 'value') }),
    table: ({ state }) => row(...known(STATES, state)),
  },
  'drive-command': {
    decode({ word, command }) {
      const { mask, value } = known(COMMANDS, command);
      return { matches: (parseInt(word, 16) & mask) === value };
    },
    table({ command }) {
      const { mask, value, transitions } = known(COMMANDS, command);
      return { ...row(mask, value), transitions };
    },
  },
  'drive-path': { decode: drive, encode: master },
};
