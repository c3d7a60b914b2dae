"""numpy as an adapter: its numbers, its packing of bits, its views of registers with swapped bytes."""

from __future__ import annotations

from typing import Any

import numpy as np
from adapter import NotOffered, bits, bitted, hexed, number, octets, serve

KINDS = ("u8", "i8", "u16", "i16", "u32", "i32", "u64", "i64", "f32", "f64")


def kind(question: dict[str, Any]) -> str:
    if question["type"] not in KINDS:
        raise NotOffered("numpy has no such type")
    sign = ">" if question["order"] in ("ABCD", "BADC") else "<"
    return f"{sign}{question['type'][0]}{int(question['type'][1:]) // 8}"


def swapped(question: dict[str, Any], data: bytes) -> bytes:
    mixed = question["order"] in ("BADC", "CDAB") and len(data) > 1
    return np.frombuffer(data, ">u2").byteswap().tobytes() if mixed else data


def encode(question: dict[str, Any]) -> dict[str, Any]:
    with np.errstate(over="raise"):
        return {"bytes": hexed(swapped(question, np.array(number(question["value"]), kind(question)).tobytes()))}


def decode(question: dict[str, Any]) -> dict[str, Any]:
    (value,) = np.frombuffer(swapped(question, octets(question["bytes"])), kind(question))
    return {"value": str(value.item())}


def pack(question: dict[str, Any]) -> dict[str, Any]:
    return {"bytes": hexed(np.packbits(bits(question["bits"]), bitorder="little").tobytes())}


def unpack(question: dict[str, Any]) -> dict[str, Any]:
    data = np.frombuffer(octets(question["bytes"]), "u1")
    return {"bits": bitted(np.unpackbits(data, count=question["count"], bitorder="little"))}


serve(
    "numpy",
    {"number": {"encode": encode, "decode": decode}, "bits": {"encode": pack, "decode": unpack}},
)
