"""Reads conformance cases of CANopen devices from the fields of the vectors, kind `device-conformance`.

    {"name": "NMT-02", "comment": "stop: SDO is silent", "clause": "CiA 301 7.2.8 NMT", "effect": "commands",
     "steps": [{"send": ["000#02<00+node>"], "wait": 20000},
               {"send": ["<600+node>#4000100000000000"], "wait": 100000}]}

    step        frames that are sent, and the patterns of accepted responses; a loop over steps; a whole SDO transfer
    condition   what the device must have (1017h, 1016h:02, TPDO ...), or "<...> is ..." between two texts

The files are read by `io.canopen.conformance`; vectors/README.md describes the fields.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any, TypeAlias, get_args

from barewire.errors import EncodeError, shown
from barewire_workbench.conform.canopen.frames import Sdo, make_case, provides
from barewire_workbench.conform.canopen.model import SILENCE, Effect, NodeCase, NodeStep
from barewire_workbench.conform.canopen.placeholders import Placeholders
from barewire_workbench.conform.canopen.transfers import (
    block_download_steps,
    block_step,
    block_upload_steps,
    download_steps,
    upload_steps,
)

CaseFields: TypeAlias = Mapping[str, Any]

_NAME = re.compile("[A-Z]{2,3}-[0-9]{2}")
_RESPONSES = ("<580+node>#",)


def applies(fields: CaseFields, device: Placeholders) -> bool:
    """Return whether a case is for this kind of device: other devices do not have it."""
    return _holds(fields, device)


def read_node_case(fields: CaseFields, device: Placeholders) -> NodeCase:
    """Return the case that these fields describe, for one device. Raise EncodeError for fields that cannot be read."""
    name, effect = fields["name"], fields["effect"]
    if not _NAME.fullmatch(name):
        raise EncodeError(f"name {shown(name)}: expected letters, a hyphen and two digits, such as SDO-01", "name")
    if effect not in get_args(Effect):
        raise EncodeError(f"effect {shown(effect)}: expected one of {', '.join(get_args(Effect))}", "effect")
    return make_case(
        device.subject,
        fields.get("clause", ""),
        tuple(map(device.fill, fields.get("listens", _RESPONSES))),
        name,
        device.fill(fields.get("comment", "")),
        *_steps(fields["steps"], device),
        effect=effect,
        needs=tuple(map(device.fill, fields.get("needs", ()))),
        why=fields.get("why", ""),
    )


def _steps(rows: list[CaseFields], device: Placeholders) -> Iterator[NodeStep]:
    for row in rows:
        if "each" in row:
            for inner in device.each(row["each"], _numbers(row["in"], device)):
                yield from _steps(row["steps"], inner) if _holds(row, inner) else ()
        elif _holds(row, device):
            yield from _transfer(row, device) if "transfer" in row else (_step(row, device),)


def _numbers(ranges: list[str], device: Placeholders) -> Iterator[int]:
    """Yield the numbers of ranges such as 000-07F, or of single numbers, in hexadecimal digits."""
    for text in map(device.fill, ranges):
        first, _, last = text.partition("-")
        yield from range(int(first, 16), int(last or first, 16) + 1)


def _holds(row: CaseFields, device: Placeholders) -> bool:
    return all(_is_true(device.fill(condition), device) for condition in row.get("if", ()))


def _is_true(condition: str, device: Placeholders) -> bool:
    left, word, right = condition.partition(" is ")
    if word:
        return (left != right.removeprefix("not ")) if right.startswith("not ") else left == right
    if condition.startswith("no "):
        return not provides(device.subject, condition.removeprefix("no "))
    return provides(device.subject, condition)


def _step(row: CaseFields, device: Placeholders) -> NodeStep:
    sends = tuple(map(device.fill, row.get("send", ())))
    wait = row.get("wait")
    return NodeStep(
        sends,
        tuple(map(device.fill, row.get("accept", (SILENCE,)))),
        tuple(map(device.fill, row.get("ends", ()))),
        None if wait is None else wait / 1e6,
        row.get("whole", False),
    )


def _transfer(row: CaseFields, device: Placeholders) -> list[NodeStep]:
    s, kind = Sdo(device.subject.node), row["transfer"]
    if row["of"] == "text":
        place, (_, value) = device.fill("<text.index/2>00"), device.subject.text_object
    else:
        place, value = device.fill(row["of"]), bytes.fromhex(device.fill(row["value"]))
    if kind == "upload":
        return upload_steps(s, place, value, row.get("segments"))
    if kind == "download":
        return download_steps(s, place, value, row.get("segments"), size=row.get("size"))
    if kind == "block upload":
        return block_upload_steps(
            s,
            place,
            value,
            crc=row.get("crc", True),
            blksize=row.get("blksize", 20),
            until=row.get("until", "done"),
        )
    if kind == "block segments":
        (request,) = map(device.fill, row["send"])
        return [block_step(s, request, value, row.get("from", 1), row.get("to", 127))]
    if kind != "block download":
        raise EncodeError(
            f"transfer {shown(kind)}: expected upload, download, block upload, block segments or block download",
            "transfer",
        )
    return block_download_steps(s, place, value)
