// Calls of Python functions in the worker. Calls made while Python loads wait for it, unless the answer is kept from an
// earlier visit: a link that was opened before shows at once what it showed then.

const KEPT = ["guess", "frame", "log", "eds", "kinds", "steps", "values"];  // their results depend on their values only
const MOST = 100, LONGEST = 4000;  // answers that are kept, and characters of their values

const worker = new Worker("worker.js", { type: "module" });
const waiting = new Map();
let count = 0;
let resolveReady, rejectReady, loaded = false;
const kept = open().catch(() => null);  // a browser may keep nothing

/** Resolves to the version of the package when Python is loaded. */
export const ready = new Promise((resolve, reject) => { [resolveReady, rejectReady] = [resolve, reject]; });

/** Calls `listener(loaded, total)`, in bytes, as Python arrives. */
export function onProgress(listener) {
  worker.addEventListener("message", ({ data }) => { if ("progress" in data) listener(data.progress, data.total); });
}

worker.addEventListener("message", ({ data }) => {
  if ("ready" in data) { loaded = true; resolveReady(data.ready); }
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
  const text = JSON.stringify(values), place = `answers/${name}?${encodeURIComponent(text)}`;
  const answers = KEPT.includes(name) && text.length <= LONGEST ? await kept : null;
  const known = loaded ? null : await answers?.match(place);
  if (known) return known.json();
  await ready;
  const result = await new Promise((resolve, reject) => {
    const id = ++count;
    waiting.set(id, { resolve, reject });
    worker.postMessage({ id, name, text });
  });
  if (answers) keep(answers, place, result).catch(() => {});  // there may be no room
  return result;
}

/** Opens the answers of this version of the package, and deletes those of others. */
async function open() {
  const { digest } = await (await fetch("manifest.json")).json(), mine = `answers-${digest}`;
  const others = (await caches.keys()).filter((name) => name.startsWith("answers-") && name !== mine);
  await Promise.all(others.map((name) => caches.delete(name)));
  return caches.open(mine);
}

async function keep(answers, place, result) {
  await answers.put(place, new Response(JSON.stringify(result)));
  const places = await answers.keys();
  await Promise.all(places.slice(0, -MOST).map((oldest) => answers.delete(oldest)));
}
