"""`barewire panel`: a machine on a page for browsers on this computer, or in the terminal, until interrupted."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

import click

from barewire.devices import Device
from barewire.errors import EncodeError
from barewire_workbench.cli.arguments import device_argument, endpoint_argument, load_device, no_check_option
from barewire_workbench.cli.ending import ending_signals_call
from barewire_workbench.cli.output import needs_extra

if TYPE_CHECKING:
    from barewire_workbench.cli.panels.world import SimulatedWorld


@click.command("panel")
@endpoint_argument
@device_argument
@click.option("--write", "writable", is_flag=True, help="Let the page write values; the URL has a token then.")
@click.option("--terminal", is_flag=True, help="Show the machine here, in the terminal, instead of a page.")
@click.option("--port", type=click.IntRange(0, 65535), help="TCP port of the page; without it, a free one.")
@click.option(
    "--period",
    type=click.FloatRange(0.05, 3600),
    default=0.5,
    show_default=True,
    metavar="S",
    help="Seconds between two polls; the line is used half of the time at most.",
)
@no_check_option
def panel_command(
    endpoint: str, device: str, writable: bool, terminal: bool, port: int | None, period: float, no_check: bool
) -> int:
    """Show a machine in a browser: live values, frames, writes.

    Until it is interrupted it serves a page with the values by group, each frame on the wire, explained on click, the
    states of a drive and a scope. The page is on 127.0.0.1 only, and loads nothing from elsewhere. Its URL is printed.
    It only reads, unless --write is given: then it shows the frames of a write before they are sent. Only what a
    browser shows is polled, and several browsers cost one poll.

    \b
    barewire panel "rtu:///dev/ttyUSB0?unit=1" adxl
    barewire panel tcp://127.0.0.1:1502 csd-mt --write --port 8510
    barewire panel tcp://127.0.0.1:1502 csd-mt --write --terminal

    It needs microdot: pip install barewire[panel]. From another computer: ssh -L 8510:127.0.0.1:8510 HOST. With
    --terminal it needs textual instead: pip install barewire[terminal].
    """
    described = load_device(device, endpoint)
    if not terminal:
        serve_panel(described, endpoint, writable=writable, port=port or 0, period=period, check=not no_check)
        return 0
    if port is not None:
        raise EncodeError("--port is that of the page for browsers: expected no --terminal beside it")
    with needs_extra("--terminal", "terminal", "textual"):
        from barewire_workbench.cli.terminal.machine import show_machine
        from barewire_workbench.cli.terminal.screen import check_terminal
    from barewire_workbench.cli.panels.line import PanelLine

    check_terminal("--terminal")
    return show_machine(PanelLine(described, endpoint, period=period, check=not no_check), writable=writable)


def serve_panel(
    device: Device,
    endpoint: str,
    *,
    writable: bool,
    port: int = 0,
    period: float = 0.5,
    check: bool = True,
    world: SimulatedWorld | None = None,
) -> None:
    """Serve the page of a machine until a signal ends it. Raises PortError for the port of the page, and without
    microdot. The port of the machine is opened when a browser looks."""
    with needs_extra("the page", "panel", "microdot"):
        from barewire_workbench.cli.panels.line import PanelLine, running
        from barewire_workbench.cli.panels.server import PanelServer

    async def serve() -> None:
        loop, ended = asyncio.get_running_loop(), asyncio.Event()
        with (
            ending_signals_call(lambda: loop.call_soon_threadsafe(ended.set)),
            running(PanelLine(device, endpoint, period=period, check=check)) as line,
        ):
            server = PanelServer(line, writable=writable, world=world)
            await server.start(port)
            print(f"panel {server.url}", flush=True)
            await ended.wait()
            await server.close()

    asyncio.run(serve())
