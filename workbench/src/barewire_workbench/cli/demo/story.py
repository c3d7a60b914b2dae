"""`barewire demo`: a story of two screens about three simulated machines on four wires.

A value is read and one written on each wire, a motor moves, and a late answer is not taken for another one. Frames are
those that were sent and received. On a terminal the movement is drawn in one line, otherwise in a few.
"""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Callable
from typing import NamedTuple

import click
from rich.console import Console

from barewire import NoAnswer
from barewire.canopen import CanFrame
from barewire.codecs import Value
from barewire.devices import Reading
from barewire.devices.drive import DriveStatus
from barewire.devices.sim import Simulator, simulator
from barewire.io.machine import MachineClient
from barewire.io.ports.base import Direction
from barewire_workbench.cli.arguments import Choice, output_form
from barewire_workbench.cli.demo.frames import (
    LINE,
    ExchangeFrames,
    connected,
    print_every_frame,
    print_every_frame_as_json,
    print_every_frame_as_page,
    print_wrapped,
)
from barewire_workbench.cli.shown_frames import ShownFrames

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
        f"rtu://pty?{LINE}",
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
        f"ascii://pty?{LINE}",
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
        (print_every_frame_as_page if form == "html" else print_every_frame_as_json)()
        return
    # The terminal of the output, and 80 columns without one; rich would also take that of stdin.
    console = Console(highlight=False, width=shutil.get_terminal_size((80, 24)).columns)
    if every_frame:
        print_every_frame(console)
    else:
        _tell(console, frames)


def _tell(console: Console, every_frame: bool) -> None:
    """Print all scenes; with `every_frame`, the frames of the movement too."""
    print_wrapped(console, _INTRODUCTION)
    machines = {scene.device: simulator(scene.device, time.monotonic()) for scene in (*_SCENES, _STEPPER)}
    for number, scene in enumerate(_SCENES, start=1):
        _print_title(console, number, scene.title)
        frames = ExchangeFrames(scene.endpoint.partition(":")[0])
        with connected(machines[scene.device], scene.endpoint, frames.watch) as (client, _):
            _read_and_write(console, scene, client, frames)
    _print_title(console, len(_SCENES) + 1, _STEPPER.title)
    frames = ExchangeFrames("tcp")
    with connected(machines["csd-mt"], _STEPPER.endpoint, frames.watch) as (client, _):
        _read_and_write(console, _STEPPER, client, frames)
        _print_title(console, len(_SCENES) + 2, f"It moves {_STEPS} steps, {_REVOLUTIONS} revolutions of its motor")
        if every_frame:
            shown = ShownFrames(_STEPPER.endpoint, show=lambda text: print_wrapped(console, text, "    ", 14, "cyan"))
            frames.also = shown.watch
        _move(console, client, in_place=sys.stdout.isatty() and not every_frame)
    _print_title(console, len(_SCENES) + 3, "A late answer on Modbus RTU is not taken for another one")
    _be_late(console, machines["az3"])
    console.print()
    for line in _END.splitlines():
        print_wrapped(console, line)


def _print_title(console: Console, number: int, title: str) -> None:
    console.print()
    print_wrapped(console, f"{number}  {title}", hanging=3, style="bold")


def _read_and_write(console: Console, scene: DemoScene, client: MachineClient, frames: ExchangeFrames) -> None:
    """Read the name of the scene and write its value; print both with their frames."""
    reading = client.read(scene.read)
    _print_exchange(console, "read ", reading, frames)
    client.write(scene.write, scene.value)
    _print_exchange(console, "write", Reading(client.device.find(scene.write), scene.value), frames)


def _print_exchange(console: Console, action: str, reading: Reading, frames: ExchangeFrames) -> None:
    _print_reading(console, action, reading)
    for direction, item in frames.items:
        print_wrapped(console, f"{direction:<8}  {_shown(item, frames.protocol)}", "    ", 14, style="cyan")
        print_wrapped(console, frames.explained(direction, item).summary, "      ", 6)
    frames.items.clear()


def _print_reading(console: Console, action: str, reading: Reading) -> None:
    text = reading.parameter.text(reading.value)
    print_wrapped(console, f"{action} {reading.name} = {text}", "  ", 4, style="bold green")


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
    print_wrapped(console, text, "  ", 2)
    frames = LateFrames(console)
    late = f"late={_DELAY}@nth=1"
    with connected(machine, f"rtu://pty?{LINE}", frames.watch, f"timeout={_TIMEOUT}", faults=late) as (client, _):
        try:
            _print_reading(console, "read ", client.read("HEATSINK TEMPERATURE"))
        except NoAnswer as error:
            print_wrapped(console, f"NoAnswer: {error}", "  ", 4, style="bold red")
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
        print_wrapped(self._console, f"{text:<46}  {self._part(direction, frame[1] & 0x7F)}", "  ", 50, style="cyan")

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
