"""Draws the screens of the terminal for the documentation, with Textual and without a terminal; `make pictures` keeps
them.

    screen-sniff.svg    `sniff --live` of docs/pictures/line.log, a refused request explained
    screen-panel.svg    `panel --terminal` of a simulated stepper drive, a frame explained
"""

from __future__ import annotations

import asyncio
import html
import re
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from barewire import ModbusServer, connect, load
from barewire.devices.sim import MachineUnits, simulator

if TYPE_CHECKING:
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
    """Return the screen of a machine. It is at a port that the system chooses, and shown at another one."""
    from barewire_workbench.cli.panels.line import PanelLine
    from barewire_workbench.cli.terminal.machine import MachineScreen

    with ModbusServer("tcp://127.0.0.1:0", MachineUnits(simulator("csd-mt", time.monotonic()))) as server:

        def at_its_port(device: Any, endpoint: str, **options: Any) -> Any:
            return connect(device, f"{server.url}?timeout=60", **options)

        line = PanelLine(load("csd-mt"), "tcp://192.168.1.10", connect=at_its_port)

        try:
            return _svg(MachineScreen(line, writable=True), ["tab", "up"], first=line.turn)
        finally:
            line.stop()
            line.run()  # closes the connection


SCREENS: dict[str, Callable[[], str]] = {"screen-sniff.svg": sniff_screen, "screen-panel.svg": panel_screen}


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
