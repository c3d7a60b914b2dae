// The panel: values by group, the frames of the line, writes with a confirmation. One event stream brings what changes;
// choosing another group opens another stream, so the server polls what is shown and nothing else.

import { element } from "./dom.js";
import { showDrive } from "./drive.js";
import { showRamp } from "./ramp.js";
import { Scope } from "./scope.js";
import { showWorld } from "./world.js";

const at = (id) => document.getElementById(id);
const token = location.hash.slice(1);
const KEPT = 300;  // frames in the list

let device, stream, polls, chosen = null;
const rows = new Map();  // name -> cell of its value
const latest = new Map();  // name -> [value, text, problem]
let held = false, seen = 0, scope, takeStatus = () => {}, takeWorld = () => {}, takeRamp = () => {};

async function asked(path, options) {
  const response = await fetch(path, options);
  const answer = await response.json();
  if (!response.ok) throw new Error(answer.problem);
  return answer;
}

const posted = (path, value) =>
  asked(path, { method: "POST", headers: { "X-Token": token }, body: JSON.stringify(value) });

// Values

function showGroup(group) {
  const body = at("values").tBodies[0];
  body.replaceChildren();
  rows.clear();
  for (const parameter of device.groups[group]) {
    const value = element("td", { class: "value" }, "…");
    const write = element("td");
    if (device.writable && parameter.access !== "ro") {
      const name = element("span", { class: "unseen" }, ` ${parameter.name}`);
      write.append(element("button", { onclick: () => openWrite(parameter) }, "Write", name));
    }
    const heading = element("th", { scope: "row" }, parameter.name, element("small", {}, parameter.place));
    const range = [parameter.range, parameter.range && parameter.unit].filter(Boolean).join(" ");
    body.append(element("tr", parameter.note ? { title: parameter.note } : {}, heading, value,
      element("td", { class: "range" }, range), write));
    if (parameter.access === "wo") value.textContent = "write only";
    else {
      rows.set(parameter.name, value);
      if (latest.has(parameter.name)) showValue(parameter.name);
    }
  }
  listen();
}

function showValue(name) {
  const cell = rows.get(name), [, text, problem] = latest.get(name);
  cell.textContent = problem || text;
  cell.classList.toggle("error", Boolean(problem));
}

// Events

function listen() {
  stream?.close();
  const shown = new Set([...rows.keys(), ...scope.names, ...(device.drive ? [device.drive.status] : []),
    ...(device.ramp ? [device.ramp.status, ...device.ramp.settings.map(({ name }) => name)] : [])]);
  const names = new URLSearchParams([...shown].map((name) => ["name", name]));
  stream = new EventSource(`events?${names}`);
  stream.onmessage = (message) => take(JSON.parse(message.data));
  stream.onerror = () => {
    showState(false, "no connection to the panel: trying again");
    if (stream.readyState === EventSource.CLOSED) setTimeout(listen, 2000);
  };
}

function take(event) {
  if (event.revision < seen) seen = 0;  // the panel was started again
  const since = event.for < 60 ? `${Math.round(event.for)} s` : `${Math.round(event.for / 60)} min`;
  showState(event.alive, event.alive ? "answers" : `no answer for ${since}: ${event.problem}`);
  for (const [name, value] of Object.entries(event.values)) {
    latest.set(name, value);
    if (rows.has(name)) showValue(name);
    takeRamp(name, value[2] || value[1]);
    if (name === device.drive?.status && value[0] !== null) takeStatus(value[0]);
  }
  if (event.alive && event.polls !== polls) scope.take(event.at, scope.names.map((name) => latest.get(name)?.[0]));
  polls = event.polls;
  if (event.diagnosis) showDiagnosis(event.diagnosis);
  if (event.world) takeWorld(event.world);
  if (!held) showFrames(event.frames.filter(([number]) => number > seen));
  seen = Math.max(seen, event.revision);
}

function showState(alive, text) {
  document.body.className = alive ? "alive" : "dead";
  if (at("state-text").textContent !== text) at("state-text").textContent = text;
}

// Diagnosis

function showDiagnosis({ exchanges, verdicts, findings }) {
  const [wrong, well] = at("diagnosis-title").children, said = verdicts.map(([text]) => text).join("; ");
  at("diagnosis").hidden = false;
  if (wrong.textContent !== said) wrong.textContent = said;  // only then it is read aloud
  well.textContent = said ? "" : `nothing wrong in the last ${exchanges} exchanges`;
  at("diagnosis").querySelector("ul").replaceChildren(...verdicts.map(([, evidence]) => element("li", {}, evidence)),
    ...findings.map(([time, text]) => element("li", { class: "soft" }, `${time} s  ${text}`)));
}

// Frames

function showFrames(frames) {
  const list = at("frames").firstElementChild, box = at("frames");
  const atEnd = box.scrollTop + box.clientHeight >= box.scrollHeight - 8;
  for (const [number, direction, digits, verdict, valid] of frames) {
    const button = element("button", { onclick: () => explain(number, button), title: verdict },
      `${direction === "sent" ? "→" : "←"} `, element("span", { class: "unseen" }, direction), digits);
    if (!valid) button.classList.add("bad");
    const item = element("li", { class: valid ? "valid" : "wrong" }, button);
    item.hidden = valid && at("bad-only").checked;
    list.append(item);
  }
  while (list.childElementCount > KEPT) list.firstElementChild.remove();
  if (atEnd) box.scrollTop = box.scrollHeight;
}

async function explain(number, button) {
  chosen?.removeAttribute("aria-current");
  chosen = button;
  button.setAttribute("aria-current", "true");
  const target = at("explained");
  try {
    const frame = await asked(`frame?number=${number}`);
    const table = element("table", {}, element("tbody", {}, ...frame.fields.map((field) =>
      element("tr", {}, ...field.map((text, column) => element("td", column === 0 ? { class: "m" } : {}, text))))));
    target.replaceChildren(element("p", { class: frame.verdict.startsWith("valid") ? "good" : "bad" }, frame.verdict),
      ...frame.findings.map((text) => element("p", {}, text)), table);
  } catch (error) {
    target.replaceChildren(element("p", { class: "bad" }, error.message));
  }
}

// Writes

let written = null;

function openWrite(parameter, text = "") {
  written = parameter;
  at("write-title").textContent = `Write ${parameter.name}`;
  at("write-about").textContent =
    [parameter.place, parameter.range && `${parameter.range} ${parameter.unit}`, parameter.note].filter(Boolean).join(" · ");
  const choice = at("write-choice"), named = Object.entries(parameter.values);
  choice.hidden = !named.length;
  choice.setAttribute("aria-label", "Named values");
  choice.replaceChildren(element("option", { value: "" }, "…"),
    ...named.map(([number, name]) => element("option", { value: number }, `${number} ${name}`)));
  at("write-text").value = text;
  planChanged();
  at("write-result").textContent = "";
  if (!at("write").open) at("write").showModal();
  if (text) showPlan();
  else at("write-text").focus();
}

function planChanged() {
  at("plan").replaceChildren();
  at("send").disabled = true;
  at("send").classList.remove("primary");
  at("show-plan").classList.add("primary");
}

async function showPlan() {
  planChanged();
  const text = at("write-text").value;
  try {
    const plan = await posted("plan", { name: written.name, text });
    if (at("write-text").value !== text) return;
    at("plan").replaceChildren(element("p", {}, `${plan.name} = ${plan.value}: raw ${plan.raw} to ${plan.address}`),
      ...plan.frames.map(([digits, verdict]) =>
        element("div", { class: "frame" }, element("span", { class: "m" }, digits), element("br"), verdict)));
    at("send").disabled = false;
    at("send").classList.add("primary");
    at("show-plan").classList.remove("primary");
    at("send").focus();
  } catch (error) {
    at("plan").replaceChildren(element("p", { class: "bad" }, error.message));
  }
}

async function send() {
  const name = written.name, text = at("write-text").value;
  planChanged();
  at("write-result").textContent = "sending …";
  try {
    at("write-result").textContent = (await posted("write", { name, text })).result;
    at("write-result").className = "good";
  } catch (error) {
    at("write-result").textContent = error.message;
    at("write-result").className = "bad";
  }
}

// Start

// A browser opens six connections to one server: a page that nobody sees leaves its own to the others, unless it records.
document.onvisibilitychange = () => {
  if (!document.hidden) listen();
  else if (!scope.names.length) stream.close();
};
at("show-plan").onclick = showPlan;
at("send").onclick = send;
at("write-text").oninput = planChanged;
at("write-text").onkeydown = (event) => { if (event.key === "Enter") { event.preventDefault(); showPlan(); } };
at("write-choice").onchange = () => { at("write-text").value = at("write-choice").value; planChanged(); };
at("hold").onclick = () => { held = !held; at("hold").setAttribute("aria-pressed", held); };
at("bad-only").onchange = () =>
  at("frames").querySelectorAll(".valid").forEach((item) => { item.hidden = at("bad-only").checked; });
at("group").onchange = () => showGroup(at("group").value);

device = await asked("device.json");
document.title = `${device.device} – barewire panel`;
at("device").textContent = device.device;
at("endpoint").textContent = device.endpoint + (device.writable ? "" : " · only reads");
at("group").append(...Object.keys(device.groups).map((group) => element("option", {}, group)));
const parameters = Object.values(device.groups).flat();
const numeric = parameters.filter((row) => row.access !== "wo" && /^[uif]\d/.test(row.type)).map((row) => row.name);
scope = new Scope(at("scope"), numeric, listen);
if (device.drive) {
  const control = parameters.find((row) => row.name === device.drive.control);
  takeStatus = showDrive(at("drive"), device.drive, device.writable && control ? (text) => openWrite(control, text) : null);
}
if (device.ramp) {
  takeRamp = showRamp(at("ramp"), at("scope"), device.ramp, parameters, device.writable && openWrite,
    async (name) => (await posted("read", { name, text: "" })).result);
  scope.choose(device.ramp.traces, () => {});
}
if (device.world) takeWorld = showWorld(at("world"), (path, name, text) => posted(path, { name, text }));
at("group").value = device.first;
showGroup(at("group").value);
