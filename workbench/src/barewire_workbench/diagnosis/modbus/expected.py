"""What a request asks a known device for: the values that the response must have, and the addresses that exist."""

from __future__ import annotations

import re
from collections.abc import Iterator

from barewire.devices import Device
from barewire_workbench.diagnosis.modbus.exchange import ExpectedValue

_NUMBER = re.compile(r"[uif](32|64)")
_TABLES = {0x01: "coil", 0x02: "discrete", 0x03: "holding", 0x04: "input", 0x06: "holding", 0x10: "holding"}


def expected_values(device: Device, pdu: bytes) -> list[ExpectedValue]:
    """Return the parameters that a request to read registers asks for.

    >>> from barewire.devices import load
    >>> [(value.name, value.order) for value in expected_values(load("az3"), bytes.fromhex("03 00 04 00 02"))]
    [('SPIDAC CHANNEL 1 SCALE', 'CDAB')]
    """
    address, quantity = int.from_bytes(pdu[1:3], "big"), int.from_bytes(pdu[3:5], "big")
    found = []
    for parameter in device.parameters:
        place = parameter.modbus
        if place is None or place.table != _TABLES.get(pdu[0]) or not _NUMBER.fullmatch(parameter.type):
            continue
        if address <= place.address and place.address + place.words <= address + quantity and place.words in (2, 4):
            limits = (parameter.minimum, parameter.maximum) if parameter.scale == 1 else (None, None)
            found.append(ExpectedValue(parameter.name, place.address - address, parameter.type, place.order, *limits))
    return found


def addresses_of_table(device: Device, pdu: bytes) -> frozenset[int]:
    """Return the addresses of the table that the request reads or writes."""
    return frozenset(_addresses(device, _TABLES.get(pdu[0], "")))


def _addresses(device: Device, table: str) -> Iterator[int]:
    for parameter in device.parameters:
        place = parameter.modbus
        if place is not None and place.table == table:
            yield from range(place.address, place.address + place.words)


def float_values(type_name: str, pdu: bytes) -> list[ExpectedValue]:
    """Return floats of one type, one behind the other, in all registers that a request asks for."""
    size = {"f32": 2, "f64": 4}[type_name]
    count = int.from_bytes(pdu[3:5], "big") // size
    return [ExpectedValue(f"value {number}", number * size, type_name) for number in range(count)]
