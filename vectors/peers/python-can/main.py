"""python-can as an adapter: the lines of candump and of Vector ASC, as it writes and reads them."""

from __future__ import annotations

from io import StringIO
from typing import Any

from adapter import NotOffered, frame_text, hexed, octets, serve
from can import ASCReader, CanutilsLogReader, CanutilsLogWriter, Message

ERROR = 0x20000000


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


serve(
    "python-can",
    {"can-text": {"encode": encode, "decode": decode}, "log-line": {"decode": lines}},
)
