"""The one place where the form of a recording of Modbus is recognised: `read_modbus_log`.

Each form reads the lines that it knows. The lines of a form with words of its own (pymodbus, libmodbus ...) belong to
it; where two of these read different bytes in one line, nothing is guessed: that is an error. The remaining lines with
a direction are read by `marked`, those with a time and bytes only by `bytelog`. What is left becomes an `Unread`, or,
in a log of bytes only, an error with its line.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Container

from barewire.errors import DecodeError
from barewire_workbench.frames.result import ProtocolName
from barewire_workbench.recordings.bytelog import Chunk, parse_log
from barewire_workbench.recordings.modbus_log.blocks import read_blocks
from barewire_workbench.recordings.modbus_log.bytewise import read_bytewise
from barewire_workbench.recordings.modbus_log.direction import (
    common_protocol,
    frame_pdu,
    recorder_is_client,
    with_one_notation,
    with_transactions,
)
from barewire_workbench.recordings.modbus_log.libmodbus import read_libmodbus
from barewire_workbench.recordings.modbus_log.marked import read_marked
from barewire_workbench.recordings.modbus_log.minimalmodbus import read_minimalmodbus
from barewire_workbench.recordings.modbus_log.model import FormContent, LogEntry, LoggedBytes, ModbusLog, Stamp
from barewire_workbench.recordings.modbus_log.octets import split_octets
from barewire_workbench.recordings.modbus_log.pymodbus import read_pymodbus
from barewire_workbench.recordings.modbus_log.segments import read_segments
from barewire_workbench.recordings.modbus_log.stamps import LogClock, find_stamp
from barewire_workbench.recordings.modbus_log.syscalls import read_syscalls
from barewire_workbench.recordings.modbus_log.tables import read_csv, read_json
from barewire_workbench.recordings.modbus_log.wireshark import read_wireshark, without_bytes
from barewire_workbench.recordings.modbus_packets import MODBUS_PORTS
from barewire_workbench.recordings.model import Unread, unread
from barewire_workbench.recordings.pcapng import is_capture

_OF_PACKETS: dict[str, Callable[[list[str], Container[int]], FormContent]] = {
    "JSON": read_json,
    "CSV": read_csv,
    "Wireshark": read_wireshark,
}
"""Exports of packets: which of them are Modbus depends on the ports."""
FORMS: dict[str, Callable[[list[str]], FormContent]] = {
    "pymodbus": read_pymodbus,
    "libmodbus": read_libmodbus,
    "MinimalModbus": read_minimalmodbus,
    "strace": read_syscalls,
    "bytes with characters": read_bytewise,
}
"""Forms with words of their own. Two of them that differ about a line are an error."""
_LONGEST_LINE = 20_000
_GENERAL: dict[str, Callable[[list[str]], FormContent]] = {"blocks": read_blocks, "marked": read_marked}
"""Forms of many programs, for the lines that no other form knows."""
_SHORTEST = 4
"""Bytes of the shortest frame."""
_LINES_MAX = 20
"""The most lines of one frame."""
_LOOKS_LIKE_BYTES = re.compile(
    r"(?:\b(?:0[xX])?[0-9A-Fa-f]{2}\b[\s,;|:-]?){4}|(?:\b0[xX][0-9A-Fa-f]{1,2}\b[\s,;|:-]?){2}"
)
_FRAME = re.compile(r"FRAME=[^;]*")
"""The field of a frame in `DATE=...;FRAME=01-03-...;SLAVE=1;`, as monitors write it."""
_COLOURS = re.compile(r"\x1b\[[0-9;]{0,20}[mK]")
"""What sets the colours of a terminal."""
_TIME_OF_DAY = re.compile(r"\s*[(\[]?\d{1,2}:\d{2}:\d")
"""Hours, minutes and seconds, as `bytelog` reads them: they begin again at midnight."""
_BLANKS_MAX = 200
_BLANKS = re.compile(rf"\s{{{_BLANKS_MAX},}}")
"""More blanks than any column has."""


def read_modbus_log(
    data: bytes, *, ports: Container[int] = MODBUS_PORTS, protocol: ProtocolName | None = None
) -> ModbusLog:
    """Read a recording of Modbus in any form: a capture, a log, a dump.

    >>> log = read_modbus_log(b"send: 0x1 0x3 0x0 0x0 0x0 0x2 0xc4 0xb\\nrecv: 0x1 0x83 0x2 0xc0 0xf1\\n")
    >>> log.form, [(item.line, item.from_client, item.protocol) for item in log.items]
    ('pymodbus', [(1, True, 'rtu'), (2, False, 'rtu')])

    `protocol` is that of the bytes of a log; by default its frames tell. Raises DecodeError, with the number of the
    line, if the bytes are no recording.
    """
    if is_capture(data):
        return ModbusLog(tuple(read_segments(data, ports)), "capture", True)
    text = _COLOURS.sub("", _text(data))
    lines = [("" if line.lstrip().startswith("#") else line) for line in text.splitlines()]
    form, content = _read_forms(lines, ports)
    if not content.entries and (why := without_bytes(lines)) is not None:
        raise DecodeError("value", b"", 0, why)
    if not content.entries:
        return _bytes_only(text, lines, protocol)
    return _decided(form, content, lines, protocol)


def _text(data: bytes) -> str:
    """Return the text of a log: UTF-8, UTF-16 with its mark (PowerShell), or Latin-1 if nearly all of it is ASCII."""
    try:
        if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
            return data.decode("utf-16")
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if 0 not in data and sum(byte < 0x80 for byte in data) > 0.7 * len(data):
            return data.decode("latin-1")
        raise DecodeError("character", data[:16], 0, f"neither a capture nor text: {error.reason}") from None


def _read_forms(lines: list[str], ports: Container[int]) -> tuple[str, FormContent]:
    """Return the names and the common content of all forms that the lines have."""
    short = [_BLANKS.sub(" " * _BLANKS_MAX, line) if len(line) <= _LONGEST_LINE else "" for line in lines]
    by_place: dict[tuple[int, int], LogEntry] = {}
    owners: dict[int, str] = {}
    known: set[int] = set()
    unreadable: set[int] = set()
    notes: list[str] = []
    contents = [(name, read_packets(lines, ports)) for name, read_packets in _OF_PACKETS.items()]
    contents += [(name, read(short)) for name, read in FORMS.items()]
    for name, content in contents:
        for place, entry in enumerate(content.entries):
            owner = owners.setdefault(entry.line, name)
            if owner == name:
                by_place[entry.line, place] = entry
            elif not _same(by_place, entry):
                text = f"line {entry.line} reads as {owner} and as {name}, with different bytes"
                raise DecodeError("value", b"", 0, text)
        known |= content.known if content.entries else set()
        unreadable |= content.unreadable
        notes += content.notes
    for name, read in _GENERAL.items():
        content = read(
            ["" if number in known or number in unreadable else line for number, line in enumerate(short, start=1)]
        )
        for place, entry in enumerate(content.entries):
            by_place[entry.line, place] = entry
            owners[entry.line] = name
        known |= content.known if content.entries else set()
        notes += content.notes
    names = [name for name in (*_OF_PACKETS, *FORMS, *_GENERAL) if name in owners.values()]
    return " and ".join(names), FormContent(
        [by_place[place] for place in sorted(by_place)], known, tuple(notes), unreadable
    )


def _same(found: dict[tuple[int, int], LogEntry], entry: LogEntry) -> bool:
    return any(line == entry.line and other.data == entry.data for (line, _), other in found.items())


def _decided(form: str, content: FormContent, lines: list[str], protocol: ProtocolName | None) -> ModbusLog:
    """Return the log with everything decided that its frames prove."""
    entries, left = list(content.entries), []
    taken = {entry.line for entry in entries} | content.known
    for number, line in enumerate(lines, start=1):
        if number in content.unreadable:
            left.append(number)
            continue
        if number in taken or not line.strip():
            continue
        stamp = find_stamp(line)
        octets = split_octets(line if stamp is None else line[stamp[2] :])
        if octets is not None and not octets.before.strip(" \t:,;|-"):
            entries.append(LogEntry(number, octets.data, None, None, stamp and stamp[0], octets.decimal))
        else:
            left.append(number)
    entries.sort(key=lambda entry: entry.line)
    log = assembled(form, entries, [(number, lines[number - 1]) for number in left], protocol)
    return log._replace(notes=content.notes + log.notes)


def assembled(
    form: str, entries: list[LogEntry], left: list[tuple[int, str]], protocol: ProtocolName | None = None
) -> ModbusLog:
    """Return the log of these entries; `left` are the lines that no form knows.

    Raises DecodeError if no frame is in it and more lines are left than read: that is no log of Modbus.
    """
    entries = with_one_notation(entries)
    pieces = [entry.data for entry in entries if entry.data]
    found = common_protocol(pieces)
    if found is None and len(left) > len(entries):
        number, line = left[0]
        shown = unread(0.0, number, "", line).text
        raise DecodeError("value", b"", 0, f"line {number}: no form of log has such a line: {shown}")
    protocol = protocol or found
    client = recorder_is_client(entries, protocol)
    clock, before = LogClock(), None
    if first := next((entry for entry in entries if entry.stamp is not None), None):
        clock.read(first.stamp, first.line)  # what stands before the first time is not earlier than the made-up 0
    items: list[LoggedBytes | Unread] = []
    waiting = list(left)
    for entry in entries:
        while waiting and waiting[0][0] < entry.line:
            items.append(_left(items, *waiting.pop(0)))
        from_client = entry.from_client
        if from_client is None and entry.sent is not None and client is not None:
            from_client = entry.sent is client
        is_more = before is not None and before.sent is False and entry.sent is False
        at = clock.read(entry.stamp, entry.line, step=not is_more)
        items.append(LoggedBytes(at, entry.data or b"", entry.line, from_client, protocol, entry.connection))
        before = entry
    items += [_left(items, *row) for row in waiting]
    if protocol == "tcp":
        items = with_transactions(items)
    return ModbusLog(tuple(items), form, clock.timed, tuple(clock.notes))


def _left(items: list[LoggedBytes | Unread], number: int, line: str) -> Unread:
    has_bytes = _LOOKS_LIKE_BYTES.search(line, 0, _LONGEST_LINE) is not None
    why = "the bytes in this line cannot be read" if has_bytes else "no bytes of a frame in this line"
    return unread(items[-1].at if items else 0.0, number, why, line)


def _bytes_only(text: str, lines: list[str], protocol: ProtocolName | None) -> ModbusLog:
    """Read a log of bytes with or without times or prefixes, or a dump."""
    try:
        log = parse_log(text)
    except DecodeError:
        if (prefixed := _prefixed(lines, protocol)) is None:
            raise
        return prefixed
    chunks, numbers = ([*log.chunks], [*log.lines]) if log.timed else _unwrapped(log.chunks, log.lines)
    found = protocol or common_protocol([chunk.data for chunk in chunks])
    clock, items = LogClock(), list[LoggedBytes | Unread]()
    for chunk, line in zip(chunks, numbers):
        of_day = _TIME_OF_DAY.match(lines[line - 1]) is not None
        at = clock.read(Stamp(chunk.at, None, of_day), line) if log.timed else chunk.at
        items.append(LoggedBytes(at, chunk.data, line, None, found))
    return ModbusLog(tuple(with_transactions(items)), "bytes", log.timed, tuple(clock.notes))


def _prefixed(lines: list[str], protocol: ProtocolName | None) -> ModbusLog | None:
    """Read lines that end with bytes, behind any text: `COM3: 01 03 ...`, `FRAME=01-03-...`. None unless frames prove
    it, or if some lines have a text and others do not, as a typing error in a log of bytes makes it."""
    entries: list[LogEntry] = []
    left: list[tuple[int, str]] = []
    prefixes: set[bool] = set()
    for number, line in enumerate(lines, start=1):
        stamp = find_stamp(line)
        plain = line if stamp is None else line[: stamp[1]] + " " * (stamp[2] - stamp[1]) + line[stamp[2] :]
        field = _FRAME.search(plain)
        octets = split_octets(plain[: field.end()] if field else plain)
        if octets is not None and len(octets.data or octets.decimal or b"") >= _SHORTEST:
            entries.append(LogEntry(number, octets.data, None, None, stamp and stamp[0], octets.decimal))
            prefixes.add(bool(octets.before.strip(" \t:,;|-[]()")))
        elif line.strip():
            left.append((number, line))
    pieces = [piece for entry in entries for piece in (entry.data, entry.decimal) if piece]
    if len(prefixes) != 1 or len(left) > len(entries) or common_protocol(pieces) is None:
        return None
    return assembled("bytes", entries, left, protocol)


def _unwrapped(chunks: list[Chunk], numbers: list[int]) -> tuple[list[Chunk], list[int]]:
    """Join lines that are one frame together, and none apart: a CRC or a length in the header proves it."""
    joined: list[Chunk] = []
    lines: list[int] = []
    place = 0
    while place < len(chunks):
        size = 1
        data = chunks[place].data
        if not _is_frame(data):
            for more in range(2, _LINES_MAX + 1):
                if place + more > len(chunks) or _is_frame(chunks[place + more - 1].data):
                    break
                data += chunks[place + more - 1].data
                if _is_frame(data):
                    size = more
                    break
        joined.append(Chunk(chunks[place].at, b"".join(chunk.data for chunk in chunks[place : place + size])))
        lines.append(numbers[place])
        place += size
    return joined, lines


def _is_frame(data: bytes) -> bool:
    return any(frame_pdu(protocol, data) is not None for protocol in ("rtu", "tcp"))
