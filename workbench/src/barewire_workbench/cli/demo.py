"""`barewire demo`: a story of two screens about three simulated machines on four wires.

A value is read and one written on each wire, a motor moves, and a late answer is not taken for another one. On a
terminal the movement is drawn in one line, otherwise in a few. `--all` and `--json` show every frame of six wires.

The ports are pseudo-terminals with the timing of 19200 8E1, TCP on loopback, and a virtual CAN bus of python-can.
Frames are those that were sent and received.
"""

from __future__ import annotations

import shutil
import sys
import textwrap
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import click
from rich.console import Console
from rich.table import Table
from rich.text import Text

from barewire import CanopenClient, NoAnswer, connect
from barewire.canopen import CanFrame
from barewire.codecs import Value
from barewire.devices import Reading
from barewire.devices.drive import DriveStatus
from barewire.devices.sim import Simulator, simulator
from barewire.io.machine import MachineClient
from barewire.io.ports.base import Direction, Watch
from barewire_workbench import Explanation, explain
from barewire_workbench.cli.arguments import Choice
from barewire_workbench.cli.output import output_form, print_json
from barewire_workbench.cli.shown_frames import ShownFrames
from barewire_workbench.cli.simulate import machine_server

_LINE = "baudrate=19200&parity=E&stopbits=1"
_INTRODUCTION = (
    "Three simulated machines on four wires, without hardware: the serial lines are pseudo-terminals, the CAN bus and "
    "TCP are inside this process. Values are read and written by name; below each are the frames that were on the wire."
)
_END = (
    "Every field of every frame: barewire demo --all\n"
    "A machine to try for yourself: barewire simulate --help\n"
    "Everything else: barewire --help"
)


class DemoScene(NamedTuple):
    """A machine on a wire, a name to read and a value to write there."""

    title: str
    device: str
    endpoint: str
    read: str
    write: str
    value: Value


_SCENES = (
    DemoScene(
        "AZ3 servo drive on Modbus RTU, 19200 8E1",
        "az3",
        f"rtu://pty?{_LINE}",
        "HEATSINK TEMPERATURE",
        "PROFILE ACCELERATION",
        2000,
    ),
    DemoScene(
        "The same drive on CANopen, by the same names",
        "az3",
        "can://memory/barewire-demo?node=1&bitrate=125000",
        "HEATSINK TEMPERATURE",
        "TARGET VELOCITY",
        1500,
    ),
    DemoScene(
        "ADXL soft starter on Modbus ASCII",
        "adxl",
        f"ascii://pty?{_LINE}",
        "Thyristors temperature",
        "Motor start command",
        1,
    ),
)
_STEPPER = DemoScene(
    "CSD MT stepper drive on Modbus TCP",
    "csd-mt",
    "tcp://127.0.0.1:0",
    "Position Actual Value",
    "Profile Velocity",
    20000,
)
_STEPS, _REVOLUTIONS = 38400, 3
_TIMEOUT, _DELAY = 0.5, 0.7


@click.command("demo")
@click.option("--all", "every_frame", is_flag=True, help="Show every field of every frame, on six wires.")
@click.option(
    "--json", "as_json", is_flag=True, help="As --all, one JSON object a line; without movement and late answer."
)
@click.option("--frames", is_flag=True, help="Show each frame of the movement, too, explained in one line.")
@click.option(
    "--format",
    "form",
    type=Choice(["text", "json", "html"]),
    help="html: as --all, a page with a sequence diagram for each wire; --json is json.",
)
def demo_command(every_frame: bool, as_json: bool, frames: bool, form: str | None) -> None:
    """Read and write three simulated machines on every wire.

    Shows the frames of a value read and written on Modbus RTU, ASCII, TCP and CANopen, a motor that moves, and a late
    answer that is not taken for the answer to the next request. It needs no hardware, and takes about 6 s.
    """
    form = output_form(form, as_json=as_json)
    if form != "text":
        (_print_every_frame_as_page if form == "html" else _print_every_frame_as_json)()
        return
    # The terminal of the output, and 80 columns without one; rich would also take that of stdin.
    console = Console(highlight=False, width=shutil.get_terminal_size((80, 24)).columns)
    if every_frame:
        _print_every_frame(console)
    else:
        _tell(console, frames)


def _tell(console: Console, every_frame: bool) -> None:
    """Print all scenes; with `every_frame`, the frames of the movement too."""
    _print_wrapped(console, _INTRODUCTION)
    machines = {scene.device: simulator(scene.device, time.monotonic()) for scene in (*_SCENES, _STEPPER)}
    for number, scene in enumerate(_SCENES, start=1):
        _print_title(console, number, scene.title)
        frames = ExchangeFrames(scene.endpoint.partition(":")[0])
        with _connected(machines[scene.device], scene.endpoint, frames.watch) as (client, _):
            _read_and_write(console, scene, client, frames)
    _print_title(console, len(_SCENES) + 1, _STEPPER.title)
    frames = ExchangeFrames("tcp")
    with _connected(machines["csd-mt"], _STEPPER.endpoint, frames.watch) as (client, _):
        _read_and_write(console, _STEPPER, client, frames)
        _print_title(console, len(_SCENES) + 2, f"It moves {_STEPS} steps, {_REVOLUTIONS} revolutions of its motor")
        if every_frame:
            shown = ShownFrames(_STEPPER.endpoint, show=lambda text: _print_wrapped(console, text, "    ", 14, "cyan"))
            frames.also = shown.watch
        _move(console, client, in_place=sys.stdout.isatty() and not every_frame)
    _print_title(console, len(_SCENES) + 3, "A late answer on Modbus RTU is not taken for another one")
    _be_late(console, machines["az3"])
    console.print()
    for line in _END.splitlines():
        _print_wrapped(console, line)


# What both have in common


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
            beginning = self.items[-1][1]
            assert isinstance(beginning, bytes)
            self.items[-1] = (direction, beginning + item)
        elif isinstance(item, bytes) or 0x580 <= item.id < 0x680:
            # A bus delivers the frames of every node; only those of the SDO exchange are shown.
            self.items.append((direction, item))

    def take(self) -> list[tuple[Direction, Explanation]]:
        """Return the frames so far, explained, and start the next exchange."""
        frames = [(direction, self.explained(direction, item)) for direction, item in self.items]
        self.items.clear()
        return frames

    def explained(self, direction: Direction, item: bytes | CanFrame) -> Explanation:
        """Return the explanation of a frame: what is sent is a request, what is received a response."""
        return explain(self.protocol, item, "request" if direction == "sent" else "response")


@contextmanager
def _connected(
    machine: Simulator, endpoint: str, watch: Watch, options: str = "", **faults: Any
) -> Iterator[tuple[MachineClient, str]]:
    """Serve the machine at the endpoint; yield a client that is _connected to it, and the URL of the server.

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


def _wait_for_boot_up(client: CanopenClient) -> None:
    """Wait for the boot-up message of the node, unless it was received already."""
    if not client.bus.monitor.frames:
        with suppress(NoAnswer):
            client.node().nmt.wait_for_boot_up(timeout=0.5)


def _print_wrapped(console: Console, text: str, indent: str = "", hanging: int = 0, style: str = "") -> None:
    """Print a text in lines not longer than the console; from the second one on indented by `hanging` columns."""
    later = " " * min(hanging, console.width * 2 // 3)
    for line in textwrap.wrap(text, console.width, initial_indent=indent, subsequent_indent=later):
        console.print(Text(line, style=style), soft_wrap=True)


# The story


def _print_title(console: Console, number: int, title: str) -> None:
    console.print()
    _print_wrapped(console, f"{number}  {title}", hanging=3, style="bold")


def _read_and_write(console: Console, scene: DemoScene, client: MachineClient, frames: ExchangeFrames) -> None:
    """Read the name of the scene and write its value; print both with their frames."""
    reading = client.read(scene.read)
    _print_exchange(console, "read ", reading, frames)
    client.write(scene.write, scene.value)
    _print_exchange(console, "write", Reading(client.device.find(scene.write), scene.value), frames)


def _print_exchange(console: Console, action: str, reading: Reading, frames: ExchangeFrames) -> None:
    _print_reading(console, action, reading)
    for direction, item in frames.items:
        _print_wrapped(console, f"{direction:<8}  {_shown(item, frames.protocol)}", "    ", 14, style="cyan")
        _print_wrapped(console, frames.explained(direction, item).summary, "      ", 6)
    frames.items.clear()


def _print_reading(console: Console, action: str, reading: Reading) -> None:
    text = reading.parameter.text(reading.value)
    _print_wrapped(console, f"{action} {reading.name} = {text}", "  ", 4, style="bold green")


def _shown(item: bytes | CanFrame, protocol: str) -> str:
    """Return the bytes of a frame in hexadecimal, those of Modbus ASCII as their characters."""
    if isinstance(item, CanFrame):
        return f"{item.id:03X}  {item.data.hex(' ').upper()}"
    if protocol == "ascii":
        return item.decode("ascii", "replace").replace("\r\n", " CR LF")
    return item.hex(" ").upper()


# The movement


def _move(console: Console, client: MachineClient, *, in_place: bool) -> None:
    """Enable the drive and move it; draw its position, over the one before if `in_place`."""
    unit = client.device.find(_STEPPER.read).unit
    draw = _draw_in_place(console, unit) if in_place else _draw_some(console, unit)
    drive = client.drive.following(lambda progress: draw(progress.status))
    drive.enable()
    drive.move(_STEPS, relative=True)
    while (status := drive.status()).velocity:  # the drive shows a mean of the last 100 ms
        pass
    draw(status)
    if in_place:
        console.print()


def _drawing(status: DriveStatus, unit: str, width: int) -> str:
    """Return a line of exactly `width` columns: the part of the way as a bar, position and velocity in numbers."""
    position, velocity = int(status.position or 0), int(status.velocity or 0)
    numbers = f"| {position:>6} {unit}, {velocity:>6} {unit}/s"
    room = max(10, width - len(numbers) - 3)
    done = min(room - 1, max(0, position * (room - 1) // _STEPS))
    return f"  |{'=' * done}>{' ' * (room - 1 - done)}{numbers}"


def _draw_in_place(console: Console, unit: str) -> Callable[[DriveStatus], None]:
    """Return a function that draws a position over the one before."""

    def draw(status: DriveStatus) -> None:
        # One column is left free: some terminals begin a new line when the last one is written.
        console.file.write("\r" + _drawing(status, unit, console.width - 1))
        console.file.flush()

    return draw


def _draw_some(console: Console, unit: str) -> Callable[[DriveStatus], None]:
    """Return a function that draws the first position and one of each quarter of the way, a line each."""
    next_quarter = 0

    def draw(status: DriveStatus) -> None:
        nonlocal next_quarter
        quarter = 4 * int(status.position or 0) // _STEPS
        # The end is drawn when the motor stands still.
        if quarter < next_quarter or (quarter == 4 and status.velocity):
            return
        next_quarter = quarter + 1
        console.print(_drawing(status, unit, console.width), soft_wrap=True)

    return draw


# The late answer


def _be_late(console: Console, machine: Simulator) -> None:
    """Read a value whose answer is later than the time-out, then another one; print the frames as they come."""
    text = (
        f"The next answer of the drive takes {_DELAY} s, the time-out of the client is {_TIMEOUT} s. The request after "
        "it is for as many registers: the late answer would fit, and SPEED KP be a temperature."
    )
    _print_wrapped(console, text, "  ", 2)
    frames = LateFrames(console)
    late = f"late={_DELAY}@nth=1"
    with _connected(machine, f"rtu://pty?{_LINE}", frames.watch, f"timeout={_TIMEOUT}", faults=late) as (client, _):
        try:
            _print_reading(console, "read ", client.read("HEATSINK TEMPERATURE"))
        except NoAnswer as error:
            _print_wrapped(console, f"NoAnswer: {error}", "  ", 4, style="bold red")
        _print_reading(console, "read ", client.read("SPEED KP"))


class LateFrames:
    """Prints each frame when it is sent or received, with the time since the first one and its part in the story."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._start = time.monotonic()
        self._frames = ExchangeFrames("rtu")
        self._data = b""
        self._requests = 0
        self._proved = False

    def watch(self, direction: Direction, item: bytes) -> None:
        """Print the frames that are complete; the port calls this with a part of one, or with several."""
        self._data += item
        end = 0
        while end < len(self._data):
            end += 1
            if self._frames.explained(direction, self._data[:end]).valid:
                self._print(direction, self._data[:end])
                self._data, end = self._data[end:], 0

    def _print(self, direction: Direction, frame: bytes) -> None:
        text = f"{time.monotonic() - self._start:.2f} s  {direction:<8}  {_shown(frame, 'rtu')}"
        _print_wrapped(self._console, f"{text:<46}  {self._part(direction, frame[1] & 0x7F)}", "  ", 50, style="cyan")

    def _part(self, direction: Direction, function: int) -> str:
        """Return the part of a frame in the story; function 08 is the probe."""
        if direction == "sent":
            if function == 8:
                return "probe: that may still come"
            self._requests += 1
            return f"asks {'HEATSINK TEMPERATURE' if self._requests == 1 else 'SPEED KP'}"
        if function == 8:
            self._proved = True
            return "the probe is answered"
        return "its answer" if self._proved else "late: dropped"


# Every frame


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


_EVERY_FRAME = (
    "Three simulated machines, on pseudo-terminals, on TCP and on a CAN bus inside this process. A line with an arrow "
    "is one value, read (->) or written (<-) by its name; under it are the frames on the wire: offset, bytes, name, "
    "value and meaning of every field. A value smaller than a register (half of one, or a bit) is read, changed and "
    "written back."
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


class DemoExchange(NamedTuple):
    """The result of a step, and its frames."""

    endpoint: str
    action: str
    reading: Reading
    frames: list[tuple[Direction, Explanation]]


def _print_every_frame(console: Console) -> None:
    """Do all steps; print each value, and under it every field of its frames, within the width of the console."""
    table = Table(header_style="bold")
    for title in ("machine and wire", "endpoint", "read", "written", "frames", "seconds"):
        table.add_column(title, overflow="fold")
    _print_wrapped(console, _EVERY_FRAME)
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


def _print_every_frame_as_json() -> None:
    """Do all steps; print one JSON object for each value, with the fields of its frames."""
    machines = _machines()
    for wire in _WIRES:
        for exchange in _run_steps(wire, machines[wire.device]):
            print_json(_fields(wire, exchange))


def _print_every_frame_as_page() -> None:
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


def _run_steps(wire: DemoWire, machine: Simulator) -> Iterator[DemoExchange]:
    """Serve the machine on the wire and do the steps there, one after the other."""
    frames = ExchangeFrames(wire.endpoint.partition(":")[0])
    with _connected(machine, wire.endpoint, frames.watch) as (client, url):
        for step in wire.steps:
            if step.value is not None:
                client.write(step.name, step.value)
                reading = Reading(machine.device.find(step.name), step.value)
            else:
                reading = _read(client, step, frames)
            action = "read" if step.value is None else "write"
            yield DemoExchange(url, action, reading, frames.take())


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
    _print_wrapped(console, title + value, "  ", 4, style="bold green")
    for direction, explanation in exchange.frames:
        _print_wrapped(console, direction, "    ", style="cyan")
        *rows, verdict = explanation.lines()
        for row, explained in zip(rows, explanation.fields):
            _print_wrapped(console, row, "      ", 6 + len(row) - len(explained.meaning))
        _print_wrapped(console, verdict, "      ", 8)


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
