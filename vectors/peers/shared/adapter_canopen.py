"""For the adapters of CANopen stacks: the objects of a case, and what a master says."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping
from typing import Any

from adapter import octets

Row = dict[str, Any]


def listed(kind: str, access: str, places: str) -> list[Row]:
    """Return objects of a type, written as place and value: "1005:00=128 1006:00=0"."""
    pairs = [text.partition("=") for text in places.split()]
    return [{"object": place, "type": kind, "access": access, "value": value} for place, _, value in pairs]


ALWAYS = listed("UNSIGNED32", "ro", "1000:00=0 1018:01=0") + listed("UNSIGNED8", "ro", "1001:00=0")
"""Objects that every device has."""
RATES = (1000, 800, 500, 250, 125, None, 50, 20, 10, 0)
"""kbit/s of the entries of table 0 of LSS; libraries are asked for a bit rate, not for an entry."""
CLASSES = {1: 0x01, 2: 0x03, 3: 0x05, 4: 0x09, 0xF: 0x81}
STRINGS = {"VISIBLE_STRING": "latin-1", "UNICODE_STRING": "utf-16-le"}
REALS = {"REAL32": "<f", "REAL64": "<d"}


def place_of(row: Row) -> tuple[int, int]:
    index, sub = row["object"].split(":")
    return int(index, 16), int(sub, 16)


def placed(rows: Iterable[Row]) -> dict[tuple[int, int], Row]:
    """Return objects by place, each record with the number of its sub-indices."""
    objects = {place_of(row): row for row in rows}
    for index in {index for index, sub in objects if sub and (index, 0) not in objects}:
        last = max(sub for one, sub in objects if one == index)
        objects[index, 0] = {"type": "UNSIGNED8", "access": "rw" if index == 0x1003 else "ro", "value": str(last)}
    return objects


def variables(index: int, values: Iterable[int | str], kind: str = "UNSIGNED32", access: str = "rw") -> list[Row]:
    """Return objects with these values, from sub-index 1 on."""
    return listed(kind, access, " ".join(f"{index:04X}:{sub:02X}={value}" for sub, value in enumerate(values, 1)))


def watched(heartbeats: Mapping[Any, int]) -> list[Row]:
    """Return the entries of 1016h for a master that watches nodes."""
    return variables(0x1016, [int(node) << 16 | time for node, time in heartbeats.items()])


def guarded(setup: Row, needed: list[Row]) -> list[Row]:
    """Return the objects of a node of the kind `node-talk`: its identity and its life time, and those `needed`."""
    life = setup.get("life_time", 0) // 1000
    numbers = [int(text, 16) for text in setup.get("address", ["0"] * 4)]
    rows = [row for row in (*ALWAYS, *needed) if row["object"] not in ("1018:01", "100C:00", "100D:00")]
    rows += variables(0x1018, numbers, access="const") + listed("UNSIGNED16", "rw", f"100C:00={life}")
    return rows + listed("UNSIGNED8", "rw", f"100D:00={int(life > 0)}")


def value_bytes(kind: str, value: str | None, sizes: Mapping[int, int] | None = None) -> bytes:
    """Return the bytes of a value of an object; `sizes` are those of a library that keeps more of some widths."""
    if kind in ("DOMAIN", "OCTET_STRING"):
        return octets(value or "")
    if kind in STRINGS:
        return (value or "").encode(STRINGS[kind])
    if kind in REALS:
        return struct.pack(REALS[kind], float(value or 0))
    size = 1 if kind == "BOOLEAN" else int(kind.lstrip("UNSIGEDTR")) // 8
    return int(value or 0).to_bytes((sizes or {}).get(size, size), "little", signed=kind.startswith("I"))


def register_bits(code: int) -> int:
    """Return the bits of 1001h for an error that the application reports."""
    if code >> 8 in (0x81, 0x82):
        return 0x11
    return CLASSES.get(code >> 12, 1) if code >> 8 != 0xF0 else 1


def one_each(frames: list[str], rows: list[Row]) -> list[Row]:
    """Return a frame for each row; what is said beyond the rows belongs to the last one."""
    said = [{"say": frame} for frame in [*frames, *[""] * len(rows)][: len(rows)]]
    if len(frames) > len(rows):
        said[-1:] = [{"say": " ".join(frames[max(len(rows) - 1, 0) :])}]
    return said
