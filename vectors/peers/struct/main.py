"""The module struct of Python's standard library as an adapter: it confirms numbers, not a protocol."""

from __future__ import annotations

import platform
import struct
from typing import Any

from adapter import NotOffered, hexed, number, octets, serve

LETTERS = {"u8": "B", "i8": "b", "u16": "H", "i16": "h", "u32": "I", "i32": "i", "u64": "Q", "i64": "q"}
LETTERS |= {"f32": "f", "f64": "d"}


def form(question: dict[str, Any]) -> str:
    """Return order and type as struct writes them."""
    if question["order"] not in ("ABCD", "DCBA") or question["type"] not in LETTERS:
        raise NotOffered("struct has no mixed order of bytes, and no odd widths")
    return (">" if question["order"] == "ABCD" else "<") + LETTERS[question["type"]]


def encode(question: dict[str, Any]) -> dict[str, Any]:
    return {"bytes": hexed(struct.pack(form(question), number(question["value"])))}


def decode(question: dict[str, Any]) -> dict[str, Any]:
    return {"value": str(struct.unpack(form(question), octets(question["bytes"]))[0])}


serve("Python", {"number": {"encode": encode, "decode": decode}}, platform.python_version())
