"""Takes the pictures of the panel in docs/screenshots: `python -m tools.website.panel_shots`.

    panel-1280-light.png   panel-390-dark.png    values, frames, and one frame explained
    panel-1280-dark.png    panel-390-light.png   a write, with the frame that will be sent

The machine is a simulated stepper drive on a pseudo-terminal.
"""

from __future__ import annotations

import subprocess
import sys
from typing import Literal

from playwright.sync_api import Page, ViewportSize, expect

from tools.website.browser import chromium
from tools.website.screenshots import cropped
from tools.website.source import ROOT

FOLDER = ROOT / "docs" / "screenshots"
HEIGHT = 800
START = "from barewire_workbench.cli import main; main()"
COMMAND = [sys.executable, "-c", START, "simulate", "csd-mt", "rtu://pty", "--panel"]
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


def main() -> int:
    """Take the four pictures."""
    with subprocess.Popen(COMMAND, stdout=subprocess.PIPE, text=True) as machine, chromium() as browser:
        assert machine.stdout is not None
        try:
            url = next(line.split()[1] for line in machine.stdout if line.startswith("panel "))
            for width, scheme in sorted(EXPLAINED | WRITING):
                size: ViewportSize = {"width": width, "height": HEIGHT}
                colours: Literal["light", "dark"] = "dark" if scheme == "dark" else "light"
                page = browser.new_page(viewport=size, color_scheme=colours)
                page.goto(url)
                _show(page, writing=(width, scheme) in WRITING)
                target = FOLDER / f"panel-{width}-{scheme}.png"
                page.screenshot(path=target)
                page.close()
                cropped(target, width, HEIGHT)
                sys.stdout.write(f"{target.relative_to(ROOT)}  {target.stat().st_size // 1024} KB\n")
        finally:
            machine.terminate()
    return 0


if __name__ == "__main__":
    sys.exit(main())
