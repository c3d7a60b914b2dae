"""`barewire panel` in Chromium: live values, a write with its confirmation by keyboard, frames explained, two browsers.

The page is checked by axe-core at the widths of a phone and of a desk, light and dark: nothing serious is found.
"""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Literal

import pytest
from playwright.sync_api import Browser, Page, expect

from barewire import load
from barewire.devices.sim import simulator
from barewire_workbench.cli.simulate import machine_server
from tests.helpers import free_port
from tests.website.accessibility import SCREENS, serious_faults
from tests.website.panels import LOADED, opened, served, value_of
from tools.website.browser import chromium

pytestmark = [pytest.mark.needs("chromium"), pytest.mark.long]


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as started:
        yield started


@pytest.fixture
def url() -> Iterator[str]:
    """Serve the panel of a simulated stepper drive."""
    with served("csd-mt", "rtu://pty") as started:
        yield started.url


def test_a_value_is_written_by_keyboard_after_its_frame_was_shown_and_both_browsers_see_it(
    browser: Browser, url: str
) -> None:
    page, other = opened(browser, url), opened(browser, url, width=390)
    for each in (page, other):
        each.get_by_label("Group").select_option("Motion")
        expect(value_of(each, "Profile Velocity")).to_have_text("24000 step/s", timeout=LOADED)
    page.get_by_role("button", name="Write Profile Velocity").focus()
    page.keyboard.press("Enter")
    expect(page.get_by_role("button", name="Send it")).to_be_disabled()
    page.keyboard.type("-1")
    page.keyboard.press("Enter")
    expect(page.locator("#plan .bad")).to_contain_text("expected", timeout=LOADED)
    page.keyboard.press("Control+a")
    page.keyboard.type("7000")
    page.keyboard.press("Enter")
    expect(page.locator("#plan .frame")).to_contain_text("Write Multiple Registers", timeout=LOADED)
    page.keyboard.press("Enter")
    expect(page.locator("#write-result")).to_contain_text("the device has 7000 step/s", timeout=LOADED)
    page.keyboard.press("Escape")
    for each in (page, other):
        expect(value_of(each, "Profile Velocity")).to_have_text("7000 step/s", timeout=LOADED)
        each.close()


def test_a_frame_is_explained_on_click(browser: Browser, url: str) -> None:
    page = opened(browser, url)
    page.get_by_role("button", name="Hold", exact=True).click()
    page.locator("#frames button").first.click()
    expect(page.locator("#explained")).to_contain_text("unit 1", timeout=LOADED)
    assert page.locator("#explained tr").count() >= 3
    page.close()


def test_a_drive_is_enabled_by_its_buttons_each_of_which_shows_its_frame(browser: Browser, url: str) -> None:
    page = opened(browser, url)
    drive = page.locator("#drive")
    expect(drive.get_by_role("status")).to_have_text("switch on disabled", timeout=LOADED)
    for command, state in (
        ("shutdown 2", "ready to switch on"),
        ("switch on 3", "switched on"),
        ("enable operation 4", "operation enabled"),
    ):
        drive.get_by_role("button", name=command).click()
        expect(page.locator("#plan .frame")).to_contain_text("valid", timeout=LOADED)
        page.get_by_role("button", name="Send it").click()
        expect(page.locator("#write-result.good")).to_contain_text("Control Word", timeout=LOADED)
        page.get_by_role("button", name="Close").click()
        expect(drive.get_by_role("status")).to_have_text(state, timeout=LOADED)
    page.close()


def test_the_scope_records_once_a_value_passes_the_level_and_saves_csv_and_svg(browser: Browser, url: str) -> None:
    page = opened(browser, url)
    page.get_by_label("Group").select_option("Motion")
    scope = page.locator("#scope")
    for name in ("Profile Velocity", "Status Word"):
        scope.get_by_label("Trace").select_option(name)
        scope.get_by_role("button", name="Add").click()
    # What is kept from before the trigger is a tenth of this time: on a busy computer seconds pass between two polls.
    scope.locator("[name=seconds]").fill("3600")
    scope.get_by_label("Run").select_option("rise")
    scope.get_by_label("Level").fill("30000")
    scope.get_by_label("Level").blur()
    expect(scope.get_by_role("status")).to_have_text("waiting for the trigger", timeout=LOADED)
    expect(scope.locator("canvas")).to_be_visible(timeout=LOADED)
    expect(value_of(page, "Profile Velocity")).to_have_text("24000 step/s", timeout=LOADED)
    for _ in range(LOADED // 1000):  # only a sample below the level can be followed by one that passes it
        if "24000" in saved(page, "CSV"):
            break
        page.wait_for_timeout(1000)
    page.get_by_role("button", name="Write Profile Velocity").click()
    page.get_by_label("New value").fill("40000")
    page.get_by_role("button", name="Show the frame").click()
    expect(page.locator("#plan .frame")).to_contain_text("valid", timeout=LOADED)
    page.get_by_role("button", name="Send it").click()
    expect(page.locator("#write-result.good")).to_contain_text("Profile Velocity", timeout=LOADED)
    page.get_by_role("button", name="Close").click()
    expect(scope.get_by_role("status")).to_contain_text("triggered", timeout=LOADED)
    first, *rows = saved(page, "CSV").splitlines()
    assert first == '"seconds","Profile Velocity","Status Word"'
    assert {row.split(",")[1] for row in rows} == {"24000", "40000"}
    assert saved(page, "SVG").count("<polyline") == 2
    page.close()


def saved(page: Page, name: str) -> str:
    """The file that a button of the scope saves."""
    with page.expect_download(timeout=LOADED) as download:
        page.locator("#scope").get_by_role("button", name=name).click()
    return Path(download.value.path()).read_text(encoding="utf-8")


def test_the_ramp_of_a_soft_starter_is_set_started_drawn_and_stopped(browser: Browser) -> None:
    with served("adxl", "rtu://pty") as panel:
        page = opened(browser, panel.url)
        ramp, confirmation = page.locator("#ramp"), page.locator("#write")
        expect(ramp.get_by_role("heading", name="Ramp")).to_contain_text("Starter ready", timeout=LOADED)
        ramp.get_by_role("button", name="Read P01.04 acceleration time").press("Enter")
        value = ramp.get_by_role("row", name="P01.04").locator("td.value")
        expect(value).to_have_text("10 s", timeout=LOADED)
        ramp.get_by_role("button", name="Write P01.04 acceleration time").click()
        page.get_by_label("New value").fill("120")
        page.keyboard.press("Enter")
        expect(confirmation.locator(".frame")).to_have_count(4, timeout=LOADED)  # three numbers, then the value
        page.get_by_role("button", name="Send it").click()
        expect(value).to_have_text("120 s", timeout=LOADED)
        page.keyboard.press("Escape")
        # The ramp down takes five seconds: on a busy computer the page may see only what comes after it.
        stopping = re.compile("Deceleration ramp|Freewheel|Starter ready")
        for button, status in (("Start", "Acceleration ramp"), ("Stop", stopping)):
            ramp.get_by_role("button", name=button).click()
            expect(confirmation.locator(".frame")).to_contain_text("Write Single Register", timeout=LOADED)
            page.get_by_role("button", name="Send it").click()
            page.get_by_role("button", name="Close").click()
            expect(ramp.get_by_role("heading", name="Ramp")).to_contain_text(status, timeout=LOADED)
        with page.expect_download() as download:
            ramp.get_by_role("button", name="CSV").click()
        first, *rows = Path(download.value.path()).read_text(encoding="utf-8").splitlines()
        assert first == '"seconds","Max current","Torque","L3-L1 Voltage"'
        assert any(float(row.split(",")[1] or 0) > 0 for row in rows)
        page.close()


def test_an_az3_on_a_can_bus_shows_values_and_states_and_takes_a_write(browser: Browser) -> None:
    with served("az3", f"can://socketcand/127.0.0.1:{free_port()}/can0") as panel:
        page = opened(browser, panel.url)
        page.get_by_label("Group").select_option("Control word, mode, targets and limits")
        expect(value_of(page, "TARGET VELOCITY")).to_have_text("0 User units", timeout=LOADED)
        page.get_by_role("button", name="Write TARGET VELOCITY").click()
        page.get_by_label("New value").fill("1500")
        page.keyboard.press("Enter")
        expect(page.locator("#plan .frame")).to_contain_text("DC050000", timeout=LOADED)
        page.get_by_role("button", name="Send it").click()
        expect(value_of(page, "TARGET VELOCITY")).to_have_text("1500 User units", timeout=LOADED)
        page.get_by_role("button", name="Close").click()
        page.locator("#drive").get_by_role("button", name="shutdown 2").click()
        page.get_by_role("button", name="Send it").click()
        expect(page.locator("#drive").get_by_role("status")).to_have_text("ready to switch on", timeout=LOADED)
        expect(page.locator("#diagnosis")).to_contain_text("nothing wrong in the last", timeout=LOADED)
        page.close()


def test_a_page_that_stays_open_recovers_when_the_machine_is_started_again(browser: Browser, tmp_path: Path) -> None:
    line = f"rtu://{tmp_path}/line"
    with served("csd-mt", line, f"{line}?timeout=1") as panel:
        page = opened(browser, panel.url)
        page.get_by_label("Group").select_option("Motion")
        expect(value_of(page, "Profile Velocity")).to_have_text("24000 step/s", timeout=LOADED)
        panel.device.close()
        expect(page.locator("body.dead #state-text")).to_contain_text("no answer for", timeout=LOADED)
        other = simulator("csd-mt", time.monotonic())
        other.store.cell("Profile Velocity").set(7000)
        with machine_server(line, other):
            expect(page.locator("body.alive")).to_be_visible(timeout=LOADED)
            expect(value_of(page, "Profile Velocity")).to_have_text("7000 step/s", timeout=LOADED)
        page.close()


def test_faults_and_the_world_are_switched_by_keyboard_and_are_seen_in_frames_and_values(
    browser: Browser, url: str
) -> None:
    page, other = opened(browser, url), opened(browser, url)
    page.get_by_label("Group").select_option("Motion")
    expect(page.locator("#diagnosis")).to_contain_text("nothing wrong in the last", timeout=LOADED)
    for each in (page, other):
        each.locator("#world summary").press("Enter")
    world = page.locator("#world")
    world.get_by_label("exception: percent of the responses").fill("100")
    world.get_by_label("exception: code").fill("04")
    world.get_by_role("switch", name="exception").press("Space")
    expect(value_of(page, "Profile Velocity")).to_contain_text("exception 04", timeout=LOADED)
    expect(page.locator("#frames button", has_text="01 83 04").first).to_be_visible(timeout=LOADED)
    expect(page.locator("#diagnosis-title")).to_contain_text("a device refused", timeout=LOADED)
    expect(page.locator("#diagnosis li").first).to_contain_text("exception 04 of unit 1", timeout=LOADED)
    expect(other.get_by_role("switch", name="exception")).to_be_checked(timeout=LOADED)
    world.get_by_role("switch", name="exception").press("Space")
    expect(value_of(page, "Profile Velocity")).to_have_text("24000 step/s", timeout=LOADED)
    expect(other.get_by_role("switch", name="exception")).not_to_be_checked(timeout=LOADED)
    world.get_by_label("ambient").fill("warm")
    page.keyboard.press("Enter")
    expect(world.locator("[role=status]")).to_contain_text("expected a number behind =, found 'warm'", timeout=LOADED)
    group = next(row.group for row in load("csd-mt").parameters if row.name == "Digital Input")
    page.get_by_label("Group").select_option(group)
    expect(value_of(page, "Digital Input")).to_contain_text("no bit set", timeout=LOADED)
    world.get_by_label("I2").fill("on")
    page.keyboard.press("Tab")
    expect(value_of(page, "Digital Input")).not_to_contain_text("no bit set", timeout=LOADED)
    for each in (page, other):
        each.close()


def test_without_the_token_the_page_says_how_to_get_it(browser: Browser, url: str) -> None:
    page = opened(browser, url.partition("#")[0])
    page.get_by_label("Group").select_option("Motion")
    page.get_by_role("button", name="Write Profile Velocity").click()
    page.get_by_label("New value").fill("6000")
    page.get_by_role("button", name="Show the frame").click()
    expect(page.locator("#plan .bad")).to_contain_text("open the URL that the command has printed", timeout=LOADED)
    page.close()


@pytest.mark.proof
@pytest.mark.parametrize(("width", "scheme"), SCREENS)
def test_nothing_serious_is_found_in_ramp_faults_diagnosis_and_the_frames_of_a_write(
    browser: Browser, width: int, scheme: Literal["light", "dark"]
) -> None:
    def check(step: str) -> None:
        assert page.evaluate("document.documentElement.scrollWidth") <= width, step
        assert serious_faults(page) == [], step

    with served("adxl", "rtu://pty") as panel:
        page = opened(browser, panel.url, width, scheme)
        expect(page.locator("#ramp .plot canvas")).to_be_visible(timeout=LOADED)
        page.locator("#ramp").get_by_role("button", name="Write P01.04 acceleration time").click()
        for text, shown in (("many", "#plan .bad"), ("120", "#plan .frame >> nth=3")):
            page.get_by_label("New value").fill(text)
            page.keyboard.press("Enter")
            expect(page.locator(shown)).to_be_visible(timeout=LOADED)
            check(f"a write of {text}")
        page.get_by_role("button", name="Send it").click()
        expect(page.locator("#write-result.good")).to_be_visible(timeout=LOADED)
        check("a write with its result")
        page.keyboard.press("Escape")
        page.locator("#world summary").click()
        world = page.locator("#world")
        world.get_by_label("exception: percent of the responses").fill("100")
        world.get_by_role("switch", name="exception").press("Space")
        expect(page.locator("#diagnosis li").first).to_be_visible(timeout=LOADED)
        page.get_by_role("button", name="Hold", exact=True).click()
        page.locator("#frames button").last.click()
        expect(page.locator("#explained table")).to_be_visible(timeout=LOADED)
        check("faults and their diagnosis")
        page.close()


@pytest.mark.parametrize(("width", "scheme"), SCREENS)
def test_nothing_serious_is_found_and_nothing_is_wider_than_the_page(
    browser: Browser, url: str, width: int, scheme: Literal["light", "dark"]
) -> None:
    page = opened(browser, url, width, scheme)
    page.get_by_label("Group").select_option("Motion")
    page.locator("#frames button").first.click()
    page.locator("#world details").evaluate("details => { details.open = true; }")
    page.locator("#scope").get_by_role("button", name="Add").click()
    for step in ("the page", "the dialog"):
        if step == "the dialog":
            page.get_by_role("button", name="Write Profile Velocity").click()
        assert page.evaluate("document.documentElement.scrollWidth") <= width, step
        assert page.evaluate("document.documentElement.scrollHeight - document.body.offsetHeight") < 40, step
        assert serious_faults(page) == [], step
    page.close()
