"""`barewire devices`: the devices of the catalogue, or the parameters of one."""

from __future__ import annotations

import shutil
import textwrap
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

import click
from rich.console import Console
from rich.table import Table

from barewire.devices import Device, Parameter, UnknownName, load, names
from barewire.devices.parameter import range_text
from barewire.errors import fold, shown
from barewire_workbench.cli.arguments import load_device
from barewire_workbench.cli.output import Output, output_option, print_json


@click.command("devices")
@click.argument("name", required=False)
@click.argument("words", nargs=-1, metavar="[WORD]...")
@click.option("--long", "is_long", is_flag=True, help="Print also defaults, values, bits and notes.")
@output_option
def devices_command(name: str | None, words: tuple[str, ...], is_long: bool, output: Output) -> None:
    """List the devices, or all parameters of one.

    NAME is one of the listed devices, the directory of your own description, or an EDS or DCF file. With WORD, only
    those parameters are listed that have it in their name, their group or their place.

    \b
    barewire devices
    barewire devices az3
    barewire devices az3 brake --long
    barewire devices az3 6040h
    """
    if name is None:
        if output.as_json:
            _print_list_as_json()
        else:
            _print_list()
        return
    device = load_device(name)
    wanted = _selected(device, " ".join(words))
    if output.as_json:
        for parameter in wanted:
            print_json(parameter_fields(parameter))
        return
    count = len(device.parameters)
    output.text(f"{device.title}: {count if len(wanted) == count else f'{len(wanted)} of {count}'} parameters")
    if is_long:
        _print_long(wanted, output)
    elif wanted:
        _print_table(wanted, output)


def parameter_fields(parameter: Parameter) -> dict[str, Any]:
    """Return the parameter for JSON: every key is always there, None is "not given". Addresses are those on the wire.

    >>> parameter_fields(load("az3").find("STATUS WORD"))["object"]
    {'index': 24641, 'sub': 0, 'bit': None, 'type': 'u16'}
    """
    scale, place = parameter.scale, parameter.object
    return {
        "name": parameter.name,
        "type": parameter.type,
        "unit": parameter.unit,
        "scale": float(scale) if scale.denominator != 1 else int(scale),
        "default": parameter.default,
        "min": parameter.minimum,
        "max": parameter.maximum,
        "access": parameter.access,
        "values": {str(number): text for number, text in parameter.values.items()},
        "firmware": parameter.firmware,
        "note": parameter.note,
        "modbus": None if parameter.modbus is None else parameter.modbus._asdict(),
        "object": None if place is None else asdict(place) | {"type": parameter.object_type},
        "bits": {str(number): text for number, text in parameter.bits.items()},
        "kind": parameter.kind,
        "storable": parameter.storable,
        "answered": parameter.answered,
        "printed": dict(parameter.printed),
        "group": parameter.group,
    }


def _selected(device: Device, text: str) -> list[Parameter]:
    """Return the parameters with this text in their name, group or place. Raises UnknownName if there is none."""
    parameters = [
        parameter
        for parameter in device.parameters
        if any(fold(text) in fold(field) for field in (parameter.name, parameter.group, *parameter.places))
    ]
    if text and not parameters:
        raise UnknownName(f"{device.name} has no parameter with {shown(text)} in its name, group or place")
    return parameters


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


def _print_table(parameters: list[Parameter], output: Output) -> None:
    """Print a line for each parameter below a heading for each group; plain text, for grep.

    On a narrow terminal columns are left out, and a name that is too long has a line of its own."""
    rows = [_columns(parameter) for parameter in parameters]
    titles = ("name", "access", "type", "range and unit", "Modbus", "CANopen")
    # A few long entries push the columns behind them to the right: a table of 80 lines is not widened for one of them.
    widths = [max(len(title), *map(len, column)) for title, column in zip(titles, zip(*rows))]
    widths[3] = min(widths[3], _RANGE_WIDTH)
    used = [any(column) for column in zip(*rows)]
    columns = shutil.get_terminal_size(fallback=(10_000, 24)).columns  # into a pipe: as wide as it is

    def room() -> int:  # for the names
        return columns - 2 - sum(width + 2 for width, is_used in zip(widths[1:], used[1:]) if is_used)

    left_out = []
    for place in _LEFT_OUT:
        if room() < min(widths[0], _NARROWEST_NAME):
            used[place] = False
            left_out.append(titles[place])
    widths[0] = min(widths[0], max(room(), _NARROWEST_NAME))

    def line(cells: tuple[str, ...]) -> str:
        if len(cells[0]) > widths[0]:
            return f"  {cells[0]}\n{line(('', *cells[1:]))}"
        shown = [f"{cell:<{width}}" for cell, width, is_used in zip(cells, widths, used) if is_used]
        return ("  " + "  ".join(shown)).rstrip()

    output.text(line(titles))
    group = ""  # rows before the first heading have none
    for parameter, row in zip(parameters, rows):
        if parameter.group != group:
            group = parameter.group
            output.text(f"\n{group}")
        output.text(line(row))
    output.text("\nAddresses are those on the wire, from 0. Defaults, values and notes: --long")
    if left_out:
        output.text(f"Left out on this narrow terminal, see --long: {', '.join(left_out)}")


_RANGE_WIDTH = 40
_LEFT_OUT = (3, 2, 1)
"""The columns that are left out on a narrow terminal, in this order."""
_NARROWEST_NAME = 34


def _columns(parameter: Parameter) -> tuple[str, ...]:
    scale = "" if parameter.scale == 1 else f" x {parameter.scale}"
    limits = " ".join(filter(None, (range_text(parameter), parameter.unit)))
    return (parameter.name, parameter.access, parameter.type + scale, limits, *parameter.places)


def _print_long(parameters: list[Parameter], output: Output) -> None:
    """Print a line for each parameter, its name first, and its other fields below; plain text, for grep."""
    width = max((len(parameter.name) for parameter in parameters), default=0)
    for parameter in parameters:
        output.text(f"{parameter.name:<{width}}  {'  '.join(filter(None, _main_fields(parameter)))}")
        for line in _other_fields(parameter):
            output.text(
                textwrap.fill(line, 110, initial_indent="    ", subsequent_indent="      ", break_on_hyphens=False)
            )


def _main_fields(parameter: Parameter) -> Iterator[str]:
    yield f"{parameter.access} {parameter.type}" + ("" if parameter.scale == 1 else f" x {parameter.scale}")
    yield parameter.unit
    yield range_text(parameter)
    yield "" if parameter.default is None else f"default {parameter.plain_text(parameter.default)}"
    yield _modbus_address(parameter)
    yield parameter.places[1]
    yield f"firmware {parameter.firmware}" if parameter.firmware else ""
    yield parameter.kind + (", storable" if parameter.storable else "")


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
