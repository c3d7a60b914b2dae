// The world of a simulated machine: a switch or a field for each property of its environment, and for each fault that its
// line can have. The lists come from the simulator; what another browser sets is shown here too.

import { element } from "./dom.js";

/** Show the world in a section; `send(path, name, text)` sets a property or a fault, and returns what the panel answers.
    Returns a function that takes each new state. */
export function showWorld(section, send) {
  section.hidden = false;
  const status = section.querySelector("[role=status]");
  const [environment, faults] = section.querySelectorAll(".fields");
  const changers = new Map();  // kind and name -> shows a new state in its row
  const set = async (path, name, text) => {
    try {
      status.textContent = (await send(path, name, text)).result;
      status.className = "good";
    } catch (error) {
      status.textContent = error.message;
      status.className = "bad";
    }
  };
  const row = (target, make) => (state) => {
    const key = `${target.dataset.path} ${state.name}`;
    if (!changers.has(key)) changers.set(key, make(target, state));
    changers.get(key)(state);
  };
  return (world) => {
    world.environment.forEach(row(environment, (target, state) => propertyRow(target, state, set)));
    world.faults.forEach(row(faults, (target, state) => faultRow(target, state, set)));
    const active = world.faults.filter(({ share }) => share).map(({ name, count }) => `${name} (${count})`);
    section.querySelector("summary span").textContent = active.length ? `faults: ${active.join(", ")}` : "no fault";
  };
}

const toggle = (attributes) => element("input", { type: "checkbox", role: "switch", ...attributes });

const titled = (name, meaning) => element("span", {}, element("b", {}, name), " ", element("small", {}, meaning));

/** Show a value in an input, unless it is being typed. */
function show(input, value) {
  if (document.activeElement !== input) input.value = value;
}

function propertyRow(target, { name, meaning, expected, choices }, set) {
  const isSwitch = choices.join() === "off,on";
  const change = () => set("world", name, isSwitch ? (input.checked ? "on" : "off") : input.value);
  const input = isSwitch ? toggle({ onchange: change })
    : choices.length ? element("select", { onchange: change }, ...choices.map((text) => element("option", {}, text)))
    : element("input", { onchange: change, title: `expected ${expected}`, autocomplete: "off", size: 12 });
  target.append(element("label", {}, input, titled(name, meaning)));
  return ({ text }) => { isSwitch ? input.checked = text === "on" : show(input, text); };
}

function faultRow(target, { name, meaning, value }, set) {
  const change = () => set("fault", name, on.checked ? `${name}${worth ? `=${worth.value}` : ""}:${share.value / 100}` : "");
  const changeIfOn = () => { if (on.checked) change(); };
  const number = (label, attributes) =>
    element("input", { onchange: changeIfOn, size: 4, "aria-label": `${name}: ${label}`, ...attributes });
  const on = toggle({ onchange: change });
  const share = number("percent of the responses", { value: 10, inputmode: "decimal" });
  const worth = value ? number(name === "exception" ? "code" : "seconds", { value }) : null;
  const count = element("small", {});
  target.append(element("div", {}, element("label", {}, on, titled(name, meaning)),
    element("span", { class: "worth" }, ...(worth ? [worth, name === "exception" ? " h, " : " s, "] : []), share, " % ", count)));
  return (state) => {
    on.checked = state.share > 0;
    if (state.share) show(share, state.share);
    if (worth) show(worth, state.value);
    count.textContent = state.count ? `${state.count} so far` : "";
  };
}
