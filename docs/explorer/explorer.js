// The page of the explorer: its views as tabs, the state in the link, and the bar while Python loads.
//
//   #view=frame&protocol=rtu&role=&text=01+04+0F+B1+00+02+22+F8

import { driveView } from "./drive.js";
import { edsView } from "./eds.js";
import { frameView } from "./frame.js";
import { logView } from "./log.js";
import { at } from "./page.js";
import { pasteBox } from "./paste.js";
import { onProgress, ready } from "./python.js";
import { stepsView } from "./steps.js";
import { valuesView } from "./values.js";

const tabs = [...document.querySelectorAll("[role=tab]")];
let current = "frame";

/** Returns a function by which a view keeps its state in the address of the page. */
function rememberer(view) {
  return (values) => {
    if (view !== current) return;
    history.replaceState(null, "", `#${new URLSearchParams({ view, ...values })}`);
  };
}

const views = {
  frame: frameView(rememberer("frame")),
  log: logView(rememberer("log")),
  eds: edsView(rememberer("eds")),
  steps: stepsView(rememberer("steps")),
  values: valuesView(rememberer("values")),
  drive: driveView(rememberer("drive")),
};

function select(view, focus = false) {
  current = view;
  for (const tab of tabs) {
    const chosen = tab.id === `tab-${view}`;
    tab.setAttribute("aria-selected", chosen);
    tab.tabIndex = chosen ? 0 : -1;
    at(tab.getAttribute("aria-controls")).hidden = !chosen;
    if (chosen && focus) tab.focus();
  }
  views[view].show();
}

/** Shows a view with these values. */
function open(view, values) {
  views[view].restore(values);
  select(view);
}

pasteBox(open);
navigator.serviceWorker?.register("sw.js").catch(() => {});  // without it each visit loads all files

function restore() {
  const values = Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
  const view = values.view in views ? values.view : "frame";
  open(view, values);
}

for (const [place, tab] of tabs.entries()) {
  tab.addEventListener("click", () => select(tab.id.slice(4)));
  tab.addEventListener("keydown", (event) => {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    const target = event.key === "Home" ? 0 : event.key === "End" ? tabs.length - 1 : step ? place + step : null;
    if (target === null) return;
    event.preventDefault();
    select(tabs.at(target % tabs.length).id.slice(4), true);
  });
}
window.addEventListener("hashchange", restore);

onProgress((loaded, total) => {
  at("progress").value = Math.min(100, (100 * loaded) / total);
});
ready.then((version) => {
  at("loading").classList.add("done");
  at("loading-text").textContent = `barewire ${version}, in Python in this browser`;
}, (error) => {
  at("loading").classList.add("done");
  at("loading-text").textContent = `Python could not be loaded: ${error.message}`;
  at("loading-text").classList.add("error");
});
restore();
