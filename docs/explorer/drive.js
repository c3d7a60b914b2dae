// The view of a simulated drive: commands and settings go to it as frames; a plot and the state machine show what it does.

import { at, formValues, make, showError } from "./page.js";
import { call } from "./python.js";

const PERIOD = 100;   // milliseconds between two readings
const SHOWN = 20;     // seconds in the plot
const FRAMES = 200;   // rows in the table

export function driveView(remember) {
  const form = at("drive-form"), settings = at("drive-settings"), state = at("drive-state");
  let device = null, samples = [], last = 0, clock = 0, path = -1;

  async function power() {
    const chosen = formValues(form).device;
    remember({ device: chosen });
    const started = await call("drive", { device: chosen });
    [device, samples, last, clock, path] = [started, [], 0, performance.now(), -1];
    at("drive-frames").tBodies[0].replaceChildren();
    showSettings();
    await tick();
  }

  function showSettings() {
    const mode = make("select", { name: "mode" }, ...Object.entries(device.modes).map(([name, number]) => new Option(name, number)));
    const fields = Object.entries(device.settings).map(([role, { name, value, unit }]) =>
      make("label", {}, `${name}${unit ? `, ${unit}` : ""}`, make("input", { name: role, type: "number", value })));
    const button = (action, words) => {
      const made = make("button", { type: "button" }, words);
      made.addEventListener("click", () => act(action));
      return made;
    };
    settings.replaceChildren(make("label", {}, "Mode", mode), ...fields, button("set", "Write these"),
      button("move", "Move to the target"), button("move-relative", "Move by the target"));
  }

  async function act(action, values) {
    if (!device) return showError(at("drive-states"), new Error("The drive is off: switch it on first."));
    try {
      if (["set", "move", "move-relative"].includes(action)) {
        await call("act", { action: "set", values: numbers(settings) });
      }
      if (action !== "set") await call("act", { action, values });
      at("drive-message")?.remove();
    } catch (error) {
      at("drive-message")?.remove();
      settings.after(make("p", { id: "drive-message", class: "error", role: "alert" }, error.message));
    }
    await tick();
  }

  const numbers = (given) => Object.fromEntries(Object.entries(formValues(given)).map(([name, text]) => [name, Number(text)]));

  let busy = false;
  async function tick() {
    if (!device || busy || at("view-drive").hidden) return;
    busy = true;
    try {
      const found = await call("sample", { now: (performance.now() - clock) / 1000, after: last, path });
      path = found.path;
      state.value = found.state;
      at("drive-word").value = `${found.status_word}h`;
      at("drive-position").value = `${found.position} ${device.units.position}`;
      at("drive-velocity").value = `${found.velocity} ${device.units.velocity}`;
      samples.push(found);
      samples = samples.filter((sample) => sample.now > found.now - SHOWN);
      plot();
      showFrames(found.frames);
      if (found.states !== null) {
        at("drive-states").innerHTML = found.states;
      }
    } catch (error) {
      device = null;
      state.value = "off";
      showError(at("drive-states"), error);
    } finally {
      busy = false;
    }
  }

  function plot() {
    const end = samples[samples.length - 1].now, begin = end - SHOWN;
    const line = (name, css) => {
      const values = samples.map((sample) => sample[name]);
      const low = Math.min(0, ...values), high = Math.max(1, ...values);
      const y = (value) => 240 - (220 * (value - low)) / (high - low);
      const points = samples.map((sample) => `${((600 * (sample.now - begin)) / SHOWN).toFixed(1)},${y(sample[name]).toFixed(1)}`);
      return [`<polyline class="${css}" points="${points.join(" ")}"/>`, low, high];
    };
    const [position, lowest, highest] = line("position", "position");
    const [velocity, slowest, fastest] = line("velocity", "velocity");
    const grid = [0, 5, 10, 15, 20].map((second) => `<line class="grid" x1="${second * 30}" x2="${second * 30}" y1="20" y2="240"/>`);
    at("drive-plot").innerHTML = `${grid.join("")}${position}${velocity}` +
      `<text x="4" y="14">position ${lowest} to ${highest} ${device.units.position}</text>` +
      `<text x="596" y="14" text-anchor="end">velocity ${slowest} to ${fastest} ${device.units.velocity}</text>` +
      `<text x="4" y="256">-20 s</text><text x="596" y="256" text-anchor="end">now</text>`;
  }

  function showFrames(frames) {
    const body = at("drive-frames").tBodies[0], polls = at("drive-polls").checked;
    for (const { number, at: time, protocol, role, text, said, polls: isPoll } of frames) {
      last = Math.max(last, number);
      if (isPoll && !polls) continue;
      const link = make("a", { href: `#${new URLSearchParams({ view: "frame", protocol, role: protocol === "can" ? "" : role, text })}` }, text);
      body.prepend(make("tr", {}, make("td", { class: "m" }, `${time.toFixed(3)} s`), make("td", { class: "m" }, link), make("td", {}, said)));
    }
    while (body.rows.length > FRAMES) body.lastElementChild.remove();
  }

  form.addEventListener("submit", (event) => event.preventDefault());
  settings.addEventListener("submit", (event) => event.preventDefault());
  at("drive-supply").addEventListener("submit", (event) => {
    event.preventDefault();
    act("volts", numbers(event.target));
  });
  form.addEventListener("change", () => { if (device) power(); });
  at("drive-commands").addEventListener("click", (event) => {
    if (event.target.dataset.act) act(event.target.dataset.act);
  });
  form.querySelector("[data-act=power]").addEventListener("click", power);
  setInterval(tick, PERIOD);

  return {
    show: () => (device ? tick() : power()),
    restore(values) {
      if (["csd-mt", "az3"].includes(values.device)) form.elements.device.value = values.device;
    },
  };
}
