"""The explorer in Chromium: it shows an example before Python is there, needs no other server, and works by keyboard.

Each view is checked by axe-core at the widths of a phone and of a desk, light and dark: nothing serious is found.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Literal
from urllib.parse import urlencode

import pytest
from playwright.sync_api import Browser, Locator, Page, Route, ViewportSize, expect

from barewire.canopen import CanFrame
from barewire.devices import load
from barewire_workbench.eds.export import export
from barewire_workbench.recordings.capture import file_header, packet_block, to_packet
from tests.website.accessibility import SCREENS, serious_faults
from tools.website import screenshots
from tools.website.browser import chromium
from tools.website.explorer import build
from tools.website.source import ROOT

pytestmark = [pytest.mark.needs("chromium"), pytest.mark.long]

VIEWS = ("frame", "log", "eds", "steps", "values", "drive")
_LOADED = 240_000
"""The longest time in milliseconds for Python to load, on a machine that does much else."""
expect.set_options(timeout=_LOADED)


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Yield the URL of an explorer that was built now."""
    site = tmp_path_factory.mktemp("site")
    build(site / "explorer")
    with screenshots.served(site) as url:
        yield f"{url}/explorer/index.html"


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as started:
        yield started


def opened(browser: Browser, width: int, scheme: Literal["light", "dark"]) -> Page:
    # Without a service worker, whose requests no route of a test sees.
    size: ViewportSize = {"width": width, "height": 900}
    page = browser.new_page(viewport=size, color_scheme=scheme, service_workers="block")
    page.set_default_timeout(_LOADED)
    return page


@pytest.fixture(scope="module")
def page(browser: Browser, address: str) -> Iterator[Page]:
    """Follow a link to a frame. The example is explained before Python is there, and the frame of the link then.

    Errors of the page and its requests to others fail the test at the end.
    """
    page = opened(browser, 1280, "light")
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("request", lambda request: None if _is_local(request.url, address) else errors.append(request.url))
    held: list[Route] = []
    page.route("**/package.zip", lambda route: held.append(route))  # a builtin has no place for playwright's marks
    page.goto(f"{address}#view=frame&protocol=can&text=605%234041600000000000")
    assert "CRC ok" in page.locator("#frame-result").inner_text()
    assert page.get_by_role("progressbar", name="Loading Python").is_visible()
    page.wait_for_function("document.getElementById('progress').value > 0")
    held[0].continue_()
    page.wait_for_selector("#loading.done", state="attached")
    assert not page.get_by_role("progressbar").is_visible()
    expect(page.get_by_role("textbox", name="Frame", exact=True)).to_have_value("605#4041600000000000")
    expect(said(page)).to_contain_text("SDO", timeout=_LOADED)
    yield page
    page.close()
    assert errors == []


def _is_local(url: str, address: str) -> bool:
    return url.startswith((address.rpartition("/explorer/")[0], "data:", "blob:"))


def show(page: Page, view: str, **values: str) -> None:
    """Open a link with a state in the page that has Python already."""
    page.evaluate("state => { location.hash = state; }", urlencode({"view": view, **values}))
    expect(page.locator(f"#view-{view}")).to_be_visible()


def said(page: Page) -> Locator:
    """Return the element whose text a screen reader says when a frame has been explained."""
    return page.locator("#frame-said")


def test_python_that_cannot_be_loaded_is_said(browser: Browser, address: str) -> None:
    # Without a service worker, which would fetch the file past the route if it is ready early.
    context = browser.new_context(service_workers="block")
    page = context.new_page()
    page.set_default_timeout(_LOADED)
    page.route("**/pyodide.mjs", lambda route: route.abort())
    page.goto(address)
    expect(page.locator("#loading-text")).to_contain_text("Python could not be loaded", timeout=_LOADED)
    context.close()


def test_the_next_visit_asks_the_server_only_whether_there_is_a_new_version_and_needs_no_network(
    browser: Browser, address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []
    monkeypatch.setattr(screenshots._Handler, "log_request", lambda handler, *_: asked.append(handler.path))
    context = browser.new_context()
    page = context.new_page()
    page.set_default_timeout(_LOADED)
    page.goto(address)
    page.evaluate("navigator.serviceWorker.ready.then(() => true)")
    assert "/explorer/package.zip" in asked
    page.close()
    asked.clear()
    for text, service in (("605%234041600000000000", "SDO"), ("705%2300", "boot-up")):
        page = context.new_page()  # the link is opened online, then offline
        page.set_default_timeout(_LOADED)
        page.goto(f"{address}#view=frame&protocol=can&text={text}")
        expect(said(page)).to_contain_text(service)
        page.close()
        context.set_offline(True)
    assert set(asked) <= {"/explorer/sw.js"}
    context.close()


def test_a_link_that_was_opened_before_shows_its_frame_without_waiting_for_python(
    browser: Browser, address: str
) -> None:
    context = browser.new_context()
    link = f"{address}#view=frame&protocol=can&text=705%2300"
    for visit in ("first", "second"):
        page = context.new_page()
        page.set_default_timeout(_LOADED)
        page.goto(link)
        expect(said(page)).to_contain_text("boot-up")
        assert page.locator("#loading.done").count() == (1 if visit == "first" else 0)
        page.close()
        context.add_init_script("window.Worker = class { addEventListener() {} postMessage() {} };")  # loads for ever
    context.close()


def test_a_byte_edited_by_keyboard_breaks_the_crc_and_a_button_mends_it(page: Page) -> None:
    show(page, "frame", protocol="rtu", text="01 03 00 00 00 02 C4 0B")
    byte = page.get_by_role("textbox", name="byte 5, quantity")
    expect(byte).to_have_value("02")
    byte.focus()
    page.keyboard.press("Control+A")
    page.keyboard.type("03")
    page.keyboard.press("Enter")
    expect(said(page)).to_contain_text("CRC is C4 0B, should be 05 CB")
    page.get_by_role("button", name="Make checksum or length right").press("Enter")
    expect(page.get_by_role("textbox", name="Frame", exact=True)).to_have_value("01 03 00 00 00 03 05 CB")
    expect(said(page)).to_contain_text("valid: a request to unit 1")


def test_a_broken_frame_is_diagnosed(page: Page) -> None:
    show(page, "frame", protocol="rtu", text="01 03 00 00 00 0A CD C5")
    expect(said(page)).to_contain_text("not valid")
    expect(page.locator("#frame-pictures")).to_contain_text("crc-swapped")


def test_whatever_is_pasted_is_shown_and_a_wrong_guess_is_one_click_to_change(page: Page) -> None:
    box = page.get_by_role("textbox", name="Paste anything")
    box.fill("605#4041600000000000")
    expect(page.locator("#paste-said")).to_have_text("This is a CAN frame (certain).")
    expect(said(page)).to_contain_text("SDO")
    expect(page.get_by_label("Direction")).to_be_hidden()
    box.fill("Tx:000000-01 03 00 00 00 02 C4 0B\nRx:000001-01 03 04 00 00 01 10 FA 6F")
    expect(page.get_by_role("tabpanel", name="Log")).to_contain_text("Read Holding Registers, 2 from 0000h -> 0 272")
    box.fill("0637")
    expect(page.get_by_role("tabpanel", name="Registers")).to_be_visible()
    page.get_by_role("button", name="a status word of a drive (possible)").press("Enter")
    expect(page.locator("#steps-result")).to_contain_text("operation enabled")
    box.fill("nothing")
    expect(page.locator("#paste-said")).to_contain_text("no frame, log, EDS or value is in it")
    box.fill("")


def test_a_file_is_read(page: Page) -> None:
    sheet = export(load("az3")).encode()
    page.locator("#paste-file").set_input_files({"name": "az3.eds", "mimeType": "text/plain", "buffer": sheet})
    expect(page.get_by_role("tabpanel", name="EDS")).to_contain_text("1000h:00")
    bus = file_header(227) + packet_block(1.0, to_packet(CanFrame.parse("705#00")))
    page.locator("#paste-file").set_input_files({"name": "bus.pcapng", "mimeType": "", "buffer": bus})
    expect(page.get_by_role("tabpanel", name="Log")).to_contain_text("boot-up")


def test_every_broken_example_is_broken(page: Page) -> None:
    show(page, "frame", protocol="rtu", text="01 03")
    names = page.locator("#frame-example optgroup[label=Broken] option").all_inner_texts()
    assert len(names) >= 10
    for name in names:
        before = said(page).inner_text()
        page.locator("#frame-example").select_option(label=name)
        expect(said(page)).not_to_have_text(before)
        expect(said(page)).to_contain_text(re.compile("not valid|was asked"))


def test_a_page_opened_as_a_file_says_how_to_serve_it(browser: Browser) -> None:
    page = browser.new_page()
    page.goto((ROOT / "docs" / "explorer" / "index.html").as_uri())
    expect(page.locator("#loading-text")).to_contain_text("python3 -m http.server")
    page.close()


def test_the_link_follows_what_is_typed(page: Page) -> None:
    show(page, "frame", protocol="rtu", text="01 03")
    page.get_by_role("textbox", name="Frame", exact=True).fill("605#4041600000000000")
    page.get_by_label("Protocol").select_option("can")
    expect(said(page)).to_contain_text("SDO")
    expect(page).to_have_url(re.compile("#view=frame&protocol=can&text=605%234041600000000000$"))


def test_tabs_work_by_arrow_keys(page: Page) -> None:
    show(page, "frame", protocol="rtu", text="01 03")
    page.get_by_role("tab", name="Frame").focus()
    page.keyboard.press("End")
    expect(page.get_by_role("tab", name="Drive")).to_be_focused()
    expect(page.get_by_role("tabpanel", name="Drive")).to_be_visible()
    page.keyboard.press("ArrowLeft")
    expect(page.get_by_role("tabpanel", name="Registers")).to_be_visible()
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("Home")
    expect(page.get_by_role("tabpanel", name="Frame")).to_be_visible()


def test_registers_and_a_wrong_register(page: Page) -> None:
    show(page, "values", text="3F8C CCCD 0001", start="0", type="f32", value="1.1")
    expect(page.locator("#values-result")).to_contain_text("1.100000023841858")
    expect(page.locator("#placed-result")).to_contain_text("Stored as the nearest f32")  # the last that is shown
    page.get_by_role("button", name="values from register 1").press("Enter")
    expect(page.locator("#values-result")).to_contain_text("From register 1 on")
    page.get_by_role("textbox", name="Registers").fill("3F8C CC")
    expect(page.locator("#values-result")).to_contain_text("3 bytes are not whole registers")


def test_a_response_is_compared_with_its_request(page: Page) -> None:
    show(page, "frame", protocol="rtu", text="02 03 02 00 07 BD 86", request="01 03 00 00 00 01 84 0A")
    expect(said(page)).to_contain_text("unit 2 answers, and unit 1 was asked")


def test_a_log_has_its_events_and_a_sequence_diagram(page: Page) -> None:
    show(page, "log", text="Tx:000000-01 03 00 00 00 02 C4 0B\nRx:000001-01 03 04 00 00 01 10 FA 6F")
    expect(page.get_by_role("region", name="Events")).to_contain_text("Read Holding Registers, 2 from 0000h -> 0 272")
    expect(page.locator("#log-result figure")).to_contain_text("unit 1")
    page.get_by_role("textbox", name="Log", exact=True).fill("nothing of a log")
    expect(page.locator("#log-result .error")).to_be_visible()


def test_steps_come_one_row_at_a_time(page: Page) -> None:
    show(page, "steps", kind="crc", text="02 07", way="register", at="2")
    expect(page.locator("#steps-count")).to_contain_text("2 of ")
    expect(page.locator("#steps-result tbody tr")).to_have_count(2)
    page.get_by_role("button", name="Next step").press("Enter")
    expect(page.locator("#steps-result tbody tr")).to_have_count(3)
    expect(page).to_have_url(re.compile("at=3"))
    page.get_by_role("button", name="All steps").press("Enter")
    expect(page.locator("#steps-result")).to_contain_text("CRC 1241h, sent low byte first: 41 12")
    page.get_by_label("Compute").select_option("float")
    expect(page.locator("#steps-result")).to_contain_text("CC CD 3F 8C")
    page.get_by_role("textbox", name="Number").fill("one")
    expect(page.locator("#steps-result .error")).to_be_visible()


def test_the_drive_moves_and_its_frames_lead_to_the_view_of_a_frame(page: Page) -> None:
    show(page, "drive", device="csd-mt")
    expect(page.locator("#drive-state")).to_have_text("switch on disabled")
    for command in ("Shutdown 0006h", "Switch on 0007h", "Enable operation 000Fh"):
        page.get_by_role("button", name=command).press("Enter")
    expect(page.locator("#drive-state")).to_have_text("operation enabled")
    page.get_by_label("Mode").select_option("velocity")
    page.get_by_label("Target Velocity").fill("20000")
    page.get_by_role("button", name="Write these").press("Enter")
    expect(page.locator("#drive-velocity")).to_have_text("20000 step/s")
    page.wait_for_selector("#drive-plot .position[points*=' ']", state="attached")
    page.locator("#drive-frames a").first.click()
    expect(page.get_by_role("tabpanel", name="Frame")).to_be_visible()
    expect(said(page)).to_contain_text("valid: a response from unit 1")


@pytest.mark.parametrize(("width", "scheme"), SCREENS)
def test_nothing_serious_is_inaccessible_or_outside_the_screen(
    page: Page, width: int, scheme: Literal["light", "dark"]
) -> None:
    page.set_viewport_size({"width": width, "height": 900})
    page.emulate_media(color_scheme=scheme)
    for view in VIEWS:
        show(page, view)
        assert page.evaluate("document.documentElement.scrollWidth") <= width, view
        assert serious_faults(page) == [], view
