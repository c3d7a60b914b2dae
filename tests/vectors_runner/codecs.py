"""number, bits, register-part, text."""

from __future__ import annotations

import math

from barewire.codecs import Text, codec, get_bit, get_half, pack_bits, set_bit, set_half, unpack_bits
from tests.vectors_runner.common import Case, bits, check, octets, whole_or_float


def number(case: Case) -> None:
    """A value stands for the nearest number of its type, so the decoded number is compared with that one."""
    kind = codec(case["type"], case["order"])
    value = whole_or_float(case["value"]) if "value" in case else 0

    def nearest() -> int | float:
        return kind.decode(kind.encode(value)) if kind.is_float else value

    if isinstance(value, float) and math.isnan(value):
        assert math.isnan(kind.decode(octets(case["bytes"])))
        assert math.isnan(kind.decode(kind.encode(value)))
        return
    if case.get("fails") == "compare":
        # Each half alone is a number of this type, but they are different numbers.
        assert kind.encode(kind.decode(octets(case["bytes"]))) == octets(case["bytes"])
        assert kind.decode(kind.encode(value)) == nearest()
    check(
        case,
        encode=lambda: kind.encode(value),
        wire=octets(case.get("bytes", "")),
        decode=lambda: kind.decode(octets(case["bytes"])),
        value=nearest() if case.get("fails") != "encode" else None,
    )


def packed_bits(case: Case) -> None:
    """A sequence of bits; the decoder is given the number of bits."""
    row = bits(case["bits"])
    data = octets(case["bytes"])
    check(case, encode=lambda: pack_bits(row), wire=data, decode=lambda: unpack_bits(data, len(row)), value=row)


def register_part(case: Case) -> None:
    """Half a register or a bit of it."""
    register, part = int(case["register"], 16), case["part"]

    def read() -> int:
        return get_half(register, part) if part in ("L", "H") else get_bit(register, int(part[4:]))

    def write() -> int:
        if part in ("L", "H"):
            return set_half(register, part, case["write"])
        return set_bit(register, int(part[4:]), bool(case["write"]))

    if case.get("fails") == "compare":
        assert case["reason"] == "mismatch"
        assert read() != case["value"]
    elif "write" not in case:
        assert case["result"] == "valid"
        assert read() == case["value"]
    else:
        then = int(case.get("then", "0"), 16)
        check(case, encode=write, wire=then, decode=read, value=case.get("value"))


def text(case: Case) -> None:
    """Characters in a fixed number of bytes."""
    kind = Text(case["size"], case["charset"], octets(case["pad"]))
    check(
        case,
        encode=lambda: kind.encode(case["text"]),
        wire=octets(case.get("bytes", "")),
        decode=lambda: kind.decode(octets(case["bytes"])),
        value=case.get("text"),
    )
