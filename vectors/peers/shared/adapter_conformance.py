"""For the adapters of servers that are given bytes and hand bytes back: the kind `server-conformance`.

`make` builds the library's server as that of adapter_server.py does, here with unit 1, whose registers and coils 0 to 9
can be read and written. Its `hear(data)` takes what arrives without a pause, and returns what the server sends. A
library that leaves it to its application where a frame ends in a stream is given one frame at a time: `cuts` is False.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "reference" / "modbus"))

from adapter import Answers, NotOffered, hexed, octets
from client_peer import unwrapped, wrapped

UNIT = 1


class Heard(Protocol):
    """A server of a library."""

    def hear(self, data: bytes) -> bytes: ...


def changed(data: bytes, how: str | None) -> bytes:
    """Return a frame with a change: `change` of the kind."""
    changes: dict[str | None, Callable[[], bytes]] = {
        None: lambda: data,
        "first-four": lambda: data[:4],
        "wrong-crc": lambda: data[:-1] + bytes([data[-1] ^ 0x10]),
        "wrong-lrc": lambda: data[:-3] + (b"1" if data[-3:-2] == b"0" else b"0") + data[-2:],
        "lower-case": data.lower,
        "no-colon": lambda: data[1:],
        "no-cr": lambda: data[:-2] + b"\n",
        "not-a-digit": lambda: data[:4] + b"G" + data[5:],
        "digit-less": lambda: data[:4] + data[5:],
        "begun-twice": lambda: data[:9] + data,
        "semicolon": lambda: data[:-1] + b";",
    }
    return changes[how]()


def responses(line: str, data: bytes) -> str:
    """Return the PDUs of what was sent, joined."""
    found = []
    while data:
        size = 6 + int.from_bytes(data[4:6], "big") if line == "tcp" else len(data)
        found.append(unwrapped(line, data[:size])[1])
        data = data[size:]
    return "; ".join(map(hexed, found))


def conformance_answers(make: Callable[..., Heard], lines: set[str], cuts: bool = False) -> Answers:
    """Return the answers of a server on these lines."""

    def run(question: dict[str, Any]) -> dict[str, Any]:
        line = question["framing"]
        if line not in lines:
            raise NotOffered("not on this line")
        several = any(len(step["send"]) > 1 for step in question["steps"])
        if not cuts and (
            several or (line == "tcp" and any("raw" in row for step in question["steps"] for row in step["send"]))
        ):
            raise NotOffered("where a frame ends in a stream, its application decides")
        server = make(line, {UNIT: {"holding_registers": {0: [0] * 10}, "coils": {0: [0] * 10}}}, {UNIT: {}})
        answers = []
        for step in question["steps"]:
            data = b"".join(
                octets(row["raw"])
                if "raw" in row
                else changed(wrapped(line, row.get("unit", UNIT), row["pdu"], 1), row.get("change"))
                for row in step["send"]
            )
            answers.append(responses(line, server.hear(data)))
        return {"answers": answers}

    return {"server-conformance": {"run": run}}
