'use strict';
// The verdict on one answer, by ../../PROTOCOL.md: judge(row) is "passed", "open", "failed" or "not offered".
// A row is a line of questions.jsonl with the `answer` to its question; of device-conformance also `filled`, by fill.js.
//
// As a program it reads rows from standard input and writes a line for each: the id of the question, a blank, the verdict.

const { equal, isExcluded, isObject } = require('./equal.js');
const { fitsOneRow, isAccepted } = require('./patterns.js');

const MAY_REFUSE = ['drive-state.decode', 'drive-command.decode'];

const form = (value) => (value === null ? 'null' : Array.isArray(value) ? 'list' : typeof value);

function judge(row) {
  const { question, expected, answer } = row;
  if (!isObject(answer) || ['is', 'refused', 'not_offered'].filter((name) => Object.hasOwn(answer, name)).length !== 1) return 'failed';
  if (Object.hasOwn(answer, 'not_offered')) return 'not offered';
  if (Object.hasOwn(answer, 'is') ? !isObject(answer.is) : typeof answer.refused !== 'string') return 'failed';
  const { is: fields, refused } = answer;
  const operation = `${question.kind}.${question.do}`;
  const result = operation === 'eds.check' && row.result === 'acceptable' ? 'valid' : row.result;
  if (result === 'invalid' && row.fails !== 'compare') return refused === '' || refused === row.reason ? 'passed' : 'failed';
  const same = fields !== undefined && asExpected(row, fields);
  if (result === 'invalid') {
    if (fields === undefined) return MAY_REFUSE.includes(operation) ? 'passed' : 'open';
    return same || !hasForm(expected, fields) ? 'failed' : 'passed';
  }
  if (result === 'acceptable' && question.do === 'encode') {
    const isWrong = same && (row.flags ?? []).includes('tolerant');
    return fields !== undefined && (isWrong || !hasForm(expected, fields)) ? 'failed' : 'passed';
  }
  if (same) return 'passed';
  return result === 'acceptable' && !(fields && isExcluded(expected, fields, question)) ? 'open' : 'failed';
}

/** Whether the fields could be an answer of another case: none is missing, empty, or of another type of JSON. */
function hasForm(expected, fields) {
  const isEmpty = (value) => value === '' || (typeof value === 'object' && value !== null && Object.keys(value).length === 0);
  return Object.entries(expected).every(([name, value]) =>
    Object.hasOwn(fields, name) && form(fields[name]) === form(value) && (isEmpty(value) || !isEmpty(fields[name])));
}

function asExpected(row, fields) {
  const { question, expected } = row;
  if (question.kind === 'device-conformance') return isAccepted(row.filled, fields.received);
  if (question.kind === 'server-conformance') return fitsOneRow(expected.answers, fields.answers);
  return equal(expected, fields, '', String((question.parameter ?? question).type ?? ''), question);
}

module.exports = { judge };
if (require.main === module) {
  require('node:readline').createInterface({ input: process.stdin }).on('line', (line) => {
    const row = JSON.parse(line);
    console.log(`${row.question.id} ${judge(row)}`);
  });
}
