"""What the adapters in Python share: the loop over the lines of JSON, and the vectors' way to write values.

    from adapter import hexed, octets, serve

    def crc(question):
        return {"wire": hexed(some_library.crc(octets(question["bytes"])))}

    serve("some-library", {"crc16": {"encode": crc}})

An answer is made of what the library returns. An exception is a refusal, unless it is NotOffered.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterable, Mapping
from importlib import metadata
from typing import Any

Answers = Mapping[str, Mapping[str, Callable[[dict[str, Any]], dict[str, Any]]]]


FIELDS: dict[int, tuple[str, ...]] = {
    **dict.fromkeys((1, 2, 3, 4), ("address", "quantity")),
    **dict.fromkeys((5, 6), ("address", "value")),
    **{0x0F: ("address", "bits"), 0x10: ("address", "registers"), 0x14: ("places",), 0x15: ("records",)},
    **{0x16: ("address", "and_mask", "or_mask"), 0x18: ("address",), 0x2B: ("read_code", "object_id")},
    0x17: ("read_address", "read_quantity", "write_address", "registers"),
}
"""The fields of a request, by function; others have none."""


class NotOffered(Exception):
    """The library has no function for this question."""


class Refused(Exception):
    """The library says no without an exception, for example with None."""


def serve(name: str, answers: Answers, version: str = "") -> None:
    """Answer the questions on standard input until it ends.

    The version is that of what was built, the second argument of the program, or that of the package of this name.
    """
    version = version or (sys.argv[2] if sys.argv[2:] else metadata.version(name))
    write, sys.stdout = sys.stdout, sys.stderr  # what a library prints is no answer
    for line in sys.stdin:
        question = json.loads(line)
        if "hello" in question:
            answer: dict[str, Any] = {"name": name, "version": version}
            answer["kinds"] = {kind: list(row) for kind, row in answers.items()}
        else:
            answer = {"id": question["id"], **_answer(answers[question["kind"]][question["do"]], question)}
        write.write(json.dumps(answer) + "\n")
        write.flush()


def _answer(function: Callable[[dict[str, Any]], dict[str, Any]], question: dict[str, Any]) -> dict[str, Any]:
    try:
        return {"is": function(question)}
    except NotOffered as why:
        return {"not_offered": str(why)}
    except Exception as error:
        return {"refused": "", "text": f"{type(error).__name__}: {error}"}


def octets(text: str) -> bytes:
    """Return the bytes of "01 04 0F B1"."""
    return bytes.fromhex(text)


def hexed(data: bytes | bytearray | Iterable[int]) -> str:
    """Return bytes as "01 04 0F B1"."""
    return bytes(data).hex(" ").upper()


def bits(text: str) -> list[bool]:
    """Return the bits of "10110011 10"."""
    return [digit == "1" for digit in text.replace(" ", "")]


def bitted(values: Iterable[Any]) -> str:
    """Return bits as "10110011 10"."""
    digits = "".join("01"[bool(value)] for value in values)
    return " ".join(digits[at : at + 8] for at in range(0, len(digits), 8))


def words(text: str) -> list[int]:
    """Return the registers of "022B 0064"."""
    return [int(word, 16) for word in text.split()]


def worded(values: Iterable[int]) -> str:
    """Return registers as "022B 0064"."""
    return " ".join(f"{value:04X}" for value in values)


def registers(data: bytes) -> list[int]:
    """Return the registers that hold these bytes."""
    return words(data.hex(" ", 2))


def register_bytes(values: Iterable[int]) -> str:
    """Return the bytes of registers as "02 2B 00 64"."""
    return hexed(octets(worded(values)))


def crc_fields(wire: bytes) -> dict[str, Any]:
    """Return the fields of a CRC from its two bytes on the wire, low byte first."""
    return {"wire": hexed(wire), "crc": f"{int.from_bytes(wire, 'little'):04X}"}


def checksums(crc: Callable[[bytes], bytes], lrc: Callable[[bytes], int] | None = None) -> Answers:
    """Return the answers of functions for checksums: a CRC as its two bytes on the wire, an LRC as a number."""
    found: dict[str, Any] = {"crc16": {"encode": lambda question: crc_fields(crc(octets(question["bytes"])))}}
    if lrc is not None:
        found["lrc"] = {"encode": lambda question: {"lrc": f"{lrc(octets(question['bytes'])):02X}"}}
    return found


def number(text: str) -> int | float:
    """Return the number of a text: "1E400" stays infinite, "12" whole."""
    try:
        return int(text)
    except ValueError:
        return float(text)


def frame_text(can_id: int, extended: bool, rest: str) -> str:
    """Return a frame as candump writes it."""
    return f"{can_id:0{8 if extended else 3}X}#{rest}"
