'use strict';
// Asks an adapter: answers(words, rows, timeout) resolves to the answers by the id of their question, and its hello.
//
// Questions do not wait for answers: up to WINDOW are under way. A program that ends, or does not answer in time, is
// started again: the first question without an answer has failed, the others are asked again. After LOST_MOST such
// losses the rest has failed. An answer that there is not has a `failure` in its place.

const { spawn } = require('node:child_process');

const [WINDOW, LOST_MOST, LINE_LONGEST, START_TIMEOUT] = [64, 20, 1 << 20, 30000];
const HELLO = { hello: 'barewire-vectors', protocol: 1 };
const shown = (text) => JSON.stringify(text.length > 300 ? `${text.slice(0, 300)}...` : text);

function answers(words, rows, timeout) {
  return new Promise((resolve, reject) => {
    const found = new Map(); // id of a question -> its answer
    const sent = new Set();
    let [queue, waiting, lost] = [[...rows].reverse(), new Map(), 0];
    let hello = null;
    let child, timer, held, complaint, isGreeted;

    function start() {
      [held, complaint, isGreeted] = ['', '', false];
      child = spawn(words[0], words.slice(1), { stdio: 'pipe', detached: process.platform !== 'win32' });
      const mine = child;
      child.stdin.on('error', () => {}); // it has ended, which `close` tells
      child.on('error', (error) => mine === child && lose(error.code === 'ENOENT' ? 'there is no such program' : error.message));
      child.on('close', (code, signal) => mine === child && lose(`it ended without an answer (${signal ?? `exit status ${code}`})`));
      child.stdout.setEncoding('utf8').on('data', (text) => mine === child && receive(text));
      child.stderr.setEncoding('utf8').on('data', (text) => {
        complaint = (complaint + text).trimEnd().split('\n').pop().slice(-500);
      });
      wait(START_TIMEOUT);
      send(HELLO);
    }

    const send = (message) => child.stdin.write(`${JSON.stringify(message)}\n`);
    function wait(time) {
      clearTimeout(timer);
      const [toWhat, hint] = isGreeted ? ['', ''] : [' to the hello', '; is its input read line by line, and its output flushed after each line?'];
      timer = setTimeout(() => lose(`no answer${toWhat} within ${time / 1000} s${hint}`), time);
    }
    function end() {
      clearTimeout(timer);
      const ended = child;
      child = null;
      try {
        if (process.platform === 'win32') ended.kill();
        else process.kill(-ended.pid, 'SIGKILL');
      } catch { /* it has ended */ }
    }
    process.once('exit', () => child && end());

    function receive(text) {
      const lines = (held + text).split('\n');
      held = lines.pop();
      if (held.length > LINE_LONGEST) return lose('a line of more than 1 MiB');
      for (const line of lines) if (child) take(line);
    }

    function take(line) {
      let answer = null;
      try { answer = JSON.parse(line); } catch { /* told below */ }
      const isObject = typeof answer === 'object' && answer !== null && !Array.isArray(answer);
      if (!isGreeted) return greet(isObject ? answer : {}, line);
      if (isObject && waiting.has(answer.id)) {
        found.set(answer.id, answer);
        waiting.delete(answer.id);
      } else if (isObject && sent.has(answer.id)) {
        return; // a second answer
      } else {
        failFirst(`its line is no answer to a question: ${shown(line)}`);
      }
      if (waiting.size) wait(timeout);
      ask();
    }

    function greet(answer, line) {
      const { kinds } = answer;
      if (typeof kinds !== 'object' || kinds === null || !Object.values(kinds).every(Array.isArray)) {
        end();
        return reject(new Error(`its hello needs "kinds": {"crc16": ["encode"], ...}, not ${shown(line)}`));
      }
      [hello, isGreeted] = [answer, true];
      clearTimeout(timer);
      ask();
    }

    function ask() {
      while (waiting.size < WINDOW && queue.length) {
        const { question } = queue.pop();
        const { id, kind, do: operation } = question;
        if (!Object.hasOwn(hello.kinds, kind) || !hello.kinds[kind].includes(operation)) {
          found.set(id, { not_offered: `${hello.name} does not offer ${kind}.${operation}` });
          continue;
        }
        if (!waiting.size) wait(timeout);
        waiting.set(id, { question });
        sent.add(id);
        send(question);
      }
      if (waiting.size) return;
      child.stdin.end();
      const last = child;
      const ending = setTimeout(() => last === child && end(), 1000);
      child.removeAllListeners('close').once('close', () => {
        clearTimeout(ending);
        clearTimeout(timer);
        child = null;
        resolve({ hello, found });
      });
      if (child.exitCode !== null || child.signalCode !== null) child.emit('close');
    }

    function failFirst(text) {
      const [id] = waiting.keys();
      if (id === undefined) return;
      found.set(id, { failure: complaint ? `${text}: ${complaint}` : text });
      waiting.delete(id);
    }

    function lose(text) {
      if (child) end();
      clearTimeout(timer);
      if (!isGreeted) return reject(new Error(complaint ? `${text}: ${complaint}` : text));
      failFirst(text);
      lost += 1;
      queue.push(...[...waiting.values()].reverse());
      waiting.clear();
      if (lost < LOST_MOST) return start();
      for (const { question } of queue) found.set(question.id, { failure: `not asked: the adapter was lost ${lost} times` });
      return resolve({ hello, found });
    }

    start();
  });
}

module.exports = { answers };
