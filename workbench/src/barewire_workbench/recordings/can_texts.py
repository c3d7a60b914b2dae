"""Recordings of CAN as text: of CANalyzer, PEAK, BUSMASTER, python-can, the test tool of CiA, and notes.

**Vector ASC: CAN frames as lines of text, written by CANalyzer and other tools**

    date Tue Nov 14 22:13:20.000 2023
    base hex  timestamps absolute                                    or dec; or relative: since the line before
    internal events logged
    Begin Triggerblock Tue Nov 14 22:13:20.000 2023
       0.000000 Start of measurement
       0.000800 1  605             Rx   d 8 40 41 60 00 00 00 00 00  Length = 0 BitCount = 64 ID = 1541
       0.099900 1  705             Rx   r 1                          remote; the length may be missing
       0.199900 1  18EBFF00x       Rx   d 2 01 02                    x: an extended identifier
       0.299900 1  ErrorFrame
       0.399900 CANFD   1 Rx   123  Name  1 0 a 16 AA BB ...         BRS ESI code length bytes duration length flags
    End TriggerBlock

The bus is the number of the channel. Times count from the start of the measurement, as in the file. Other lines of
the format (statistics, status, other buses, comments) are skipped.

**PCAN trace files (.trc) of PEAK, versions 1.0 to 2.1**

    ;$STARTTIME=45244.92593171296                          days since 1899-12-30
         1)      1059.9  Rx         0605  8  40 41 60 00 00 00 00 00       1.1; 1.0 without Rx, 1.2, 1.3 with a bus
         1      1059.900 DT     0605 Rx 8  40 41 60 00 00 00 00 00         2.0
         1      1059.900 DT  1  0605 Rx -  8    40 41 60 00 00 00 00 00    2.1, as ;$COLUMNS=N,O,T,B,I,d,R,L,D says
         2      1060.100 RR  1  0705 Rx -  1                                    a remote frame; ER error, ST status ...

Times are milliseconds from the start. An identifier of 8 digits is an extended one.

**Logs of BUSMASTER, of Bosch and ETAS**

    ***BUSMASTER Ver 3.2.2***                              in Markdown, a title may have become **_BUSMASTER ..._**
    ***HEX***                                              or DEC
    ***ABSOLUTE MODE***                                    or SYSTEM: the time of day; RELATIVE: since the line before
    ***<Time><Tx/Rx><Channel><CAN ID><Type><DLC><DataBytes>***
    00:00:06:9840 Tx 1 0x605 s 8 40 41 60 00 00 00 00 00   hours, minutes, seconds, 0.1 ms; x: an extended identifier
    00:00:06:9851 Rx 1 1413 s 8 075 065 096 000 055 ...    DEC: three digits for each byte
    00:00:06:9860 Rx 1 0x705 sr 1                          a remote frame

Bytes behind the length are left out: some versions print those of the frame before.

**What python-can prints and writes as text: its Printer, `can_logger`, and its CSV files**

Timestamp: 1700000000.500000    ID:      605    S Tx                DL:  8    40 41 60 00 ...     Channel: can0
                                                X extended, R remote, E error, F CAN FD
timestamp,arbitration_id,extended,remote,error,dlc,data
1700000000.5,0x605,0,0,0,8,QEFgAAAAAAA=                    the data in base64

**Frames of CAN as they are noted and posted: an identifier and its bytes in a line of any text, without times**

    182#4007     error: 20000004#0030...       60B   [8]  40 0A 10 00 00 00 00 00
    082 40 81 10 12 47 00 fd 00                30)  2427.0  Rx  0CF00400  8  F8 7D ...     as many bytes as it says
    67F Tx SD  8  23 14 10 00 00 00 00 00      msg ID: 0x20000088, Data[0..7]: 0x00, 0x00, ...
    <701> (8) b'0210010000000000'              Standard ID: 0x351  DLC: 8  Data: 0x44 0x02 ...
    COB-ID: 0x7E5                              can.Message(arbitration_id=0x605, dlc=8, data=[0x40, 0x41, ...])
    Data: 04 01 00 00 00 00 00 00              Response from 0x7E4: 17 01 ...               beside one of the others
    ffffffff0c000020080000000000080000000000   a frame of gs_usb, as Linux and firmware print it: echo, identifier ...

The frames count as 1 ms apart.

**The log of the CANopen conformance test tool of CiA: reads its frames**

        Test Info   : ### Test case : 2.1  -  Test name : SDO 01 ####      other lines are skipped
        Test CAN    : CAN1  604 Tx SD  8  40 00 10 00 00 00 00 00
                      |     |   |  ||  |  '-- the data in hexadecimal; absent for a remote frame
                      |     |   |  ||  '-- the length
                      |     |   |  |'-- D data frame, R remote frame
                      |     |   |  '-- S identifier of 11 bits, E of 29 bits
                      |     |   '-- Tx the tool sent it, Rx the device under test
                      |     '-- the identifier in hexadecimal
                      '-- the bus

The log has no times, so the lines are 1 ms apart. The form is that of version 3.0.3.10, of which a report is published
(test/test_report_CCT.md of the repository CANopenNode/CANopenDemo). That one has 11-bit data frames alone: E and R are
read by analogy.
"""

from __future__ import annotations

import re
from base64 import b64decode
from binascii import Error as Base64Error
from collections.abc import Iterable, Iterator

from barewire.canopen.frame import BASE_MAX, DATA_MAX, EXTENDED_MAX, AnyFrame, CanFrame, ErrorFrame, FdFrame
from barewire.errors import DecodeError
from barewire_workbench.frames.result import text_error
from barewire_workbench.recordings.candump import parse_frame
from barewire_workbench.recordings.model import FD_LENGTHS, FD_MAX, Dropped, Recorded, RecordedItem, split_lines, unread

_EDL = 0x1000
"""The flag for CAN FD in a CANFD line; without it the line has a classical frame."""

_ASC_START = re.compile(r"(?i)^\s*(date\s|base\s+(hex|dec)|(no\s+)?internal events logged)")
_ASC_BASE = re.compile(r"(?i)^\s*base\s+(hex|dec)\s+timestamps\s+(absolute|relative)")
_ASC_KNOWN = re.compile(
    r"(?i)^\s*(//|date\s|base\s|(no\s+)?internal events|begin\s|end\s|previous log|"
    r"\d+\.\d+\s+(start of|sv:|log |can\s+\d+\s+status|\d+\s+statistic|\d+\s+overloadframe|cantp|tfs:|gps|"
    r"lin|l\d|j1939|li\s|fr|eth|more|test|%|[a-z]+\s*:))"
)
_ASC_OVERRUN = re.compile(r"(?i)^\s*(\d{1,12}\.\d{1,12})\s+(?:can\s+)?(\d+)\s+.*overrun")
_ASC_ERROR = re.compile(r"(?i)^\s*(\d{1,12}\.\d{1,12})\s+(?:canfd\s+)?(\d+)\s+(?:rx\s+|tx\s+)?errorframe")
_ASC_FRAME = re.compile(
    r"(?i)^\s*(?P<at>\d{1,12}\.\d{1,12})\s+(?P<bus>\d+)\s+(?P<id>[0-9a-f]+)(?P<x>x?)\s+(?P<dir>rx|tx|txrq)\s+"
    r"(?P<kind>[dr])(?P<rest>.*)$"
)
_ASC_FD = re.compile(
    r"(?i)^\s*(?P<at>\d{1,12}\.\d{1,12})\s+canfd\s+(?P<bus>\d+)\s+(?P<dir>rx|tx|txrq)\s+(?P<id>[0-9a-f]+)(?P<x>x?)\s+"
    r"(?:(?P<name>(?![01]\s+[01]\s+[0-9a-f]\s+\d)\S+)\s+)?(?P<brs>[01])\s+(?P<esi>[01])\s+(?P<code>[0-9a-f])\s+"
    r"(?P<length>\d+)(?P<rest>.*)$"
)


def is_asc(text: str) -> bool:
    """Return whether the text begins like an ASC file."""
    lines = [line for line in text.splitlines()[:20] if line.strip() and not line.lstrip().startswith("//")]
    return bool(lines) and _ASC_START.match(lines[0]) is not None


def read_asc(text: str | Iterable[str]) -> Iterator[RecordedItem]:
    """Yield the frames of the file.

    >>> text = "base hex  timestamps absolute\\n 0.5 1  705  Rx   d 1 05\\n"
    >>> [(item.at, item.bus, str(item.frame)) for item in read_asc(text)]
    [(0.5, '1', '705#05')]
    """
    base, relative, now = 16, False, 0.0
    for number, line in enumerate(split_lines(text), start=1):
        if header := _ASC_BASE.match(line):
            base, relative = (16 if header[1].lower() == "hex" else 10), header[2].lower() == "relative"
            continue
        if not line.strip():
            continue
        match = _ASC_FRAME.match(line) or _ASC_FD.match(line) or _ASC_ERROR.match(line)
        if match is None:
            if overrun := _ASC_OVERRUN.match(line):
                yield Dropped(now, overrun[2], 0)
            elif not _ASC_KNOWN.match(line):
                yield unread(now, number, "not a line of an ASC file", line)
            continue
        stamp = float(match[1])
        now = now + stamp if relative else stamp
        if match.re is _ASC_ERROR:
            yield Recorded(now, match[2], ErrorFrame(0x80), number)
            continue
        try:
            frame = _asc_frame(match, base) if match.re is _ASC_FRAME else _asc_fd_frame(match, base)
        except DecodeError as error:
            yield unread(now, number, error, line)
        else:
            yield Recorded(now, match["bus"], frame, number)


def _asc_error(match: re.Match[str], words: str) -> DecodeError:
    return DecodeError("value", match[0].encode("latin-1", "replace"), 0, words)


def _asc_identifier(match: re.Match[str], base: int) -> tuple[int, bool]:
    extended = bool(match["x"])
    try:
        number = int(match["id"], base)
    except ValueError:
        raise _asc_error(match, f"identifier {match['id']!r} is not a number in base {base}") from None
    if number > (EXTENDED_MAX if extended else BASE_MAX):
        raise _asc_error(match, f"identifier {match['id']}: expected up to 7FF, or 1FFFFFFFx")
    return number, extended


def _asc_data(match: re.Match[str], tokens: list[str], length: int, base: int) -> bytes:
    tokens = tokens[:length]
    try:
        data = bytes(int(token, base) for token in tokens)
    except ValueError:
        raise _asc_error(match, f"{' '.join(tokens)[:24]!r} is not bytes in base {base}") from None
    if len(data) < length:
        raise _asc_error(match, f"the length is {length}, but {len(data)} bytes follow")
    return data


def _asc_frame(match: re.Match[str], base: int) -> CanFrame:
    number, extended = _asc_identifier(match, base)
    tokens = match["rest"].split()
    code = tokens[0] if tokens else ""
    if match["kind"].lower() == "r":
        requested = int(code, 16) if len(code) == 1 and code in "0123456789abcdefABCDEF" else 0
        return CanFrame(number, b"", extended, True, min(requested, DATA_MAX))
    if len(code) != 1 or code not in "0123456789abcdefABCDEF":
        raise _asc_error(match, f"length {code!r}: expected one digit")
    return CanFrame(number, _asc_data(match, tokens[1:], min(int(code, 16), DATA_MAX), base), extended)


def _asc_fd_frame(match: re.Match[str], base: int) -> AnyFrame:
    number, extended = _asc_identifier(match, base)
    length, tokens = int(match["length"]), match["rest"].split()
    if length > FD_LENGTHS[-1]:
        raise _asc_error(match, f"length {length}: a CAN FD frame has at most {FD_LENGTHS[-1]} bytes")
    data = _asc_data(match, tokens, length, base)
    rest = tokens[length:]  # duration, length in bits, flags
    try:
        flags = int(rest[2], 16) if len(rest) > 2 else _EDL
    except ValueError:
        flags = _EDL
    if not flags & _EDL and length <= DATA_MAX:
        if flags & 0x10:
            return CanFrame(number, b"", extended, True, min(int(match["code"], 16), DATA_MAX))
        return CanFrame(number, data, extended)
    return FdFrame(number, data, extended, int(match["brs"]) | int(match["esi"]) << 1)


_TRC_EPOCH = 25569.0
"""Days from 1899-12-30 to 1970-01-01."""
_TRC_START = re.compile(r";\s*\$STARTTIME=(\d{1,6}(?:\.\d{1,15})?)\s*$")
_TRC_COLUMNS = re.compile(r";\s*\$COLUMNS=([A-Za-z,]{1,40})\s*$")
_TRC_VERSION = re.compile(r";\s*\$FILEVERSION=[12]\.\d\s*$")
_TRC_OLD = re.compile(
    r"\s*\d{1,9}\)\s+(?P<at>\d{1,12}(?:\.\d{1,6})?)\s+(?:(?P<bus>\d{1,2})\s+)?(?:(?P<direction>Rx|Tx|Warng|Error)\s+)?"
    r"(?P<id>[0-9A-Fa-f]{4}|[0-9A-Fa-f]{8})\s+(?:-\s+)?(?P<length>\d{1,2})(?P<rest>(?:\s.*)?)$",
    re.ASCII,
)
_TRC_FD_TYPES = frozenset({"FD", "FB", "FE", "BI"})
_TRC_OTHER_TYPES = frozenset({"ST", "EC", "EV"})


def is_trc(text: str) -> bool:
    """Return whether a text begins like a trace file.

    >>> is_trc(";$FILEVERSION=2.1"), is_trc("(1.5) can0 705#05")
    (True, False)
    """
    for line in text.splitlines()[:30]:
        if line.startswith(";"):
            if _TRC_VERSION.match(line):
                return True
        elif line.strip():
            return bool(_TRC_OLD.match(line))
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
            if heading := _TRC_START.match(line):
                start = now = (float(heading[1]) - _TRC_EPOCH) * 86400.0
            elif heading := _TRC_COLUMNS.match(line):
                columns = heading[1].replace(",", "")
            continue
        if not line.strip():
            continue
        try:
            row = _trc_row(line, columns)
            if row is None:
                continue
            offset, bus, sent, frame = row
        except DecodeError as error:
            yield unread(now, number, error, line)
            continue
        now = max(now, start + offset)
        yield Recorded(now, bus, frame, number, sent)


def _trc_row(line: str, columns: str) -> tuple[float, str, bool | None, AnyFrame] | None:
    """Return time, bus, direction and frame of a line; None for a line about the state of the bus."""
    if not columns:
        row = _TRC_OLD.match(line)
        if row is None:
            raise text_error("delimiter", line, 0, "not a line of a trace file")
        if row["direction"] in ("Warng", "Error"):
            return None
        sent = None if row["direction"] is None else row["direction"] == "Tx"
        frame = _trc_frame("", row["id"], int(row["length"]), row["rest"].split(), line)
        return float(row["at"]) / 1000, row["bus"] or "", sent, frame
    tokens = line.split(maxsplit=len(columns) - 1)
    if len(tokens) < len(columns) - 1:
        raise text_error("short", line, len(line), f"{len(tokens)} columns, expected {len(columns)}: {columns}")
    fields = dict(zip(columns, tokens))
    kind = fields.get("T", "DT")
    if kind in _TRC_OTHER_TYPES:
        return None
    try:
        offset = float(fields["O"]) / 1000
        length = int(fields.get("L") or fields["l"])
    except (ValueError, KeyError):
        raise text_error("value", line, 0, "the time or the length is not a number") from None
    if not 0 <= offset < 1e12:
        raise text_error("value", line, 0, "the time is out of range")
    frame = _trc_frame(kind, fields.get("I", ""), length, fields.get("D", "").split(), line)
    bus = fields.get("B", "")
    return offset, "" if bus == "-" else bus, {"Rx": False, "Tx": True}.get(fields.get("d", "")), frame


def _trc_frame(kind: str, identifier: str, length: int, tokens: list[str], line: str) -> AnyFrame:
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
        data = bytes(int(token, 16) for token in tokens[:length] if len(token) == 2 or _trc_error(line, token))
    except ValueError:
        raise text_error("character", line, 0, f"{' '.join(tokens[:length])[:24]!r} is not bytes") from None
    if kind in _TRC_FD_TYPES:
        return FdFrame(int(identifier, 16), data, extended)
    return CanFrame.parse(f"{digits}#{data.hex()}")


def _trc_error(line: str, token: str) -> bool:
    raise text_error("character", line, 0, f"{token[:24]!r} is not a byte")


_BUSMASTER_TITLE = re.compile(r"(?m)^\s*[*_]{3,}(?:BUSMASTER Ver|<Time><Tx/Rx><Channel><CAN ID>)")
_BUSMASTER_MODE = re.compile(r"[*_]{3,}(HEX|DEC|(?:RELATIVE|ABSOLUTE|SYSTEM) MODE)[*_]{3,}")
_BUSMASTER_FRAME = re.compile(
    r"(?P<hours>\d{1,4}):(?P<minutes>\d{1,2}):(?P<seconds>\d{1,2}):(?P<part>\d{1,4})\s+(?P<way>Tx|Rx)\s+(?P<bus>\d{1,3})\s+"
    r"(?P<id>(?:0x)?[0-9A-Fa-f]{1,10})\s+(?P<kind>sr?|xr?)\s+(?P<length>\d{1,2})(?P<rest>(?:\s.*)?)$",
    re.ASCII,
)
_BUSMASTER_BASES = {"HEX": 16, "DEC": 10}
_DAY = 86400.0


def is_busmaster(text: str) -> bool:
    """Return whether a text has a title of BUSMASTER.

    >>> is_busmaster("***BUSMASTER Ver 3.2.2***"), is_busmaster("(1.5) can0 705#05")
    (True, False)
    """
    return _BUSMASTER_TITLE.search(text) is not None


def read_busmaster(text: str | Iterable[str]) -> Iterator[RecordedItem]:
    """Yield the frames of a log.

    >>> [str(item.frame) for item in read_busmaster("***DEC***\\n00:00:06:9840 Rx 1 1413 s 2 075 065")]
    ['585#4B41']
    """
    base, is_relative, now, has_title = 16, False, 0.0, False
    for number, line in enumerate(split_lines(text), start=1):
        plain = line.strip()
        row = _BUSMASTER_FRAME.match(plain)
        if row is None:
            has_title = has_title or is_busmaster(plain)
            if mode := _BUSMASTER_MODE.match(plain):
                if mode[1] in _BUSMASTER_BASES:
                    base = _BUSMASTER_BASES[mode[1]]
                else:
                    is_relative = mode[1] == "RELATIVE MODE"
            elif has_title and plain and not plain.startswith(("***", "**_")):
                yield unread(now, number, "not a line of BUSMASTER", line)
            continue
        part = int(row["part"]) / (10_000 if len(row["part"]) == 4 else 1000)
        stamp = int(row["hours"]) * 3600 + int(row["minutes"]) * 60 + int(row["seconds"]) + part
        if is_relative:
            now += stamp
        else:
            now = stamp + _DAY * round(max(0.0, now - stamp) / _DAY)  # at midnight the time of day begins anew
        try:
            yield Recorded(now, row["bus"], _busmaster_frame(row, base), number, row["way"] == "Tx")
        except DecodeError as error:
            yield unread(now, number, error, line)


def _busmaster_frame(row: re.Match[str], base: int) -> AnyFrame:
    line, length, extended = row[0], int(row["length"]), row["kind"].startswith("x")
    tokens = row["rest"].split()[:length]
    try:
        number = int(row["id"], 16 if row["id"].startswith("0x") else base)
        data = bytes(int(token, base) for token in tokens)
    except ValueError:
        raise text_error(
            "character", line, 0, f"{row['id']} {' '.join(tokens)[:24]} are no numbers of base {base}"
        ) from None
    if length > DATA_MAX:
        raise text_error("length", line, 0, f"length {length}: expected 0 to {DATA_MAX}")
    return _flagged_frame(number, extended, "R" if row["kind"].endswith("r") else "", length, data, line)


_CSV_HEAD = "timestamp,arbitration_id,extended,remote,error,dlc,data"
_PRINTED = re.compile(
    r"(?P<logger>.{0,200}?)\bTimestamp:\s+(?P<at>\d{1,12}\.\d{1,9})\s+ID:\s+(?P<id>[0-9a-f]{1,8})\s+(?P<kind>[SX])\s?"
    r"(?P<flags>[A-Za-z ]{0,20}?)\s*DLC?:\s+(?P<length>\d{1,2})(?P<bytes>(?:\s+[0-9a-f]{2}(?![0-9a-z]))*)(?P<rest>.*)$"
)
_PRINTED_CHANNEL = re.compile(r"Channel:\s+(\S+)")
_CSV_ROW = re.compile(
    r"(?P<at>\d{1,12}(?:\.\d{1,9})?),0x(?P<id>[0-9a-fA-F]{1,8}),(?P<extended>[01]),(?P<remote>[01]),(?P<error>[01]),"
    r"(?P<length>\d{1,2}),(?P<data>[A-Za-z0-9+/=]*)"
)


def is_python_can_text(text: str) -> bool:
    """Return whether one of the first lines is of python-can.

    >>> is_python_can_text("timestamp,arbitration_id,extended,remote,error,dlc,data"), is_python_can_text("705#05")
    (True, False)
    """
    return any(line.strip() == _CSV_HEAD or _PRINTED.match(line) for line in text.splitlines()[:20])


def read_python_can_text(text: str | Iterable[str]) -> Iterator[RecordedItem]:
    """Yield the frames of printed lines, or of a CSV file.

    >>> [str(item.frame) for item in read_python_can_text("1.5,0x705,0,0,0,1,BQ==")]
    ['705#05']
    """
    now = 0.0
    for number, line in enumerate(split_lines(text), start=1):
        if not line.strip() or line.strip() == _CSV_HEAD:
            continue
        row = _PRINTED.match(line) or _CSV_ROW.fullmatch(line.strip())
        try:
            if row is None:
                raise text_error("delimiter", line, 0, "not a line of python-can")
            frame = _printed(row, line) if row.re is _PRINTED else _written(row, line)
        except DecodeError as error:
            yield unread(now, number, error, line)
            continue
        now = float(row["at"])
        channel = _PRINTED_CHANNEL.search(row["rest"]) if row.re is _PRINTED else None
        directions = row["logger"] + row["flags"] if row.re is _PRINTED else ""
        sent = "tx" in directions.lower() if re.search("(?i)[rt]x", directions) else None
        yield Recorded(now, channel[1] if channel else "", frame, number, sent)


def _printed(row: re.Match[str], line: str) -> AnyFrame:
    data = bytes.fromhex(row["bytes"])
    flags = row["flags"].replace("Rx", "").replace("Tx", "")
    length = int(row["length"])
    return _flagged_frame(int(row["id"], 16), row["kind"] == "X", flags, length, data, line)


def _written(row: re.Match[str], line: str) -> AnyFrame:
    try:
        data = b64decode(row["data"], validate=True)
    except (Base64Error, ValueError):
        raise text_error("character", line, 0, f"{row['data'][:24]!r} is not base64") from None
    flags = ("R" if row["remote"] == "1" else "") + ("E" if row["error"] == "1" else "")
    length = int(row["length"])
    flags += "F" if length > DATA_MAX else ""
    return _flagged_frame(int(row["id"], 16), row["extended"] == "1", flags, length, data, line)


def _flagged_frame(number: int, extended: bool, flags: str, length: int, data: bytes, line: str) -> AnyFrame:
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


_STEP = 0.001
_NOTED_BUS = "can0"
_NOTES_MAX = 500
"""Lines of a text in which a frame is looked for."""
_PAIRS = r"(?P<data>(?:[0-9A-Fa-f]{2}\b[ \t]{0,3}){0,8})"
_HASHED = re.compile(
    r"(?<![\w/.#-])(?P<id>[0-7][0-9A-Fa-f]{2}|[0-3][0-9A-Fa-f]{7})#(?P<data>(?:[0-9A-Fa-f]{2}\.?){1,8}|(?=\s*$))(?![\w#])",
    re.ASCII,
)
_COLUMNS = re.compile(
    r"(?<![\w.:/-])(?:0[xX])?(?P<id>[0-9A-Fa-f]{3,4}|[0-9A-Fa-f]{8})[hH]?:?[\s|]+(?:[RT]x\s+)?(?:S?D\s+)?"
    r"[\[({]?(?P<length>[0-8])[\])}]?:?[\s|]+" + _PAIRS + r"(?:$|(?![0-9A-Fa-f]{2}\b))"
)
_ID = re.compile(
    r"(?i)(?<![a-z])(?P<of>[a-z]{2,12})?[-_ ]?id(?:entifier)?\b\W{0,3}[:= ]\W{0,3}(?:0x)?(?P<id>[0-9a-f]{1,10})h?\b"
)
_OF_CAN = frozenset(
    {"cob", "can", "arbitration", "msg", "message", "std", "ext", "standard", "extended", "frame", "tx", "rx"}
)
_BYTES_NOTE = re.compile(r"<(?P<id>[0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})>\s+\([0-8]\)\s+b'(?P<data>(?:[0-9A-Fa-f]{2}){0,8})'")
_DLC = re.compile(r"(?i)\b(?:dlc?|len|length|size)\W{0,4}([0-8])\b")
_DATA = re.compile(r"(?i)\b(?:data|payload|bytes)(?:\[[\d. ]{1,6}\])?[\s:=({\[\x22]{1,4}(?=[0-9a-f])")
_NUMBERS = re.compile(r"[\s:=,({\[]*((?:(?:0[xX])?[0-9A-Fa-f]{1,3}\b[\s,;-]{0,3}){1,8}|(?:[0-9A-Fa-f]{2}){1,8}\b)")
_GS_USB = re.compile(
    r"(?i)(?:ffffffff|[0-9a-f]{2}000000)[0-9a-f]{8}0[0-8]0[0-7]0[0-9a-f]00[0-9a-f]{16}(?:[0-9a-f]{8})?"
)
"""A frame of the USB adapters of gs_usb, candleLight: echo, identifier, length, channel, flags, 8 bytes, a time."""
_BARE_NOTE = re.compile(rf"(?P<id>[0-9A-Fa-f]{{3}})(?:#|\s+){_PAIRS}")
_TIMED_NOTE = re.compile(
    rf"\s*\d{{1,10}}\.\d{{1,9}}\s+(?=.*[A-Fa-f]|(?:\S+\s+){{8}}\S+\s*$)(?P<id>[0-7][0-9A-Fa-f]{{2}})\s+{_PAIRS}\s*"
)
"""A time, an identifier and its bytes, which are no decimal numbers: one has a letter, or there are eight."""
_COLONED_NOTE = re.compile(rf".*\b0[xX](?P<id>[0-9A-Fa-f]{{3}}):\s*{_PAIRS}")
_LEAST_ID = 0x80
"""A lower number may be that of a unit or a node."""
_SENT_NOTE = re.compile(r"(?i)\b(?:(tx|sent|send|sending|transmit\w*)|rx|recv|received?)\b")


def is_can_notes(text: str) -> bool:
    """Return whether a frame is in one of the lines, with its length or words that tell, or each line is a bare frame.

    >>> is_can_notes("182#4007\\n202#0600"), is_can_notes("01 03 00 00 00 0A C5 CD")
    (True, False)
    >>> is_can_notes("my log\\n12.5 58C 43 02 65 00"), is_can_notes("12.5 100 3 17 4")
    (True, False)
    """
    lines = [line.strip() for line in text.splitlines()[:_NOTES_MAX] if line.strip()]
    is_bare = bool(lines) and all(map(_BARE_NOTE.fullmatch, lines))
    return is_bare or any(frame for _, _, frame in _noted_frames(lines))


def read_can_notes(text: str | Iterable[str]) -> Iterator[RecordedItem]:
    """Yield the frames, 1 ms apart.

    >>> [str(item.frame) for item in read_can_notes("60B   [2]  40 0A\\nID: 0x67F, data: 0x23, 0x14")]
    ['60B#400A', '67F#2314']
    """
    now = 0.0
    for number, line, frame in _noted_frames(split_lines(text)):
        plain = "" if frame else line.strip()
        if (bare := _BARE_NOTE.fullmatch(plain) or _COLONED_NOTE.fullmatch(plain)) is not None:
            frame = _frame_text(bare["id"], _joined(bare["data"]))
        now += _STEP
        way = _SENT_NOTE.search(line)
        try:
            if not frame:
                raise text_error("delimiter", line, 0, "no frame of CAN in this line")
            yield Recorded(now, _NOTED_BUS, parse_frame(frame), number, None if way is None else way[1] is not None)
        except DecodeError as error:
            yield unread(now, number, error, line)


def _noted_frames(lines: Iterable[str]) -> Iterator[tuple[int, str, str]]:
    """Yield each line that is not empty with its number, and its frame; a title with an identifier belongs to the line
    behind it."""
    title = ""
    for number, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        frame_match = _HASHED.search(line) if "#" in line else None
        usb = _GS_USB.fullmatch(line.replace(" ", "").strip())
        if frame_match is None and (columns := _COLUMNS.search(line)) is not None:
            frame_match = columns if 2 * int(columns["length"]) == len(_joined(columns["data"])) else None
        frame_match = frame_match or _TIMED_NOTE.fullmatch(line) or _BYTES_NOTE.search(line)
        frame = "" if frame_match is None else _frame_text(frame_match["id"], _joined(frame_match["data"]))
        frame = frame if usb is None else _of_usb(bytes.fromhex(usb[0]))
        named = _ID.search(title + line) if not frame else None
        title = ""
        if named is not None and (named["of"] or "can").lower() in _OF_CAN:
            rest = named.string[named.end() :]
            frame = _worded(named["id"], rest, is_json='":' in named[0])
            title = "" if rest.strip(" .)]`") else f"{line} "
        if not title:
            yield number, line, frame


def _of_usb(data: bytes) -> str:
    """Return the frame in one of gs_usb: a number of 4 bytes for the echo, identifier with its flags, length, channel.

    >>> _of_usb(bytes.fromhex("ffffffff 0c000020 08 00 00 00 000c080000000000"))
    '2000000C#000c080000000000'
    """
    number, length = int.from_bytes(data[4:8], "little"), data[8]
    identifier = number & EXTENDED_MAX | number & 0x2000_0000  # the flag of an error frame
    is_long = number != identifier or identifier > BASE_MAX
    text = f"{identifier:0{8 if is_long else 3}X}"
    return f"{text}#R{length}" if number & 0x4000_0000 else f"{text}#{data[12 : 12 + length].hex()}"


def _worded(identifier: str, rest: str, *, is_json: bool) -> str:
    """Return the frame of an identifier and the words behind it; empty without bytes, or with more or fewer."""
    length, data = _DLC.search(rest), _DATA.search(rest)
    start = data or length
    numbers = None if start is None else _NUMBERS.match(rest, start.end())
    tokens = re.findall(r"(?:0[xX])?([0-9A-Fa-f]+)", numbers[1]) if numbers is not None else []
    is_decimal = is_json or (identifier.isdecimal() and int(identifier) <= BASE_MAX < int(identifier, 16))
    if is_decimal or any(len(token) == 3 for token in tokens):
        tokens = [f"{int(token):02X}" for token in tokens if token.isdecimal() and int(token) <= 0xFF]
    joined = "".join(token.rjust(2, "0") for token in tokens)
    number = int(identifier, 10 if is_decimal and identifier.isdecimal() else 16)
    if not joined or number < _LEAST_ID or (length is not None and 2 * int(length[1]) != len(joined)):
        return ""
    return _frame_text(f"{number:03X}", joined)


def _frame_text(identifier: str, data: str) -> str:
    number = int(identifier, 16)
    is_base = number <= BASE_MAX and len(identifier) < 8
    return f"{number:0{3 if is_base else 8}X}#{data}"


def _joined(digits: str) -> str:
    return re.sub(r"[^0-9A-Fa-f]", "", digits)


_CONFORMANCE = re.compile(r"Test CAN\s*:\s*(?P<text>.*)$")
_CONFORMANCE_FRAME = re.compile(
    r"(?P<bus>\S+)\s+(?P<id>[0-9A-Fa-f]{1,8})\s+(?P<way>Tx|Rx)\s+(?P<kind>[SE][DR])\s+(?P<length>\d{1,2})(?P<data>.*)$"
)


def is_conformance_log(text: str) -> bool:
    """Return whether one of the lines is a frame in the form of this log.

    >>> is_conformance_log("Test CAN : CAN1  704 Rx SD  1  00"), is_conformance_log("(1.5) can0 705#05")
    (True, False)
    """
    return any(
        (match := _CONFORMANCE.match(line)) and _CONFORMANCE_FRAME.match(match["text"]) for line in text.splitlines()
    )


def read_conformance_log(text: str | Iterable[str]) -> Iterator[RecordedItem]:
    """Yield the frames of a log.

    >>> [(str(item.frame), item.sent) for item in read_conformance_log("Test CAN : CAN1  000 Tx SD  2  81 04")]
    [('000#8104', True)]
    """
    now = 0.0
    for number, line in enumerate(split_lines(text), start=1):
        step = _CONFORMANCE.match(line)
        if step is None:
            continue
        now += _STEP
        match = _CONFORMANCE_FRAME.match(step["text"])
        frame = None if match is None else _conformance_frame(match)
        if match is None or frame is None:
            text = "expected bus, identifier, Tx or Rx, SD (SR, ED, ER), length and as many bytes"
            yield unread(now, number, text, line)
        else:
            yield Recorded(now, match["bus"], frame, number, match["way"] == "Tx")


def _conformance_frame(match: re.Match[str]) -> CanFrame | None:
    """Return the frame of a line; None if a part of it is impossible."""
    extended, remote = match["kind"][0] == "E", match["kind"][1] == "R"
    identifier, length, digits = int(match["id"], 16), int(match["length"]), match["data"].split()
    if identifier > (EXTENDED_MAX if extended else BASE_MAX) or length > DATA_MAX:
        return None
    if remote:
        return CanFrame(identifier, b"", extended, True, length)
    if len(digits) < length or any(len(pair) != 2 for pair in digits[:length]):
        return None
    try:
        return CanFrame(identifier, bytes.fromhex(" ".join(digits[:length])), extended)
    except ValueError:
        return None
