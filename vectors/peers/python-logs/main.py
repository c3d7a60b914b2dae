"""python-can and cantools as adapters: recordings of a CAN bus, and the lines of candump.

barewire vectors check --adapter "python vectors/peers python-logs python-can"      (or cantools)
"""

from __future__ import annotations

import sys
from datetime import UTC, datetime, timedelta
from importlib.metadata import version
from io import StringIO
from typing import Any

from adapter import Answers, NotOffered, hexed, octets, serve

EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
ERROR = 0x20000000


def frame_text(can_id: int, extended: bool, rest: str) -> str:
    """Return a frame as candump writes it."""
    return f"{can_id:0{8 if extended else 3}X}#{rest}"


def python_can() -> Answers:
    """The lines of candump and of Vector ASC, as python-can writes and reads them."""
    from can import ASCReader, CanutilsLogReader, CanutilsLogWriter, Message

    def encode(question: dict[str, Any]) -> dict[str, Any]:
        frame = question["frame"]
        if frame["remote"] and frame["requested"]:
            raise NotOffered("python-can writes the requested number after the letter R only since 4.7")
        message = Message(
            arbitration_id=int(frame["id"], 16),
            is_extended_id=frame["extended"],
            is_remote_frame=frame["remote"],
            data=None if frame["remote"] else octets(frame["data"]),
            check=True,
        )
        file = StringIO()
        CanutilsLogWriter(file).on_message_received(message)
        return {"text": file.getvalue().split()[2]}

    def decode(question: dict[str, Any]) -> dict[str, Any]:
        (found,) = CanutilsLogReader(StringIO(f"(0.0) can0 {question['text']}\n"))
        width = 8 if found.is_extended_id else 3
        frame = {"id": f"{found.arbitration_id:0{width}X}", "extended": found.is_extended_id}
        requested = found.dlc if found.is_remote_frame else 0
        data = "" if found.is_remote_frame else hexed(found.data)
        return {"frame": {**frame, "remote": found.is_remote_frame, "requested": requested, "data": data}}

    def item(found: Any, first: int) -> dict[str, Any]:
        at, bus = round(found.timestamp * 1e6), found.channel
        row = {"at": at, "bus": str(bus + first) if isinstance(bus, int) else bus, "sent": not found.is_rx}
        rest = bytes(found.data).hex().upper()
        if found.is_remote_frame:
            rest = f"R{found.dlc or ''}"
        if found.is_fd:
            rest = f"#{found.bitrate_switch | found.error_state_indicator << 1:X}{rest}"
        if found.is_error_frame:
            return row | {"frame": frame_text(ERROR | found.arbitration_id, True, rest)}
        return row | {"frame": frame_text(found.arbitration_id, found.is_extended_id, rest)}

    def lines(question: dict[str, Any]) -> dict[str, Any]:
        rows = question["lines"]
        if question["format"] == "asc" and "internal events logged" not in rows:
            rows = [rows[0], "internal events logged", *rows[1:]]  # the end of the head, which the library waits for
        text = "\n".join(rows) + "\n"
        if question["format"] == "asc":
            return {"items": [item(found, 1) for found in ASCReader(StringIO(text))]}  # its channels begin with 0
        if question["format"] != "candump" or any("  [" in line for line in question["lines"]):
            raise NotOffered("python-can reads the log of candump, not its screen")
        return {"items": [item(found, 0) for found in CanutilsLogReader(StringIO(text))]}

    return {"can-text": {"encode": encode, "decode": decode}, "log-line": {"decode": lines}}


def cantools() -> Answers:
    """The lines of candump, of its log and of its screen, as cantools reads them."""
    from cantools.logreader import Parser

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

    return {"log-line": {"decode": lines}}


name = sys.argv[1]
serve(name, version(name), {"python-can": python_can, "cantools": cantools}[name]())
