"""cantools as an adapter: the lines of candump, of its log and of its screen, as it reads them."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from io import StringIO
from typing import Any

from adapter import NotOffered, frame_text, serve
from cantools.logreader import Parser

EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def lines(question: dict[str, Any]) -> dict[str, Any]:
    if question["format"] != "candump":
        raise NotOffered("cantools reads candump, and traces of PCAN")
    if any("##" in line or "R" in line.partition("#")[2][1:] for line in question["lines"]):
        raise NotOffered("cantools keeps no flags of CAN FD, and no length of a remote frame")
    items: list[dict[str, Any]] = []
    for number, line in enumerate(question["lines"], 1):
        for _, found in Parser(StringIO(line), tz=UTC).iterlines(keep_unknowns=True):
            items.append({"unread": number} if found is None else item(found))
    return {"items": items}


def item(found: Any) -> dict[str, Any]:
    if found.is_remote_frame:
        raise NotOffered("cantools keeps no length of a remote frame")
    if len(found.data) > 8:
        raise NotOffered("cantools keeps no flags of CAN FD")
    row = {
        "bus": found.channel,
        "frame": frame_text(found.frame_id, found.is_extended_frame, found.data.hex().upper()),
    }
    if isinstance(found.timestamp, timedelta):
        return row | {"at": found.timestamp // timedelta(microseconds=1)}
    if found.timestamp is None:
        return row
    zoned = found.timestamp if found.timestamp.tzinfo else found.timestamp.replace(tzinfo=UTC)
    return row | {"at": (zoned - EPOCH) // timedelta(microseconds=1)}


serve("cantools", {"log-line": {"decode": lines}})
