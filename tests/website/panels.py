"""The panel of a simulated machine, and its page in a browser, for tests."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any, Literal, NamedTuple

from playwright.sync_api import Browser, Page, expect

from barewire import load
from barewire.devices.sim import simulator
from barewire_workbench.cli.panels.line import PanelLine, running
from barewire_workbench.cli.panels.server import PanelServer
from barewire_workbench.cli.panels.world import SimulatedWorld
from barewire_workbench.cli.simulate import machine_server

LOADED = 240_000
"""The longest time in milliseconds, on a machine that does much else."""


class Served(NamedTuple):
    """The panel of a simulated machine: its URL, its line, and the server of the machine."""

    url: str
    line: PanelLine
    device: Any


@contextmanager
def served(name: str, endpoint: str, client: str = "", period: float = 0.1) -> Iterator[Served]:
    """Serve the panel of a simulated machine in a thread. `client` is its URL if it is not that of the server."""
    urls: list[str] = []
    started = threading.Event()
    loop = asyncio.new_event_loop()
    ended = asyncio.Event()

    async def serve(line: PanelLine) -> None:
        assert device.faults is not None
        server = PanelServer(line, writable=True, world=SimulatedWorld(machine, device.faults))
        await server.start()
        urls.append(server.url)
        started.set()
        await ended.wait()
        await server.close()

    machine = simulator(name, time.monotonic())
    with (
        # In another thread: the one of playwright runs a loop already, and a new bus needs one of its own.
        ThreadPoolExecutor(1) as elsewhere,
        elsewhere.submit(machine_server, endpoint, machine, faults=()).result() as device,
        running(PanelLine(load(name), client or f"{device.url}?timeout=20", period=period)) as line,
    ):
        thread = threading.Thread(target=loop.run_until_complete, args=(serve(line),))
        thread.start()
        try:
            assert started.wait(30)
            yield Served(urls[0], line, device)
        finally:
            loop.call_soon_threadsafe(ended.set)
            thread.join()
            loop.close()


def opened(browser: Browser, url: str, width: int = 1280, scheme: Literal["light", "dark"] = "light") -> Page:
    page = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=scheme)
    page.set_default_timeout(LOADED)
    problems: list[str] = []
    page.on("pageerror", lambda error: problems.append(str(error)))
    page.on("request", lambda request: None if request.url.startswith(("data:", url[:20])) else problems.append("out"))
    page.goto(url)
    expect(page.locator("body.alive")).to_be_visible(timeout=LOADED)
    assert problems == []
    return page


def value_of(page: Page, name: str) -> Any:
    return page.locator("#values tr", has=page.get_by_role("rowheader", name=name)).locator("td.value")
