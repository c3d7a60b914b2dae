// The view of a calculation, one row at a time: a class looks at a step, says what comes next, and goes on.

import { at, formValues, latest, make, settled, showError } from "./page.js";
import { call } from "./python.js";

export function stepsView(remember) {
  const form = at("steps-form"), inputs = at("steps-inputs"), result = at("steps-result"), slider = at("steps-at");
  let kinds = [], wanted = {}, shown = Infinity;

  async function load() {
    if (kinds.length) return;
    kinds = await call("kinds");
    at("steps-kind").append(...kinds.map(({ name, title }) => new Option(title, name)));
    if (kinds.some(({ name }) => name === wanted.kind)) at("steps-kind").value = wanted.kind;
    showInputs();
  }

  function showInputs() {
    const { inputs: asked } = kinds.find(({ name }) => name === at("steps-kind").value);
    inputs.replaceChildren(...asked.map(({ name, label, value, choices }) => {
      const control = choices.length
        ? make("select", { name }, ...choices.map((choice) => new Option(choice, choice)))
        : make("input", { name, autocomplete: "off", spellcheck: "false" });
      control.value = wanted[name] ?? value;
      if (choices.length && control.selectedIndex < 0) control.value = value;
      return make("label", {}, label, control);
    }));
    wanted = {};
  }

  const show = latest(async () => {
    try {
      await load();
      const values = formValues(form);
      remember({ ...values, ...(Number.isFinite(shown) ? { at: shown } : {}) });
      showSteps(await call("steps", values));
      at("steps-controls").hidden = false;
    } catch (error) {
      at("steps-controls").hidden = true;
      showError(result, error);
    }
  });

  function showSteps({ title, source, sections, result: end }) {
    const total = sections.reduce((sum, section) => sum + (section.rows?.length ?? 0), 0) + 1;
    const upTo = Math.min(shown, total);
    let row = 0;
    const parts = [make("h2", {}, title), make("p", { class: "soft" }, source)];
    for (const section of sections) {
      if (row > upTo || (row === upTo && row > 0 && section.rows)) break;
      if (!section.rows) {
        parts.push(make("p", {}, section.text));
        continue;
      }
      const visible = section.rows.slice(0, Math.max(0, upTo - row));
      const rows = visible.map((cells, place) =>
        make("tr", { class: row + place + 1 === upTo && upTo < total ? "now" : undefined }, ...cells.map((cell) => make("td", { class: "m" }, cell))));
      row += section.rows.length;
      parts.push(make("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": section.caption || title }, make("table", { class: "data" },
        make("caption", { class: "soft" }, section.caption),
        make("thead", {}, make("tr", {}, ...section.header.map((text) => make("th", { scope: "col" }, text)))),
        make("tbody", {}, ...rows))));
    }
    if (upTo >= total) parts.push(make("p", { class: "verdict" }, end));
    result.replaceChildren(...parts);
    slider.max = total;
    slider.value = upTo;
    at("steps-count").value = `${upTo} of ${total}`;
    at("steps-back").disabled = upTo <= 0;
    at("steps-next").disabled = upTo >= total;
    result.querySelector("tr.now")?.scrollIntoView({ block: "nearest" });
  }

  const move = (change) => () => { shown = Math.max(0, Number(slider.value) + change); show(); };
  at("steps-back").addEventListener("click", move(-1));
  at("steps-next").addEventListener("click", move(1));
  at("steps-all").addEventListener("click", () => { shown = Infinity; show(); });
  slider.addEventListener("input", () => { shown = Number(slider.value); show(); });
  form.addEventListener("submit", (event) => event.preventDefault());
  at("steps-kind").addEventListener("change", () => { shown = Infinity; showInputs(); show(); });
  inputs.addEventListener("input", settled(() => { shown = Infinity; show(); }));

  return {
    show,
    restore({ at: place, ...values }) {
      shown = place === undefined ? Infinity : Number.parseInt(place, 10) || 0;
      wanted = values;
      if (kinds.length) {
        if (kinds.some(({ name }) => name === values.kind)) at("steps-kind").value = values.kind;
        showInputs();
      }
    },
  };
}
