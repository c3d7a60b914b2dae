"""Answers for number, bits, register-part, text."""

from __future__ import annotations

from barewire.codecs import Text, codec, get_bit, get_half, pack_bits, set_bit, set_half, unpack_bits
from barewire_workbench.vectors.answers.texts import bits, bitted, hexed, number, octets
from barewire_workbench.vectors.questions import Fields


def encode_number(given: Fields) -> Fields:
    """Encode a number, of floating point the nearest one of its type."""
    return {"bytes": hexed(codec(given["type"], given["order"]).encode(number(given["value"])))}


def decode_number(given: Fields) -> Fields:
    """Decode a number."""
    return {"value": str(codec(given["type"], given["order"]).decode(octets(given["bytes"])))}


def encode_bits(given: Fields) -> Fields:
    """Pack bits into bytes, the first one into bit 0."""
    return {"bytes": hexed(pack_bits(bits(given["bits"])))}


def decode_bits(given: Fields) -> Fields:
    """Unpack `count` bits."""
    return {"bits": bitted(unpack_bits(octets(given["bytes"]), given["count"]))}


def read_part(given: Fields) -> Fields:
    """Read half a register or a bit of it."""
    register, part = int(given["register"], 16), given["part"]
    return {"value": get_half(register, part) if part in ("L", "H") else int(get_bit(register, int(part[4:])))}


def write_part(given: Fields) -> Fields:
    """Replace half a register or a bit of it."""
    register, part, value = int(given["register"], 16), given["part"], given["write"]
    then = set_half(register, part, value) if part in ("L", "H") else set_bit(register, int(part[4:]), bool(value))
    return {"then": f"{then:04X}"}


def encode_characters(given: Fields) -> Fields:
    """Encode characters into a fixed number of bytes."""
    return {"bytes": hexed(Text(given["size"], given["charset"], octets(given["pad"])).encode(given["text"]))}


def decode_characters(given: Fields) -> Fields:
    """Decode characters from a fixed number of bytes."""
    return {"text": Text(given["size"], given["charset"], octets(given["pad"])).decode(octets(given["bytes"]))}
