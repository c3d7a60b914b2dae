// The view of a log: its lines as `sniff` prints them, what is wrong, and a sequence diagram.

import { at, formValues, latest, make, settled, showError } from "./page.js";
import { call } from "./python.js";

const EXAMPLES = [
  ["pymodbus, an answer missing", `2026-03-01 10:00:00,100 DEBUG send: 0x1 0x3 0x0 0x0 0x0 0x2 0xc4 0xb
2026-03-01 10:00:00,120 DEBUG recv: 0x1 0x3 0x4 0x0 0x0 0x1 0x10 0xfa 0x6f
2026-03-01 10:00:01,100 DEBUG send: 0x1 0x3 0x0 0x0 0x0 0x2 0xc4 0xb
2026-03-01 10:00:02,100 DEBUG send: 0x1 0x3 0x0 0x0 0x0 0x2 0xc4 0xb
2026-03-01 10:00:02,120 DEBUG recv: 0x1 0x3 0x4 0x0 0x0 0x1 0x10 0xfa 0x6f`],
  ["Modbus Poll", `Tx:000000-01 03 00 00 00 02 C4 0B
Rx:000001-01 03 04 00 00 01 10 FA 6F
Tx:000002-01 03 9C 41 00 01 FA 4E
Rx:000003-01 83 02 C0 F1`],
  ["candump, a node boots and is read", `(1.000000) can0 705#00
(1.100000) can0 000#0105
(1.200000) can0 705#05
(1.300000) can0 605#4041600000000000
(1.301000) can0 585#4B41600050020000
(1.400000) can0 605#4018100500000000
(1.401000) can0 585#8018100511000906`],
];

export function logView(remember) {
  const form = at("log-form"), result = at("log-result"), examples = at("log-example");
  examples.append(new Option("choose one", ""), ...EXAMPLES.map(([name], place) => new Option(name, place)));
  form.elements.text.value = EXAMPLES[0][1];
  let data = "";  // of a file that is not text

  const show = latest(async () => {
    const { text } = formValues(form);
    remember({ text: text.length <= 4000 ? text : "" });  // a longer link is refused by many programs
    try {
      const found = await call("log", data ? { data } : { text });
      const parts = [make("p", { role: "status" }, `${found.kind}: ${found.lines.length} lines`)];
      if (found.notes.length) parts.push(make("ul", {}, ...found.notes.map((note) => make("li", {}, note))));
      parts.push(...diagnosis(found));
      parts.push(make("pre", { class: "scroll tall", tabindex: "0", role: "region", "aria-label": "Events" }, found.lines.join("\n")));
      const picture = make("div");
      picture.innerHTML = found.picture;
      result.replaceChildren(...parts, picture);
    } catch (error) {
      showError(result, error);
    }
  });

  form.addEventListener("submit", (event) => event.preventDefault());
  form.addEventListener("input", (event) => {
    if (event.target === examples) return;
    data = "";
    soon();
  });
  const soon = settled(show, 300);
  examples.addEventListener("change", () => {
    if (!examples.value) return;
    data = "";
    form.elements.text.value = EXAMPLES[examples.value][1];
    show();
  });
  return {
    show,
    restore(values) {
      data = values.data ?? "";
      if (data) form.elements.text.value = "";
      else if (values.text) form.elements.text.value = values.text;
    },
  };
}

function diagnosis({ findings = [], verdicts = [] }) {
  if (!findings.length && !verdicts.length) return [];
  return [make("h2", {}, "Diagnosis"),
    ...verdicts.map((text) => make("p", { class: "verdict" }, text)),
    make("ul", { class: "findings" }, ...findings.map((text) => make("li", {}, text)))];
}
