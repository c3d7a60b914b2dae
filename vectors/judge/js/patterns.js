'use strict';
// Whether what a running server or device sent is accepted: patterns of server-conformance and device-conformance.

/** server-conformance: a row of texts, one for each step; in them .. is any byte, ... any rest. */
function fitsOneRow(rows, texts) {
  const isFitting = (pattern, text) => {
    let [wanted, found] = [pattern, text].map((one) => one.split(' ').filter(Boolean));
    if (wanted.at(-1) === '...') [wanted, found] = [wanted.slice(0, -1), found.slice(0, wanted.length - 1)];
    return wanted.length === found.length && wanted.every((byte, place) => byte === found[place] || /^\.\.;*$/.test(byte));
  };
  const isRow = Array.isArray(texts) && texts.every((text) => typeof text === 'string');
  return isRow && rows.some((row) => row.length === texts.length && row.every((pattern, place) => isFitting(pattern, texts[place])));
}

/** device-conformance: the frames of each step fit a pattern of `accept`; one of `ends` ends the case. */
function isAccepted(steps, received) {
  if (!Array.isArray(steps) || !Array.isArray(received) || !received.every(Array.isArray)) return false;
  for (const [place, { accept = [''], ends = [] }] of steps.entries()) {
    const fits = (pattern) => fitsFrames(pattern.split(/,(?![0-9]+\})/).map((part) => part.trim()).filter(Boolean), received[place]);
    if (place >= received.length) return false;
    if (ends.some(fits)) return received.length === place + 1;
    if (!accept.some(fits)) return false;
  }
  return steps.length > 0 && received.length === steps.length;
}

function fitsFrames([part, ...parts], frames) {
  if (part === undefined) return frames.length === 0;
  const [, frame, least = 1, most = least] = /^([^{]*)(?:\{(\d+),(\d+)\})?$/.exec(part);
  const isOne = (text) => typeof text === 'string' && frame.split('|').some((alternative) => fitsFrame(alternative, text));
  for (let count = 0; count <= most; count += 1) {
    if (count >= least && fitsFrames(parts, frames.slice(count))) return true;
    if (count >= frames.length || !isOne(frames[count])) return false;
  }
  return false;
}

const fitsFrame = (pattern, text) => new RegExp(`^(?:${pattern.replaceAll('.', '[0-9A-F]')})$`).test(text);

module.exports = { fitsFrame, fitsOneRow, isAccepted };
