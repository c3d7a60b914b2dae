"""Writes tests/devices/addresses.txt: the address of every parameter of the catalogue, one line each.

The descriptions were compared with the pages of the manuals once, row by row. With this list a test reports every later
change of an address, type, scale or unit.

    python tools/addresses.py          after an intended change
"""

from __future__ import annotations

from pathlib import Path

from barewire.devices import Parameter, load, names

FILE = Path(__file__).parents[1] / "tests" / "devices" / "addresses.txt"


def line(device: str, parameter: Parameter) -> str:
    """Return one line: device, name, type, scale, unit, access, address on Modbus, object."""
    at, item = parameter.modbus, parameter.object
    modbus = (
        f"{at.table} {at.address} +{at.words} {at.half or '-'} {at.bit if at.bit is not None else '-'} {at.order}"
        if at
        else "-"
    )
    index = f"{item.index:04X}:{item.sub:02X} {item.bit if item.bit is not None else '-'}" if item else "-"
    kind = f"{parameter.type} x {parameter.scale} [{parameter.unit}] {parameter.access}"
    return f"{device} | {parameter.name} | {kind} | {modbus} | {index}"


def addresses() -> str:
    """Return the whole list."""
    return "".join(f"{line(device, parameter)}\n" for device in names() for parameter in load(device).parameters)


if __name__ == "__main__":
    FILE.write_text(addresses(), encoding="utf-8")
