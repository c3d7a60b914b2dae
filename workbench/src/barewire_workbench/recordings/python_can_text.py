"""What python-can prints and writes as text: its Printer, `can_logger`, and its CSV files.

Timestamp: 1700000000.500000    ID:      605    S Tx                DL:  8    40 41 60 00 ...     Channel: can0
                                                X extended, R remote, E error, F CAN FD
timestamp,arbitration_id,extended,remote,error,dlc,data
1700000000.5,0x605,0,0,0,8,QEFgAAAAAAA=                    the data in base64
"""

from __future__ import annotations

import re
from base64 import b64decode
from binascii import Error as Base64Error
from collections.abc import Iterable, Iterator

from barewire.canopen.frame import BASE_MAX, DATA_MAX, EXTENDED_MAX, AnyFrame, CanFrame, ErrorFrame, FdFrame
from barewire.errors import DecodeError
from barewire_workbench.frames.result import text_error
from barewire_workbench.recordings.model import FD_MAX, Recorded, RecordedItem, split_lines, unread

_HEAD = "timestamp,arbitration_id,extended,remote,error,dlc,data"
_LINE = re.compile(
    r"\s*Timestamp:\s+(?P<at>\d{1,12}\.\d{1,9})\s+ID:\s+(?P<id>[0-9a-f]{1,8})\s+(?P<kind>[SX])\s?"
    r"(?P<flags>[A-Za-z ]{0,20}?)\s*DL:\s+(?P<length>\d{1,2})(?P<bytes>(?:\s+[0-9a-f]{2}(?![0-9a-z]))*)(?P<rest>.*)$"
)
_CHANNEL = re.compile(r"Channel:\s+(\S+)")
_ROW = re.compile(
    r"(?P<at>\d{1,12}(?:\.\d{1,9})?),0x(?P<id>[0-9a-fA-F]{1,8}),(?P<extended>[01]),(?P<remote>[01]),(?P<error>[01]),"
    r"(?P<length>\d{1,2}),(?P<data>[A-Za-z0-9+/=]*)"
)


def is_python_can_text(text: str) -> bool:
    """Return whether one of the first lines is of python-can.

    >>> is_python_can_text("timestamp,arbitration_id,extended,remote,error,dlc,data"), is_python_can_text("705#05")
    (True, False)
    """
    return any(line.strip() == _HEAD or _LINE.match(line) for line in text.splitlines()[:20])


def read_python_can_text(text: str | Iterable[str]) -> Iterator[RecordedItem]:
    """Yield the frames of printed lines, or of a CSV file.

    >>> [str(item.frame) for item in read_python_can_text("1.5,0x705,0,0,0,1,BQ==")]
    ['705#05']
    """
    now = 0.0
    for number, line in enumerate(split_lines(text), start=1):
        if not line.strip() or line.strip() == _HEAD:
            continue
        found = _LINE.match(line) or _ROW.fullmatch(line.strip())
        try:
            if found is None:
                raise text_error("delimiter", line, 0, "not a line of python-can")
            frame = _printed(found, line) if found.re is _LINE else _written(found, line)
        except DecodeError as error:
            yield unread(now, number, error, line)
            continue
        now = float(found["at"])
        channel = _CHANNEL.search(found["rest"]) if found.re is _LINE else None
        sent = ("Tx" in found["flags"]) if found.re is _LINE and re.search("[RT]x", found["flags"]) else None
        yield Recorded(now, channel[1] if channel else "", frame, number, sent)


def _printed(found: re.Match[str], line: str) -> AnyFrame:
    data = bytes.fromhex(found["bytes"])
    flags = found["flags"].replace("Rx", "").replace("Tx", "")
    length = int(found["length"])
    return _frame(int(found["id"], 16), found["kind"] == "X", flags, length, data, line)


def _written(found: re.Match[str], line: str) -> AnyFrame:
    try:
        data = b64decode(found["data"], validate=True)
    except (Base64Error, ValueError):
        raise text_error("character", line, 0, f"{found['data'][:24]!r} is not base64") from None
    flags = ("R" if found["remote"] == "1" else "") + ("E" if found["error"] == "1" else "")
    length = int(found["length"])
    flags += "F" if length > DATA_MAX else ""
    return _frame(int(found["id"], 16), found["extended"] == "1", flags, length, data, line)


def _frame(number: int, extended: bool, flags: str, length: int, data: bytes, line: str) -> AnyFrame:
    if number > (EXTENDED_MAX if extended else BASE_MAX):
        raise text_error("value", line, 0, f"identifier {number:X}h: expected up to 7FF, or 1FFFFFFF if extended")
    if "E" in flags:
        return ErrorFrame(0x80)
    if "R" in flags:
        return CanFrame(number, b"", extended, True, min(length, DATA_MAX))
    if length != len(data) or length > FD_MAX:
        raise text_error("length", line, len(line), f"the length is {length}, but {len(data)} bytes follow")
    if "F" in flags or length > DATA_MAX:
        return FdFrame(number, data, extended)
    return CanFrame(number, data, extended)
