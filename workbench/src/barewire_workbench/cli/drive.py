"""`barewire drive`: enable, move and stop a drive, and show its progress."""

from __future__ import annotations

import math
import re
import shlex
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import wraps
from typing import Any

import click
from rich.console import Console
from rich.progress import Progress as Bar, SpinnerColumn, TextColumn, TimeElapsedColumn

from barewire import BarewireError, NoAnswer, PortError, Refused, connect, load
from barewire.devices.cia402 import State
from barewire.devices.device import Device, drive_roles
from barewire.devices.drive import DriveProgress, DriveStatus, DriveStuck, bit_names, check_mode
from barewire.devices.parameter import show
from barewire.errors import shown
from barewire.io.drive import DriveClient
from barewire.io.machine import MachineClient
from barewire_workbench.cli.arguments import (
    CommandGroup,
    check_machine,
    device_argument,
    duration,
    endpoint_argument,
    no_check_option,
    no_wait_option,
)
from barewire_workbench.cli.ending import EndedBySignal, ended_by_signals, late_response_awaited
from barewire_workbench.cli.output import Output, note, output_option, print_json
from barewire_workbench.cli.shown_frames import frames_option, frames_shown

_Action = Callable[..., DriveStatus]
"""A method of a drive with the arguments of its command; returns the status at the end."""


class _DriveGroup(CommandGroup):
    """A group that shows the help of a command in any place: `drive move --help` needs no ENDPOINT and DEVICE."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse the arguments of the group; with --help, print the help of the command and exit."""
        command = next((self.commands[word] for word in args if word in self.commands), None)
        if command is not None and set(ctx.help_option_names).intersection(args):
            click.echo(command.get_help(click.Context(command, info_name=command.name, parent=ctx)))
            ctx.exit()
        return super().parse_args(ctx, args)


@click.group("drive", cls=_DriveGroup)
@endpoint_argument
@device_argument
@click.pass_context
def drive_command(ctx: click.Context, endpoint: str, device: str) -> None:
    """Enable, move and stop a CiA 402 drive.

    DEVICE is one whose description has a table [drive]: az3, csd-mt, or your own. Each command waits until the drive
    reaches the state or position. If it does not, the error names the state in which it is stuck, and why. While a
    movement is under way, Ctrl-C is a quick stop; so are SIGTERM, a closed terminal and a closed pipe. Until the quick
    stop is confirmed or has failed, further signals are ignored.

    move, velocity and home need an enabled drive: none of them switches the current on unless --enable is given.

    A machine that says that it is another one is not moved; `--no-check` does not ask, nor do quick-stop and disable.

    After a time-out on a serial line the command waits at its end until no late response is expected (3 time-outs).

    `barewire drive COMMAND --help` explains a command.

    \b
    barewire drive tcp://192.168.1.10 csd-mt enable
    barewire drive tcp://192.168.1.10 csd-mt move 12800 --relative --velocity 20000
    barewire drive "can://socketcan/can0?node=1" az3 velocity -1500 --enable
    barewire drive "rtu:///dev/ttyUSB0?unit=1" az3 quick-stop
    """
    description = load(device)
    drive_roles(description)  # a device that is not a drive is reported before a port is opened
    ctx.obj = (endpoint, description, device)


class _MovingCommand(click.Command):
    """A command with a TARGET, which may begin with a dash: -1000 is not an option, --velocty is a misspelt one."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse the arguments. An option that does not exist is an error with the nearest one."""
        known = {name for parameter in self.get_params(ctx) for name in parameter.opts if name.startswith("-")}
        for word in args:
            name = word.partition("=")[0]
            if name not in known and re.match(r"--?[a-z]", name):
                from difflib import get_close_matches  # only errors need it

                raise click.NoSuchOption(name, possibilities=get_close_matches(name, known), ctx=ctx)
        return super().parse_args(ctx, args)


def _number(value: str) -> int | float:
    """The type of a number; an int if it has no fraction, because most drives count in steps."""
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise click.BadParameter(f"{shown(value)}: expected a number")
    return int(number) if number.is_integer() else number


def _action(name: str, *, moves: bool = False) -> Callable[[_Action], click.Command]:
    """Make a command of an action, with the options that all have; Ctrl-C is a quick stop if the action `moves`."""

    def make_command(action: _Action) -> click.Command:
        @wraps(action)
        def run_action(
            ctx: click.Context,
            /,
            output: Output,
            timeout: float,
            no_wait: bool,
            no_check: bool,
            frames: bool,
            **arguments: Any,
        ) -> None:
            endpoint, device, _ = ctx.obj
            if moves:
                check_mode(device, name)  # before a port is opened
            with (
                frames_shown(endpoint, device, frames, output) as options,
                connect(device, endpoint, **options) as machine,
                late_response_awaited(lambda: machine, no_wait),
                _progress_output(output) as show_progress,
            ):
                if name in _MUST_BE_DONE:
                    show_progress = _if_possible(show_progress)
                else:
                    _check(machine, no_check, before_write=name != "status")
                if name == "enable" and (old := _old_target(machine, device)):
                    note(old)
                client = machine.drive.following(show_progress, timeout=timeout)
                status = _carry_out(name, action, client, arguments, moves=moves)
            bits = ", ".join(bit_names(status.status_word)) or "no bit set"
            output.text(f"{status.state_name}{_values(status)}; status word {status.status_word:04X}h: {bits}")
            output.text(*_remarks(name, device, status, arguments))
            if name == "velocity" and arguments["target"]:
                stop = f'barewire drive "{endpoint}" {shlex.quote(ctx.obj[2])} velocity 0'
                output.text(f"the motor keeps turning; to stop it: {stop}")
            if name == "reset" and client.drive.control is None:  # nothing was written
                output.text("no fault to reset")

        # A negative target such as -1000 begins with a dash and is not an option.
        settings = {"ignore_unknown_options": moves}
        command = output_option(
            _timeout_option(no_wait_option(no_check_option(frames_option(click.pass_context(run_action)))))
        )
        kind = _MovingCommand if moves else click.Command
        return drive_command.command(name, cls=kind, context_settings=settings)(command)

    return make_command


def _carry_out(
    name: str, action: _Action, client: DriveClient, arguments: dict[str, Any], *, moves: bool
) -> DriveStatus:
    """Carry out an action. A movement that does not reach its target, or that a signal ends, becomes a quick stop."""
    with ended_by_signals(interrupt=True) as ignore_signals:
        try:
            try:
                return action(client, **arguments)
            except Exception:
                ignore_signals()  # from here on nothing interrupts a quick stop or the report of an error
                raise
        except (NoAnswer, PortError) as error:
            if moves and client.drive.control is not None:
                error.add_note(f"{name}: the motor may still be turning")
            raise
        except DriveStuck as error:
            if moves and client.drive.control is not None:
                outcome = _quick_stop(client, f"{name} did not reach its target")
                error.add_note(f"then the command stopped the motor: {outcome}")
            raise
        except (EndedBySignal, OSError) as error:
            if moves and (isinstance(error, EndedBySignal) or client.drive.control is not None):
                outcome = _quick_stop(client, f"{name} was interrupted")
                with suppress(OSError):
                    note(f"{name} was interrupted: {outcome}")
            if isinstance(error, EndedBySignal):
                raise click.exceptions.Exit(error.status) from None
            raise


def _check(machine: MachineClient, no_check: bool, *, before_write: bool) -> None:
    """Ask the machine what it is. A signal ends the command, and stops nothing: nothing was written yet."""
    with ended_by_signals():
        try:
            check_machine(machine, no_check, before_write=before_write)
        except EndedBySignal as error:
            raise click.exceptions.Exit(error.status) from None


def _old_target(machine: Any, device: Device) -> str:
    """Return why a drive will turn as soon as it is enabled: its mode is velocity, and a target is left in it."""
    roles = drive_roles(device)
    if not (roles.mode and roles.target_velocity and "velocity" in roles.modes):
        return ""
    with suppress(Refused):  # a drive whose commands cannot be read back is not checked
        mode, target = machine.read(roles.mode, roles.target_velocity)
        if mode.value == roles.modes["velocity"] and target.value:
            shown = target.parameter.plain_text(target.value)
            return f"{roles.target_velocity} is {shown} in the velocity mode: the motor turns when it is enabled"
    return ""


_AT_REST = ("move", "home", "velocity", "quick-stop")
"""The actions that end at a velocity that is known: 0, or the target."""
_MUST_BE_DONE = ("quick-stop", "disable")
"""The actions that are carried out also if nothing can be printed, and without a question before them."""
_CURRENT_ON = (State.OPERATION_ENABLED, State.QUICK_STOP_ACTIVE)


def _if_possible(show_progress: Callable[[DriveProgress], object]) -> Callable[[DriveProgress], None]:
    """Return a function that shows progress, and does nothing if the output is closed or full."""

    def try_to_show(progress: DriveProgress) -> None:
        with suppress(OSError):
            show_progress(progress)

    return try_to_show


def _quick_stop(client: DriveClient, why: str) -> str:
    """Stop the drive, also if the progress cannot be printed because the terminal is closed; return what was done and
    the state in which the drive is left."""
    client.drive.progress = None if client.drive.progress is None else _if_possible(client.drive.progress)
    try:
        status = client.quick_stop()
    except BarewireError as error:
        error.add_note(f"{why}, and its quick stop failed: the motor may still be turning")
        raise
    current = "on, the motor holds its position" if status.state in _CURRENT_ON else "off, the motor is free"
    where = "" if status.position is None else f" at position {show(status.position)}"
    return f"quick stop, the motor stands{where}; {status.state_name}; current {current}"


def _remarks(action: str, device: Device, status: DriveStatus, arguments: dict[str, Any]) -> Iterator[str]:
    """Yield what the values of a result do not explain: a limit of the drive, and a velocity that lags behind."""
    if action == "velocity" and status.is_limited:
        held = "" if status.velocity is None else f" at {show(status.velocity)}"
        yield f"the drive limits itself{held}, {show(arguments['target'])} was asked for (internal limit, bit 11)"
        return
    goal = arguments["target"] if action == "velocity" else 0
    shown = status.velocity
    if action in _AT_REST and shown is not None and abs(float(shown) - goal) > _CLOSE * abs(goal):
        parameter = device.find(drive_roles(device).velocity)
        why = parameter.note.partition(". ")[0]
        if why[1:2].islower():
            why = why[0].lower() + why[1:]
        stands = not goal and action in ("velocity", "quick-stop")
        done = "the motor stands" if stands else "the target is reached"
        if why or not goal:
            yield f"{done}; {parameter.name} still shows {show(shown)}{why and f': {why}'}"


_CLOSE = 0.02
"""The part of a velocity by which the one that is shown may differ without a remark."""


_timeout_option = click.option(
    "--timeout",
    type=duration,
    default=3.0,
    show_default=True,
    metavar="S",
    help="Seconds for each change of state.",
)
_enable_option = click.option(
    "--enable", is_flag=True, help="Enable the drive first; otherwise it must be enabled already."
)
_within_option = click.option(
    "--within",
    type=duration,
    default=60.0,
    show_default=True,
    metavar="S",
    help="Seconds for the movement; after them, a quick stop.",
)
_velocity_option = click.option("--velocity", type=_number, help="Profile velocity, in the drive's unit.")
_acceleration_option = click.option("--acceleration", type=_number, help="Profile acceleration.")
_deceleration_option = click.option("--deceleration", type=_number, help="Profile deceleration.")


# Progress


@contextmanager
def _progress_output(output: Output) -> Iterator[Callable[[DriveProgress], None]]:
    """Yield a function that prints progress: JSON lines, on a terminal one line that is updated, or a line a change."""
    start = time.monotonic()
    if output.as_json:
        yield lambda progress: print_json(progress.as_dict() | {"time": round(progress.status.now - start, 3)})
    elif sys.stdout.isatty():
        columns = (SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn())
        with Bar(*columns, console=Console(highlight=False), transient=True) as bar:
            task = bar.add_task("", total=None)
            yield lambda progress: bar.update(task, description=_short(progress))
    else:
        yield _line_per_change(start)


def _line_per_change(start: float) -> Callable[[DriveProgress], None]:
    """Return a function that prints a line for each new state and condition, with the seconds since the start."""
    shown: tuple[str, str] | None = None

    def show_progress(progress: DriveProgress) -> None:
        nonlocal shown
        status, waiting_for = progress.status, progress.waiting_for
        if waiting_for and shown != (status.state_name, waiting_for):
            shown = (status.state_name, waiting_for)
            goal = "" if waiting_for == repr(status.state_name) else f", waiting for {waiting_for}"
            text = f"{progress.action}: {status.state_name}{goal}{_values(status)}"
            print(f"{status.now - start:7.3f} s  {text}", flush=True)

    return show_progress


def _short(progress: DriveProgress) -> str:
    """Return the progress in one line of a terminal: the values of a drive that may move, the state of any other."""
    goal = progress.waiting_for.partition(" (")[0]
    status = progress.status
    state = "" if status.state is State.OPERATION_ENABLED else f", {status.state_name}"
    values = _values(status) if status.velocity or not state else ""
    # The goal is last: a terminal of 80 columns may cut it, and not the velocity.
    return f"{progress.action}{state}{values}{goal and f'; waiting for {goal}'}"


def _values(status: DriveStatus) -> str:
    values = (("position", status.position), ("velocity", status.velocity))
    return "".join(f", {name} {show(value)}" for name, value in values if value is not None)


# The commands


@_action("status")
def status_command(drive: DriveClient) -> DriveStatus:
    """Read state, position and velocity once."""
    return drive.status()


@_action("enable")
def enable_command(drive: DriveClient) -> DriveStatus:
    """Go to operation enabled. A fault is not reset."""
    return drive.enable()


@_action("disable")
def disable_command(drive: DriveClient) -> DriveStatus:
    """Switch the current off. A turning motor coasts; quick-stop brakes it."""
    return drive.disable()


@_action("quick-stop")
def quick_stop_command(drive: DriveClient) -> DriveStatus:
    """Brake on the quick stop ramp."""
    return drive.quick_stop()


@_action("reset")
def reset_command(drive: DriveClient) -> DriveStatus:
    """Reset a fault whose cause is gone."""
    return drive.reset()


@_action("move", moves=True)
@click.argument("target", type=_number)
@click.option("--relative", is_flag=True, help="Move by TARGET, not to it.")
@click.option("--immediately", is_flag=True, help="Replace a movement that is under way.")
@_velocity_option
@_acceleration_option
@_deceleration_option
@_within_option
@_enable_option
def move_command(drive: DriveClient, target: int | float, **arguments: Any) -> DriveStatus:
    """Move the enabled drive to the position TARGET.

    TARGET is in the drive's unit. If it is not reached `--within` S, the command stops the motor by a quick stop.
    Profile values that are not given stay as they are in the drive.
    """
    return drive.move(target, **arguments)


@_action("velocity", moves=True)
@click.argument("target", type=_number)
@_acceleration_option
@_deceleration_option
@_within_option
@_enable_option
def velocity_command(drive: DriveClient, target: int | float, **arguments: Any) -> DriveStatus:
    """Turn the enabled drive at the velocity TARGET.

    TARGET is in the drive's unit. If it is not reached `--within` S, the command stops the motor by a quick stop.
    The motor keeps turning after the command ends. 0 stops it on its ramp.
    """
    return drive.velocity(target, **arguments)


@_action("home", moves=True)
@click.argument("method", type=click.IntRange(-128, 127), required=False)
@_within_option
@_enable_option
def home_command(drive: DriveClient, method: int | None, **arguments: Any) -> DriveStatus:
    """Find the home position with the enabled drive.

    Without METHOD, the method that is set in the drive is used. If home is not found `--within` S, the command stops
    the motor by a quick stop.
    """
    return drive.home(method, **arguments)
