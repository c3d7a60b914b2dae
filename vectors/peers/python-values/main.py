"""Python's standard library, numpy and crcmod as an adapter: they confirm values, not a protocol.

barewire vectors check --adapter "python vectors/peers python-values struct"      (or numpy, crcmod)
"""

from __future__ import annotations

import platform
import struct
import sys
from importlib.metadata import version
from typing import Any

from adapter import NotOffered, bits, bitted, crc_fields, hexed, number, octets, serve

LETTERS = {"u8": "B", "i8": "b", "u16": "H", "i16": "h", "u32": "I", "i32": "i", "u64": "Q", "i64": "q"}
LETTERS |= {"f32": "f", "f64": "d"}
ENDS = {"ABCD": ("big", ">"), "DCBA": ("little", "<")}


def kind_of(question: dict[str, Any]) -> tuple[str, int, str, str]:
    """Return letter and bits of a type, and the order as a word and as the sign of struct."""
    if question["order"] not in ENDS:
        raise NotOffered("Python has no mixed order of bytes")
    return question["type"][0], int(question["type"][1:]), *ENDS[question["order"]]


def encode_number(question: dict[str, Any]) -> dict[str, Any]:
    letter, width, end, sign = kind_of(question)
    value = number(question["value"])
    if letter == "f":
        return {"bytes": hexed(struct.pack(sign + LETTERS[question["type"]], value))}
    return {"bytes": hexed(value.to_bytes(width // 8, end, signed=letter == "i"))}  # type: ignore[union-attr,arg-type]


def decode_number(question: dict[str, Any]) -> dict[str, Any]:
    letter, width, end, sign = kind_of(question)
    data = octets(question["bytes"])
    if question["type"] in LETTERS:
        return {"value": str(struct.unpack(sign + LETTERS[question["type"]], data)[0])}
    if len(data) != width // 8:
        raise NotOffered("int.from_bytes takes any number of bytes")
    return {"value": str(int.from_bytes(data, end, signed=letter == "i"))}  # type: ignore[arg-type]


def decode_text(question: dict[str, Any]) -> dict[str, Any]:
    (data,) = struct.unpack(f"{question['size']}s", octets(question["bytes"]))
    return {"text": data.decode(question["charset"]).rstrip(octets(question["pad"]).decode("latin-1") + "\0")}


def encode_object(question: dict[str, Any]) -> dict[str, Any]:
    value = question["value"]
    match question["type"]:
        case "BOOLEAN":
            return {"bytes": hexed(struct.pack("<?", value))}
        case "VISIBLE_STRING":
            return {"bytes": hexed(value.encode("ascii"))}
        case "UNICODE_STRING":
            return {"bytes": hexed(value.encode("utf-16-le"))}
    raise NotOffered("Python has no such type")


def decode_object(question: dict[str, Any]) -> dict[str, Any]:
    data = octets(question["bytes"])
    match question["type"]:
        case "BOOLEAN":
            return {"value": struct.unpack("<?", data)[0]}
        case "VISIBLE_STRING":
            return {"value": data.decode("ascii")}
        case "UNICODE_STRING":
            return {"value": data.decode("utf-16-le")}
    raise NotOffered("Python has no such type")


def numpy() -> Any:
    """The numbers of numpy, its packing of bits, and its views of registers with swapped bytes."""
    import numpy as np

    def kind(question: dict[str, Any]) -> str:
        if question["type"] not in LETTERS:
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

    return {"number": {"encode": encode, "decode": decode}, "bits": {"encode": pack, "decode": unpack}}


def crcmod() -> Any:
    """The CRC of Modbus as crcmod computes it from the catalogue of checksums."""
    from crcmod.predefined import PredefinedCrc

    def crc(question: dict[str, Any]) -> dict[str, Any]:
        sum16 = PredefinedCrc("modbus")
        sum16.update(octets(question["bytes"]))
        return crc_fields(sum16.crcValue.to_bytes(2, "little"))

    return {"crc16": {"encode": crc}}


STANDARD = {
    "number": {"encode": encode_number, "decode": decode_number},
    "text": {"decode": decode_text},
    "object-value": {"encode": encode_object, "decode": decode_object},
}
match sys.argv[1:]:
    case ["numpy" | "crcmod" as name]:
        serve(name, version(name), {"numpy": numpy, "crcmod": crcmod}[name]())
    case _:
        serve("Python", platform.python_version(), STANDARD)
