// The view of registers: the same bytes as every type in every order, and a value as registers.

import { at, formValues, latest, make, settled, showError, table } from "./page.js";
import { call } from "./python.js";

const TYPES = ["f32", "u16", "i16", "u32", "i32", "u64", "i64", "f64"];

export function valuesView(remember) {
  const form = at("values-form"), placed = at("placed-form");
  let start = 0;
  placed.elements.type.append(...TYPES.map((name) => new Option(name, name)));

  const show = latest(async () => {
    const { text } = formValues(form);
    const { type, value } = formValues(placed);
    remember({ text, start, type, value });
    try {
      showRegisters(await call("values", { text, start }));
    } catch (error) {
      at("values-registers").replaceChildren();
      showError(at("values-result"), error);
    }
    try {
      showPlaced(await call("placed", { type, value }), type);
    } catch (error) {
      showError(at("placed-result"), error);
    }
  });

  function showRegisters({ registers, orders, rows }) {
    const choose = (place) => {
      const button = make("button", { type: "button", "aria-pressed": place === start, "aria-label": `values from register ${place}` }, `${place}`);
      button.addEventListener("click", async () => {
        start = place;
        await show();
        at("values-registers").querySelectorAll("button")[place]?.focus();
      });
      return button;
    };
    at("values-registers").replaceChildren(table("Registers; press one to read values from it on",
      ["from", "hex", "u16", "i16", "bits", "text"],
      registers.map((register, place) => [choose(place), register.hex, `${register.u16}`, `${register.i16}`, register.bits, register.text]),
      [1, 2, 3, 4, 5]));
    at("values-result").replaceChildren(table(`From register ${start} on, in each order of its bytes`,
      ["type", "registers", ...orders],
      rows.map((row) => [row.type, `${row.registers}`, ...row.values.map((value) => value ?? "too few registers")]), [1, 2, 3, 4, 5]));
  }

  function showPlaced({ stored, exact, rows }, type) {
    at("placed-result").replaceChildren(
      make("p", {}, exact ? `Stored exactly: ${stored}.` : `Stored as the nearest ${type}: ${stored}.`),
      table(`Registers of this value, in each order`, ["order", "registers"],
        rows.map(({ order, registers }) => [order, registers.join(" ")]), [1]));
  }

  for (const each of [form, placed]) {
    each.addEventListener("submit", (event) => event.preventDefault());
    each.addEventListener("input", settled(() => { if (each === form) start = 0; show(); }));
  }
  return {
    show,
    restore(values) {
      if ("text" in values) form.elements.text.value = values.text;
      if (TYPES.includes(values.type)) placed.elements.type.value = values.type;
      if ("value" in values) placed.elements.value.value = values.value;
      start = Number.parseInt(values.start ?? "0", 10) || 0;
    },
  };
}
