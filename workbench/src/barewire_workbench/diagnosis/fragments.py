"""What bytes in a text are that are no whole frame: the data of SDO messages, the bytes of a float.

    The can frame is this `80 00 00 00 00 00 04 05`                 an SDO abort: 0504 0000h
    I get <07><7A><42><9B>, and it should be 77.514603              the float 77.5146, low word first

A reading is given only if it makes sense: an SDO command with an index of the dictionary, an abort with a known code;
an order of a float that gives a number of the text, or the only one that gives plausible numbers.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from barewire.canopen.abort_codes import AbortCode
from barewire.codecs import ORDERS, Number
from barewire_workbench.diagnosis.exchange import is_plausible, shown_digits
from barewire_workbench.diagnosis.tcp import diagnose_tcp
from barewire_workbench.frames.can import explain_sdo
from barewire_workbench.frames.result import FrameRole
from barewire_workbench.recordings.modbus_log.marked import frame_pdu
from barewire_workbench.recordings.modbus_log.posted import read_posted, without_markup

_SDO = 8
_REQUESTS, _ANSWERS = (
    frozenset((0x22, 0x23, 0x27, 0x2B, 0x2F, 0x40)),
    frozenset((0x41, 0x42, 0x43, 0x47, 0x4B, 0x4F, 0x60)),
)
_ABORT = 0x80
_INDEX = range(0x10, 0xC0)
"""The high bytes of the indexes of a dictionary."""
_FLOAT = 4
_NUMBER = re.compile(r"(?<![\w.:-])-?\d{1,9}\.\d{1,9}(?![\w.:])")
_IS_FLOAT = re.compile(r"(?i)float|\bf32\b|\breal\b")
_REGISTERS = re.compile(r"\[\s*(\d{1,5}(?:\s*,\s*\d{1,5}){1,63})\s*\]")
_DIGITS = 3
"""So many digits of a number tell it from others."""
_FLOATS_MAX = 16
"""Bytes of the floats that are tried in each order."""
_LONGEST = 0x8000
"""Characters of a text in which bytes are looked for."""


def pieces_of(text: str) -> list[bytes]:
    """Return the bytes in a text, four or more in a row."""
    lines = [without_markup(line) for line in text[:_LONGEST].splitlines()]
    return list(dict.fromkeys(found.entry.data for found in read_posted(lines, least=_FLOAT) if found.entry.data))


def readings_of(text: str, pieces: list[bytes]) -> list[str]:
    """Return what bytes of a text are that are no frame of their own.

    >>> readings_of("a frame 80 00 00 00 00 00 04 05", [bytes.fromhex("8000000000000405")])[0].partition("is an ")[2]
    'SDO message of either side: abort, 0000h:00, 0504 0000h SDO protocol timed out'
    >>> readings_of("it is 77.5146", [bytes.fromhex("077A429B")])[0].partition(": ")[2]
    'CDAB 77.5146; ABCD 1.88275e-34 (77.5146 is in the text)'
    """
    return [*_sdo(pieces), *_tcp(pieces), *floats_of(text, pieces)]


def _tcp(pieces: list[bytes]) -> Iterator[str]:
    """Yield the frames of TCP that end too early, by the length in their header."""
    for data in pieces:
        for cut in diagnose_tcp(data):
            if cut.code == "cut-frame" and data[2:4] == b"\0\0":
                yield f"{shown_digits(data)} of Modbus TCP is {cut.text}: {cut.proof}"


def _sdo(pieces: list[bytes]) -> Iterator[str]:
    rows = [data[at : at + _SDO] for data in pieces if len(data) % _SDO == 0 for at in range(0, len(data), _SDO)]
    for data in dict.fromkeys(rows):
        command, has_index = data[0], data[2] in _INDEX
        is_abort = command == _ABORT and int.from_bytes(data[4:], "little") in set(AbortCode)
        if frame_pdu("rtu", data) is None and (is_abort or (has_index and command in _REQUESTS | _ANSWERS)):
            role: FrameRole = "request" if command in _REQUESTS else "response"
            side = "message of either side" if is_abort else "request" if role == "request" else "answer"
            yield (
                f"{shown_digits(data)} without its identifier is an SDO {side}: {explain_sdo(data, role).summary}"
                + _unused(data)
            )


def _unused(data: bytes) -> str:
    """Return the bytes behind the value of an expedited transfer, if they are not 0."""
    number = data[0] >> 2 & 3 if data[0] >> 5 in (1, 2) and data[0] & 3 == 3 else 0
    rest = data[len(data) - number :] if number else b""
    return f"; the unused bytes {shown_digits(rest)} are ignored" if any(rest) else ""


def floats_of(text: str, pieces: list[bytes]) -> Iterator[str]:
    """Yield the floats that bytes or registers of a text are in another word order, if they are none as they stand."""
    numbers = [number for number in _NUMBER.findall(text) if len(number.strip("-0.").replace(".", "")) >= _DIGITS]
    registers = [[int(number) for number in row.split(",")] for row in _REGISTERS.findall(text)]
    pieces = [*pieces, *(_packed(row) for row in registers if 0xFF < max(row) <= 0xFFFF)]
    for data in dict.fromkeys(map(_values, pieces)):
        if not data or len(data) % _FLOAT or len(data) > _FLOATS_MAX:
            continue
        parts = [data[at : at + _FLOAT] for at in range(0, len(data), _FLOAT)]
        read = {order: [float(Number("f32", order).decode(part)) for part in parts] for order in ORDERS}
        shown = [value for values in read.values() for value in values if _is_shown(value, numbers)]
        plausible = [order for order in ORDERS if all(map(is_plausible, read[order]))]
        is_float = shown and not any(value in shown for value in read["ABCD"])
        if plausible and "ABCD" not in plausible and (is_float or _IS_FLOAT.search(text)):
            orders = [*plausible, "ABCD"]
            values = "; ".join(f"{order} {', '.join(f'{value:g}' for value in read[order])}" for order in orders)
            said = f" ({shown[0]:g} is in the text)" if shown else ""
            yield f"{shown_digits(data)} as floats, in plausible word orders and as it stands: {values}{said}"


def _values(data: bytes) -> bytes:
    """Return the registers in a response, or the bytes themselves."""
    pdu = next(filter(None, (frame_pdu(name, data) for name in ("rtu", "tcp"))), b"")
    return pdu[2:] if pdu[:1] in (b"\3", b"\4") and len(pdu) == pdu[1] + 2 else b"" if pdu else data


def _packed(registers: list[int]) -> bytes:
    return b"".join(register.to_bytes(2, "big") for register in registers)


def _is_shown(value: float, numbers: list[str]) -> bool:
    return any(abs(value - float(number)) <= 0.6 * 10.0 ** -len(number.partition(".")[2]) for number in numbers)
