// The view of an electronic data sheet: findings, then the objects.

import { at, formValues, latest, make, settled, showError, table } from "./page.js";
import { call } from "./python.js";

export function edsView(remember) {
  const form = at("eds-form"), result = at("eds-result");

  const show = latest(async () => {
    const { text } = formValues(form);
    remember({});  // a file is too long for a link
    if (!text.trim()) { result.replaceChildren(); return; }
    try {
      const { title, rows, more, findings } = await call("eds", { text });
      const parts = [make("h2", {}, title)];
      parts.push(make("p", { class: "verdict" }, findings.length ? `${findings.length} findings` : "No findings."));
      if (findings.length) parts.push(make("ul", { class: "findings scroll tall" }, ...findings.map((text) => make("li", {}, text))));
      parts.push(table("Objects", ["object", "name", "type", "access", "default"], rows, [0]));
      if (more) parts.push(make("p", {}, `... and ${more} more: barewire eds shows them`));
      result.replaceChildren(...parts);
    } catch (error) {
      showError(result, error);
    }
  });

  form.addEventListener("submit", (event) => event.preventDefault());
  form.addEventListener("input", settled(show, 300));
  return { show, restore(values) { if (values.text) form.elements.text.value = values.text; } };
}
