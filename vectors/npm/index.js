'use strict';
// The vectors for programs in JavaScript. README.md tells what the fields of each kind mean.
//
//   const { kinds, cases } = require('barewire-vectors');       // or: import { kinds, cases } from 'barewire-vectors'
//   for (const { id, kind, case: one } of cases) { ... }

const { readFileSync, readdirSync } = require('node:fs');
const { join } = require('node:path');

const read = (...names) => JSON.parse(readFileSync(join(__dirname, ...names), 'utf8'));

exports.version = read('package.json').version;
exports.kinds = read('kinds.json');
exports.schema = read('schema.json');
exports.index = read('index.json');
exports.changes = read('changes.json');
exports.profiles = read('profiles.json');

// Each file: its name as "rtu/crc16", then its fields: format, subject, kind, notes, cases.
exports.files = readdirSync(join(__dirname, 'cases'), { withFileTypes: true })
  .filter((room) => room.isDirectory())
  .flatMap((room) => readdirSync(join(__dirname, 'cases', room.name)).map((name) => [room.name, name]))
  .filter(([, name]) => name.endsWith('.json'))
  .map(([room, name]) => ({ name: `${room}/${name.slice(0, -5)}`, ...read('cases', room, name) }))
  .filter((file) => file.format === 'barewire-vectors/1')
  .sort((one, other) => (`${one.name}.json` < `${other.name}.json` ? -1 : 1)); // as the files in their folders

// Each case, with its id, its kind, and the name of its file.
exports.cases = exports.files.flatMap((file) =>
  file.cases.map((one) => ({ id: one.id, kind: file.kind, file: file.name, case: one })),
);

// Each question of each case: the line for an adapter, the expected fields, and what the verdict depends on.
exports.questions = () =>
  readFileSync(join(__dirname, 'questions.jsonl'), 'utf8').trimEnd().split('\n').map((line) => JSON.parse(line));

/** Whether a text fits a pattern, in which * stands for any characters. */
exports.fits = (pattern, text) =>
  new RegExp(`^${pattern.split('*').map((part) => part.replace(/[^\w/-]/g, '\\$&')).join('.*')}$`).test(text);

// The cases of a profile, as in `cases`: profiles.json has its rules.
exports.inProfile = (name) => {
  const { kinds, files = ['*'], without_kinds: withoutKinds = [], without = [], without_lines: lines = [], first = Infinity } =
    exports.profiles[name];
  const counts = {};
  return exports.cases.filter(({ kind, file, case: one }) => {
    const isThere = (kinds ?? [kind]).includes(kind) && !withoutKinds.includes(kind) && files.some((pattern) => exports.fits(pattern, file));
    if (!isThere || (one.flags ?? []).some((flag) => without.includes(flag)) || lines.includes(one.server?.line)) return false;
    counts[file] = (counts[file] ?? 0) + 1;
    return counts[file] <= first;
  });
};
