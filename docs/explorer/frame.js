// The view of one frame: text and bytes are two ways to edit the same frame.

import { at, formValues, latest, make, settled, showError } from "./page.js";
import { call } from "./python.js";

// name, protocol, frame, request
const EXAMPLES = {
  "Right": [
    ["a request", "rtu", "01 04 0F B1 00 02 22 F8"],
    ["an exception, and its request", "rtu", "01 83 02 C0 F1", "01 03 9C 41 00 01 FA 4E"],
    ["Modbus ASCII", "ascii", ":01040FB1000239"],
    ["Modbus TCP", "tcp", "00 01 00 00 00 06 01 03 00 6B 00 03"],
    ["an SDO request", "can", "605#4041600000000000"],
    ["an NMT command", "can", "000#0105"],
  ],
  "Broken": [
    ["CRC bytes exchanged", "rtu", "01 03 00 00 00 0A CD C5"],
    ["a byte lost", "rtu", "03 00 00 00 0A C5 CD"],
    ["one bit wrong", "rtu", "01 83 02 C0 F0"],
    ["noise before it", "rtu", "00 01 03 00 00 00 0A C5 CD"],
    ["its end is missing", "rtu", "01 03 04 00 00 01 10 FA"],
    ["two frames together", "rtu", "01 03 00 00 00 02 C4 0B 01 03 04 00 00 01 10 FA 6F"],
    ["TCP on a serial line", "rtu", "00 01 00 00 00 06 01 03 00 00 00 0A"],
    ["the answer of another unit", "rtu", "02 03 02 00 07 BD 86", "01 03 00 00 00 01 84 0A"],
    ["a wrong LRC", "ascii", ":01040FB1000238"],
    ["a wrong length", "tcp", "00 01 00 00 00 09 01 03 00 6B 00 03"],
    ["RTU on TCP", "tcp", "01 03 00 6B 00 03 74 17"],
    ["an SDO of four bytes", "can", "605#40416000"],
  ],
};

export function frameView(remember) {
  const form = at("frame-form"), result = at("frame-result"), bytes = at("frame-bytes");
  const examples = at("frame-example");
  examples.append(new Option("choose one", ""));
  for (const [label, group] of Object.entries(EXAMPLES)) {
    examples.append(make("optgroup", { label }, ...group.map(([name], place) => new Option(name, `${label} ${place}`))));
  }

  const show = latest(async () => {
    const values = formValues(form);
    // A CAN frame has its direction in its identifier, and only one of the machines is on CAN.
    for (const id of ["frame-request", "frame-role"]) at(id).hidden = values.protocol === "can";
    for (const option of form.elements.device.options) option.hidden = values.protocol === "can" && !["", "az3"].includes(option.value);
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
      const whole = protocol === "ascii" ? 1 : 2;
      input.addEventListener("input", () => { if (input.value.length === whole) edit(place, input.value); });
      input.addEventListener("change", () => { if (input.value.length < whole) edit(place, input.value); });
      input.addEventListener("focus", () => input.select());
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
    const [label, place] = examples.value.split(" ");
    const [, protocol, text, request = ""] = EXAMPLES[label][place];
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
