"""`barewire devices`: the machines there are, and every parameter of one, with every field of its description."""

from __future__ import annotations

import json

import click
from rich.console import Console
from rich.table import Table
from rich.text import Text

from barewire.cli.arguments import json_option
from barewire.devices import Device, Parameter, describe, load, names
from barewire.devices.parameter import show


@click.command()
@click.argument("name", required=False)
@json_option
def devices(name: str | None, as_json: bool) -> None:
    """List the devices, or all parameters of NAME (a device, or the directory of a description of your own)."""
    if name is None:
        _list(as_json)
    elif as_json:
        for parameter in load(name).parameters:
            print(json.dumps(describe(parameter), ensure_ascii=False))
    else:
        _show(load(name))


def _list(as_json: bool) -> None:
    table = Table(box=None, header_style="bold", pad_edge=False)
    for title in ("name", "device", "parameters", "speaks", "described in"):
        table.add_column(title)
    for name in names():
        device = load(name)
        speaks = [word for word, side in (("Modbus", device.modbus), ("CANopen", device.canopen)) if side]
        if as_json:
            fields = {"name": name, "title": device.title, "parameters": len(device.parameters), "speaks": speaks}
            print(json.dumps(fields, ensure_ascii=False))
        row = (name, device.title, str(len(device.parameters)), ", ".join(speaks), "; ".join(device.documents))
        table.add_row(*row)
    if not as_json:
        Console().print(table)


def _show(device: Device) -> None:
    title = f"{device.title}: {len(device.parameters)} parameters"
    table = Table(header_style="bold", title=title, title_justify="left")
    for title in ("name", "type", "unit", "range", "default", "access", "Modbus", "object", "firmware"):
        table.add_column(title, overflow="fold")
    for parameter in device.parameters:
        table.add_row(*(Text(cell) for cell in _cells(parameter)))
    console = Console()
    console.print(table)
    notes = [parameter for parameter in device.parameters if parameter.note or parameter.values or parameter.bits]
    if notes:
        console.print("\nNotes, names of values and bits", style="bold")
    for parameter in notes:
        console.print(Text(parameter.name, style="bold"))
        for number, meaning in parameter.values.items():
            console.print(Text(f"    {number}: {meaning}"))
        for bit, meaning in parameter.bits.items():
            console.print(Text(f"    bit {bit}: {meaning}"))
        if parameter.note:
            console.print(Text(f"    {parameter.note}"))
        for key, printed in parameter.printed.items():
            console.print(Text(f"    the manual prints for {key}: {printed}"))


def _cells(parameter: Parameter) -> tuple[str, ...]:
    low = "" if parameter.minimum is None else show(parameter.minimum)
    high = "" if parameter.maximum is None else show(parameter.maximum)
    kind = parameter.type + ("" if parameter.scale == 1 else f" x {parameter.scale}")
    default = "" if parameter.default is None else show(parameter.default)
    return (
        parameter.name,
        kind,
        parameter.unit,
        f"{low}..{high}" if low or high else "",
        default,
        parameter.access,
        modbus_place(parameter),
        object_place(parameter),
        parameter.firmware,
    )


def modbus_place(parameter: Parameter) -> str:
    """'holding 0FB1h +2', 'input 24 H', 'coil 81': the place on the wire."""
    place = parameter.modbus
    if place is None:
        return ""
    words = f" +{place.words - 1}" if place.words > 1 else ""
    part = f" {place.half}" if place.half else f" bit {place.bit}" if place.bit is not None else ""
    return f"{place.table} {place.address} ({place.address:04X}h){words}{part}"


def object_place(parameter: Parameter) -> str:
    """'6041h:00', and the bit if it is only one."""
    place = parameter.object
    if place is None:
        return ""
    return f"{place.index:04X}h:{place.sub:02X}" + ("" if place.bit is None else f" bit {place.bit}")
