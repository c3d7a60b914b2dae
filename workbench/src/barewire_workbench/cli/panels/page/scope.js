// The scope: values over time as traces, with a trigger, and CSV and SVG as files. uPlot draws them.
//
//     free run        the latest seconds
//     trigger         waits until the first trace passes the level, then records the seconds behind it, and stops

import { element } from "./dom.js";

const LONGEST = 20_000;  // points of a trace that are kept
const COLOURS = ["--accent", "--good", "--bad", "--soft"];

export class Scope {
  /** Show traces in a section. `choices` are the names that may be traces; `changed` is called with the chosen ones. */
  constructor(section, choices, changed) {
    this.section = section;
    this.names = [];
    this.data = [[]];  // times, then one list for each trace
    this.triggeredAt = null;
    this.at = (name) => section.querySelector(`[name=${name}]`);
    this.at("trace").append(...choices.map((name) => element("option", {}, name)));
    this.at("add").onclick = () => this.choose([...this.names, this.at("trace").value], changed);
    this.at("remove").onclick = () => this.choose([], changed);
    this.at("arm").onclick = () => this.clear("waiting for the trigger");
    this.at("csv").onclick = () => save("scope.csv", "text/csv", this.csv());
    this.at("svg").onclick = () => save("scope.svg", "image/svg+xml", this.svg());
    for (const name of ["mode", "level", "seconds"]) this.at(name).onchange = () => this.clear();
    matchMedia("(prefers-color-scheme: dark)").onchange = () => this.draw(true);
    addEventListener("resize", () => this.draw(true));
  }

  choose(names, changed) {
    this.names = [...new Set(names)].slice(0, COLOURS.length);
    this.clear();
    changed();
  }

  get seconds() { return Math.max(1, Number(this.at("seconds").value) || 30); }

  clear(text = "") {
    this.data = [[], ...this.names.map(() => [])];
    this.triggeredAt = this.last = null;
    this.say(text || (this.at("mode").value === "free" || !this.names.length ? "" : "waiting for the trigger"));
    this.draw(true);
  }

  say(text) { this.section.querySelector("[role=status]").textContent = text; }

  /** Take the numbers of the traces at a time in seconds. */
  take(at, numbers) {
    if (!this.names.length || at <= (this.data[0].at(-1) ?? -1)) return;
    const mode = this.at("mode").value, level = Number(this.at("level").value), [first] = numbers;
    if (mode !== "free") {
      if (this.triggeredAt !== null && at > this.triggeredAt + this.seconds) return;  // recorded
      const passes = this.last != null && first != null &&
        (mode === "rise" ? this.last < level && first >= level : this.last > level && first <= level);
      this.last = first;
      if (this.triggeredAt === null && passes) {
        this.triggeredAt = at;
        this.say(`triggered: ${this.names[0]} passed ${level}`);
      }
    }
    [at, ...numbers].forEach((value, place) => this.data[place].push(value ?? null));
    const from = this.triggeredAt === null ? at - this.seconds : this.triggeredAt - this.seconds / 10;
    let over = 0;
    while (this.data[0][over] < from || this.data[0].length - over > LONGEST) over += 1;
    if (over) this.data.forEach((list) => list.splice(0, over));
    this.draw(false);
  }

  colour(place) { return getComputedStyle(document.body).getPropertyValue(COLOURS[place]).trim(); }

  draw(anew) {
    const target = this.section.querySelector(".plot");
    target.hidden = !this.names.length;
    if (!anew && this.plot) return this.plot.setData(this.data);
    this.plot?.destroy();
    this.plot = null;
    if (!this.names.length) return;
    const soft = this.colour(3), axis = { stroke: soft, grid: { stroke: `${soft}44` }, ticks: { stroke: soft } };
    this.plot = new uPlot({
      width: Math.max(280, target.clientWidth), height: 260, legend: { live: false },
      scales: { x: { time: false } }, axes: [{ ...axis, label: "s", labelSize: 20, size: 36 }, { ...axis, size: 84 }],
      series: [{}, ...this.names.map((name, place) =>
        ({ label: name, stroke: this.colour(place), width: 2, dash: [[], [8, 4], [2, 4], [10, 3, 2, 3]][place] }))],
    }, this.data, target);
  }

  csv() {
    const quoted = (text) => `"${String(text).replaceAll('"', '""')}"`;
    const rows = this.data[0].map((time, row) => this.data.map((list) => list[row] ?? "").join(","));
    return [["seconds", ...this.names].map(quoted).join(","), ...rows, ""].join("\r\n");
  }

  svg() {
    const [times, ...traces] = this.data, numbers = traces.flat().filter((value) => value !== null);
    const low = Math.min(...numbers), high = Math.max(...numbers), begin = times[0], end = times.at(-1);
    const x = (time) => (60 + 720 * (time - begin) / (end - begin || 1)).toFixed(1);
    const y = (value) => (340 - 300 * (value - low) / (high - low || 1)).toFixed(1);
    const text = (words) => String(words).replaceAll("&", "&amp;").replaceAll("<", "&lt;");
    const lines = traces.map((list, place) => {
      const points = list.map((value, row) => value === null ? "" : `${x(times[row])},${y(value)}`).join(" ");
      return `<polyline fill="none" stroke="${this.colour(place)}" stroke-width="2" points="${points}"/>` +
        `<text x="${60 + 180 * place}" y="20" fill="${this.colour(place)}">${text(this.names[place])}</text>`;
    });
    return `<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 800 380" font-family="sans-serif" font-size="13">` +
      `<rect width="800" height="380" fill="${getComputedStyle(document.body).backgroundColor}"/>${lines.join("")}` +
      `<g fill="${this.colour(3)}"><text x="4" y="44">${high}</text><text x="4" y="344">${low}</text>` +
      `<text x="60" y="368">${begin} s</text><text x="780" y="368" text-anchor="end">${end} s</text></g></svg>\n`;
  }
}

function save(name, type, content) {
  const url = URL.createObjectURL(new Blob([content], { type }));
  element("a", { href: url, download: name }).click();
  URL.revokeObjectURL(url);
}
