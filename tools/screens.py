"""Draws the screens of the terminal for the documentation, with Textual and without a terminal; `make pictures` keeps
them.

    screen-sniff.svg    `sniff --live` of docs/pictures/line.log, a refused request explained
    screen-panel.svg    `panel --terminal` of a simulated stepper drive, a frame explained
    screen-ramp.svg     the same of a simulated soft starter, half a minute after its start
"""

from __future__ import annotations

import asyncio
import html
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from barewire import ModbusServer, connect, load
from barewire.devices.sim import simulator

if TYPE_CHECKING:
    from barewire_workbench.cli.panels.line import PanelLine
    from barewire_workbench.cli.terminal.machine import MachineScreen
    from barewire_workbench.cli.terminal.sniffing import SniffScreen

FOLDER = Path(__file__).parent.parent / "docs" / "pictures"
SIZE = (100, 28)


def sniff_screen() -> str:
    """Return the screen of a recording."""
    from barewire_workbench.cli.sources import Source
    from barewire_workbench.cli.terminal.heard import HeardRows, hear_modbus
    from barewire_workbench.cli.terminal.sniffing import SniffScreen, save_rows

    heard = HeardRows()
    with click.Context(click.Command("sniff")):
        traffic = Source(str(FOLDER / "line.log"), None)
        hear_modbus(heard, traffic, seconds=None, window=1.0, names=None, file=None)
    heard.ended = True
    return _svg(SniffScreen(heard, "line.log", lambda rows, name: save_rows(rows, name, is_can=False)), ["up"])


def panel_screen() -> str:
    """Return the screen of a machine."""
    with _machine_screen("csd-mt", lambda: 0.0) as (app, line):
        return _svg(app, ["tab", "up"], first=line.turn)


def ramp_screen() -> str:
    """Return the screen of a soft starter that was started. Its time is that of the polls, one a second."""
    seconds = 0.0
    with _machine_screen("adxl", lambda: seconds) as (app, line):

        def poll() -> None:
            nonlocal seconds
            for second in range(45):
                if second == 15:
                    line.write("Motor start command", 1)
                line.turn()
                app.look()
                seconds += 1

        return _svg(app, [], first=poll)


@contextmanager
def _machine_screen(name: str, now: Callable[[], float]) -> Iterator[tuple[MachineScreen, PanelLine]]:
    """The screen of a simulated machine whose time `now` returns, and its line, which is polled with `turn`. The
    machine is at a port that the system chooses, and is shown at another one."""
    from barewire_workbench.cli.panels.line import PanelLine
    from barewire_workbench.cli.terminal.machine import MachineScreen
    from barewire_workbench.live.polling import Clock

    class TimeOfPolls(Clock):
        def now(self) -> float:
            return now()

    class TimedUnit:
        def handle(self, request: Any, _: float) -> Any:
            return adapter.handle(request, now())

    adapter: Any = simulator(name, now()).modbus
    with ModbusServer("tcp://127.0.0.1:0", {1: TimedUnit()}) as server:

        def at_its_port(device: Any, endpoint: str, **options: Any) -> Any:
            return connect(device, f"{server.url}?timeout=60&unit=1", **options)

        line = PanelLine(load(name), "tcp://192.168.1.10", check=False, connect=at_its_port, clock=TimeOfPolls())
        try:
            yield MachineScreen(line, writable=True), line
        finally:
            line.stop()
            line.run()  # closes the connection


SCREENS: dict[str, Callable[[], str]] = {
    "screen-sniff.svg": sniff_screen,
    "screen-panel.svg": panel_screen,
    "screen-ramp.svg": ramp_screen,
}


def _svg(app: SniffScreen | MachineScreen, keys: Sequence[str], first: Callable[[], object] = lambda: None) -> str:
    """Return a screen as it is after some keys. What it would load from elsewhere, a font, is left out."""

    async def run() -> str:
        async with app.run_test(size=SIZE) as pilot:
            await pilot.pause()
            first()
            app.look()
            await pilot.press(*keys)
            await pilot.pause()
            app.look()  # what the keys have changed
            await pilot.pause()
            svg: str = app.export_screenshot()
            return svg

    return re.sub(r"<!--.*?-->\s*|@font-face \{.*?\}\s*", "", asyncio.run(run()), flags=re.DOTALL) + "\n"


def text_of(svg: str) -> str:
    """Return the characters of a screen, line by line."""
    lines: dict[float, list[tuple[float, str]]] = {}
    for attributes, text in re.findall(r"<text ([^>]*)>(.*?)</text>", svg):
        x, y = (float(value) for value in re.findall(r'\b[xy]="([\d.]+)"', attributes))
        lines.setdefault(y, []).append((x, html.unescape(text).replace("\xa0", " ")))
    return "\n".join("".join(text for _, text in sorted(line)) for _, line in sorted(lines.items()))
