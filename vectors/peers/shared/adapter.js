"use strict";
// What the adapters in JavaScript share: the loop over the lines of JSON, and the vectors' way to write values.

const readline = require("node:readline");

class NotOffered extends Error {}

const octets = (text) => Buffer.from(text.replaceAll(" ", ""), "hex");
const hexed = (data) => (Buffer.from(data).toString("hex").toUpperCase().match(/../g) || []).join(" ");
const bits = (text) => [...text.replaceAll(" ", "")].map((digit) => digit === "1");
const bitted = (values) => (values.map((bit) => (bit ? "1" : "0")).join("").match(/.{1,8}/g) || []).join(" ");
const words = (text) => text.split(" ").filter(Boolean).map((word) => parseInt(word, 16));
const worded = (values) => values.map((value) => value.toString(16).toUpperCase().padStart(4, "0")).join(" ");

/** Return the fields of a CRC from its number. */
function crcFields(crc) {
  const wire = Buffer.alloc(2);
  wire.writeUInt16LE(crc);
  return {crc: worded([crc]), wire: hexed(wire)};
}

/** Answer the questions on standard input. An answer may be a promise; an exception or null is a refusal. */
async function serve(name, answers) {
  const {version} = require(`../node_modules/${name}/package.json`);
  for await (const line of readline.createInterface({input: process.stdin})) {
    const question = JSON.parse(line);
    let answer;
    if ("hello" in question) {
      const kinds = Object.entries(answers).map(([kind, row]) => [kind, Object.keys(row)]);
      answer = {name, version, kinds: Object.fromEntries(kinds)};
    } else {
      try {
        const fields = await answers[question.kind][question.do](question);
        answer = fields === null ? {refused: "", text: "null"} : {is: fields};
      } catch (error) {
        answer = error instanceof NotOffered ? {not_offered: error.message} : {refused: "", text: String(error)};
      }
      answer.id = question.id;
    }
    process.stdout.write(JSON.stringify(answer) + "\n");
  }
}

module.exports = {NotOffered, bits, bitted, crcFields, hexed, octets, serve, worded, words};
