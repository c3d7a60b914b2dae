"""`barewire read` and `barewire write`: named values of a machine, over whatever wire."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import click

from barewire.cli.arguments import device_argument, endpoint_argument, json_option, print_json
from barewire.codecs import Value
from barewire.devices import Device, Parameter, Reading, load
from barewire.devices.asked import to_write
from barewire.devices.parameter import show
from barewire.errors import BarewireError, NoAnswer
from barewire.shells import ModbusClient, connect
from barewire.shells.client import Client


@click.command()
@endpoint_argument
@device_argument
@click.argument("names", nargs=-1, required=True, metavar="NAME...")
@json_option
def read(endpoint: str, device: str, names: tuple[str, ...], as_json: bool) -> None:
    """Read named values.

    \b
    barewire read "rtu:///dev/ttyUSB0?unit=1" adxl "Thyristors temperature" "Status"
    """
    machine = load(device)
    for name in names:
        machine.find(name)  # a wrong name is told before a port is opened
    with _client(endpoint) as client:
        for reading in client.read(machine, *names):
            _print(reading, as_json)


@click.command()
@endpoint_argument
@device_argument
@click.argument("assignments", nargs=-1, required=True, metavar="NAME=VALUE...")
@click.option("--force", is_flag=True, help="Send what the description calls read only or out of range.")
@json_option
def write(endpoint: str, device: str, assignments: tuple[str, ...], force: bool, as_json: bool) -> None:
    """Write named values, in the order given.

    A VALUE is a number (0x for hexadecimal), on or off, or the name of one of the parameter's values.

    \b
    barewire write "tcp://127.0.0.1:1502" csd-mt "Control Word=0x0006"
    """
    machine = load(device)
    wanted = [_assignment(machine, text) for text in assignments]
    for name, value in wanted:
        # All of them before the first is sent: half a command may start a motor.
        to_write(machine, {name: value}, force)
        _remark(machine.find(name), value)
    with _client(endpoint) as client:
        # One at a time, because order matters and a name may come twice: "Control Word=6" "Control Word=7".
        for name, value in wanted:
            client.write(machine, {name: value}, force=force)
            reading = Reading(machine.find(name), value)
            _print(reading, as_json, ", written")


@contextmanager
def _client(endpoint: str) -> Iterator[Client]:
    """A client that does not leave a serial line to the next command while a lost answer may still come there."""
    with connect(endpoint) as client:
        try:
            yield client
        except NoAnswer:
            if isinstance(client, ModbusClient):
                with suppress(BarewireError):
                    client.settle()
            raise


def _assignment(machine: Device, text: str) -> tuple[str, Value]:
    name, equals, value = text.partition("=")
    if not equals:
        raise click.UsageError(f"{text!r}: expected NAME=VALUE")
    parameter = machine.find(name)
    return parameter.name, parameter.parse(value)


def _remark(parameter: Parameter, value: Value) -> None:
    """A number that none of the names of a parameter stands for may be right: it is sent, and remarked on."""
    if parameter.values and value not in parameter.values:
        names = "; ".join(f"{number}: {name}" for number, name in parameter.values.items())
        told = f"{parameter.name} = {show(value)} has no name in the description: {names}"
        print(f"barewire: note: {told}", file=sys.stderr)


def _print(reading: Reading, as_json: bool, done: str = "") -> None:
    if not as_json:
        print(f"{reading}{done}", flush=True)
        return
    text = reading.parameter.text(reading.value)
    print_json({"name": reading.name, "value": reading.value, "unit": reading.unit, "text": text})
