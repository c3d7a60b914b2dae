"""`barewire read` and `barewire write`: named values of a machine, over whatever wire."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import click

from barewire.cli.arguments import (
    device_argument,
    endpoint_argument,
    json_option,
    print_json,
    say_timing,
    timing_option,
)
from barewire.codecs import Value
from barewire.devices import Device, Parameter, Reading
from barewire.devices.parameter import show
from barewire.devices.raw_address import device_with
from barewire.devices.request_checks import to_write
from barewire.devices.value_text import parse_value
from barewire.errors import BarewireError, NoAnswer
from barewire.io.machine import MachineClient, connect
from barewire.io.modbus.client import ModbusClient


@click.command()
@endpoint_argument
@device_argument
@click.argument("names", nargs=-1, required=True, metavar="NAME...")
@json_option
@timing_option
def read(endpoint: str, device: str, names: tuple[str, ...], as_json: bool, timing: bool) -> None:
    """Read named values.

    \b
    barewire read "rtu:///dev/ttyUSB0?unit=1" adxl "Thyristors temperature" "Status"
    barewire read "tcp://127.0.0.1:1502" raw holding:100 input:0x0FB1:u32 coil:7
    barewire read "can://socketcan/can0?node=5" raw object:1018h.1:u32

    A place may stand for a name, TABLE:ADDRESS[:TYPE[:ORDER]] or object:INDEX[.SUB]:TYPE, with the address on the wire,
    from 0. DEVICE `raw` has nothing else: whatever answers.
    """
    machine = device_with(device, names)
    for name in names:
        machine.find(name)  # a wrong name is told before a port is opened
    say_timing(endpoint, timing)
    with _connected(machine, endpoint) as connected:
        for reading in connected.read_all(names):
            _print(reading, as_json)


@click.command()
@endpoint_argument
@device_argument
@click.argument("assignments", nargs=-1, required=True, metavar="NAME=VALUE...")
@click.option("--force", is_flag=True, help="Send what the description calls read only or out of range.")
@json_option
@timing_option
def write(endpoint: str, device: str, assignments: tuple[str, ...], force: bool, as_json: bool, timing: bool) -> None:
    """Write named values, in the order given.

    A VALUE is a number (0x for hexadecimal), on or off, or the name of one of the parameter's values. Neighbours travel
    in one request where the device lets them. Half a register, one bit of a register or of an object is read, changed
    and written back, and the answer says so.

    \b
    barewire write "tcp://127.0.0.1:1502" csd-mt "Control Word=0x0006"
    barewire write "tcp://127.0.0.1:1502" raw holding:100:f32=1.5 coil:7=on
    """
    machine = device_with(device, [text.partition("=")[0] for text in assignments])
    wanted = [_assignment(machine, text) for text in assignments]
    for name, value in wanted:
        # All of them before the first is sent: half a command may start a motor.
        to_write(machine, {name: value}, force)
        _remark(machine.find(name), value)
    say_timing(endpoint, timing)
    with _connected(machine, endpoint) as connected:
        for values in _in_turn(wanted):
            connected.write(values, force=force)
            for name, value in values.items():
                reading = Reading(machine.find(name), value)
                _print(reading, as_json, how=_how(reading.parameter, endpoint))


@contextmanager
def _connected(device: Device, endpoint: str) -> Iterator[MachineClient]:
    """The machine. A serial line is not left to the next command while a lost answer may still come there."""
    with connect(device, endpoint) as machine:
        try:
            yield machine
        except NoAnswer:
            if isinstance(machine.client, ModbusClient):
                with suppress(BarewireError):
                    machine.client.settle()
            raise


def _in_turn(wanted: list[tuple[str, Value]]) -> Iterator[dict[str, Value]]:
    """What can be written together, neighbours in one request. Order is kept, and a name may come twice: another turn.

    >>> list(_in_turn([("Control Word", 6), ("Control Word", 7), ("Target Position", 100)]))
    [{'Control Word': 6}, {'Control Word': 7, 'Target Position': 100}]
    """
    turn: dict[str, Value] = {}
    for name, value in wanted:
        if name in turn:
            yield turn
            turn = {}
        turn[name] = value
    yield turn


def _assignment(machine: Device, text: str) -> tuple[str, Value]:
    name, equals, value = text.partition("=")
    if not equals:
        raise click.UsageError(f"{text!r}: expected NAME=VALUE")
    parameter = machine.find(name)
    return parameter.name, parse_value(parameter, value)


def _remark(parameter: Parameter, value: Value) -> None:
    """A number that none of the names of a parameter stands for may be right: it is sent, and remarked on."""
    if parameter.values and value not in parameter.values:
        names = "; ".join(f"{number}: {name}" for number, name in parameter.values.items())
        told = f"{parameter.name} = {show(value)} has no name in the description: {names}"
        print(f"barewire: note: {told}", file=sys.stderr)


def _how(parameter: Parameter, endpoint: str) -> str:
    """How a value was written: as it is, as a part of what travels, or without an answer that would say so."""
    if not parameter.answered:
        return "sent: the device does not answer it"
    if endpoint.startswith("can:"):
        part = "object" if parameter.object is not None and parameter.object.bit is not None else ""
    else:
        part = "register" if parameter.modbus is not None and parameter.modbus.partial else ""
    return f"written: its {part} was read, changed and written back" if part else "written"


def _print(reading: Reading, as_json: bool, how: str = "") -> None:
    if not as_json:
        print(f"{reading}, {how}" if how else str(reading), flush=True)
        return
    text = reading.parameter.text(reading.value)
    fields = {"name": reading.name, "value": reading.value, "unit": reading.unit, "text": text}
    print_json(fields | ({"how": how} if how else {}))
