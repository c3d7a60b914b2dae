"""Every frame of the demo, for `barewire demo --all` and `--json`: three simulated machines on six wires.

The ports are pseudo-terminals with the timing of 19200 8E1, TCP on loopback, and a virtual CAN bus of python-can.
The frames shown are those that were sent and received.
"""

from __future__ import annotations

import textwrap
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from rich.console import Console
from rich.table import Table
from rich.text import Text

from barewire import CanopenClient, NoAnswer, connect
from barewire.canopen import CanFrame
from barewire.codecs import Value
from barewire.devices import Reading
from barewire.devices.sim import Simulator, simulator
from barewire.io.machine import MachineClient
from barewire.io.ports.base import Direction, Watch
from barewire_workbench import Explanation, explain
from barewire_workbench.cli.arguments import print_json
from barewire_workbench.cli.simulate import machine_server

LINE = "baudrate=19200&parity=E&stopbits=1"


class DemoStep(NamedTuple):
    """Read a name, or write it if there is a value. With `until`, read until the text of the value has this in it."""

    name: str
    value: Value | None = None
    until: str = ""


class DemoWire(NamedTuple):
    """One machine on one wire, and the steps to do there."""

    title: str
    device: str
    endpoint: str
    steps: tuple[DemoStep, ...]


_INTRODUCTION = (
    "Three simulated machines, on pseudo-terminals, on TCP and on a CAN bus inside this process. A line with an arrow "
    "is one value, read (->) or written (<-) by its name; under it are the frames on the wire: offset, bytes, name, "
    "value and meaning of every field. A value smaller than a register (half of one, or a bit) is read, changed and "
    "written back."
)

_WIRES = (
    DemoWire(
        "AZ3 servo drive, Modbus RTU",
        "az3",
        f"rtu://pty?{LINE}",
        (
            DemoStep("HEATSINK TEMPERATURE"),
            DemoStep("SPEED KP"),
            DemoStep("MODES OF OPERATION", 3),
            DemoStep("PROFILE ACCELERATION", 2000),
            DemoStep("PROFILE ACCELERATION"),
            DemoStep("STATUS WORD"),
        ),
    ),
    DemoWire(
        "the same AZ3, CANopen",
        "az3",
        "can://memory/barewire-demo?node=1&bitrate=125000",
        (
            DemoStep("HEATSINK TEMPERATURE"),
            DemoStep("SPEED KP"),
            DemoStep("PROFILE ACCELERATION"),
            DemoStep("TARGET VELOCITY", 1500),
            DemoStep("TARGET VELOCITY"),
            DemoStep("STATUS WORD"),
        ),
    ),
    DemoWire(
        "ADXL soft starter, Modbus RTU",
        "adxl",
        f"rtu://pty?{LINE}",
        (
            DemoStep("Thyristors temperature"),
            DemoStep("Status"),
            DemoStep("Motor start command", 1),
            DemoStep("Status"),
        ),
    ),
    DemoWire(
        "the same ADXL, Modbus ASCII",
        "adxl",
        f"ascii://pty?{LINE}",
        (DemoStep("Thyristors temperature"), DemoStep("L1 current"), DemoStep("Motor stop command", 1)),
    ),
    DemoWire(
        "the same ADXL, Modbus TCP",
        "adxl",
        "tcp://127.0.0.1:0",
        (DemoStep("Thyristors temperature"), DemoStep("Status"), DemoStep("Start counter")),
    ),
    DemoWire(
        "CSD MT stepper drive, Modbus TCP",
        "csd-mt",
        "tcp://127.0.0.1:0",
        (
            DemoStep("Status Word", until="switch on disabled"),
            DemoStep("Control Word", 0x0006),
            DemoStep("Status Word", until="ready to switch on"),
            DemoStep("Control Word", 0x0007),
            DemoStep("Status Word", until="switched on"),
            DemoStep("Control Word", 0x000F),
            DemoStep("Status Word", until="operation enabled"),
            DemoStep("Position Actual Value"),
        ),
    ),
)


@dataclass
class ExchangeFrames:
    """The frames of one exchange, in order; a frame that arrived in pieces is joined."""

    protocol: str
    items: list[tuple[Direction, bytes | CanFrame]] = field(default_factory=list)
    also: Watch | None = None
    """Called with every frame, too."""

    def watch(self, direction: Direction, item: bytes | CanFrame) -> None:
        """Add what was sent or received; the port calls this."""
        if self.also is not None:
            self.also(direction, item)
        if isinstance(item, bytes) and self.items and self.items[-1][0] == direction:
            before = self.items[-1][1]
            assert isinstance(before, bytes)
            self.items[-1] = (direction, before + item)
        elif isinstance(item, bytes) or 0x580 <= item.id < 0x680:
            # A bus delivers the frames of every node; only those of the SDO exchange are shown.
            self.items.append((direction, item))

    def take(self) -> list[tuple[Direction, Explanation]]:
        """Return the frames so far, explained, and start the next exchange."""
        taken = [(direction, self.explained(direction, item)) for direction, item in self.items]
        self.items.clear()
        return taken

    def explained(self, direction: Direction, item: bytes | CanFrame) -> Explanation:
        """Return the explanation of a frame: what is sent is a request, what is received a response."""
        return explain(self.protocol, item, "request" if direction == "sent" else "response")


class DemoExchange(NamedTuple):
    """The result of a step, and its frames."""

    endpoint: str
    action: str
    reading: Reading
    frames: list[tuple[Direction, Explanation]]


def print_every_frame(console: Console) -> None:
    """Do all steps; print each value, and under it every field of its frames, within the width of the console."""
    table = Table(header_style="bold")
    for title in ("machine and wire", "endpoint", "read", "written", "frames", "seconds"):
        table.add_column(title, overflow="fold")
    print_wrapped(console, _INTRODUCTION)
    machines = _machines()
    for wire in _WIRES:
        console.print(f"\n[bold]{wire.title}[/bold]")
        start = time.monotonic()
        exchanges = []
        for exchange in _run_steps(wire, machines[wire.device]):
            exchanges.append(exchange)
            _print(console, exchange)
        actions = [exchange.action for exchange in exchanges]
        frames = sum(len(exchange.frames) for exchange in exchanges)
        counts = (actions.count("read"), actions.count("write"), frames)
        endpoint = exchanges[0].endpoint.partition("?")[0]
        table.add_row(wire.title, endpoint, *map(str, counts), f"{time.monotonic() - start:.2f}")
    console.print("\n[bold]Summary[/bold]")
    console.print(table)


def print_every_frame_as_json() -> None:
    """Do all steps; print one JSON object for each value, with the fields of its frames."""
    machines = _machines()
    for wire in _WIRES:
        for exchange in _run_steps(wire, machines[wire.device]):
            print_json(_fields(wire, exchange))


def print_every_frame_as_page() -> None:
    """Do all steps; print a page with a sequence diagram for each wire."""
    from barewire_workbench.pictures.picture import as_html
    from barewire_workbench.pictures.recordings import explained_message
    from barewire_workbench.pictures.sequence import SequencePicture

    machines, pictures = _machines(), []
    for wire in _WIRES:
        messages = []
        for exchange in _run_steps(wire, machines[wire.device]):
            for direction, explanation in exchange.frames:
                stations = ("client", wire.device) if direction == "sent" else (wire.device, "client")
                messages.append(explained_message(*stations, explanation))
        pictures.append(SequencePicture(wire.title, messages, ["client"]))
    print(as_html(*pictures), end="")


def _machines() -> dict[str, Simulator]:
    return {wire.device: simulator(wire.device, time.monotonic()) for wire in _WIRES}


@contextmanager
def connected(
    machine: Simulator, endpoint: str, watch: Watch, options: str = "", **faults: Any
) -> Iterator[tuple[MachineClient, str]]:
    """Serve the machine at the endpoint; yield a client that is connected to it, and the URL of the server.

    `options` are those of a URL for the client: "timeout=0.5". `faults` are those of `ModbusServer`.
    """
    with machine_server(endpoint, machine, **faults) as server:
        url = server.url
        for option in ("pace=1" if endpoint.startswith(("rtu:", "ascii:")) else "", options):
            url += f"{'&' if '?' in url else '?'}{option}" if option else ""
        with connect(machine.device, url, watch=watch) as client:
            if isinstance(client.client, CanopenClient):
                _wait_for_boot_up(client.client)
            yield client, server.url


def _run_steps(wire: DemoWire, machine: Simulator) -> Iterator[DemoExchange]:
    """Serve the machine on the wire and do the steps there, one after the other."""
    frames = ExchangeFrames(wire.endpoint.partition(":")[0])
    with connected(machine, wire.endpoint, frames.watch) as (client, url):
        for step in wire.steps:
            if step.value is not None:
                client.write(step.name, step.value)
                reading = Reading(machine.device.find(step.name), step.value)
            else:
                reading = _read(client, step, frames)
            action = "read" if step.value is None else "write"
            yield DemoExchange(url, action, reading, frames.take())


def _wait_for_boot_up(client: CanopenClient) -> None:
    """Wait for the boot-up message of the node, unless it was received already."""
    if not client.bus.monitor.frames:
        with suppress(NoAnswer):
            client.node().nmt.wait_for_boot_up(timeout=0.5)


def _read(machine: MachineClient, step: DemoStep, frames: ExchangeFrames) -> Reading:
    """Read the name; if the device has to reach a state first, repeat that for up to 3 s."""
    give_up = time.monotonic() + 3.0
    while True:
        reading = machine.read(step.name)
        if step.until in reading.parameter.text(reading.value):
            return reading
        if time.monotonic() > give_up:
            raise NoAnswer(f"{reading} and not {step.until!r} after 3 s")
        frames.take()
        time.sleep(0.02)


def _print(console: Console, exchange: DemoExchange) -> None:
    arrow = "<-" if exchange.action == "write" else "->"
    value = exchange.reading.parameter.text(exchange.reading.value)
    title = f"{exchange.action} {exchange.reading.name} {arrow} "
    console.print()
    print_wrapped(console, title + value, "  ", 4, style="bold green")
    for direction, explanation in exchange.frames:
        print_wrapped(console, direction, "    ", style="cyan")
        *rows, verdict = explanation.lines()
        for row, explained in zip(rows, explanation.fields):
            print_wrapped(console, row, "      ", 6 + len(row) - len(explained.meaning))
        print_wrapped(console, verdict, "      ", 8)


def print_wrapped(console: Console, text: str, indent: str = "", hanging: int = 0, style: str = "") -> None:
    """Print a text in lines not longer than the console; from the second one on indented by `hanging` columns."""
    later = " " * min(hanging, console.width * 2 // 3)
    for line in textwrap.wrap(text, console.width, initial_indent=indent, subsequent_indent=later):
        console.print(Text(line, style=style), soft_wrap=True)


def _fields(wire: DemoWire, exchange: DemoExchange) -> dict[str, Any]:
    reading = exchange.reading
    return {
        "wire": wire.title,
        "device": wire.device,
        "endpoint": exchange.endpoint,
        "action": exchange.action,
        "name": reading.name,
        "value": reading.value,
        "unit": reading.unit,
        "text": reading.parameter.text(reading.value),
        "frames": [{"direction": direction, **explanation.as_dict()} for direction, explanation in exchange.frames],
    }
