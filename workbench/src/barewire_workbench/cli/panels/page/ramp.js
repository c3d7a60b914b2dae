// A motor that is started and stopped: its status, the commands, the settings of its ramp, and the scope beside them.

import { element } from "./dom.js";

/** Show the ramp in a section, with the scope in it. `openWrite(parameter, text)` begins a write, if one may write;
    `read(name)` reads a setting of a menu. Returns a function that takes the name of each new value and its text. */
export function showRamp(section, scope, ramp, parameters, openWrite, read) {
  section.hidden = false;
  section.append(scope);
  const cells = new Map([[ramp.status, section.querySelector("h2 span")]]);
  const status = section.querySelector("p");
  const button = (label, onclick, about = "") =>
    element("button", { onclick }, label, element("span", { class: "unseen" }, about));
  const write = (parameter, label, about) =>
    button(label, () => openWrite(parameter, label === "Write" ? "" : Object.keys(parameter.values)[0] ?? "1"), about);
  const named = (name) => parameters.find((parameter) => parameter.name === name);
  if (openWrite) section.querySelector(".buttons").append(write(named(ramp.start), "Start"), write(named(ramp.stop), "Stop"));
  section.querySelector("tbody").append(...ramp.settings.map((setting) => {
    const { name, place, menu } = setting, value = element("td", { class: "value" }, menu ? "not read" : "…");
    const readNow = async () => {
      try {
        status.textContent = `${name}: ${await read(name)}`;
      } catch (error) {
        status.textContent = error.message;
      }
    };
    cells.set(name, value);
    return element("tr", {}, element("th", { scope: "row" }, name, element("small", {}, place)), value, element("td", {},
      ...(openWrite ? [...(menu ? [button("Read", readNow, ` ${name}`), " "] : []), write(setting, "Write", ` ${name}`)] : [])));
  }));
  return (name, text) => { if (cells.has(name)) cells.get(name).textContent = text; };
}
