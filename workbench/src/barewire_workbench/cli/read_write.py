"""`barewire read` and `barewire write`: named values of a machine, over Modbus or CANopen."""

from __future__ import annotations

import csv
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace

import click

from barewire import BarewireError, connect
from barewire.codecs import Value
from barewire.devices import Device, Parameter, Reading
from barewire.devices.parameter import show
from barewire.devices.request_checks import to_write
from barewire.errors import shown
from barewire.io.endpoint import Endpoint
from barewire.io.machine import MachineClient
from barewire.modbus.exceptions import ModbusException
from barewire_workbench.cli.arguments import (
    Choice,
    check_machine,
    check_no_file_name,
    device_argument,
    endpoint_argument,
    no_check_option,
    no_wait_option,
    print_timing,
    timing_option,
)
from barewire_workbench.cli.completion import complete_name
from barewire_workbench.cli.dry_run import address_text, frames_of, raw_text
from barewire_workbench.cli.ending import late_response_awaited
from barewire_workbench.cli.output import Output, note, output_option
from barewire_workbench.cli.raw_address import (
    device_with,
    expanded,
    is_raw_address,
    names_to_read,
    printed_number_hint,
    wire_address,
)
from barewire_workbench.cli.shown_frames import ShownFrames, frames_option, frames_shown, is_verbose
from barewire_workbench.cli.value_text import parse_value
from barewire_workbench.eds.device import configured_values
from barewire_workbench.live.read_values import (
    COLUMNS,
    ReadValue,
    is_pattern,
    read_values,
)


@click.command("read")
@endpoint_argument
@device_argument
@click.argument("names", nargs=-1, metavar="NAME...", shell_complete=complete_name)
@click.option("--all", "everything", is_flag=True, help="Read every value that can be read.")
@click.option("--group", "groups", multiple=True, help="Read the values of this group; `barewire devices` lists them.")
@click.option("--access", type=Choice(["ro", "rw"]), help="Of these, only what is read only, or writable.")
@click.option("--csv", "as_csv", is_flag=True, help="Print a table for a spreadsheet.")
@output_option
@timing_option
@no_wait_option
@no_check_option
@frames_option
@click.pass_context
def read_command(
    context: click.Context,
    /,
    endpoint: str,
    device: str,
    names: tuple[str, ...],
    everything: bool,
    groups: tuple[str, ...],
    access: str | None,
    as_csv: bool,
    output: Output,
    timing: bool,
    no_wait: bool,
    no_check: bool,
    frames: bool,
) -> None:
    """Read named values of a device.

    \b
    barewire read "rtu:///dev/ttyUSB0?unit=1" adxl "Thyristors temperature" "Status"
    barewire read "tcp://127.0.0.1:1502" raw holding:100 input:0x0FB1:u32 coil:7
    barewire read "can://socketcan/can0?node=5" raw object:1018h.1:u32 object:1008h:string
    barewire read "can://socketcan/can0?node=5" drive.eds 1018h.1 "*velocity*"
    barewire read "tcp://127.0.0.1:1502" csd-mt --all --access rw --csv
    barewire read "tcp://127.0.0.1:1502" csd-mt "*velocity*"

    DEVICE is a name of `barewire devices`, the directory of your own description, or an EDS or DCF file. Instead of a
    NAME, give an address: TABLE:ADDRESS[:TYPE[:ORDER]], counted from 0 as on the wire, or object:INDEX[.SUB]:TYPE, of
    an object that DEVICE has also 1018h.1. holding:0-9 is each register from 0 to 9; 40001, 400001, 4x0001 and hr:0 are
    holding:0. DEVICE `raw` is any device, by addresses only. A NAME with * or ? in it is each value that has such a
    name.

    --all, --group and a NAME with * leave out what a reading changes, or what may be long; its own name reads it.

    Of several values, one that the device refuses, or does not answer, costs only itself: its line says why, the
    others are read, and the exit status is 1.

    A machine that says that it is another one is not read, which takes a request or two. `--no-check` reads it anyway.

    A request waits `timeout` seconds for its response (1, an option of ENDPOINT). If there is none on a serial line,
    the command waits until `late_window` is over (3 time-outs): a late response must not reach the next command.
    """
    if not (names or everything or groups):
        raise click.UsageError("no NAME given: expected names, --group or --all; see barewire read --help")
    if everything and (names or groups):
        raise click.UsageError("--all reads every value: expected no NAME and no --group beside it")
    if as_csv and output.as_json:
        raise click.UsageError("--csv and --json: give one of them")
    check_no_file_name(names)
    described = device_with(device, endpoint=endpoint)
    names = expanded(names, described)
    description = device_with(described, [name for name in names if not is_pattern(name)])
    # An unknown name is reported before a port is opened.
    wanted = names_to_read(description, endpoint, names, groups=groups, access=access)
    if not wanted:
        raise click.UsageError(f"{device} has no such value that can be read over {endpoint.partition(':')[0]}")
    if timing:
        print_timing(endpoint, description)
    configured = configured_values(description)
    columns = (*COLUMNS, "configuration") if configured else COLUMNS
    table = csv.DictWriter(sys.stdout, columns, restval="", lineterminator="\n") if as_csv else None
    failed = 0
    with connected(description, endpoint, no_wait, frames=frames, output=output) as machine:
        check_machine(machine, no_check)
        is_one = len(wanted) == 1 and not (as_csv or everything or groups)
        values = [_read_one(machine, wanted[0])] if is_one else _read_several(machine, wanted)
        if table is not None:
            table.writeheader()
        for value in values:
            value = value._replace(configured=configured.get(value.parameter.name))
            failed += value.reading is None
            if table is not None:
                table.writerow(value.as_dict())
            else:
                output.show(value, value.as_dict)
    if failed:
        note(f"{failed} of {len(wanted)} values were not read")
        context.exit(1)


def _read_one(machine: MachineClient, name: str) -> ReadValue:
    """Read one value, whose error is that of the command."""
    try:
        reading = machine.read(name)
    except ModbusException as error:
        if hint := _hint(machine.device.find(name)):
            error.add_context(hint)
        raise
    return ReadValue(reading.parameter, reading)


def _read_several(machine: MachineClient, names: Sequence[str]) -> Iterator[ReadValue]:
    for value in read_values(machine, names):
        hint = _hint(value.parameter) if value.reading is None else ""
        yield value._replace(problem=f"{value.problem}; {hint}") if hint else value


@click.command("write")
@endpoint_argument
@device_argument
@click.argument("assignments", nargs=-1, required=True, metavar="NAME=VALUE...", shell_complete=complete_name)
@click.option(
    "--force",
    is_flag=True,
    help="Write also values that are read only or out of range, and read back what the device has then.",
)
@click.option(
    "--verify", is_flag=True, help="Read back what was written; exit status 1 if the device has another value."
)
@click.option("--dry-run", is_flag=True, help="Show what would be written, with --frames each frame; send nothing.")
@output_option
@timing_option
@no_wait_option
@no_check_option
@frames_option
@click.pass_context
def write_command(
    context: click.Context,
    /,
    endpoint: str,
    device: str,
    assignments: tuple[str, ...],
    force: bool,
    verify: bool,
    dry_run: bool,
    output: Output,
    timing: bool,
    no_wait: bool,
    no_check: bool,
    frames: bool,
) -> None:
    """Write named values of a device, in the order given.

    A VALUE is a number (0x for hexadecimal), on or off, or the name of one of the parameter's values; of an octet
    string or a domain bytes such as 01AB, or @FILE; of a time of day 2026-03-01T12:00:00. Adjacent registers are
    written in one request where the device allows it. Half a register, or one bit of a register or of an object, is
    read, changed and written back; the output line states that.

    Nothing is written to a machine that says that it is another one, or that does not say what its manual promises.
    `--no-check` does not ask.

    \b
    barewire write "tcp://127.0.0.1:1502" csd-mt "Control Word=0x0006"
    barewire write "tcp://127.0.0.1:1502" csd-mt "Profile Velocity=5000" --dry-run --frames
    barewire write "tcp://127.0.0.1:1502" raw holding:100:f32=1.5 coil:7=on --verify
    """
    described = device_with(device, endpoint=endpoint)
    given = [(wire_address(name, described), value) for name, value in map(_assignment, assignments)]
    description = device_with(described, [name for name, _ in given])
    wanted = [_parsed(description.find(name), value) for name, value in given]
    for name, value in wanted:
        # Every value is checked before the first is sent: half of a sequence may start a motor.
        to_write(description, {name: value}, force)
        parameter = description.find(name)
        if verify and not (parameter.readable and parameter.answered):
            why = "it cannot be read" if not parameter.readable else "the device does not answer it"
            raise click.UsageError(f"--verify: {parameter.name}: {why}")
        _note_unnamed(parameter, value)
    if timing:
        print_timing(endpoint, description)
    if dry_run:
        _show_plan(endpoint, description, wanted, output, force=force, frames=frames)
        return
    differing = 0
    with connected(description, endpoint, no_wait, frames=frames, output=output) as machine:
        check_machine(machine, no_check, before_write=True)
        for values in _batches(wanted):
            done = "each may be written or not: "
            try:
                machine.write(values, force=force)
                done = "written, and perhaps not read back: "
                differing += _tell_written(machine, values, endpoint, output, verify=verify, force=force)
            except KeyboardInterrupt as error:
                error.add_note(done + ", ".join(values))
                raise
    if verify and differing:
        note(f"{differing} of {len(wanted)} values are not as written")
        context.exit(1)


def _tell_written(
    machine: MachineClient, values: Mapping[str, Value], endpoint: str, output: Output, *, verify: bool, force: bool
) -> int:
    """Print what was written, each value read back if that is asked for. Return how many the device has otherwise."""
    differing = 0
    for name, value in values.items():
        reading = Reading(machine.device.find(name), value)
        how = _how_written(reading.parameter, endpoint)
        if verify or force:
            is_same, text = _read_back(machine, reading, endpoint)
            differing += not is_same
            how += text or ("; the device has it" if verify else "")
        output.show(f"{reading}, {how}", ReadValue(reading.parameter, reading).as_dict() | {"how": how})
    return differing


def _hint(parameter: Parameter) -> str:
    """Return what the address of a parameter that was not read probably is; empty if it is none of a manual."""
    place = parameter.modbus
    if place is None or not is_raw_address(parameter.name):
        return ""
    return printed_number_hint(place.table, place.address)


@contextmanager
def connected(device: Device, endpoint: str, no_wait: bool, *, frames: bool, output: Output) -> Iterator[MachineClient]:
    """Yield the connected machine. With `frames`, print each frame that passes."""
    with (
        frames_shown(endpoint, device, frames, output) as options,
        connect(device, endpoint, **options) as machine,
        late_response_awaited(lambda: machine, no_wait),
    ):
        yield machine


def _batches(wanted: list[tuple[str, Value]]) -> Iterator[dict[str, Value]]:
    """Yield values that can be written in one call, in order. A name that comes again begins the next batch.

    >>> list(_batches([("Control Word", 6), ("Control Word", 7), ("Target Position", 100)]))
    [{'Control Word': 6}, {'Control Word': 7, 'Target Position': 100}]
    """
    batch: dict[str, Value] = {}
    for name, value in wanted:
        if name in batch:
            yield batch
            batch = {}
        batch[name] = value
    yield batch


def _assignment(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not equals:
        raise click.UsageError(f"{shown(text)}: expected NAME=VALUE")
    return name, value


def _parsed(parameter: Parameter, value: str) -> tuple[str, Value]:
    return parameter.name, parse_value(parameter, value)


def _note_unnamed(parameter: Parameter, value: Value) -> None:
    """Print a note for a number that has no name although the parameter names its values; it is written anyway."""
    if parameter.values and value not in parameter.values:
        names = "; ".join(f"{number}: {name}" for number, name in parameter.values.items())
        note(f"note: {parameter.name} = {show(value)} has no name in the description: {names}")


def _how_written(parameter: Parameter, endpoint: str) -> str:
    """Return how a value was written: as a whole, as a part of a register or object, or without confirmation."""
    if not parameter.answered:
        return "sent: the device does not answer it"
    part = _part(parameter, endpoint)
    return f"written: its {part} was read, changed and written back" if part else "written"


def _part(parameter: Parameter, endpoint: str) -> str:
    """Return of what the value is only a part: "register" or "object"; empty if it is a whole one."""
    if endpoint.startswith("can:"):
        return "object" if parameter.object is not None and parameter.object.bit is not None else ""
    return "register" if parameter.modbus is not None and parameter.modbus.partial else ""


def _read_back(machine: MachineClient, written: Reading, endpoint: str) -> tuple[bool, str]:
    """Return whether the device has what was written, and a text if it has not: a device may keep its own value and
    report no error. Raw numbers are compared, since its value may be out of the range."""
    parameter = replace(written.parameter, minimum=None, maximum=None)
    if not parameter.readable or not parameter.answered:
        return True, ""
    try:
        present = machine.read(parameter.name).value
    except BarewireError as error:
        return False, f"; not read back: {error}"
    is_can = Endpoint.parse(endpoint).scheme == "can"
    if raw_text(parameter, present, is_can=is_can) == raw_text(parameter, written.value, is_can=is_can):
        return True, ""
    return False, f", but the device has {parameter.text(present)}"


def _show_plan(
    endpoint: str, device: Device, wanted: list[tuple[str, Value]], output: Output, *, force: bool, frames: bool
) -> None:
    """Print what would be written."""
    is_can = Endpoint.parse(endpoint).scheme == "can"
    for values in _batches(wanted):
        planned = list(frames_of(endpoint, device, values, force=force))  # also checks that it can be written there
        for name, value in values.items():
            reading = Reading(device.find(name), value)
            parameter = replace(reading.parameter, minimum=None, maximum=None)
            address, raw = address_text(parameter, is_can=is_can), raw_text(parameter, value, is_can=is_can)
            part = _part(parameter, endpoint)
            how = f"; its {part} is read, changed and written back" if part else ""
            fields = ReadValue(reading.parameter, reading).as_dict() | {"raw": raw, "address": address}
            output.show(f"{reading}, would be written: raw {raw} to {address}{how}", fields)
        if frames:
            shown_frames = ShownFrames(endpoint, device, every_field=is_verbose(), output=output)
            for frame in planned:
                shown_frames.show("would send", frame)
