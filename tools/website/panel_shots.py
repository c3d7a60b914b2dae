"""Takes the pictures of the panel in docs/screenshots: `python -m tools.website.panel_shots`.

    panel-1280-light.png   panel-390-dark.png    values, frames, and one frame explained
    panel-1280-dark.png    panel-390-light.png   a write, with the frame that will be sent
    panel-faults-1280-light.png   panel-faults-390-dark.png   a soft starter that starts, on a line with noise

The machines are a simulated stepper drive and a soft starter, each on a pseudo-terminal.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial

from playwright.sync_api import Browser, Page, ViewportSize, expect

from tools.website.browser import chromium
from tools.website.screenshots import cropped
from tools.website.source import ROOT

FOLDER = ROOT / "docs" / "screenshots"
HEIGHT, TALL = 800, 1000
START = "from barewire_workbench.cli import main; main()"
COMMAND = [sys.executable, "-c", START, "simulate", "--panel"]
DRIVE = "csd-mt", "rtu://pty"
STARTER = "adxl", "rtu://pty", "--fault", "noise:0.01", "--seed", "3"
EXPLAINED, WRITING = {(1280, "light"), (390, "dark")}, {(1280, "dark"), (390, "light")}


def _show(page: Page, *, writing: bool) -> None:
    page.get_by_label("Group").select_option("Motion")
    expect(page.locator("#frames button").last).to_be_visible()
    page.wait_for_timeout(1000)  # the values of the group arrive
    page.locator("#frames button").last.click()
    page.wait_for_timeout(300)
    if writing:
        page.get_by_role("button", name="Write Profile Velocity").click()
        page.get_by_label("New value").fill("7000")
        page.keyboard.press("Enter")
        page.wait_for_timeout(500)


def _show_faults(page: Page) -> None:
    page.locator("#world summary").click()
    page.get_by_role("button", name="Start", exact=True).click()
    page.get_by_role("button", name="Send it").click()
    page.get_by_role("button", name="Close").click()
    page.wait_for_timeout(14_000)  # the ramp takes ten seconds


@contextmanager
def _panel(*machine: str) -> Iterator[str]:
    """Simulate a machine while the block runs; the URL of its page is the value."""
    with subprocess.Popen([*COMMAND, *machine], stdout=subprocess.PIPE, text=True) as simulation:
        assert simulation.stdout is not None
        try:
            yield next(line.split()[1] for line in simulation.stdout if line.startswith("panel "))
        finally:
            simulation.terminate()
            simulation.wait()  # it prints its faults until it ends


def _take(browser: Browser, url: str, name: str, place: tuple[int, str], show: Callable[[Page], None]) -> None:
    width, scheme = place
    height = HEIGHT if name == "panel" else TALL
    size: ViewportSize = {"width": width, "height": height}
    page = browser.new_page(viewport=size, color_scheme="dark" if scheme == "dark" else "light")
    page.goto(url)
    show(page)
    target = FOLDER / f"{name}-{width}-{scheme}.png"
    page.screenshot(path=target)
    page.close()
    cropped(target, width, height)
    sys.stdout.write(f"{target.relative_to(ROOT)}  {target.stat().st_size // 1024} KB\n")


def main() -> int:
    """Take the six pictures."""
    with chromium() as browser:
        with _panel(*DRIVE) as url:
            for place in sorted(EXPLAINED | WRITING):
                _take(browser, url, "panel", place, partial(_show, writing=place in WRITING))
        for place in ((1280, "light"), (390, "dark")):  # each has a motor at rest
            with _panel(*STARTER) as url:
                _take(browser, url, "panel-faults", place, _show_faults)
    return 0


if __name__ == "__main__":
    sys.exit(main())
