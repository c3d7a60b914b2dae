"""Answers for text: lines of recordings, and parts of an EDS or DCF."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from barewire.canopen import eds
from barewire.canopen.datatypes import BY_NAME
from barewire.canopen.eds.value_syntax import Expression, Formula
from barewire.canopen.frame import AnyFrame, CanFrame
from barewire.canopen.pdo.multiplexed import Mpdo
from barewire.errors import DecodeError
from barewire_workbench.recordings.asc import read_asc
from barewire_workbench.recordings.bytelog import parse_log
from barewire_workbench.recordings.candump import log_line, read_candump
from barewire_workbench.recordings.conformance_log import read_conformance_log
from barewire_workbench.recordings.model import Dropped, Recorded, RecordedItem
from barewire_workbench.vectors.answers.texts import hexed, octets
from barewire_workbench.vectors.questions import Fields

_READERS: dict[str, Callable[[str], Iterator[RecordedItem]]] = {
    "candump": read_candump,
    "asc": read_asc,
    "conformance": read_conformance_log,
}
_NOT_HERE = {"not-listed", "no-object", "no-name"}
"""Rules about whole files, which a part of one breaks."""


def read_lines(given: Fields) -> Fields:
    """Read the lines of a recording."""
    text = "\n".join(given["lines"]) + "\n"
    if given["format"] == "bytes":
        try:
            chunks = parse_log(text).chunks
        except DecodeError as error:
            return {"items": [{"unread": int(error.text.split()[1].rstrip(":"))}]}
        return {"items": [{"at": round(chunk.at * 1e6), "bytes": hexed(chunk.data)} for chunk in chunks]}
    return {"items": [_item(item) for item in _READERS[given["format"]](text)]}


def _item(item: RecordedItem) -> Fields:
    if isinstance(item, Recorded):
        fields: Fields = {"at": round(item.at * 1e6), "bus": item.bus, "frame": frame_text(item.frame)}
        return fields if item.sent is None else fields | {"sent": item.sent}
    if isinstance(item, Dropped):
        return {"bus": item.bus, "dropped": item.frames}
    return {"unread": item.line}


def frame_text(frame: AnyFrame) -> str:
    """Return a frame of any kind as candump writes it."""
    return log_line(0.0, "x", frame).split()[2]


def read_eds(given: Fields) -> Fields:
    """Return the objects that lines of an EDS describe."""
    found = eds.parse("\n".join(given["lines"]).encode())
    rows = []
    for described in found.objects.values():
        for item in described.items:
            row = {
                "object": f"{described.index:04X}:{item.sub:02X}",
                "name": item.name,
                "type": BY_NAME[item.type].standard,
                "access": item.access,
                "default": _value(item.default),
                "low": _value(item.low),
                "high": _value(item.high),
                "value": _value(item.value),
                "mapped": item.pdo,
            }
            rows.append(row)
    return {"objects": rows}


def _value(value: Expression | None) -> str | None:
    if value is None:
        return None
    if isinstance(value, Formula):
        return f"$NODEID+{value.offset}"
    if isinstance(value, bytes):
        return hexed(value)
    return str(int(value)) if isinstance(value, bool) else str(value)


def check_eds(given: Fields) -> Fields:
    """Return the numbers of the lines that depart from CiA 306."""
    found = eds.parse("\n".join(given["lines"]).encode())
    return {"wrong": sorted({one.line for one in found.diagnostics if one.rule not in _NOT_HERE})}


def encode_mpdo(given: Fields) -> Fields:
    """Return the 8 bytes of a multiplexed PDO."""
    index, sub = int(given["index"], 16), int(given["sub"], 16)
    return {"bytes": hexed(Mpdo(given["addressing"], given["node"], index, sub, octets(given["data"])).pack())}


def decode_mpdo(given: Fields) -> Fields:
    """Return the parts of a multiplexed PDO."""
    found = Mpdo.decode(CanFrame(0x181, octets(given["bytes"])))
    place = {"index": f"{found.index:04X}", "sub": f"{found.sub:02X}"}
    return {"addressing": found.addressing, "node": found.node, **place, "data": hexed(found.data)}
