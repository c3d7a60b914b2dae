#!/usr/bin/env node
'use strict';
// The command of the package: runs the cases against an adapter (START.md), without Python.

const { writeFileSync } = require('node:fs');
const { parseArgs } = require('node:util');
const { answers } = require('./ask.js');
const vectors = require('./index.js');
const { judge } = require('./judge/js/judge.js');
const { fill } = require('./judge/js/fill.js');

const USAGE = `barewire-vectors ${vectors.version}

barewire-vectors check [options] -- COMMAND ...   run the cases against the adapter COMMAND
barewire-vectors list [options]                   the cases of a choice, or the profiles

  --profiles        with list: the profiles, and how many cases each has
  --profile NAME    only the cases of a profile
  --kind KIND       only cases of this kind; may come again
  --only PATTERN    only these ids, files or folders: 'rtu/*'; may come again
  --timeout SECONDS from one answer to the next (10)
  --junit FILE      also write JUnit XML
  --badge FILE      also write a badge, .svg or .json

Exit status 1 if a case has failed, or if nothing has passed; 2 if the command cannot be carried out.
`;
const STATES = ['passed', 'open', 'failed', 'not offered'];
const OPTIONS = {
  ...Object.fromEntries(['profile', 'timeout', 'junit', 'badge'].map((name) => [name, { type: 'string' }])),
  ...Object.fromEntries(['kind', 'only'].map((name) => [name, { type: 'string', multiple: true, default: [] }])),
  profiles: { type: 'boolean' },
  help: { type: 'boolean' },
};

class Mistake extends Error {}

function chosen({ profile, kind, only }) {
  if (profile !== undefined && !Object.hasOwn(vectors.profiles, profile)) {
    throw new Mistake(`profile ${profile}: expected one of ${Object.keys(vectors.profiles).join(', ')}`);
  }
  for (const name of kind) if (!Object.hasOwn(vectors.kinds, name)) throw new Mistake(`kind ${name}: there is no such kind`);
  const fits = (one) => {
    const [folder, name] = one.file.split('/');
    return [one.id, one.file, folder, name].some((text) => only.some((pattern) => vectors.fits(pattern, text)));
  };
  const cases = (profile === undefined ? vectors.cases : vectors.inProfile(profile))
    .filter((one) => (!kind.length || kind.includes(one.kind)) && (!only.length || fits(one)));
  if (!cases.length) throw new Mistake('no case fits the options; barewire-vectors list shows all');
  return cases;
}

function list(options) {
  if (options.profiles) {
    for (const [name, { about }] of Object.entries(vectors.profiles)) {
      console.log(`${name.padEnd(16)}${String(vectors.inProfile(name).length).padStart(6)} cases   ${about}`);
    }
  } else {
    for (const { id, case: one } of chosen(options)) console.log(`${id.padEnd(32)} ${one.result.padEnd(11)} ${one.comment ?? ''}`);
  }
  return 0;
}

/** A text of a foreign program without control characters. */
const printable = (text) => text.replace(/[\p{Cc}\p{Cs}]/gu, '?');
const short = (value) => ((text) => (text.length > 300 ? `${text.slice(0, 300)}...` : text))(JSON.stringify(value) ?? 'nothing');

function judged(row, answer) {
  if (answer.failure !== undefined) return { state: 'failed', text: answer.failure };
  const filled = row.question.kind === 'device-conformance' ? fill(row.question, answer.is?.device) : undefined;
  const state = judge({ ...row, answer, filled });
  const expected = row.result === 'invalid' && row.fails !== 'compare' ? `refused as ${row.reason}` : short(row.expected);
  const text = answer.not_offered ?? `answered ${short(answer.is ?? answer)}, expected ${row.fails === 'compare' ? 'other values than ' : ''}${expected}`;
  return { state, text: state === 'passed' ? '' : `${row.question.do}: ${text}` };
}

/** The verdict on a case: the worst one of its questions; of a case that compares the best one. */
function verdict(one, verdicts) {
  const order = one.case.fails === 'compare' ? ['passed', 'open', 'failed', 'not offered'] : ['failed', 'open', 'passed', 'not offered'];
  return verdicts.reduce((worst, next) => (order.indexOf(next.state) < order.indexOf(worst.state) ? next : worst));
}

async function check(options, words) {
  if (!words.length) throw new Mistake('check: a command is needed, behind --: barewire-vectors check -- ./my-adapter');
  const timeout = Number(options.timeout ?? 10);
  if (!(timeout > 0)) throw new Mistake(`--timeout ${options.timeout}: expected seconds`);
  if (options.badge !== undefined && !/\.(svg|json)$/.test(options.badge)) throw new Mistake(`--badge ${options.badge}: expected a name that ends with .svg or .json`);
  if (options.badge !== undefined && (options.kind.length || options.only.length)) throw new Mistake('--badge: is for a whole profile, or for all cases');
  const cases = chosen(options);
  const byCase = grouped(vectors.questions());
  const { hello, found } = await answers(words, cases.flatMap((one) => byCase.get(one.id)), timeout * 1000)
    .catch((error) => { throw new Mistake(`adapter ${words.join(' ')}: ${error.message}`); });
  const name = printable(`${hello.name ?? words[0]} ${hello.version ?? ''}`.trim());
  const checked = cases.map((one) => ({
    ...one, ...verdict(one, byCase.get(one.id).map((row) => judged(row, found.get(row.question.id)))),
  }));
  for (const { id, case: one, state, text } of checked) {
    if (state === 'failed') console.log(`failed  ${id}  ${one.comment ?? ''}\n    ${printable(text)}`);
  }
  const total = report(checked, name);
  if (options.junit !== undefined) writeFileSync(options.junit, junit(checked, name));
  if (options.badge !== undefined) writeFileSync(options.badge, badge(options.profile ?? 'vectors', total, options.badge.endsWith('.json')));
  return total.failed || !total.passed ? 1 : 0;
}

function grouped(rows) {
  const groups = new Map();
  for (const row of rows) {
    if (!groups.has(row.case)) groups.set(row.case, []);
    groups.get(row.case).push(row);
  }
  return groups;
}

const counts = (checked) => Object.fromEntries(STATES.map((state) => [state, checked.filter((one) => one.state === state).length]));

function report(checked, name) {
  const total = counts(checked);
  const kinds = [...new Set(checked.map((one) => one.kind))];
  const width = Math.max(4, ...kinds.map((kind) => kind.length));
  const line = (first, cells) => console.log(first.padEnd(width) + cells.map((cell) => String(cell || '').padStart(13)).join(''));
  line('', STATES);
  for (const kind of kinds) line(kind, Object.values(counts(checked.filter((one) => one.kind === kind))));
  line('all', Object.values(total));
  const rest = total['not offered'] ? `, ${total['not offered']} not offered` : '';
  console.log(`${name}: ${total.passed} of ${checked.length} cases passed${rest}`);
  return total;
}

const xml = (text) => text.replace(/[&<>"]/g, (mark) => ({ '&': '&amp;', '<': '&lt;', '>': '&gt;', '"': '&quot;' })[mark]);

function junit(checked, name) {
  const suites = [...new Set(checked.map((one) => one.file))].map((file) => {
    const rows = checked.filter((one) => one.file === file);
    const { failed, open, 'not offered': missing } = counts(rows);
    const cases = rows.map(({ id, state, text }) => {
      const message = xml(printable(state === 'failed' ? text : `${state}: ${text}`));
      const inside = { passed: '', failed: `<failure message="${message}"/>` }[state] ?? `<skipped message="${message}"/>`;
      return `<testcase classname="${file}" name="${id}">${inside}</testcase>`;
    });
    return `<testsuite name="${file}" tests="${rows.length}" failures="${failed}" skipped="${open + missing}">${cases.join('')}</testsuite>`;
  });
  return `<?xml version="1.0" encoding="utf-8"?>\n<testsuites name="barewire vectors: ${xml(name)}">${suites.join('\n')}</testsuites>\n`;
}

function badge(profile, total, asJson) {
  const count = STATES.reduce((sum, state) => sum + total[state], 0);
  const good = total.passed + total.open;
  const colour = total.failed || !good ? '#c03a2b' : good < count ? '#b5860b' : '#3c9a1e';
  const [label, message] = [`${profile} ${vectors.version}`, `${good} of ${count}`];
  if (asJson) return `${JSON.stringify({ schemaVersion: 1, label, message, color: colour.slice(1) })}\n`;
  const [left, right] = [label, message].map((text) => 7 * text.length + 12);
  const text = 'y="14" fill="#fff" font-family="Verdana,DejaVu Sans,sans-serif" font-size="11" text-anchor="middle"';
  return `<svg xmlns="http://www.w3.org/2000/svg" width="${left + right}" height="20" role="img">` +
    `<title>${xml(label)}: ${xml(message)}</title><rect width="${left + right}" height="20" rx="3" fill="#555"/>` +
    `<path d="M${left} 0h${right - 3}a3 3 0 0 1 3 3v14a3 3 0 0 1 -3 3h-${right - 3}z" fill="${colour}"/>` +
    `<text x="${left / 2}" ${text}>${xml(label)}</text><text x="${left + right / 2}" ${text}>${xml(message)}</text></svg>\n`;
}

async function main() {
  const given = process.argv.slice(2);
  const bar = given.indexOf('--');
  const [before, words] = bar < 0 ? [given, []] : [given.slice(0, bar), given.slice(bar + 1)];
  const { values, positionals: [command, ...more] } = parseArgs({ args: before, options: OPTIONS, allowPositionals: true });
  if (values.help || command === undefined) {
    process.stdout.write(USAGE);
    return values.help ? 0 : 2;
  }
  if (more.length || !['check', 'list'].includes(command)) throw new Mistake(`${[command, ...more].join(' ')}: expected check or list, and the adapter behind --`);
  return command === 'list' ? list(values) : check(values, words);
}

for (const signal of ['SIGINT', 'SIGTERM']) process.once(signal, () => process.exit(signal === 'SIGINT' ? 130 : 143));
main().then((status) => { process.exitCode = status; }, (error) => {
  if (process.env.DEBUG) throw error;
  process.stderr.write(`barewire-vectors: ${error.message}\n`);
  process.exitCode = 2;
});
