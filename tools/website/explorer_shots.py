"""Takes the pictures of the explorer in docs/screenshots: `python -m tools.website.explorer_shots`, after `make docs`.

    explorer-frame-1280-light.png    a broken frame with its diagnosis
    explorer-log-390-light.png       a log, its verdict and its sequence diagram
    explorer-steps-390-dark.png      the CRC, one row at a time
    explorer-drive-1280-dark.png     a drive that was enabled and moved

Each view is opened by its link, with Python loaded, in Chromium at the width and in the colours of its name.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Literal, NamedTuple
from urllib.parse import urlencode

from playwright.sync_api import Page, expect

from tools.website.browser import chromium
from tools.website.screenshots import SITE, cropped, served
from tools.website.source import ROOT

FOLDER = ROOT / "docs" / "screenshots"
_LOADED = 60_000
"""The longest time for Python to load, in milliseconds."""


class Shot(NamedTuple):
    """One picture: its view, width and colours, the state in the link, and what is done before it is taken."""

    view: str
    width: int
    height: int
    scheme: Literal["light", "dark"]
    state: dict[str, str]
    prepare: Callable[[Page], None]


def _explained(page: Page) -> None:
    expect(page.locator("#frame-pictures")).to_contain_text("crc-swapped")


def _read(page: Page) -> None:
    expect(page.locator("#log-result .verdict")).to_be_visible()
    page.locator("#log-result .verdict").scroll_into_view_if_needed()


def _stepped(page: Page) -> None:
    expect(page.locator("#steps-count")).to_contain_text("9 of")


def _moved(page: Page) -> None:
    expect(page.locator("#drive-state")).to_have_text("switch on disabled")
    for command in ("Shutdown", "Switch on 0007h", "Enable operation"):
        page.get_by_role("button", name=command).click()
    expect(page.locator("#drive-state")).to_have_text("operation enabled")
    page.get_by_label("Target Position").fill("25600")
    page.get_by_role("button", name="Move to the target").click()
    expect(page.locator("#drive-position")).to_have_text("25600 step")
    page.locator("#drive-plot").scroll_into_view_if_needed()


SHOTS = (
    Shot("frame", 1280, 900, "light", {"protocol": "rtu", "text": "01 03 00 00 00 0A CD C5"}, _explained),
    Shot("log", 390, 844, "light", {}, _read),
    Shot("steps", 390, 844, "dark", {"kind": "crc", "text": "02 07", "way": "register", "at": "9"}, _stepped),
    Shot("drive", 1280, 900, "dark", {"device": "csd-mt"}, _moved),
)


def main() -> int:
    """Take every picture."""
    expect.set_options(timeout=_LOADED)
    with served(SITE) as url, chromium() as browser:
        for shot in SHOTS:
            page = browser.new_page(viewport={"width": shot.width, "height": shot.height}, color_scheme=shot.scheme)
            page.goto(f"{url}/explorer/index.html#{urlencode({'view': shot.view, **shot.state})}")
            page.wait_for_selector("#loading.done", state="attached", timeout=_LOADED)
            shot.prepare(page)
            target = FOLDER / f"explorer-{shot.view}-{shot.width}-{shot.scheme}.png"
            page.screenshot(path=target)
            cropped(target, shot.width, shot.height)
            sys.stdout.write(f"{target.relative_to(ROOT)}  {target.stat().st_size // 1024} KB\n")
            page.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
