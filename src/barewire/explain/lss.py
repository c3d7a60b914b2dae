"""LSS: give a device its node-ID and bit rate over the bus itself.   [CiA 305]

7E5h   | service | 7 bytes, numbers little-endian, unused 0 |      master -> device
7E4h   | service | 7 bytes                                  |      device -> master
"""

from __future__ import annotations

from typing import NamedTuple

from barewire.codecs import Field
from barewire.errors import DecodeError
from barewire.explain.explanation import Role, cover

ADDRESS = ("vendor-ID", "product code", "revision", "serial number")
RESULT = (("result", 1), ("details", 1))


class Row(NamedTuple):
    """One service: its name, and name and length of each field behind byte 0."""

    name: str
    places: tuple[tuple[str, int], ...] = ()


REQUESTS: dict[int, Row] = {
    0x04: Row("switch state global", (("mode", 1),)),
    0x11: Row("configure node-ID", (("node-ID", 1),)),
    0x13: Row("configure bit timing", (("table", 1), ("entry", 1))),
    0x15: Row("activate bit timing", (("delay", 2),)),
    0x17: Row("store configuration"),
    **{0x40 + k: Row(f"switch state selective: {name}", ((name, 4),)) for k, name in enumerate(ADDRESS)},
    0x46: Row("identify device: vendor-ID", (("vendor-ID", 4),)),
    0x47: Row("identify device: product code", (("product code", 4),)),
    0x48: Row("identify device: revision, lowest", (("revision", 4),)),
    0x49: Row("identify device: revision, highest", (("revision", 4),)),
    0x4A: Row("identify device: serial number, lowest", (("serial number", 4),)),
    0x4B: Row("identify device: serial number, highest", (("serial number", 4),)),
    0x4C: Row("identify devices without a node-ID"),
    0x51: Row("fastscan", (("number", 4), ("bit check", 1), ("LSS sub", 1), ("LSS next", 1))),
    **{0x5A + k: Row(f"inquire {name}") for k, name in enumerate(ADDRESS)},
    0x5E: Row("inquire node-ID"),
}
RESPONSES: dict[int, Row] = {
    0x11: Row("configure node-ID", RESULT),
    0x13: Row("configure bit timing", RESULT),
    0x17: Row("store configuration", RESULT),
    0x44: Row("switch state selective: it is me"),
    0x4F: Row("identify device: it is me"),
    0x50: Row("a device without a node-ID is here"),
    **{0x5A + k: Row(f"inquire {name}", ((name, 4),)) for k, name in enumerate(ADDRESS)},
    0x5E: Row("inquire node-ID", (("node-ID", 1),)),
}


def read_lss(data: bytes, role: Role) -> tuple[list[Field], DecodeError | None, str]:
    """Fields, fault and summary of an LSS frame.

    >>> read_lss(bytes.fromhex("1105000000000000"), "request")[2]
    'configure node-ID'
    """
    if not data:
        return [], DecodeError("short", data, 0, "the service is byte 0, but there are none"), ""
    row = (REQUESTS if role == "request" else RESPONSES).get(data[0])
    if row is None:
        error = DecodeError("function", data, 0, f"{data[0]:02X}h is no service of an LSS {role}")
        return cover([Field(0, 1, "service", data[0], "unknown")], len(data)), error, "unknown service"
    fields = [Field(0, 1, "service", data[0], row.name)]
    at = 1
    for name, length in row.places:
        if at + length > len(data):
            return cover(fields, len(data), name), None, row.name
        value = int.from_bytes(data[at : at + length], "little")
        fields.append(Field(at, length, name, value, _words(name, value)))
        at += length
    if at < len(data):
        fields.append(Field(at, len(data) - at, "reserved", data[at:].hex(" ").upper()))
    return fields, None, row.name


def _words(name: str, value: int) -> str:
    match name:
        case "mode":
            return {0: "waiting", 1: "configuration"}.get(value, "not defined")
        case "node-ID":
            return "no node-ID yet" if value == 0xFF else "" if 1 <= value <= 127 else "expected 1..127"
        case "result":
            return {0: "done", 0xFF: "failed, see details"}.get(value, "refused")
        case "delay":
            return "ms before the change, and the same again after it"
    return ""
