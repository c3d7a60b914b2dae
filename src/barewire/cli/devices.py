"""`barewire devices`: the devices of the catalogue, or every parameter of one with every field of its description."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator

import click
from rich.console import Console
from rich.table import Table

from barewire.cli.arguments import json_option, print_json
from barewire.devices import Device, Parameter, load, names
from barewire.devices.parameter import show


@click.command("devices")
@click.argument("name", required=False)
@json_option
def devices_command(name: str | None, as_json: bool) -> None:
    """List the devices, or all parameters of one.

    NAME is one of the listed devices, or the directory of your own description.
    """
    if name is None and as_json:
        _print_list_as_json()
    elif name is None:
        _print_list()
    elif as_json:
        for parameter in load(name).parameters:
            print_json(parameter.as_dict())
    else:
        _print_parameters(load(name))


def _print_list_as_json() -> None:
    for name in names():
        device = load(name)
        count = len(device.parameters)
        print_json({"name": name, "title": device.title, "parameters": count, "protocols": _protocols(device)})


def _print_list() -> None:
    table = Table(
        "name", "device", "parameters", "protocols", "described in", box=None, header_style="bold", pad_edge=False
    )
    for name in names():
        device = load(name)
        count, documents = str(len(device.parameters)), "; ".join(device.documents)
        table.add_row(name, device.title, count, ", ".join(_protocols(device)), documents)
    Console().print(table)


def _protocols(device: Device) -> list[str]:
    return [name for name, side in (("Modbus", device.modbus), ("CANopen", device.canopen)) if side]


def _print_parameters(device: Device) -> None:
    """Print a line for each parameter, its name first, and its other fields below; plain text, for grep."""
    print(f"{device.title}: {len(device.parameters)} parameters")
    width = max((len(parameter.name) for parameter in device.parameters), default=0)
    for parameter in device.parameters:
        print(f"{parameter.name:<{width}}  {'  '.join(filter(None, _main_fields(parameter)))}")
        for line in _other_fields(parameter):
            print(textwrap.fill(line, 110, initial_indent="    ", subsequent_indent="      ", break_on_hyphens=False))


def _main_fields(parameter: Parameter) -> Iterator[str]:
    yield f"{parameter.access} {parameter.type}" + ("" if parameter.scale == 1 else f" x {parameter.scale}")
    yield parameter.unit
    low = "" if parameter.minimum is None else show(parameter.minimum)
    high = "" if parameter.maximum is None else show(parameter.maximum)
    yield f"{low}..{high}" if low or high else ""
    yield "" if parameter.default is None else f"default {show(parameter.default)}"
    yield _modbus_address(parameter)
    yield _object_address(parameter)
    yield f"firmware {parameter.firmware}" if parameter.firmware else ""
    yield "storable" if parameter.storable else ""


def _other_fields(parameter: Parameter) -> Iterator[str]:
    yield from (f"{number}: {meaning}" for number, meaning in parameter.values.items())
    yield from (f"bit {bit}: {meaning}" for bit, meaning in parameter.bits.items())
    if parameter.note:
        yield parameter.note
    yield from (f"the manual prints for {key}: {printed}" for key, printed in parameter.printed.items())


def _modbus_address(parameter: Parameter) -> str:
    """Return the address on the wire, such as 'holding 4017 (0FB1h) +1', 'input 24 (0018h) H', 'coil 81 (0051h)'."""
    place = parameter.modbus
    if place is None:
        return ""
    words = f" +{place.words - 1}" if place.words > 1 else ""
    part = f" {place.half}" if place.half else f" bit {place.bit}" if place.bit is not None else ""
    return f"{place.table} {place.address} ({place.address:04X}h){words}{part}"


def _object_address(parameter: Parameter) -> str:
    """Return the object, such as '6041h:00', and the bit if it is a single one."""
    place = parameter.object
    if place is None:
        return ""
    return f"{place.index:04X}h:{place.sub:02X}" + ("" if place.bit is None else f" bit {place.bit}")
