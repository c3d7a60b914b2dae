// Calls of Python functions in the worker. Calls made while Python loads wait for it.

const worker = new Worker("worker.js", { type: "module" });
const waiting = new Map();
let count = 0;
let resolveReady, rejectReady;

/** Resolves to the version of the package when Python is loaded. */
export const ready = new Promise((resolve, reject) => { [resolveReady, rejectReady] = [resolve, reject]; });

/** Calls `listener(loaded, total)`, in bytes, as Python arrives. */
export function onProgress(listener) {
  worker.addEventListener("message", ({ data }) => { if ("progress" in data) listener(data.progress, data.total); });
}

worker.addEventListener("message", ({ data }) => {
  if ("ready" in data) resolveReady(data.ready);
  if ("failed" in data) rejectReady(new Error(data.failed));
  if (!("id" in data)) return;
  const { resolve, reject } = waiting.get(data.id);
  waiting.delete(data.id);
  const answer = JSON.parse(data.text);
  if ("error" in answer) reject(new Error(answer.error));
  else resolve(answer.result);
});
worker.addEventListener("error", (event) => rejectReady(new Error(event.message || "the worker did not start")));

/** Returns the result of a function of `bridge`; rejects with the text of its error. */
export async function call(name, values = {}) {
  await ready;
  return new Promise((resolve, reject) => {
    const id = ++count;
    waiting.set(id, { resolve, reject });
    worker.postMessage({ id, name, text: JSON.stringify(values) });
  });
}
