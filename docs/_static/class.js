// Keys go from screen to screen, as do presenters; within a picture that is higher than the window they scroll first.
// Other screens that are too high get smaller type.
const screens = [...document.querySelectorAll("section")];
const STEPS = { ArrowRight: 1, ArrowDown: 1, PageDown: 1, " ": 1, ArrowLeft: -1, ArrowUp: -1, PageUp: -1 };
const shown = () => screens.findLast((screen) => screen.getBoundingClientRect().top <= innerHeight / 2) ?? screens[0];

function go(screen) {
  screen.scrollIntoView();
  history.replaceState(null, "", `#${screen.id}`);
}

function step(by) {
  const { top, bottom } = shown().getBoundingClientRect();
  const left = by > 0 ? bottom - innerHeight : -top;
  if (left > 1) scrollBy(0, by * Math.min(left, 0.8 * innerHeight));
  else go(screens[screens.indexOf(shown()) + by] ?? shown());
}

addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey) return;
  if (event.key === "f") document.documentElement.requestFullscreen();
  else if (event.key === "Home") go(screens[0]);
  else if (event.key === "End") go(screens.at(-1));
  else if (event.key in STEPS) step(event.shiftKey ? -1 : STEPS[event.key]);
  else return;
  event.preventDefault();
});

function fit() {
  const here = shown();
  const wide = matchMedia("(min-width: 46em)").matches;
  for (const screen of screens) {
    screen.style.fontSize = "";
    const scrolls = screen.querySelector("img")?.height > 0.8 * innerHeight;
    for (let size = 0.95; wide && !scrolls && size > 0.4 && screen.offsetHeight > innerHeight + 1; size -= 0.05) {
      screen.style.fontSize = `${size}em`;
    }
  }
  if (wide) here.scrollIntoView();
}
addEventListener("load", fit);
addEventListener("resize", fit);
