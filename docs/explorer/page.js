// Small helpers of the views.

/** Returns the element with this id. */
export const at = (id) => document.getElementById(id);

/** Returns a new element: make("td", { class: "n" }, "text", child). */
export function make(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value !== undefined && value !== null) element.setAttribute(name, value);
  }
  element.append(...children);
  return element;
}

/** Returns a table with a caption: head is a list of texts, rows are lists of texts or elements. */
export function table(caption, head, rows, numbers = []) {
  const cell = (tag, column, value) => make(tag, { class: numbers.includes(column) ? "n m" : undefined }, value ?? "");
  return make("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": caption },
    make("table", { class: "data" },
      make("caption", { class: "soft" }, caption),
      make("thead", {}, make("tr", {}, ...head.map((text) => make("th", { scope: "col" }, text)))),
      make("tbody", {}, ...rows.map((row) => make("tr", {}, ...row.map((value, column) => cell("td", column, value)))))));
}

/** Shows an error where a result would be. */
export function showError(place, error) {
  place.replaceChildren(make("p", { class: "error" }, error.message));
}

/** Returns a function that calls `action` when no call came for a while (milliseconds). */
export function settled(action, pause = 150) {
  let timer = 0;
  return () => { clearTimeout(timer); timer = setTimeout(action, pause); };
}

/** Returns the named controls of a form as an object of texts. */
export function formValues(form) {
  return Object.fromEntries([...form.elements].filter((control) => control.name).map((control) => [control.name, control.value]));
}

/**
 * Runs `action` for the latest input only: while one runs, later ones replace each other.
 * A slow computation of an old input never overwrites that of a newer one.
 */
export function latest(action) {
  let running = false, again = false;
  const run = async () => {
    if (running) { again = true; return; }
    running = true;
    do { again = false; await action(); } while (again);
    running = false;
  };
  return run;
}
