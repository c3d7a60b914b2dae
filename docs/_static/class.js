// Keys go from screen to screen, as do presenters; a screen that is too high for the window gets smaller type.
const screens = [...document.querySelectorAll("section")];
const STEPS = { ArrowRight: 1, ArrowDown: 1, PageDown: 1, " ": 1, ArrowLeft: -1, ArrowUp: -1, PageUp: -1 };

const away = (screen) => Math.abs(screen.getBoundingClientRect().top);
const shown = () => screens.reduce((nearest, screen) => (away(screen) < away(nearest) ? screen : nearest));

addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey) return;
  const step = event.key === " " && event.shiftKey ? -1 : STEPS[event.key];
  const ends = { Home: 0, End: screens.length - 1 };
  const target = ends[event.key] ?? (step && screens.indexOf(shown()) + step);
  if (event.key === "f") document.documentElement.requestFullscreen();
  if (target === undefined) return;
  event.preventDefault();
  const next = screens[Math.max(0, Math.min(target, screens.length - 1))];
  next.scrollIntoView();
  history.replaceState(null, "", `#${next.id}`);
});

function fit() {
  const here = shown();
  const wide = matchMedia("(min-width: 46em)").matches;
  for (const screen of screens) {
    screen.style.fontSize = "";
    for (let size = 0.95; wide && size > 0.4 && screen.offsetHeight > innerHeight + 1; size -= 0.05) {
      screen.style.fontSize = `${size}em`;
    }
  }
  if (wide) here.scrollIntoView();
}
addEventListener("load", fit);
addEventListener("resize", fit);
