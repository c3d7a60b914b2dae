"""Pictures in Chromium: nothing is cut off or wider than the page, and parts light each other up."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Page

from barewire.canopen import CanFrame
from barewire.rtu import encode
from barewire_workbench import explain, explain_text
from barewire_workbench.pictures.fields import FieldsPicture
from barewire_workbench.pictures.levels import frame_pictures
from barewire_workbench.pictures.picture import Picture, as_html, as_svg
from barewire_workbench.pictures.recordings import recording_picture
from barewire_workbench.pictures.states import DriveWord, StatesPicture
from barewire_workbench.pictures.steps import RegistersPicture
from tests.workbench.pictures.test_sequence import BUS, LINE
from tools.website.browser import chromium

pytestmark = [pytest.mark.needs("chromium"), pytest.mark.long]

ANSWER, EXTENDED = CanFrame.parse("585#4B41600037060000"), CanFrame.parse("1ABCDE05#FFFFFFFFFFFFFFFF")
PICTURES: dict[str, list[Picture]] = {
    "rtu": [*frame_pictures(explain("rtu", encode(1, bytes.fromhex("03 06 00 17 FF FF 80 00")))).values()],
    "wrong": [FieldsPicture(explain_text("rtu", "01 03 00 00 00 02 0B C4"))],
    "tcp": [FieldsPicture(explain("tcp", bytes.fromhex("00 01 00 00 00 06 01 03 00 00 00 02")))],
    "ascii": [*frame_pictures(explain("ascii", b":01040FB1000239\r\n")).values()],
    "can": [
        *frame_pictures(explain_text("can", "585#4B41600037060000"), CanFrame.parse("585#4B41600037060000")).values()
    ],
    "extended": [*frame_pictures(explain("can", EXTENDED), EXTENDED).values()],
    "line": [recording_picture("line.log", LINE)],
    "bus": [recording_picture("bus.log", BUS)],
    "states": [StatesPicture(DriveWord("status", word, 1.5) for word in (0x250, 0x231, 0x233, 0x237, 0x218))],
    "value": [RegistersPicture.of_value(-1.5e-30, order="DCBA", address=65534)],
    "values": [RegistersPicture.of_bytes(b"\xcc\xcd\x3f\x8c", "i32")],
}
CUT_OFF = """() => [...document.querySelectorAll("svg text")].filter(text => {
  const box = text.getBoundingClientRect(), room = text.ownerSVGElement.getBoundingClientRect();
  return box.width && (box.left < room.left - 1 || box.right > room.right + 1 || box.bottom > room.bottom + 1);
}).map(text => text.textContent)"""
SMALL = """() => [...document.querySelectorAll("body *, svg text")].filter(
  part => parseFloat(getComputedStyle(part).fontSize) < 12).length"""
LIT = """() => [...document.querySelectorAll(".field, tr, rect, g")].filter(
  part => getComputedStyle(part).outlineStyle === "solid" && getComputedStyle(part).outlineWidth === "2px"
).map(part => part.tagName.toLowerCase()).sort()"""


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as started:
        yield started


@pytest.fixture(scope="module", params=[390, 1280])
def page(browser: Browser, request: pytest.FixtureRequest) -> Iterator[Page]:
    opened = browser.new_page(viewport={"width": request.param, "height": 900}, color_scheme="dark")
    requests: list[str] = []
    opened.on("request", lambda request: requests.append(request.url))
    yield opened
    opened.close()
    assert requests == []


@pytest.mark.parametrize("name", PICTURES)
def test_nothing_is_cut_off_too_small_or_wider_than_the_page(page: Page, name: str) -> None:
    page.set_content(as_html(*PICTURES[name]))
    assert page.evaluate(CUT_OFF) == []
    assert page.evaluate(SMALL) == 0
    assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
    for picture in PICTURES[name]:
        page.set_content(f"<body>{as_svg(picture)}</body>")
        assert page.evaluate(CUT_OFF) == [], picture.title


def test_bytes_and_meaning_light_each_other_up_in_a_page(page: Page) -> None:
    page.set_content(as_html(*PICTURES["tcp"]))
    assert page.evaluate(LIT) == []
    page.keyboard.press("Tab")
    page.keyboard.press("Tab")
    assert page.evaluate(LIT) == ["span", "tr"]
    assert page.evaluate("document.activeElement.getAttribute('aria-label')").startswith("field 2, protocol: 00 00")
    page.evaluate("document.activeElement.blur()")
    page.locator("tbody tr").nth(3).hover()
    assert page.evaluate(LIT) == ["span", "tr"]


def test_bytes_and_meaning_light_each_other_up_in_a_drawing(page: Page) -> None:
    page.set_content(f"<body>{as_svg(PICTURES['tcp'][0])}</body>")
    assert page.evaluate(LIT) == []
    page.keyboard.press("Tab")
    assert page.evaluate(LIT).count("g") == 2
