"""Twenty browsers at one machine on one serial line: what the device counts, the pages show, the server keeps.

One process of Chromium carries the twenty as contexts, which share neither connections nor storage, as twenty browsers
on one computer would. The panel is the command, in a process of its own; the device counts the requests at the other
end of a pseudo-terminal. `make proof` takes 100 polls; those of an hour, with what was counted:

    BAREWIRE_POLLS=7200 make suite WORKERS= ARGS="-m proof -s tests/website/test_twenty_browsers.py"
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple
from urllib.request import urlopen

import pytest
from playwright.sync_api import Page, expect

from barewire import ModbusServer
from barewire.devices.sim import simulator
from tests.website.panels import LOADED, opened, value_of
from tools.website.browser import chromium

pytestmark = [
    pytest.mark.needs("chromium"),
    pytest.mark.skipif(
        not Path("/proc/self/smaps_rollup").exists(), reason="the memory of a process is read from /proc"
    ),
    pytest.mark.proof,
    pytest.mark.timeout(7200),  # each wait ends after LOADED; twenty pages are drawn by two processors or by one
]

BROWSERS = 20
PERIOD = 0.05
"""Seconds between two polls: a tenth of those of a panel without `--period`."""
POLLS = int(os.environ.get("BAREWIRE_POLLS", "100"))
"""Polls while the memory is watched; 7,200 are an hour with the period of half a second."""


class Device:
    """A simulated stepper drive on a pseudo-terminal that keeps each request. It can be restarted."""

    def __init__(self, line: str) -> None:
        self.line, self.requests = line, list[Any]()
        self.start()

    def start(self) -> None:
        adapter: Any = simulator("csd-mt", time.monotonic()).modbus
        requests = self.requests

        class Counted:
            def handle(self, request: Any, now: float) -> Any:
                requests.append(request)
                return adapter.handle(request, now)

        self.server = ModbusServer(self.line, {1: Counted()})
        self.server.start()

    def written(self) -> list[int]:
        """The values of all writes, in the order in which they arrived."""
        writes = [request for request in self.requests if type(request).__name__ == "WriteMultipleRegisters"]
        return [request.registers[0] | request.registers[1] << 16 for request in writes]


class Panel(NamedTuple):
    """A panel in a process of its own."""

    url: str
    process: int

    def polls(self) -> int:
        with urlopen(f"{self.url.partition('#')[0]}events?name=Status%20Word", timeout=60) as events:
            count: int = json.loads(events.readline().removeprefix(b"data: "))["polls"]
        return count

    def memory(self) -> int:
        """KiB that the process has in memory for itself, by the page table."""
        counted = Path(f"/proc/{self.process}/smaps_rollup").read_text(encoding="ascii")
        return int(counted.partition("Private_Dirty:")[2].split()[0])


@contextmanager
def panel_of(line: str) -> Iterator[Panel]:
    code = "from barewire_workbench.cli import main; main()"
    command = [sys.executable, "-c", code, "panel", f"{line}?timeout=2", "csd-mt", "--write", "--period", str(PERIOD)]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
        try:
            assert process.stdout is not None
            yield Panel(process.stdout.readline().split()[1], process.pid)
        finally:
            process.terminate()


def requests_per_poll(panel: Panel, device: Device, polls: int) -> float:
    """Wait for so many polls; return the requests that the device received for each."""
    first, received = panel.polls(), len(device.requests)
    while (last := panel.polls()) < first + polls:
        time.sleep(0.1)
    return (len(device.requests) - received) / (last - first)


def write_from(pages: list[Page], first: int) -> None:
    """Write another value from each page, all confirmed before the first of them has its answer.

    The keyboard is used: before a click playwright waits until the page has been drawn some twenty times, and on one
    busy computer twenty pages take turns at that.
    """
    for number, page in enumerate(pages, first):
        page.get_by_role("button", name="Write Profile Velocity").press("Enter")
        page.get_by_label("New value").fill(str(number))
        page.keyboard.press("Enter")
    for page in pages:
        expect(page.locator("#plan .frame")).to_be_visible(timeout=LOADED)
    for page in pages:
        page.get_by_role("button", name="Send it").press("Enter")
    for number, page in enumerate(pages, first):
        expected = f"written; the device has {number} step/s"
        expect(page.locator("#write-result")).to_contain_text(expected, timeout=LOADED)
        page.get_by_role("button", name="Close").press("Enter")


def test_twenty_browsers_cost_one_poll_lose_no_write_and_survive_a_restart_in_flat_memory(tmp_path: Path) -> None:
    device = Device(f"rtu://{tmp_path}/line")
    with chromium() as browser, panel_of(device.line) as panel:
        pages: list[Page] = []
        costs = []
        for count in (1, BROWSERS):
            while len(pages) < count:
                pages.append(opened(browser, panel.url))
                pages[-1].get_by_label("Group").select_option("Motion")
            for page in pages:
                expect(value_of(page, "Profile Velocity")).to_have_text("24000 step/s", timeout=LOADED)
            costs.append(requests_per_poll(panel, device, 40))
        assert costs[1] == pytest.approx(costs[0], rel=0.1)  # polls and requests are not counted at the same moment

        write_from(pages, first=5000)
        assert sorted(device.written()) == list(range(5000, 5000 + BROWSERS))  # each once
        for page in pages:
            expect(value_of(page, "Profile Velocity")).to_have_text(f"{device.written()[-1]} step/s", timeout=LOADED)

        device.server.close()
        for page in pages:
            expect(page.locator("body.dead #state-text")).to_contain_text("no answer for", timeout=LOADED)
        device.start()
        for page in pages:
            expect(page.locator("body.alive")).to_be_visible(timeout=LOADED)
            expect(value_of(page, "Profile Velocity")).to_have_text("24000 step/s", timeout=LOADED)
        write_from(pages, first=6000)
        assert sorted(device.written()[BROWSERS:]) == list(range(6000, 6000 + BROWSERS))

        start, sizes = panel.polls(), list[int]()
        for tenth in range(1, 11):  # the first half fills what is kept: 300 frames, caches
            while panel.polls() < start + POLLS * tenth / 10:
                time.sleep(0.2)
            sizes.append(panel.memory())
        # In an hour 500 bytes kept from each poll are seen here, 56 by test_an_hour_with_twenty_viewers in test_panel.
        assert max(sizes[5:]) < sizes[4] * 1.05
        last = device.written()[-1]
        for page in pages:
            expect(value_of(page, "Profile Velocity")).to_have_text(f"{last} step/s", timeout=LOADED)
            expect(page.locator("body")).to_have_class("alive")
            page.close()
    device.server.close()
    print(f"\nrequests per poll: {costs[0]:.1f} with one browser, {costs[1]:.1f} with {BROWSERS}")
    print(f"writes: {len(device.written())} confirmed, {len(device.written())} received, each once")
    print(f"memory of the panel in KiB, over {POLLS} polls: {' '.join(map(str, sizes))}")
