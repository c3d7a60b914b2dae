"""What a pasted text or a dropped file is, how sure that is, and which view of the page shows it.

    01 04 0F B1 00 02 22 F8          Modbus RTU, certain: the CRC is right
    01 04 0F B1 00 02 22 F9          Modbus RTU, likely: no other protocol fits; or registers
    605#4041600000000000             a CAN frame
    0637                             a register; or a status word, a control word, a COB-ID
    40001                            the number of a register in a manual, or a number
    [FileInfo] ...                   an EDS
    two lines with frames or more    a log; so is the file of a capture

The first guess is the best. The others are what the text could be as well.
"""

from __future__ import annotations

import re
from base64 import b64decode
from collections.abc import Iterator
from contextlib import suppress
from typing import Any, NamedTuple

from barewire.errors import BarewireError, EncodeError
from barewire.rtu import encode
from barewire_workbench import explain_text
from barewire_workbench.frames.input import parse_hex
from barewire_workbench.monitor.recording import is_can_recording, read_recording
from barewire_workbench.recordings.candump import parse_any_can
from barewire_workbench.recordings.capture import is_capture
from barewire_workbench.recordings.modbus_log import LoggedBytes, read_modbus_log
from barewire_workbench.recordings.model import Recorded

LONGEST = 4_000_000
"""The most bytes of a file."""
_FRAME_MAX = 4096
"""The longest text of one frame, in characters."""
_BLF = b"LOGG"
"""How a BLF file begins."""
_EDS = re.compile(r"^\s*\[(FileInfo|DeviceInfo|MandatoryObjects)\]\s*$", re.IGNORECASE | re.MULTILINE)
_NAMES = {"rtu": "Modbus RTU", "tcp": "Modbus TCP", "ascii": "Modbus ASCII", "can": "CAN"}
_NUMBER = re.compile(r"[-+]?\d+(?:[.,]\d+)?(?:[eE][-+]?\d+)?")
_NUMBERED = re.compile(r"([134])(\d{4,5})")
_FOURS = re.compile(r"[0-9A-Fa-f]{4}(?:\s+[0-9A-Fa-f]{4})*")
_WORD = re.compile(r"(?:0x)?([0-9A-Fa-f]{3,4})h?")


class Table(NamedTuple):
    """One of the tables whose numbers begin with 1, 3 or 4, and the function code that reads it."""

    name: str
    function_code: int


_TABLES = {"1": Table("a discrete input", 2), "3": Table("an input register", 4), "4": Table("a holding register", 3)}


class Guess(NamedTuple):
    """One thing that the text may be: what to say, how sure it is, and the view with its values."""

    says: str
    sure: str
    view: str
    values: dict[str, str]


def guess(text: str = "", data: str = "") -> list[dict[str, Any]]:
    """Return the guesses for a text, or for a file, whose bytes come as base64; the best first."""
    raw = b64decode(data) if data else text.encode()
    if len(raw) > LONGEST:
        raise EncodeError(f"{len(raw)} bytes: at most {LONGEST} here; `barewire sniff` and `diagnose` read more")
    if not raw.strip():
        raise EncodeError("nothing there: paste a frame, a log, an EDS or a value, or drop a file")
    if is_capture(raw) or raw.startswith(_BLF):
        return [Guess("a capture", "certain", "log", {"data": data})._asdict()]
    found = list(_of_text(text or raw.decode("utf-8", "replace")))
    if not found:
        raise EncodeError("no frame, log, EDS or value is in it: expected bytes in hexadecimal, or lines with some")
    order = ("certain", "likely", "possible")
    return [one._asdict() for one in sorted(found, key=lambda one: order.index(one.sure))]


def _of_text(text: str) -> Iterator[Guess]:
    if _EDS.search(text):
        yield Guess("an electronic data sheet", "certain", "eds", {"text": text})
        return
    frames = list(_frames(text)) if len(text) <= _FRAME_MAX else []
    values = list(_values(text.strip()))
    if any(frame.sure == "certain" for frame in frames):
        frames = [frame for frame in frames if frame.sure != "possible"]
    else:
        number = _frames_in_log(text)
        if number > 1 or (number and not frames and not values):
            says = f"a log, with {number} frame{'s' if number > 1 else ''} or pieces of frames"
            yield Guess(says, "certain" if number > 1 else "likely", "log", {"text": text})
            frames = []  # lines of several frames, which no protocol takes for one
        elif _FOURS.fullmatch(text.strip()):
            frames = [frame._replace(sure="possible") for frame in frames]
    yield from frames
    yield from values


def _frames(text: str) -> Iterator[Guess]:
    """Yield each protocol of which the text may be one frame."""
    if "\n" not in text.strip() and re.search(r"#|\[\d+\]|^\s*\(", text):
        with suppress(BarewireError):
            parse_any_can(text)
            yield Guess("a CAN frame", "certain", "frame", {"protocol": "can", "text": text})
            return
    protocols = ["ascii"] if ":" in text.strip()[:1] else ["rtu", "tcp", "ascii"]
    for protocol in protocols:
        with suppress(BarewireError):
            explanation = explain_text(protocol, text)
            values = {"protocol": protocol, "text": text}
            length = sum(field.length for field in explanation.fields)
            if explanation.valid:
                yield Guess(f"a frame of {_NAMES[protocol]}, valid", "certain", "frame", values)
            elif protocol == "ascii" and not text.strip().startswith(":"):
                continue
            elif length >= 4:  # the shortest frame
                fits = protocol == "ascii" or (protocol == "tcp") == (parse_hex(text)[2:4] == b"\0\0")
                says = f"a frame of {_NAMES[protocol]}, with a mistake"
                yield Guess(says, "likely" if fits else "possible", "frame", values)


def _frames_in_log(text: str) -> int:
    """Return how many frames, or pieces of frames, a log has; 0 for a text that is no log."""
    data = text.encode()
    with suppress(BarewireError):
        if is_can_recording(data):
            return sum(isinstance(item, Recorded) for item in read_recording(data))
        return sum(isinstance(item, LoggedBytes) for item in read_modbus_log(data).items)
    return 0


def _values(text: str) -> Iterator[Guess]:
    """Yield what the text is as a number, a word, or registers."""
    if (numbered := _NUMBERED.fullmatch(text)) is not None:
        table, number = _TABLES[numbered[1]], int(numbered[2])
        address = number - 1
        if 0 <= address <= 0xFFFF:
            request = encode(1, bytes((table.function_code,)) + address.to_bytes(2, "big") + b"\0\1").hex(" ").upper()
            says = f"the number of {table.name} in a manual, address {address} on the wire: a request for it"
            yield Guess(says, "likely", "frame", {"protocol": "rtu", "text": request})
    if _NUMBER.fullmatch(text):
        kind = "f32" if re.search(r"[.,eE]", text) else "i32" if text.startswith("-") else "u32"
        yield Guess("a number", "likely", "values", {"type": kind, "value": text})
    if (word := _WORD.fullmatch(text)) is not None:
        digits = word[1].zfill(4)
        yield Guess("a status word of a drive", "possible", "steps", {"kind": "statusword", "text": digits})
        yield Guess("a control word of a drive", "possible", "steps", {"kind": "controlword", "text": digits})
        if int(digits, 16) <= 0x7FF:
            yield Guess("a COB-ID", "possible", "steps", {"kind": "cob-id", "text": f"{int(digits, 16):X}h"})
    with suppress(BarewireError):
        data = parse_hex(text)
        if data and not len(data) % 2 and len(data) <= 250:
            sure = "likely" if _FOURS.fullmatch(text) or len(data) == 2 else "possible"
            yield Guess("registers", sure, "values", {"text": data.hex(" ", 2).upper()})
