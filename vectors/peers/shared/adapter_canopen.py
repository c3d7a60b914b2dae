"""For the adapters of CANopen stacks: the objects of a case, and what a master says."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

Row = dict[str, Any]
ALWAYS: list[Row] = [
    {"object": place, "type": kind, "access": "ro", "value": "0"}
    for place, kind in (("1000:00", "UNSIGNED32"), ("1001:00", "UNSIGNED8"), ("1018:01", "UNSIGNED32"))
]
"""Objects that every device has."""
RATES = (1000, 800, 500, 250, 125, None, 50, 20, 10, 0)
"""kbit/s of the entries of table 0 of LSS; libraries are asked for a bit rate, not for an entry."""
CLASSES = {1: 0x01, 2: 0x03, 3: 0x05, 4: 0x09, 0xF: 0x81}


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
    return [
        {"object": f"{index:04X}:{sub:02X}", "type": kind, "access": access, "value": str(value)}
        for sub, value in enumerate(values, 1)
    ]


def watched(heartbeats: dict[str, int]) -> list[Row]:
    """Return the entries of 1016h for a master that watches nodes."""
    return variables(0x1016, [int(node) << 16 | time for node, time in heartbeats.items()])


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
