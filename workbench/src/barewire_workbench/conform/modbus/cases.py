"""Reads conformance cases of Modbus servers from the fields of the vectors, kind `server-conformance`.

    {"comment": "03 with quantity 0", "clause": "MB-APP 6.3", "framings": ["tcp", "rtu", "ascii"],
     "steps": [{"send": [{"pdu": "03 00 00 00 00"}]}], "answers": [["83 03"]]}

The files are read by `io.modbus.conformance`; vectors/README.md describes the fields.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from barewire.errors import EncodeError, shown
from barewire_workbench.conform.modbus.model import ServerCase, ServerStep, Stimulus

CHANGES: dict[str, Callable[[bytes], bytes]] = {
    "first-four": lambda frame: frame[:4],
    "wrong-crc": lambda frame: frame[:-1] + bytes((frame[-1] ^ 0x10,)),
    "wrong-lrc": lambda frame: frame[:-3] + (b"0" if frame[-3:-2] != b"0" else b"1") + frame[-2:],
    "lower-case": lambda frame: frame.lower(),
    "no-colon": lambda frame: frame[1:],
    "no-cr": lambda frame: frame[:-2] + b"\n",
    "not-a-digit": lambda frame: frame[:4] + b"G" + frame[5:],
    "digit-less": lambda frame: frame[:4] + frame[5:],
    "begun-twice": lambda frame: frame[:9] + frame,
    "semicolon": lambda frame: frame[:-1] + b";",
}
"""By name: what is done to a good frame before it is sent."""


def read_case(fields: Mapping[str, Any]) -> ServerCase:
    """Return the case that these fields describe. Raises EncodeError for an unknown change."""
    return ServerCase(
        fields["comment"],
        fields.get("clause", ""),
        tuple(read_step(step) for step in fields["steps"]),
        tuple(map(tuple, fields.get("answers", ()))),
        fields.get("id", ""),
    )


def read_step(fields: Mapping[str, Any]) -> ServerStep:
    """Return one step: `send` at once, after `after` microseconds of silence."""
    return ServerStep(tuple(map(_stimulus, fields["send"])), fields.get("after", 0) / 1e6)


def _stimulus(fields: Mapping[str, Any]) -> Stimulus:
    name = fields.get("change")
    if name is not None and name not in CHANGES:
        raise EncodeError(f"change {shown(name)}: expected one of {', '.join(CHANGES)}", "change")
    return Stimulus(
        bytes.fromhex(fields.get("pdu", "")),
        fields.get("unit"),
        bytes.fromhex(fields.get("raw", "")),
        None if name is None else CHANGES[name],
    )
