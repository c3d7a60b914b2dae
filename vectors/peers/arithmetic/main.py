"""Arithmetic done another way: fractions, bit fields of ctypes and struct of Python's standard library, as an adapter.

barewire vectors check --adapter "python vectors/peers arithmetic"

It confirms that a number was calculated right, and not what a standard demands: the tables of the kinds are in it a
second time, written from the manuals by the same hands. So it is counted apart from the programs of others.
"""

from __future__ import annotations

import ctypes
import platform
import struct
from fractions import Fraction
from typing import Any

from adapter import NotOffered, Refused, hexed, number, octets, register_bytes, serve, worded, words

LETTERS = {"u8": "B", "i8": "b", "u16": "H", "i16": "h", "u32": "I", "i32": "i", "u64": "Q", "i64": "q", "f32": "f"}


# Values of devices -------------------------------------------------------------------------------------------------


def encode_parameter(question: dict[str, Any]) -> dict[str, Any]:
    parameter, answer = question["parameter"], {}
    if "modbus" in parameter:
        answer["registers"] = worded(in_registers(parameter, question["value"], question.get("old")))
    if "object" in parameter:
        answer["bytes"] = hexed(in_object(parameter, question["value"], question.get("old")))
    return answer


def decode_parameter(question: dict[str, Any]) -> dict[str, Any]:
    parameter, found = question["parameter"], []
    if "registers" in question and "modbus" in parameter:
        found.append(from_registers(parameter, words(question["registers"])))
    if "bytes" in question and "object" in parameter:
        found.append(from_object(parameter, octets(question["bytes"])))
    if len({*found}) != 1:
        raise Refused("the two places differ")
    return {"value": found[0]}


def in_registers(parameter: dict[str, Any], value: str, old: str | None) -> list[int]:
    place, count = parameter["modbus"], parameter["modbus"]["words"]
    if parameter["type"] == "text":
        data = struct.pack(f"{2 * count}s", value.encode("ascii"))
        if len(value) > 2 * count:
            raise ValueError("a longer text")
        return [*struct.unpack(f">{count}H", data)]
    if "bit" in place:
        parts, at = struct.pack(">H", words(old or "0000")[0]), place["bit"]
        digits = [*f"{int.from_bytes(parts, 'big'):016b}"]
        digits[15 - at] = {"0": "0", "1": "1"}[value]
        return [int("".join(digits), 2)]
    if "half" in place:
        high, low = struct.pack(">H", words(old or "0000")[0])
        (byte,) = struct.pack(LETTERS[parameter["type"]], raw_of(parameter, value))
        return [high << 8 | byte] if place["half"] == "L" else [byte << 8 | low]
    if parameter["type"] in ("u8", "i8", "bool"):  # alone in its register: a number of 16 bits
        check = struct.pack(LETTERS.get(parameter["type"], "?"), int(raw_of(parameter, value)))
        return [int.from_bytes(check, "little", signed=parameter["type"] == "i8") & 0xFFFF]
    data = struct.pack(">" + LETTERS[parameter["type"]], raw_of(parameter, value))
    return ordered([*struct.unpack(f">{count}H", data)], place.get("order", "ABCD"))


def from_registers(parameter: dict[str, Any], row: list[int]) -> str:
    place = parameter["modbus"]
    if len(row) != place["words"]:
        raise ValueError("another number of registers")
    if parameter["type"] == "text":
        return octets(register_bytes(row)).decode("ascii").rstrip("\0 ")
    if "bit" in place:
        return f"{row[0]:016b}"[15 - place["bit"]]
    if "half" in place:
        byte = f"{row[0]:04X}"[2:] if place["half"] == "L" else f"{row[0]:04X}"[:2]
        return value_of(parameter, struct.unpack(LETTERS[parameter["type"]], octets(byte))[0])
    if parameter["type"] in ("u8", "i8", "bool"):
        (whole,) = struct.unpack(">h" if parameter["type"] == "i8" else ">H", octets(register_bytes(row)))
        struct.pack(LETTERS.get(parameter["type"], "B"), whole)
        return value_of(parameter, whole)
    data = octets(register_bytes(ordered(row, place.get("order", "ABCD"))))
    return value_of(parameter, struct.unpack(">" + LETTERS[parameter["type"]], data)[0])


def ordered(row: list[int], order: str) -> list[int]:
    """Return registers in an order of bytes; each order is its own reverse."""
    if order in ("CDAB", "DCBA"):
        row = row[::-1]
    return [int.from_bytes(word.to_bytes(2, "little"), "big") for word in row] if order in ("BADC", "DCBA") else row


def in_object(parameter: dict[str, Any], value: str, old: str | None) -> bytes:
    if "bit" in parameter["object"]:
        data = octets(old or "00 00")
        digits = [*f"{int.from_bytes(data, 'little'):0{8 * len(data)}b}"][::-1]
        digits[parameter["object"]["bit"]] = {"0": "0", "1": "1"}[value]
        return int("".join(digits[::-1]), 2).to_bytes(len(data), "little")
    if parameter["type"] == "bool":
        return struct.pack("<?", bool(int(value)))
    return struct.pack("<" + LETTERS[parameter["type"]], raw_of(parameter, value))


def from_object(parameter: dict[str, Any], data: bytes) -> str:
    if "bit" in parameter["object"]:
        return f"{int.from_bytes(data, 'little'):0{8 * len(data)}b}"[::-1][parameter["object"]["bit"]]
    return value_of(parameter, struct.unpack("<" + LETTERS.get(parameter["type"], "?"), data)[0])


def raw_of(parameter: dict[str, Any], value: str) -> Any:
    """Return the number in the device: an integer exactly, and refused between two steps."""
    if parameter["type"] == "f32" and "scale" not in parameter:
        return number(value)
    steps = Fraction(value) / Fraction(parameter.get("scale", "1"))
    if steps.denominator != 1:
        raise ValueError(f"{value} is between two steps")
    return int(steps)


def value_of(parameter: dict[str, Any], raw: Any) -> str:
    if parameter["type"] == "f32" and "scale" not in parameter:
        return repr(raw)
    return decimal(Fraction(int(raw)) * Fraction(parameter.get("scale", "1")))


def decimal(value: Fraction) -> str:
    """Return a fraction as a decimal number."""
    places = next((places for places in range(30) if (value * 10**places).denominator == 1), None)
    if places is None:
        raise NotOffered("no decimal number")
    return f"{value.numerator * 10**places // value.denominator}e-{places}"


def part(question: dict[str, Any]) -> dict[str, Any]:
    data = octets(question["register"])
    if question["part"] in ("H", "L"):
        return {"value": dict(zip("HL", data))[question["part"]]}
    at = int(question["part"].removeprefix("bit "))
    if not 0 <= at <= 15:
        raise ValueError("a register has 16 bits")
    return {"value": int(f"{int(question['register'], 16):016b}"[15 - at])}


def write_part(question: dict[str, Any]) -> dict[str, Any]:
    halves = dict(zip("HL", octets(question["register"])))
    if question["part"] in halves:
        halves[question["part"]] = question["write"]
        return {"then": bytes(halves.values()).hex().upper()}
    at, digits = int(question["part"].removeprefix("bit ")), [*f"{int(question['register'], 16):016b}"]
    if not 0 <= at <= 15 or question["write"] not in (0, 1):
        raise ValueError("a bit of 16")
    digits[15 - at] = str(question["write"])
    return {"then": f"{int(''.join(digits), 2):04X}"}


# Times -------------------------------------------------------------------------------------------------------------


def timing(question: dict[str, Any]) -> dict[str, Any]:
    """Serial line 2.5.1.1: 3.5 and 1.5 characters, and fixed times above 19200 bit/s."""
    if question["bits"] not in (10, 11, 12):
        raise ValueError("no character of RTU")
    character = Fraction(question["bits"], question["baud"])
    inside, behind = (Fraction("0.00075"), Fraction("0.00175"))
    if question["baud"] <= 19200:
        inside, behind = character * Fraction("1.5"), character * Fraction("3.5")
    names = ("character_ns", "t15_ns", "t35_ns")
    return dict(zip(names, (round(time * 10**9) for time in (character, inside, behind))))


class Time(ctypes.LittleEndianStructure):
    """TIME_OF_DAY of CiA 301, 7.1.6.7."""

    _pack_ = 1
    _fields_ = (("milliseconds", ctypes.c_uint32, 28), ("reserved", ctypes.c_uint32, 4), ("days", ctypes.c_uint16))


def encode_time(question: dict[str, Any]) -> dict[str, Any]:
    if not question["type"].startswith("TIME_"):
        raise NotOffered("times only")
    value = question["value"]
    made = Time(value["milliseconds"], 0, value["days"])
    if (made.milliseconds, made.days) != (value["milliseconds"], value["days"]):
        raise ValueError("more than the field holds")
    return {"bytes": hexed(bytes(made))}


def decode_time(question: dict[str, Any]) -> dict[str, Any]:
    data = octets(question["bytes"])
    if not question["type"].startswith("TIME_"):
        raise NotOffered("times only")
    if len(data) != ctypes.sizeof(Time):
        raise ValueError("six bytes")
    found = Time.from_buffer_copy(data)
    if found.milliseconds >= 24 * 60 * 60 * 1000:
        raise ValueError("more than a day")
    return {"value": {"days": found.days, "milliseconds": found.milliseconds}}


# Bit fields of CANopen ---------------------------------------------------------------------------------------------


class Entry(ctypes.LittleEndianStructure):
    """A COB-ID in the object dictionary (CiA 301, 7.5.2)."""

    _fields_ = tuple((name, ctypes.c_uint32, bits) for name, bits in (("id", 29), ("ext", 1), ("b30", 1), ("b31", 1)))


def encode_entry(question: dict[str, Any]) -> dict[str, Any]:
    flags = (question[name] for name in ("extended", "bit30", "bit31"))
    (value,) = struct.unpack("<I", bytes(Entry(int(question["identifier"], 16), *map(int, flags))))
    return {"value": f"{value:08X}"}


def decode_entry(question: dict[str, Any]) -> dict[str, Any]:
    found = Entry.from_buffer_copy(struct.pack("<I", int(question["value"], 16)))
    identifier = f"{found.id:08X}" if found.ext else f"{found.id & 0x7FF:03X}"
    flags = {"extended": bool(found.ext), "bit30": bool(found.b30), "bit31": bool(found.b31)}
    return {"identifier": identifier, **flags}


def encode_consumer(question: dict[str, Any]) -> dict[str, Any]:
    data = struct.pack("<HBx", question["milliseconds"], question["node"])
    return {"value": str(struct.unpack("<I", data)[0]), "bytes": hexed(data)}


def decode_consumer(question: dict[str, Any]) -> dict[str, Any]:
    milliseconds, node, _ = struct.unpack("<HBB", octets(question["bytes"]))
    used = milliseconds and 1 <= node <= 127
    return {"node": node if used else None, "milliseconds": milliseconds if used else None}


class Multiplexed(ctypes.LittleEndianStructure):
    """The eight bytes of an MPDO (CiA 301, 7.2.2.4)."""

    _pack_ = 1
    _fields_ = (
        *(("node", ctypes.c_uint8, 7), ("dam", ctypes.c_uint8, 1)),
        *(("index", ctypes.c_uint16), ("sub", ctypes.c_uint8), ("data", ctypes.c_uint8 * 4)),
    )


def encode_mpdo(question: dict[str, Any]) -> dict[str, Any]:
    dam, data = question["addressing"] == "DAM", octets(question["data"])
    made = Multiplexed(question["node"], dam, int(question["index"], 16), int(question["sub"], 16), (*data,))
    if made.node != question["node"] or not (dam or made.node):
        raise ValueError("no node")
    return {"bytes": hexed(bytes(made))}


def decode_mpdo(question: dict[str, Any]) -> dict[str, Any]:
    data = octets(question["bytes"])
    if len(data) != 8:
        raise ValueError("eight bytes")
    found = Multiplexed.from_buffer_copy(data)
    if not (found.dam or found.node):
        raise ValueError("no producer")
    row = {"addressing": "DAM" if found.dam else "SAM", "node": found.node, "index": f"{found.index:04X}"}
    return {**row, "sub": f"{found.sub:02X}", "data": hexed(found.data)}


serve(
    "arithmetic",
    platform.python_version(),
    {
        "parameter": {"encode": encode_parameter, "decode": decode_parameter},
        "register-part": {"decode": part, "encode": write_part},
        "rtu-timing": {"encode": timing},
        "object-value": {"encode": encode_time, "decode": decode_time},
        "cob-entry": {"encode": encode_entry, "decode": decode_entry},
        "heartbeat-consumer": {"encode": encode_consumer, "decode": decode_consumer},
        "mpdo": {"encode": encode_mpdo, "decode": decode_mpdo},
    },
)
