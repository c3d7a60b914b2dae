"""`barewire demo`: three simulated machines, read and written by name on RTU, ASCII, TCP and CAN, each byte explained.

The ports are pseudo-terminals with the timing of 19200 8E1, TCP on loopback, and a virtual CAN bus of python-can.
The frames shown are those that were sent and received.
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

from barewire import CanopenClient, NoAnswer, connect
from barewire.canopen import CanFrame
from barewire.cli.arguments import json_option, print_json
from barewire.cli.simulate import machine_server
from barewire.codecs import Value
from barewire.devices import Reading, load
from barewire.devices.sim import Simulator, simulator
from barewire.explain import Explanation, explain
from barewire.io.machine import MachineClient
from barewire.io.ports.trace import Direction

_LINE = "baudrate=19200&parity=E&stopbits=1"


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
    "Three simulated machines, on pseudo-terminals, on TCP and on a CAN bus inside this process. Each line in bold is "
    "one value, read or written by its name; under it are the frames on the wire: offset, bytes, name, value and "
    "meaning of every field. A value smaller than a register (half of one, or a bit) is read, changed and written back."
)

_WIRES = (
    DemoWire(
        "AZ3 servo drive, Modbus RTU",
        "az3",
        f"rtu://pty?{_LINE}",
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
        "can://virtual/barewire-demo?node=1&bitrate=125000",
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
        f"rtu://pty?{_LINE}",
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
        f"ascii://pty?{_LINE}",
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

    def watch(self, direction: Direction, item: bytes | CanFrame) -> None:
        """Add what was sent or received; the port calls this."""
        if isinstance(item, bytes) and self.items and self.items[-1][0] == direction:
            before = self.items[-1][1]
            assert isinstance(before, bytes)
            self.items[-1] = (direction, before + item)
        elif isinstance(item, bytes) or 0x580 <= item.id < 0x680:
            # A bus delivers the frames of every node; only those of the SDO exchange are shown.
            self.items.append((direction, item))

    def take(self) -> list[tuple[Direction, Explanation]]:
        """Return the frames so far, explained, and start the next exchange."""
        roles = {"sent": "request", "received": "response"}
        taken = [(direction, explain(self.protocol, item, roles[direction])) for direction, item in self.items]
        self.items.clear()
        return taken


class DemoExchange(NamedTuple):
    """The result of a step, and its frames."""

    endpoint: str
    action: str
    reading: Reading
    frames: list[tuple[Direction, Explanation]]


@click.command("demo")
@json_option
def demo_command(as_json: bool) -> None:
    """Read and write three simulated machines on every wire.

    Every frame is shown with the meaning of its bytes.
    """
    console = Console(highlight=False)
    table = Table(title="Summary", title_justify="left", header_style="bold")
    for title in ("machine and wire", "endpoint", "read", "written", "frames", "seconds"):
        table.add_column(title, overflow="fold")
    if not as_json:
        console.print(_INTRODUCTION)
    machines = {wire.device: simulator(wire.device, time.monotonic()) for wire in _WIRES}
    for wire in _WIRES:
        if not as_json:
            console.print(f"\n[bold]{wire.title}[/bold]")
        start = time.monotonic()
        exchanges = []
        for exchange in _run_steps(wire, machines[wire.device]):
            exchanges.append(exchange)
            if as_json:
                print_json(_fields(wire, exchange))
            else:
                _print(console, exchange)
        actions = [exchange.action for exchange in exchanges]
        frames = sum(len(exchange.frames) for exchange in exchanges)
        counts = (actions.count("read"), actions.count("write"), frames)
        endpoint = exchanges[0].endpoint.partition("?")[0]
        table.add_row(wire.title, endpoint, *map(str, counts), f"{time.monotonic() - start:.2f}")
    if not as_json:
        console.print()
        console.print(table)


def _run_steps(wire: DemoWire, machine: Simulator) -> Iterator[DemoExchange]:
    """Serve the machine on the wire and do the steps there, one after the other."""
    description = load(wire.device)
    with ExitStack() as stack:
        server = stack.enter_context(machine_server(wire.endpoint, machine))
        scheme = wire.endpoint.partition(":")[0]
        frames = ExchangeFrames(scheme)
        url = f"{server.url}&pace=1" if scheme in ("rtu", "ascii") else server.url
        machine_client = stack.enter_context(connect(description, url, watch=frames.watch))
        if isinstance(machine_client.client, CanopenClient):
            _wait_for_boot_up(machine_client.client)
        for step in wire.steps:
            if step.value is not None:
                machine_client.write(step.name, step.value)
                reading = Reading(description.find(step.name), step.value)
            else:
                reading = _read(machine_client, step, frames)
            action = "read" if step.value is None else "write"
            yield DemoExchange(server.url, action, reading, frames.take())


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
    console.print(Text(f"\n  {exchange.action} {exchange.reading.name} {arrow} {value}", style="bold green"))
    for direction, explanation in exchange.frames:
        console.print(Text(f"    {direction}", style="cyan"))
        for line in explanation.lines():
            console.print(Text(f"      {line}"), soft_wrap=True)


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
