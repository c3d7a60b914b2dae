"""`barewire read` and `barewire write`: named values of a machine, over Modbus or CANopen."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import click

from barewire import BarewireError, connect
from barewire.codecs import Value
from barewire.devices import Device, Parameter, Reading
from barewire.devices.parameter import show
from barewire.devices.raw_address import device_with, expanded
from barewire.devices.request_checks import parse_value, to_write
from barewire.errors import shown
from barewire.io.machine import MachineClient
from barewire_workbench.cli.arguments import (
    device_argument,
    endpoint_argument,
    no_wait_option,
    print_timing,
    timing_option,
)
from barewire_workbench.cli.ending import late_response_awaited
from barewire_workbench.cli.output import Output, note, output_option
from barewire_workbench.cli.shown_frames import frames_option, frames_shown


@click.command("read")
@endpoint_argument
@device_argument
@click.argument("names", nargs=-1, required=True, metavar="NAME...")
@output_option
@timing_option
@no_wait_option
@frames_option
def read_command(
    endpoint: str, device: str, names: tuple[str, ...], output: Output, timing: bool, no_wait: bool, frames: bool
) -> None:
    """Read named values of a device.

    \b
    barewire read "rtu:///dev/ttyUSB0?unit=1" adxl "Thyristors temperature" "Status"
    barewire read "tcp://127.0.0.1:1502" raw holding:100 input:0x0FB1:u32 coil:7
    barewire read "can://socketcan/can0?node=5" raw object:1018h.1:u32

    DEVICE is a name of `barewire devices`, or the directory of your own description. Instead of a NAME, give an
    address: TABLE:ADDRESS[:TYPE[:ORDER]], counted from 0 as on the wire, or object:INDEX[.SUB]:TYPE. holding:0-9 is
    each register from 0 to 9. DEVICE `raw` is any device, by addresses only.

    A request waits `timeout` seconds for its response (1, an option of ENDPOINT). If there is none on a serial line,
    the command waits until `late_window` is over (3 time-outs): a late response must not reach the next command.
    """
    names = expanded(names)
    description = device_with(device, names)
    for name in names:
        description.find(name)  # an unknown name is reported before a port is opened
    if timing:
        print_timing(endpoint)
    with _connected(description, endpoint, no_wait, frames=frames, output=output) as machine:
        for reading in machine.read_all(names):
            output.show(reading, _fields(reading))


@click.command("write")
@endpoint_argument
@device_argument
@click.argument("assignments", nargs=-1, required=True, metavar="NAME=VALUE...")
@click.option(
    "--force",
    is_flag=True,
    help="Write also values that are read only or out of range, and read back what the device has then.",
)
@output_option
@timing_option
@no_wait_option
@frames_option
def write_command(
    endpoint: str,
    device: str,
    assignments: tuple[str, ...],
    force: bool,
    output: Output,
    timing: bool,
    no_wait: bool,
    frames: bool,
) -> None:
    """Write named values of a device, in the order given.

    A VALUE is a number (0x for hexadecimal), on or off, or the name of one of the parameter's values. Adjacent
    registers are written in one request where the device allows it. Half a register, or one bit of a register or of an
    object, is read, changed and written back; the output line states that.

    \b
    barewire write "tcp://127.0.0.1:1502" csd-mt "Control Word=0x0006"
    barewire write "tcp://127.0.0.1:1502" raw holding:100:f32=1.5 coil:7=on
    """
    description = device_with(device, [text.partition("=")[0] for text in assignments])
    wanted = [_assignment(description, text) for text in assignments]
    for name, value in wanted:
        # Every value is checked before the first is sent: half of a sequence may start a motor.
        to_write(description, {name: value}, force)
        _note_unnamed(description.find(name), value)
    if timing:
        print_timing(endpoint)
    with _connected(description, endpoint, no_wait, frames=frames, output=output) as machine:
        for values in _batches(wanted):
            machine.write(values, force=force)
            for name, value in values.items():
                reading = Reading(description.find(name), value)
                how = _how_written(reading.parameter, endpoint) + (_read_back(machine, reading) if force else "")
                output.show(f"{reading}, {how}", _fields(reading) | {"how": how})


@contextmanager
def _connected(
    device: Device, endpoint: str, no_wait: bool, *, frames: bool, output: Output
) -> Iterator[MachineClient]:
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


def _assignment(device: Device, text: str) -> tuple[str, Value]:
    name, equals, value = text.partition("=")
    if not equals:
        raise click.UsageError(f"{shown(text)}: expected NAME=VALUE")
    parameter = device.find(name)
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
    if endpoint.startswith("can:"):
        part = "object" if parameter.object is not None and parameter.object.bit is not None else ""
    else:
        part = "register" if parameter.modbus is not None and parameter.modbus.partial else ""
    return f"written: its {part} was read, changed and written back" if part else "written"


def _read_back(machine: MachineClient, written: Reading) -> str:
    """Return what the device has after a forced write: it may keep its own value and report no error."""
    parameter = written.parameter
    if not parameter.readable or not parameter.answered:
        return ""
    try:
        present = parameter.text(machine.read(parameter.name).value)
    except BarewireError as error:
        return f"; not read back: {error}"
    return "" if present == parameter.text(written.value) else f", but the device has {present}"


def _fields(reading: Reading) -> dict[str, object]:
    text = reading.parameter.text(reading.value)
    return {"name": reading.name, "value": reading.value, "unit": reading.unit, "text": text}
