// The view of one frame: text and bytes are two ways to edit the same frame.

import { at, formValues, latest, make, settled, showError } from "./page.js";
import { call } from "./python.js";

// name, protocol, frame, request
const EXAMPLES = [
  ["a request", "rtu", "01 04 0F B1 00 02 22 F8"],
  ["a response with a wrong CRC", "rtu", "01 04 04 00 00 01 10 3B C3"],
  ["CRC bytes exchanged", "rtu", "01 03 00 00 00 0A C5 CD"],
  ["an exception, and its request", "rtu", "01 83 02 C0 F1", "01 03 9C 41 00 01 FA 4E"],
  ["the answer of another unit", "rtu", "02 03 02 00 07 BD 86", "01 03 00 00 00 01 84 0A"],
  ["Modbus ASCII", "ascii", ":01040FB1000239"],
  ["Modbus TCP", "tcp", "00 01 00 00 00 06 01 03 00 6B 00 03"],
  ["an SDO request", "can", "605#4041600000000000"],
  ["an NMT command", "can", "000#0105"],
];

export function frameView(remember) {
  const form = at("frame-form"), result = at("frame-result"), bytes = at("frame-bytes");
  const examples = at("frame-example");
  examples.append(new Option("choose one", ""), ...EXAMPLES.map(([name], place) => new Option(name, place)));

  const show = latest(async () => {
    const values = formValues(form);
    at("frame-request").hidden = values.protocol === "can";
    remember(Object.fromEntries(Object.entries(values).filter(([, value]) => value)));
    try {
      const found = await call("frame", values);
      showBytes(found.bytes, values.protocol);
      showFrame(result, found);
    } catch (error) {
      bytes.querySelector(".cells").replaceChildren();
      showError(result, error);
    }
  });
  const showSoon = settled(show);

  function showBytes(found, protocol) {
    const cells = bytes.querySelector(".cells");
    const focused = [...cells.querySelectorAll("input")].indexOf(document.activeElement);
    bytes.querySelector("legend").textContent = protocol === "ascii" ? "Characters" : "Bytes";
    cells.replaceChildren(...found.map(({ hex, name }, place) => {
      const input = make("input", { class: "byte", value: hex, maxlength: protocol === "ascii" ? 1 : 2,
        "aria-label": `${protocol === "ascii" ? "character" : "byte"} ${place}, ${name}`, autocomplete: "off" });
      input.addEventListener("change", () => edit(place, input.value));
      return make("label", {}, make("span", { "aria-hidden": "true" }, name), input);
    }));
    if (focused >= 0) cells.querySelectorAll("input")[Math.min(focused, found.length - 1)]?.focus();
    at("frame-mend").hidden = protocol === "can";
  }

  async function edit(place, hex) {
    const { protocol, text } = formValues(form);
    await replaceText(() => call("edit", { protocol, text, at: place, hex }));
  }

  async function replaceText(action) {
    try {
      form.elements.text.value = await action();
    } catch (error) {
      showError(result, error);
      return;
    }
    await show();
  }

  form.addEventListener("submit", (event) => event.preventDefault());
  form.addEventListener("input", (event) => { if (event.target !== examples) showSoon(); });
  examples.addEventListener("change", () => {
    if (!examples.value) return;
    const [, protocol, text, request = ""] = EXAMPLES[examples.value];
    restore({ protocol, text, request });
    show();
  });
  at("frame-mend").addEventListener("click", () => {
    const { protocol, text } = formValues(form);
    replaceText(() => call("mend", { protocol, text }));
  });
  at("frame-copy").addEventListener("click", async () => {
    const button = at("frame-copy"), words = button.textContent;
    try {
      await navigator.clipboard.writeText(location.href);
      button.textContent = "Copied";
    } catch {
      button.textContent = "The address of this page is the link";
    }
    setTimeout(() => { button.textContent = words; }, 2000);
  });

  function restore(values) {
    for (const [name, usual] of Object.entries({ protocol: "rtu", role: "", device: "", request: "", text: form.elements.text.value })) {
      const control = form.elements[name];
      control.value = values[name] ?? usual;
      if (control.selectedIndex < 0) control.value = usual;
    }
  }

  return { show, restore };
}

/** Shows the pictures of a frame; the first has the verdict and the diagnosis. A screen reader says the verdict. */
function showFrame(place, found) {
  const pictures = make("div", { id: "frame-pictures" });
  pictures.innerHTML = Object.values(found.pictures).join("");
  place.replaceChildren(pictures);
  const said = [found.verdict, ...found.diagnosis.map(({ text }) => text)].join(" ");
  if (at("frame-said").textContent !== said) at("frame-said").textContent = said;
}
