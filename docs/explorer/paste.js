// The box above the views: says what a text or file is, and shows it in the view that fits best.

import { at, latest, make, settled, showError } from "./page.js";
import { call } from "./python.js";

/** Connects the box. `open(view, values)` shows a view. */
export function pasteBox(open) {
  const form = at("paste-form"), said = at("paste-said"), box = form.elements.text;
  let given = {};

  const show = latest(async () => {
    if (!given.text?.trim() && !given.data) { said.replaceChildren(); return; }
    try {
      const [best, ...others] = await call("guess", given);
      choose(best, others);
    } catch (error) {
      showError(said, error);
    }
  });

  /** Opens the view of one guess, and offers the others. */
  function choose(best, others) {
    said.replaceChildren(`This is ${best.says} (${best.sure}).`);
    if (others.length) said.append(" Or:");
    for (const other of others) {
      const button = make("button", { type: "button" }, `${other.says} (${other.sure})`);
      button.addEventListener("click", () => {
        choose(other, [best, ...others.filter((guess) => guess !== other)]);
        said.querySelector("button")?.focus();
      });
      said.append(" ", button);
    }
    open(best.view, best.values);
  }

  async function read(file) {
    const data = new Uint8Array(await file.arrayBuffer());
    let binary = "";
    for (let place = 0; place < data.length; place += 0x8000) binary += String.fromCharCode(...data.subarray(place, place + 0x8000));
    given = { data: btoa(binary) };
    box.value = file.name;
    await show();
  }

  form.addEventListener("submit", (event) => event.preventDefault());
  box.addEventListener("input", settled(() => { given = { text: box.value }; show(); }, 250));
  at("paste-file").addEventListener("change", ({ target }) => { if (target.files.length) read(target.files[0]); });
  document.addEventListener("dragover", (event) => { if (event.dataTransfer.types.includes("Files")) event.preventDefault(); });
  document.addEventListener("drop", (event) => {
    if (!event.dataTransfer.files.length) return;
    event.preventDefault();
    read(event.dataTransfer.files[0]);
  });
}
