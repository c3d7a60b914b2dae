"""PCAN trace files (.trc) of PEAK, versions 1.0 to 2.1.

    ;$STARTTIME=45244.92593171296                          days since 1899-12-30
         1)      1059.9  Rx         0605  8  40 41 60 00 00 00 00 00       1.1; 1.0 without Rx, 1.2, 1.3 with a bus
         1      1059.900 DT     0605 Rx 8  40 41 60 00 00 00 00 00         2.0
         1      1059.900 DT  1  0605 Rx -  8    40 41 60 00 00 00 00 00    2.1, as ;$COLUMNS=N,O,T,B,I,d,R,L,D says
         2      1060.100 RR  1  0705 Rx -  1                                    a remote frame; ER error, ST status ...

Times are milliseconds from the start. An identifier of 8 digits is an extended one.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

from barewire.canopen.frame import DATA_MAX, AnyFrame, CanFrame, ErrorFrame, FdFrame
from barewire.errors import DecodeError
from barewire_workbench.frames.result import text_error
from barewire_workbench.recordings.model import FD_MAX, Recorded, RecordedItem, split_lines, unread

_EPOCH = 25569.0
"""Days from 1899-12-30 to 1970-01-01."""
_START = re.compile(r";\s*\$STARTTIME=(\d{1,6}(?:\.\d{1,15})?)\s*$")
_COLUMNS = re.compile(r";\s*\$COLUMNS=([A-Za-z,]{1,40})\s*$")
_VERSION = re.compile(r";\s*\$FILEVERSION=[12]\.\d\s*$")
_OLD = re.compile(
    r"\s*\d{1,9}\)\s+(?P<at>\d{1,12}(?:\.\d{1,6})?)\s+(?:(?P<bus>\d{1,2})\s+)?(?:(?P<direction>Rx|Tx|Warng|Error)\s+)?"
    r"(?P<id>[0-9A-Fa-f]{4}|[0-9A-Fa-f]{8})\s+(?:-\s+)?(?P<length>\d{1,2})(?P<rest>(?:\s.*)?)$"
)
_FD_TYPES = frozenset({"FD", "FB", "FE", "BI"})
_OTHER_TYPES = frozenset({"ST", "EC", "EV"})


def is_trc(text: str) -> bool:
    """Return whether a text begins like a trace file.

    >>> is_trc(";$FILEVERSION=2.1"), is_trc("(1.5) can0 705#05")
    (True, False)
    """
    for line in text.splitlines()[:30]:
        if line.startswith(";"):
            if _VERSION.match(line):
                return True
        elif line.strip():
            return bool(_OLD.match(line))
    return False


def read_trc(text: str | Iterable[str]) -> Iterator[RecordedItem]:
    """Yield the frames of a trace file.

    >>> text = ";$FILEVERSION=1.1\\n  1)  1059.9  Rx  0605  8  40 41 60 00 00 00 00 00"
    >>> [(item.at, str(item.frame)) for item in read_trc(text)]
    [(1.0599, '605#4041600000000000')]
    """
    start, now, columns = 0.0, 0.0, ""
    for number, line in enumerate(split_lines(text), start=1):
        if line.startswith(";"):
            if found := _START.match(line):
                start = now = (float(found[1]) - _EPOCH) * 86400.0
            elif found := _COLUMNS.match(line):
                columns = found[1].replace(",", "")
            continue
        if not line.strip():
            continue
        try:
            row = _row(line, columns)
            if row is None:
                continue
            offset, bus, sent, frame = row
        except DecodeError as error:
            yield unread(now, number, error, line)
            continue
        now = max(now, start + offset)
        yield Recorded(now, bus, frame, number, sent)


def _row(line: str, columns: str) -> tuple[float, str, bool | None, AnyFrame] | None:
    """Return time, bus, direction and frame of a line; None for a line about the state of the bus."""
    if not columns:
        found = _OLD.match(line)
        if found is None:
            raise text_error("delimiter", line, 0, "not a line of a trace file")
        if found["direction"] in ("Warng", "Error"):
            return None
        sent = None if found["direction"] is None else found["direction"] == "Tx"
        frame = _frame("", found["id"], int(found["length"]), found["rest"].split(), line)
        return float(found["at"]) / 1000, found["bus"] or "", sent, frame
    tokens = line.split(maxsplit=len(columns) - 1)
    if len(tokens) < len(columns) - 1:
        raise text_error("short", line, len(line), f"{len(tokens)} columns, expected {len(columns)}: {columns}")
    fields = dict(zip(columns, tokens))
    kind = fields.get("T", "DT")
    if kind in _OTHER_TYPES:
        return None
    try:
        offset = float(fields["O"]) / 1000
        length = int(fields.get("L") or fields["l"])
    except (ValueError, KeyError):
        raise text_error("value", line, 0, "the time or the length is not a number") from None
    if not 0 <= offset < 1e12:
        raise text_error("value", line, 0, "the time is out of range")
    frame = _frame(kind, fields.get("I", ""), length, fields.get("D", "").split(), line)
    bus = fields.get("B", "")
    return offset, "" if bus == "-" else bus, {"Rx": False, "Tx": True}.get(fields.get("d", "")), frame


def _frame(kind: str, identifier: str, length: int, tokens: list[str], line: str) -> AnyFrame:
    if kind == "ER":
        return ErrorFrame(0x80)
    if not re.fullmatch(r"[0-9A-Fa-f]{4}|[0-9A-Fa-f]{8}", identifier):
        raise text_error("value", line, 0, f"identifier {identifier!r}: expected 4 or 8 hexadecimal digits")
    extended = len(identifier) == 8
    digits = identifier if extended else identifier[-3:] if identifier[0] == "0" else identifier
    if kind == "RR" or tokens[:1] == ["RTR"]:
        return CanFrame.parse(f"{digits}#R{min(length, DATA_MAX)}")
    if len(tokens) < length or length > FD_MAX:
        raise text_error("length", line, len(line), f"the length is {length}, but {len(tokens)} bytes follow")
    try:
        data = bytes(int(token, 16) for token in tokens[:length] if len(token) == 2 or _wrong(line, token))
    except ValueError:
        raise text_error("character", line, 0, f"{' '.join(tokens[:length])[:24]!r} is not bytes") from None
    if kind in _FD_TYPES:
        return FdFrame(int(identifier, 16), data, extended)
    return CanFrame.parse(f"{digits}#{data.hex()}")


def _wrong(line: str, token: str) -> bool:
    raise text_error("character", line, 0, f"{token[:24]!r} is not a byte")
