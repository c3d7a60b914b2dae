"""`barewire read` and `barewire write`: named values of a machine, over whatever wire."""

from __future__ import annotations

import json

import click

from barewire.cli.arguments import device_argument, endpoint_argument, json_option
from barewire.codecs import Value
from barewire.devices import Device, Reading, load
from barewire.shells import connect


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
    with connect(endpoint) as client:
        for reading in client.read(machine, *names):
            print(_json(reading) if as_json else str(reading))


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
    with connect(endpoint) as client:
        # One at a time, because order matters and a name may come twice: "Control Word=6" "Control Word=7".
        for name, value in wanted:
            client.write(machine, {name: value}, force=force)
            reading = Reading(machine.find(name), value)
            print(_json(reading) if as_json else f"{reading}, written", flush=True)


def _assignment(machine: Device, text: str) -> tuple[str, Value]:
    name, equals, value = text.partition("=")
    if not equals:
        raise click.UsageError(f"{text!r}: expected NAME=VALUE")
    parameter = machine.find(name)
    return parameter.name, parameter.parse(value)


def _json(reading: Reading) -> str:
    fields = {
        "name": reading.name,
        "value": reading.value,
        "unit": reading.unit,
        "text": reading.parameter.text(reading.value),
    }
    return json.dumps(fields, ensure_ascii=False)
