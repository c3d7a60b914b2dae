"""`barewire demo`: the three machines, simulated, read and written by name over all four wires, every byte explained.

Real ports: pseudo-terminals that take the time of 19200 8E1, TCP on loopback, and a CAN bus of python-can. What is
shown is what travelled; nothing is prepared.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import click
from rich.console import Console
from rich.table import Table
from rich.text import Text

from barewire.canopen import CanFrame
from barewire.cli.arguments import json_option, print_json
from barewire.cli.simulate import host_device
from barewire.codecs import Value
from barewire.devices import Reading, load
from barewire.devices.sim import Simulator, simulator
from barewire.errors import NoAnswer
from barewire.explain import Explanation, explain
from barewire.io.canopen.client import CanopenClient
from barewire.io.machine import MachineClient, connect
from barewire.io.ports.trace import Direction

LINE = "baudrate=19200&parity=E&stopbits=1"


class Step(NamedTuple):
    """Read a name, or write it if there is a value; `until` waits for the device to get there."""

    name: str
    value: Value | None = None
    until: str = ""


class Wire(NamedTuple):
    """One machine on one wire, and what is done there."""

    title: str
    device: str
    endpoint: str
    steps: tuple[Step, ...]


INTRODUCTION = """\
Three simulated machines on real ports. Each line in bold is one value, read or written by its name; under it are the
frames that travelled: offset, bytes, name, value and meaning of every field. What is smaller than a register (half of
one, a bit) is written as: read, change, write back."""

WIRES = (
    Wire(
        "AZ3 servo drive, Modbus RTU",
        "az3",
        f"rtu://pty?{LINE}",
        (
            Step("HEATSINK TEMPERATURE"),
            Step("SPEED KP"),
            Step("MODES OF OPERATION", 3),
            Step("PROFILE ACCELERATION", 2000),
            Step("PROFILE ACCELERATION"),
            Step("STATUS WORD"),
        ),
    ),
    Wire(
        "the same AZ3, CANopen",
        "az3",
        "can://virtual/barewire-demo?node=1&bitrate=125000",
        (
            Step("HEATSINK TEMPERATURE"),
            Step("SPEED KP"),
            Step("PROFILE ACCELERATION"),
            Step("TARGET VELOCITY", 1500),
            Step("TARGET VELOCITY"),
            Step("STATUS WORD"),
        ),
    ),
    Wire(
        "ADXL soft starter, Modbus RTU",
        "adxl",
        f"rtu://pty?{LINE}",
        (Step("Thyristors temperature"), Step("Status"), Step("Motor start command", 1), Step("Status")),
    ),
    Wire(
        "the same ADXL, Modbus ASCII",
        "adxl",
        f"ascii://pty?{LINE}",
        (Step("Thyristors temperature"), Step("L1 current"), Step("Motor stop command", 1)),
    ),
    Wire(
        "the same ADXL, Modbus TCP",
        "adxl",
        "tcp://127.0.0.1:0",
        (Step("Thyristors temperature"), Step("Status"), Step("Start counter")),
    ),
    Wire(
        "CSD MT stepper drive, Modbus TCP",
        "csd-mt",
        "tcp://127.0.0.1:0",
        (
            Step("Status Word", until="switch on disabled"),
            Step("Control Word", 0x0006),
            Step("Status Word", until="ready to switch on"),
            Step("Control Word", 0x0007),
            Step("Status Word", until="switched on"),
            Step("Control Word", 0x000F),
            Step("Status Word", until="operation enabled"),
            Step("Position Actual Value"),
        ),
    ),
)


@dataclass
class Frames:
    """What passed in one exchange, in order; bytes that came in pieces are put together."""

    protocol: str
    passed: list[tuple[Direction, bytes | CanFrame]] = field(default_factory=list)

    def watch(self, direction: Direction, item: bytes | CanFrame) -> None:
        """Called for everything that passes the port."""
        if isinstance(item, bytes) and self.passed and self.passed[-1][0] == direction:
            before = self.passed[-1][1]
            assert isinstance(before, bytes)
            self.passed[-1] = (direction, before + item)
        elif isinstance(item, bytes) or 0x580 <= item.id < 0x680:
            # On a bus everybody hears everything; here only the SDO exchange is of interest.
            self.passed.append((direction, item))

    def take(self) -> list[tuple[Direction, Explanation]]:
        """The frames so far, explained; the next exchange begins empty."""
        roles = {"sent": "request", "received": "response"}
        taken = [(direction, explain(self.protocol, item, roles[direction])) for direction, item in self.passed]
        self.passed.clear()
        return taken


class Exchange(NamedTuple):
    """One step done: what it gave, and every frame of it."""

    endpoint: str
    action: str
    reading: Reading
    frames: list[tuple[Direction, Explanation]]


@click.command()
@json_option
def demo(as_json: bool) -> None:
    """Watch the three machines being read and written by name over RTU, ASCII, TCP and CANopen."""
    console = Console(highlight=False)
    table = Table(title="What was done", title_justify="left", header_style="bold")
    for title in ("machine and wire", "endpoint", "read", "written", "frames", "seconds"):
        table.add_column(title, overflow="fold")
    if not as_json:
        console.print(INTRODUCTION)
    machines = {wire.device: simulator(wire.device, time.monotonic()) for wire in WIRES}
    for wire in WIRES:
        if not as_json:
            console.print(f"\n[bold]{wire.title}[/bold]")
        began = time.monotonic()
        done = []
        for exchange in play_wire(wire, machines[wire.device]):
            done.append(exchange)
            if as_json:
                print_json(_fields(wire, exchange))
            else:
                _print(console, exchange)
        actions = [exchange.action for exchange in done]
        frames = sum(len(exchange.frames) for exchange in done)
        counts = (actions.count("read"), actions.count("write"), frames)
        table.add_row(
            wire.title, done[0].endpoint.partition("?")[0], *map(str, counts), f"{time.monotonic() - began:.2f}"
        )
    if not as_json:
        console.print()
        console.print(table)


def play_wire(wire: Wire, machine: Simulator) -> Iterator[Exchange]:
    """Host the machine on the wire and do the steps there, one after the other."""
    description = load(wire.device)
    with ExitStack() as stack:
        host = stack.enter_context(host_device(wire.device, wire.endpoint, machine))
        scheme = wire.endpoint.partition(":")[0]
        frames = Frames(scheme)
        url = f"{host.url}&pace=1" if scheme in ("rtu", "ascii") else host.url
        connected = stack.enter_context(connect(description, url, watch=frames.watch))
        if isinstance(connected.client, CanopenClient):
            _until_there(connected.client)
        for step in wire.steps:
            if step.value is not None:
                connected.write(step.name, step.value)
                reading = Reading(description.find(step.name), step.value)
            else:
                reading = _read(connected, step, frames)
            action = "read" if step.value is None else "write"
            yield Exchange(host.url, action, reading, frames.take())


def _until_there(client: CanopenClient) -> None:
    """Until the node has said its boot-up message, which it may have done already."""
    if not client.bus.monitor.frames:
        with suppress(NoAnswer):
            client.node().nmt.wait_for_boot_up(timeout=0.5)


def _read(machine: MachineClient, step: Step, frames: Frames) -> Reading:
    """Read the name; if the device has to get somewhere first, again and again for three seconds."""
    give_up = time.monotonic() + 3.0
    while True:
        reading = machine.read(step.name)
        if step.until in reading.parameter.text(reading.value):
            return reading
        if time.monotonic() > give_up:
            raise NoAnswer(f"{reading} and not {step.until!r} after 3 s")
        frames.take()
        time.sleep(0.02)


def _print(console: Console, exchange: Exchange) -> None:
    arrow = "<-" if exchange.action == "write" else "->"
    value = exchange.reading.parameter.text(exchange.reading.value)
    console.print(Text(f"\n  {exchange.action} {exchange.reading.name} {arrow} {value}", style="bold green"))
    for direction, explanation in exchange.frames:
        console.print(Text(f"    {direction}", style="cyan"))
        for line in explanation.lines():
            console.print(Text(f"      {line}"), soft_wrap=True)


def _fields(wire: Wire, exchange: Exchange) -> dict[str, Any]:
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
