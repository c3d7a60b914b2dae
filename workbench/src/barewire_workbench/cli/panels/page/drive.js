// The state machine of a CiA 402 drive: the state in its status word, and a button for each command that leaves it. A
// button opens the confirmation of a write to the control word; nothing is sent without it.

import { element } from "./dom.js";

/** Return the state that a status word has by the patterns of the description, or undefined. */
function stateOf(patterns, word) {
  return Object.keys(patterns).find((state) => (word & patterns[state][0]) === patterns[state][1]);
}

/** Show the states of a drive in a section; `openWrite(text)` begins a write of its control word, if one may write.
    Returns a function that takes each new status word. */
export function showDrive(section, drive, openWrite) {
  section.hidden = false;
  const boxes = new Map(Object.keys(drive.patterns).map((state) => [state, element("li", {}, state)]));
  section.querySelector("ol").replaceChildren(...boxes.values());
  const commands = section.querySelector(".buttons");
  let shown;
  return (word) => {
    const state = stateOf(drive.patterns, word);
    if (state === shown) return;
    boxes.get(shown)?.removeAttribute("aria-current");
    boxes.get(state)?.setAttribute("aria-current", "step");
    shown = state;
    section.querySelector("[role=status]").textContent = state ?? "this status word is none of CiA 402";
    const steps = drive.transitions.filter(([, source]) => source === state);
    commands.replaceChildren(...(openWrite ? steps : []).map(([number, , target, command, control]) =>
      element("button", { onclick: () => openWrite(`0x${control.toString(16).padStart(4, "0").toUpperCase()}`) },
        `${command}`, element("small", {}, ` ${number} → ${target}`))));
  };
}
