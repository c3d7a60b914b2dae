"""`barewire drive`: enable a drive, move it, stop it, and watch it get there."""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import wraps
from typing import Any

import click
from rich.console import Console
from rich.progress import Progress as Bar, SpinnerColumn, TextColumn, TimeElapsedColumn

from barewire.cli.arguments import device_argument, endpoint_argument, json_option, print_json
from barewire.devices import load
from barewire.devices.device import drive_roles
from barewire.devices.drive.report import DriveProgress, DriveStatus, bit_names
from barewire.devices.parameter import show
from barewire.errors import NoAnswer, PortError
from barewire.io.drive import DriveClient
from barewire.io.machine import connect

Conduct = Callable[..., DriveStatus]


@click.group()
@endpoint_argument
@device_argument
@click.pass_context
def drive(ctx: click.Context, endpoint: str, device: str) -> None:
    """Enable, move and stop a drive of CiA 402, over whatever wire.

    DEVICE is one whose description has a table [drive]: az3, csd-mt, or your own. It waits until the drive is there;
    one that does not get there is an error that says in which state it is stuck, and why. Ctrl-C while it waits for
    a movement is a quick stop; so are SIGTERM, a terminal that is closed, and a reader of the output who leaves.

    \b
    barewire drive tcp://192.168.1.10 csd-mt enable
    barewire drive tcp://192.168.1.10 csd-mt move 12800 --relative --velocity 20000
    barewire drive "can://socketcan/can0?node=1" az3 velocity -1500
    barewire drive "rtu:///dev/ttyUSB0?unit=1" az3 quick-stop
    """
    machine = load(device)
    drive_roles(machine)  # what is no drive is told before a port is opened
    ctx.obj = (endpoint, machine)


class Number(click.ParamType[int | float]):
    """A whole number where it is one: most drives count in steps."""

    name = "number"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int | float:
        """The number."""
        try:
            number = float(value)
        except ValueError:
            self.fail(f"{value!r}: expected a number", param, ctx)
        return int(number) if number.is_integer() else number


def word(name: str, *, moves: bool = False) -> Callable[[Conduct], click.Command]:
    """Make a command of a function that conducts a drive: with --json and --timeout, and Ctrl-C as a quick stop."""

    def command(conduct: Conduct) -> click.Command:
        @wraps(conduct)
        def act(ctx: click.Context, /, as_json: bool, timeout: float, **how: Any) -> None:
            endpoint, device = ctx.obj
            with connect(device, endpoint) as machine, followed(as_json) as progress:
                conductor = machine.drive.following(progress, timeout=timeout)
                try:
                    with ended_by_signals():
                        look = conduct(conductor, **how)
                except (NoAnswer, PortError) as error:
                    if moves and conductor.drive.control is not None:
                        error.add_note(f"{name}: the motor may still be turning")
                    raise
                except (KeyboardInterrupt, OSError) as gone:
                    if moves and (isinstance(gone, KeyboardInterrupt) or conductor.drive.control is not None):
                        stop(conductor)
                    if isinstance(gone, Ended):
                        raise click.exceptions.Exit(gone.status) from None
                    raise
            if not as_json:
                print(f"{look.state_name}{_values(look)}; status word {look.status_word:04X}h: {_bits(look)}")

        # Negative targets begin with a dash: -1000 is no option.
        settings = {"ignore_unknown_options": moves}
        return drive.command(name, context_settings=settings)(json_option(timeout_option(click.pass_context(act))))

    return command


class Ended(KeyboardInterrupt):
    """Somebody ends this process; `status` is what it says when it is over."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self.status = 128 + number


ENDING = tuple(getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """A signal that would end the process becomes `Ended`, as Ctrl-C is KeyboardInterrupt. One is enough."""

    def end(number: int, _: object) -> None:
        for one in handled:
            signal.signal(one, signal.SIG_IGN)  # nothing but another Ctrl-C disturbs the quick stop that follows
        raise Ended(number)

    # Under nohup a terminal that goes away stays ignored.
    handled = {number: before for number in ENDING if (before := signal.getsignal(number)) is not signal.SIG_IGN}
    for number in handled:
        signal.signal(number, end)
    try:
        yield
    finally:
        if all(signal.getsignal(number) is end for number in handled):
            for number, before in handled.items():
                signal.signal(number, before)


def stop(conductor: DriveClient) -> None:
    """A quick stop, told as long as somebody can be told: the terminal may be gone, and the motor must not know."""
    tell = conductor.drive.progress

    def try_to_tell(progress: DriveProgress) -> None:
        with suppress(OSError):
            if tell is not None:
                tell(progress)

    conductor.drive.progress = try_to_tell
    conductor.quick_stop()


timeout_option = click.option(
    "--timeout", default=3.0, show_default=True, metavar="S", help="Seconds for each change of state."
)
within_option = click.option("--within", default=60.0, show_default=True, metavar="S", help="Seconds it may take.")
velocity_option = click.option("--velocity", type=Number(), help="Profile velocity, in the drive's unit.")
acceleration_option = click.option("--acceleration", type=Number(), help="Profile acceleration.")
deceleration_option = click.option("--deceleration", type=Number(), help="Profile deceleration.")


def _values(look: DriveStatus) -> str:
    told = (("position", look.position), ("velocity", look.velocity))
    return "".join(f", {name} {show(value)}" for name, value in told if value is not None)


def _bits(look: DriveStatus) -> str:
    return ", ".join(bit_names(look.status_word)) or "no bit set"


# How it is shown


@contextmanager
def followed(as_json: bool) -> Iterator[Callable[[DriveProgress], None]]:
    """Who is told of progress: JSON lines, a moving line on a terminal, or a line for each change."""
    began = time.monotonic()
    if as_json:
        yield lambda progress: print_json(_fields(progress, began))
    elif sys.stdout.isatty():
        columns = (SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn())
        with Bar(*columns, console=Console(highlight=False), transient=True) as bar:
            task = bar.add_task("", total=None)
            yield lambda progress: bar.update(task, description=_short(progress))
    else:
        yield _changes(began)


def _fields(progress: DriveProgress, began: float) -> dict[str, Any]:
    return progress.as_dict() | {"time": round(progress.status.now - began, 3)}


def _line(progress: DriveProgress) -> str:
    waiting = f", waiting for {progress.waiting_for}" if progress.waiting_for else ""
    return f"{progress.action}: {progress.status.state_name}{waiting}{_values(progress.status)}"


def _short(progress: DriveProgress) -> str:
    """The same for one line of a terminal, without what brackets explain."""
    doing = progress.waiting_for.partition(" (")[0] or progress.action
    return f"{doing} | {progress.status.state_name}{_values(progress.status)}"


def _changes(began: float) -> Callable[[DriveProgress], None]:
    """A line for each new state and each new thing that is waited for, with the seconds since the beginning."""
    last: list[tuple[str, str]] = []

    def tell(progress: DriveProgress) -> None:
        step = (progress.status.state_name, progress.waiting_for)
        if progress.waiting_for and step not in last[-1:]:
            last.append(step)
            print(f"{progress.status.now - began:7.3f} s  {_line(progress)}", flush=True)

    return tell


# The words


@word("status")
def status(conductor: DriveClient) -> DriveStatus:
    """Read the drive once."""
    return conductor.status()


@word("enable")
def enable(conductor: DriveClient) -> DriveStatus:
    """To operation enabled. A fault is not reset on the way."""
    return conductor.enable()


@word("disable")
def disable(conductor: DriveClient) -> DriveStatus:
    """Current off. A motor that turns coasts: quick-stop brakes it."""
    return conductor.disable()


@word("quick-stop")
def quick_stop(conductor: DriveClient) -> DriveStatus:
    """Brake on the quick stop ramp."""
    return conductor.quick_stop()


@word("reset")
def reset(conductor: DriveClient) -> DriveStatus:
    """Out of a fault, once its cause is gone."""
    return conductor.reset()


@word("move", moves=True)
@click.argument("target", type=Number())
@click.option("--relative", is_flag=True, help="By TARGET, not to it.")
@click.option("--immediately", is_flag=True, help="Replace a movement that is under way.")
@velocity_option
@acceleration_option
@deceleration_option
@within_option
def move(conductor: DriveClient, target: int | float, **how: Any) -> DriveStatus:
    """To the position TARGET, in the drive's unit. What is not given of the profile stays as it is in the drive."""
    return conductor.move(target, **how)


@word("velocity", moves=True)
@click.argument("target", type=Number())
@acceleration_option
@deceleration_option
@within_option
def velocity(conductor: DriveClient, target: int | float, **how: Any) -> DriveStatus:
    """To the velocity TARGET, in the drive's unit; the motor goes on turning. 0 stops it on its ramp."""
    return conductor.velocity(target, **how)


@word("home", moves=True)
@click.argument("method", type=int, required=False)
@within_option
def home(conductor: DriveClient, method: int | None, within: float) -> DriveStatus:
    """Find home, with the method that is set in the drive or METHOD."""
    return conductor.home(method, within=within)
