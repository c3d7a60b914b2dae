"""The one place where the form of a recording of Modbus is recognised: `read_modbus_log`.

A capture has TCP segments, which are put in order, and RTU frames in datagrams. Of a text, each form reads its own
lines. The lines of a form with words of its own (pymodbus, libmodbus ...) belong to it; where two of these read
different bytes in one line, nothing is guessed: that is an error. The remaining lines with a direction are read by
`marked`, those with a time and bytes only by `parse_log`. What is left becomes an `Unread`, or, in a log of bytes only,
an error with its line.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Callable, Container, Iterable, Iterator
from itertools import chain, islice, zip_longest
from math import inf

from barewire.errors import DecodeError
from barewire.modbus.messages.registry import decode_request, decode_response
from barewire_workbench.frames.input import dump_line
from barewire_workbench.frames.result import ProtocolName, counted
from barewire_workbench.recordings.capture import (
    MODBUS_PORTS,
    ConnectionKey,
    Packet,
    is_can_packet,
    is_capture,
    modbus_payload,
    read_packets,
)
from barewire_workbench.recordings.modbus_log.envelope import ENVELOPE_START, opened
from barewire_workbench.recordings.modbus_log.exports import read_csv, read_json, read_wireshark, without_bytes
from barewire_workbench.recordings.modbus_log.marked import (
    PROTOCOLS,
    common_protocol,
    frame_pdu,
    has_direction,
    is_decimal,
    is_without_crc,
    read_blocks,
    read_marked,
    recorder_is_client,
    with_crc,
    with_transactions,
)
from barewire_workbench.recordings.modbus_log.model import FormContent, LogEntry, LoggedBytes, ModbusLog, Stamp
from barewire_workbench.recordings.modbus_log.octets import (
    DUMP_OFFSET,
    Chunk,
    Log,
    LogClock,
    find_stamp,
    parse_log,
    split_octets,
    without_stamp,
)
from barewire_workbench.recordings.modbus_log.posted import (
    IN_PART,
    PROSE,
    Posted,
    read_posted,
    whole_frames,
    without_markup,
)
from barewire_workbench.recordings.modbus_log.programs import (
    read_bytewise,
    read_libmodbus,
    read_minimalmodbus,
    read_pymodbus,
    read_syscalls,
)
from barewire_workbench.recordings.model import LeftOut, Unread, unread, without_colours
from barewire_workbench.recordings.source import RecordingSource
from barewire_workbench.sniffer import readable, shapes

_EARLY_SEGMENTS = 64
"""The most segments that wait for a missing one before it is skipped."""
_DIRECTIONS = 4096
"""The most directions of connections whose order is known: of the others the next segment is the first."""


class _Reassembly:
    """One direction of a TCP connection: puts the segments in order and drops repeated bytes."""

    def __init__(self) -> None:
        self._next: int | None = None
        self._early: dict[int, bytes] = {}

    def put(self, sequence: int, data: bytes) -> bytes:
        """Take a segment; return the bytes that now continue the stream."""
        if self._next is None:
            self._next = sequence
        self._early[sequence] = max(self._early.get(sequence, b""), data, key=len)
        if len(self._early) > _EARLY_SEGMENTS:  # the next one was not captured: skip it
            expected = self._next
            self._next = min(self._early, key=lambda start: start - expected & 0xFFFFFFFF)
        complete = b""
        while (following := self._take_at(self._next)) is not None:
            complete += following
            self._next = self._next + len(following) & 0xFFFFFFFF
        return complete

    def _take_at(self, position: int) -> bytes | None:
        """Return the bytes at this sequence number and drop segments before it; sequence numbers wrap at 32 bits."""
        for start in list(self._early):
            known = position - start & 0xFFFFFFFF
            if known < 0x80000000:
                new = self._early.pop(start)[known:]
                if new:
                    return new
        return None


def read_segments(
    packets: Iterable[tuple[int, Packet | DecodeError]], ports: Container[int]
) -> Iterator[LoggedBytes | Unread]:
    """Yield the Modbus bytes of a capture; `line` is the number of the packet. The place where it is damaged is the
    last item. Raises DecodeError if nothing is before it."""
    reassemblies: dict[tuple[ConnectionKey, bool], _Reassembly] = {}
    at: float | None = None
    left_out = LeftOut("Modbus")
    for number, packet in packets:
        if isinstance(packet, DecodeError):
            if at is None:
                raise packet
            yield unread(at, number, packet, "")
            break
        payload = modbus_payload(packet, ports)
        if payload is None:
            is_can = is_can_packet(packet)
            left_out.of_other_bus += is_can
            left_out.neither += not is_can
            continue
        piece, name = payload.data, _connection_text(payload.connection)
        if payload.sequence is not None:
            direction = payload.connection, payload.from_client
            known = reassemblies.pop(direction, None)
            segments = reassemblies[direction] = known or _Reassembly()
            if len(reassemblies) > _DIRECTIONS:
                del reassemblies[next(iter(reassemblies))]
            piece = segments.put(payload.sequence, payload.data)
        if piece:
            at = payload.at
            yield LoggedBytes(at, piece, number, payload.from_client, payload.protocol, name)
    yield from left_out.items(at or 0.0)


def is_can_capture(source: RecordingSource, ports: Container[int] = MODBUS_PORTS) -> bool:
    """Return whether the first packet of CAN or of Modbus is one of CAN. Those before it, which are neither, are passed
    over, so that they need not be kept."""
    for found in source.packets:
        packet = found[1]
        is_can = isinstance(packet, Packet) and is_can_packet(packet)
        if is_can or isinstance(packet, DecodeError) or modbus_payload(packet, ports) is not None:
            source.packets = chain([found], source.packets)
            return is_can
    return False


def _connection_text(connection: ConnectionKey) -> str:
    client, client_port, server, port = connection
    return f"{_address_text(client)}:{client_port} {_address_text(server)}:{port}"


def _address_text(address: bytes) -> str:
    if len(address) == 4:
        return ".".join(map(str, address))
    return f"[{':'.join(f'{address[at]:x}{address[at + 1]:02x}' for at in range(0, 16, 2))}]"


_OF_PACKETS: dict[str, Callable[[list[str], Container[int]], FormContent]] = {
    "JSON": read_json,
    "CSV": read_csv,
    "Wireshark": read_wireshark,
}
"""Exports of packets: which of them are Modbus depends on the ports."""
FORMS: dict[str, Callable[[list[str], object], FormContent]] = {
    "pymodbus": read_pymodbus,
    "libmodbus": read_libmodbus,
    "MinimalModbus": lambda lines, _: read_minimalmodbus(lines),
    "strace": read_syscalls,
    "bytes with characters": lambda lines, _: read_bytewise(lines),
}
"""Forms with words of their own. Two of them that differ about a line are an error."""
_BY_LINES = frozenset({"pymodbus", "libmodbus", "MinimalModbus", "strace", "marked"})
"""Forms in which a line has whole entries, so that a part of the log can be read before the rest is there."""
_OF_ANY_PROGRAM = frozenset({"marked", "blocks", "bytes"})
"""Forms without words of their own: a text in sentences may look like one."""
_UNDECIDED_MAX = 4_000_000
"""Characters of a text without a form; more of them are no log."""
_DUMP_WHOLE = 0x4_0000
"""Characters of a dump that is one piece; a longer one is read in parts."""
_POSTED_MAX, _POSTED_SHOWN = 0xF000, 5
"""Characters of the longest text in which bytes are looked for between words; the notes that say why they are bytes."""
_DIFFERENT = "with different bytes"
"""How two forms read one line of which nothing is guessed."""
_LOG = 2
"""So many entries with frames are a log, and no text with frames in sentences."""
_LONGEST_LINE = 20_000
"""Characters; no form looks into a longer line."""
_GENERAL: dict[str, Callable[[list[str]], FormContent]] = {"blocks": read_blocks, "marked": read_marked}
"""Forms of many programs, for the lines that no other form has read."""
_SHORTEST = 4
"""Bytes of the shortest frame."""
_AT_ONCE = 0.005
"""Seconds in which no program sends or receives the same frame again."""
_LINES_MAX = 20
"""The most lines of one frame."""
UNREADABLE = "the bytes in this line cannot be read"
"""Why a line is unread that looks as if it held bytes of a frame."""
_SILENT = re.compile(
    r"(?i)(?<!\bthe )\btime[ds]?[ -]?out(?!\w| ?(?:setting|to |of |[=:(]*\s*\d))|"
    r"\bno (?:\w+ ){0,2}(?:response|answer|reply)\b|"
    r"(?:received|got|read) 0\b|\b0 (?:bytes )?(?:received|read)\b|(?:not|n't) (?:respond|answer)|TimedOut|ETIMEDOUT|"
    r"stop waiting for|TimeoutE|nothing (?:was )?received"
)
"""What a program says that waited in vain."""
_LOOKS_LIKE_BYTES = re.compile(
    r"(?:\b(?:0[xX])?[0-9A-Fa-f]{2}\b[\s,;|:-]?){4}|(?:\b0[xX][0-9A-Fa-f]{1,2}\b[\s,;|:-]?){2}"
)
_FRAME = re.compile(r"FRAME=[^;]*")
"""The field of a frame in `DATE=...;FRAME=01-03-...;SLAVE=1;`, as monitors write it."""
_TIME_OF_DAY = re.compile(r"\s*[(\[]?\d{1,2}:\d{2}:\d")
"""Hours, minutes and seconds, as `parse_log` reads them: they begin again at midnight."""
_HALF = re.compile(r"\b((?:[0-9A-Fa-f]{2} ){3,})([0-9A-Fa-f])\s*$")
"""Bytes of two digits each, and one digit behind them."""
_TOLD_MAX, _EXCEPTION = 2000, (5, 9)
"""Lines of a text in which an answer may be told, and the bytes of an exception of RTU and of TCP."""
_HALF_MAX = 1000
"""Characters at the end of a text in which they are looked for."""
_ASCII = bytes(range(0x80))
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
        return ModbusLog(tuple(read_segments(enumerate(read_packets(data), start=1), ports)), "capture", True)
    parts = RecordingSource.of(data).text_parts(_decode)
    return _LogReader(ports, protocol).read_rest(_without_half([_plain(line) for lines in parts for line in lines]))


def read_modbus_parts(
    source: RecordingSource, *, ports: Container[int] = MODBUS_PORTS, protocol: ProtocolName | None = None
) -> Iterator[ModbusLog]:
    """Yield a recording part by part, each as soon as it is there, if its form allows that: one whose entries have
    several lines is one part. What the first part shows is decided for the others. As `read_modbus_log`.
    """
    if is_capture(source.start):
        is_empty = True
        for item in read_segments(source.packets, ports):
            is_empty = False
            yield ModbusLog((item,), "capture", True)
        if is_empty:
            yield ModbusLog((), "capture", True)
        return
    reader, waiting, tried = _LogReader(ports, protocol), list[str](), 0
    for lines in source.text_parts(_decode):
        waiting += [_plain(line) for line in lines]
        size = sum(map(len, waiting)) if reader.form is None else 0
        if reader.form is not None or (size >= 2 * tried and size >= reader.least):
            tried = size
            log, waiting = reader.read_part(waiting)
            if log is not None:
                yield log
    if waiting or reader.form is None:
        yield reader.read_rest(_without_half(waiting))


def _plain(line: str) -> str:
    """Return a line without colours, and without the text of a comment."""
    line = without_colours(line)
    return "" if line.lstrip().startswith("#") else line


def _decode(data: bytes) -> str:
    """Return the text of a log that is not in UTF-8 or UTF-16: Latin-1 if nearly all of it is ASCII."""
    if 0 not in data and len(data.translate(None, _ASCII)) < 0.3 * len(data):
        return data.decode("latin-1")
    raise DecodeError("character", data[:16], 0, "neither a capture nor text: these are not its characters")


class _LogReader:
    """Reads a log part by part. `form` is None until a part has shown it; with less than `least` characters this form
    cannot be read in parts."""

    def __init__(self, ports: Container[int], protocol: ProtocolName | None) -> None:
        self.form: str | None = None
        self.least = 0.0
        self._ports = ports
        self._protocol = protocol
        self._offset = 0  # lines of the parts before
        self._states: dict[str, object] | None = None  # what the forms have decided, once they are known
        self._is_decimal: bool | None = None
        self._client: bool | None = None
        self._clock = LogClock()
        self._before: LogEntry | None = None
        self._now = 0.0
        self._open_numbers: set[bytes] = set()
        self._bytes: Log | None = None  # the part before, of a log of bytes only
        self._is_prefixed = False
        self._is_text = False  # marks were taken out, or bytes found between words: that is for the whole text

    def read_part(self, lines: list[str]) -> tuple[ModbusLog | None, list[str]]:
        """Return what the lines hold, and the lines to read again with the next ones: all of them as long as the form
        is not known, otherwise those of an entry that may go on."""
        if self.form is None:
            size = sum(map(len, lines))
            is_long = size > _UNDECIDED_MAX
            try:
                trial = _LogReader(self._ports, self._protocol)
                log = trial.read_rest(lines)
            except DecodeError:
                if is_long:
                    raise
                return None, lines
            pieces = [item.data for item in log.items if isinstance(item, LoggedBytes)]
            is_dump = log.form == "bytes" and any(map(DUMP_OFFSET.match, lines))
            if common_protocol(pieces) is None and not is_long and not is_dump:
                return None, lines
            if is_dump or trial._is_text or not _is_by_lines(log.form, lines):
                self.least = _DUMP_WHOLE if is_dump else inf
            if size < self.least:
                return None, lines
        size = len(lines) - self._unfinished(lines)
        return (self.read_rest(lines[:size]) if size else None), lines[size:]

    def _unfinished(self, lines: list[str]) -> int:
        """Return the number of lines at the end that may be a part of a frame: bytes that are no whole frame."""
        for number, line in enumerate(reversed(lines[-_LINES_MAX:]), start=1):
            octets = split_octets(line) if len(line) <= _LONGEST_LINE else None
            if octets is None:
                return 0
            if any(frame_pdu(name, data) is not None for name in PROTOCOLS for data in octets[1:] if data):
                return number - 1
            if octets.before.strip():
                return number
        return 0

    def read_rest(self, lines: list[str]) -> ModbusLog:
        """Return what the lines hold: the last ones of the log, or all of them. A short text that is no log of frames
        may be one with marks of Markdown, or have frames within sentences: the reading with most frames counts."""
        if self.form is not None or sum(map(len, lines)) > _POSTED_MAX:
            return self._read(lines)
        log: ModbusLog | None = None
        try:
            log = self._read(lines)
        except DecodeError as error:
            if _DIFFERENT in error.text:
                raise
            refused = error
        plain = [without_markup(line) for line in lines]
        if log is not None and plain == lines:
            whole = (item for item in log.items if isinstance(item, LoggedBytes) and _is_whole(item))
            is_log = len(list(islice(whole, _LOG))) == _LOG or not _OF_ANY_PROGRAM.issuperset(log.form.split(" and "))
            if is_log and not any(isinstance(item, Unread) for item in log.items):
                self.form = log.form
                return log
        found = max((log, self._unmarked(plain)), key=_framed)
        if found is None or _OF_ANY_PROGRAM.issuperset(found.form.split(" and ")):
            found = _with_more_frames(found, self._posted(plain))
        if found is None:
            raise refused
        self.form, self._is_text = found.form, found is not log
        return found

    def _unmarked(self, plain: list[str]) -> ModbusLog | None:
        try:
            return _LogReader(self._ports, self._protocol)._read(plain)
        except DecodeError:
            return None

    def _posted(self, lines: list[str]) -> ModbusLog | None:
        found = [posted for posted in read_posted(lines) if posted.why != IN_PART]
        found = [this for before, this in zip([None, *found], found) if before is None or not _is_quoted(before, this)]
        if not found:
            return None
        taken = {posted.entry.line for posted in found}
        left = [(number, line) for number, line in enumerate(lines, 1) if line.strip() and number not in taken]
        reader = _LogReader(self._ports, self._protocol)
        reader.form = "posted"
        log = reader._assembled("posted", _told_answers([posted.entry for posted in found], lines), left)
        whys = (f"line {posted.entry.line}: read as bytes: {posted.why}" for posted in found[:_POSTED_SHOWN])
        return log._replace(notes=(*whys, *log.notes))

    def _read(self, lines: list[str]) -> ModbusLog:
        """Return what the lines hold, in the form of a log."""
        if self.form == "bytes":
            log = self._bytes_only(lines)
        else:
            form, content = self._read_forms(lines)
            if self.form is None and not content.entries:
                if (why := without_bytes(lines)) is not None:
                    raise DecodeError("value", b"", 0, why)
                log = self._bytes_only(lines)
            else:
                log = self._decided(self.form or form, content, lines)
        self.form = log.form
        self._offset += len(lines)
        return log

    def _read_forms(self, lines: list[str]) -> tuple[str, FormContent]:
        """Return the names and the common content of all forms that the lines have."""
        short = [_bounded(line) for line in lines]
        states, self._states = self._states, {}
        by_place: dict[tuple[int, int], LogEntry] = {}
        owners: dict[int, str] = {}
        known: set[int] = set()
        unreadable: set[int] = set()
        notes: list[tuple[int, str]] = []
        for name, content in self._own_words(lines, short, states):
            for place, entry in enumerate(content.entries):
                owner = owners.setdefault(entry.line, name)
                if owner == name:
                    by_place[entry.line, place] = entry
                elif not _same(by_place, entry):
                    text = f"line {self._offset + entry.line} reads as {owner} and as {name}, {_DIFFERENT}"
                    raise DecodeError("value", b"", 0, text)
            if content.entries or states is not None:
                known |= content.known
                self._states[name] = content.decided
            unreadable |= content.unreadable
            notes += content.notes
        for name, read_general in _GENERAL.items():
            if states is not None and name != "marked":
                continue
            left = [
                "" if number in known or number in unreadable else line for number, line in enumerate(short, start=1)
            ]
            content = read_general(left)
            is_alone = _OF_ANY_PROGRAM.issuperset(owners.values())
            for place, entry in enumerate(content.entries):
                is_short = 0 < len(entry.data or b"") < _SHORTEST
                if is_short and not is_alone and not has_direction(left[entry.line - 1]):
                    continue  # values that are printed beside the bytes of a program with words of its own
                by_place[entry.line, place] = entry
                owners[entry.line] = name
            known |= content.known if content.entries else set()
            notes += content.notes
        names = [name for name in (*_OF_PACKETS, *FORMS, *_GENERAL) if name in owners.values()]
        before = [] if self._before is None else [self._before]
        entries, again = _once([*before, *(by_place[place] for place in sorted(by_place))])
        if again:
            notes.append((again[0].line, f"the bytes of the line before, printed again: {counted(len(again), 'line')}"))
        return " and ".join(names), FormContent(entries[len(before) :], known, tuple(notes), unreadable)

    def _own_words(
        self, lines: list[str], short: list[str], states: dict[str, object] | None
    ) -> Iterator[tuple[str, FormContent]]:
        """Yield what each form with words of its own reads; of a later part only those that the first part has."""
        if states is None:
            for name, read_packets in _OF_PACKETS.items():
                yield name, read_packets(lines, self._ports)
        for name, read in FORMS.items():
            if states is None or name in states:
                yield name, read(short, states and states[name])

    def _decided(self, form: str, content: FormContent, lines: list[str]) -> ModbusLog:
        """Return the log with everything decided that its frames prove."""
        entries, left = list(content.entries), list[int]()
        taken = {entry.line for entry in entries} | content.known
        for number, line in enumerate(lines, start=1):
            if number in content.unreadable:
                left.append(number)
                continue
            if number in taken or not line.strip():
                continue
            octets = None
            if len(line) <= _LONGEST_LINE:
                stamp = find_stamp(line)
                octets = split_octets(line if stamp is None else line[stamp[2] :])
            least = 1 if _OF_ANY_PROGRAM.issuperset(form.split(" and ")) else _SHORTEST  # fewer bytes are values
            is_long = octets is not None and len(octets.data or octets.decimal or b"") >= least
            if octets is not None and is_long and not octets.before.strip(" \t:,;|-"):
                entries.append(LogEntry(number, octets.data, None, None, stamp and stamp[0], octets.decimal))
            elif not _SILENT.search(line, 0, _LONGEST_LINE):
                left.append(number)
        entries.sort(key=lambda entry: entry.line)
        entries = list(self._with_silences(_told_answers(entries, lines), lines))
        log = self._assembled(form, entries, [(number, lines[number - 1]) for number in left])
        notes = tuple(f"line {self._offset + number}: {text}" for number, text in content.notes)
        return log._replace(notes=notes + log.notes)

    def _with_silences(self, entries: list[LogEntry], lines: list[str]) -> Iterator[LogEntry]:
        """Yield the entries, and one without bytes where the program says that it waits for an answer no more.

        If received bytes follow that are no frame, they are a part of that answer: they were printed too late.
        """
        before = [] if self._before is None else [self._before._replace(line=0)]
        for place, (entry, following) in enumerate(zip_longest([*before, *entries], [*before, *entries][1:])):
            is_part = following is not None and _is_part(following)
            if entry.data == b"" and is_part:
                continue
            if place >= len(before):
                yield entry
            if entry.sent is False or entry.from_client is False or is_part:
                continue
            end = len(lines) if following is None else following.line - 1
            for number, line in enumerate(lines[entry.line : end], start=entry.line + 1):
                if len(line) <= _LONGEST_LINE and _SILENT.search(line):
                    stamp = find_stamp(line)
                    yield LogEntry(number, b"", False, None, stamp and stamp[0], b"", entry.connection)
                    break

    def _assembled(self, form: str, entries: list[LogEntry], left: list[tuple[int, str]]) -> ModbusLog:
        """Return the log of these entries; `left` are the lines that no form has read.

        Raises DecodeError if no frame is in it and more lines are left than read: that is no log of Modbus.
        """
        if self._is_decimal is None:
            self._is_decimal = is_decimal(entries)
        if self._is_decimal:
            entries = [entry._replace(data=entry.decimal) for entry in entries]
        entries = [_taken_out(entry) for entry in entries]
        if self._protocol is None:
            self._protocol = common_protocol([entry.data for entry in entries if entry.data])
        added = ""
        if self._protocol is None and entries and all(entry.data and is_without_crc(entry.data) for entry in entries):
            entries = [entry._replace(data=with_crc(entry.data or b"")) for entry in entries]
            self._protocol = "rtu"
            added = f"no frame is printed with a CRC; to read them it is added to {counted(len(entries), 'frame')}"
        protocol = self._protocol
        if self.form is None and protocol is None and len(left) > len(entries):
            number, line = left[0]
            shown = unread(0.0, number, "", line).text
            raise DecodeError("value", b"", 0, f"line {number}: no form of log has such a line: {shown}")
        if self._client is None:
            self._client = recorder_is_client(entries, protocol)
        clock, client, offset = self._clock, self._client, self._offset
        if not clock.timed and (first := next((entry for entry in entries if entry.stamp is not None), None)):
            # what stands before the first time is not earlier than the made-up 0
            clock.read(first.stamp, offset + first.line)
        items: list[LoggedBytes | Unread] = []
        waiting = deque(left)
        before = self._before
        for entry in entries:
            while waiting and waiting[0][0] < entry.line:
                items.append(self._left(*waiting.popleft()))
            from_client = entry.from_client
            if from_client is None and entry.sent is not None and client is not None:
                from_client = entry.sent is client
            is_more = before is not None and (
                before.sent is entry.sent is False or before.from_client is entry.from_client is False
            )
            at = self._now = clock.read(entry.stamp, offset + entry.line, step=not is_more)
            items.append(
                LoggedBytes(
                    at, entry.data or b"", offset + entry.line, from_client, protocol, entry.connection, entry.envelope
                )
            )
            before = entry
        self._before = before
        items += [self._left(*row) for row in waiting]
        if protocol == "tcp":
            items = with_transactions(items, self._open_numbers)
        return ModbusLog(tuple(items), form, clock.timed, (*filter(None, [added]), *self._new_notes()))

    def _new_notes(self) -> tuple[str, ...]:
        notes, self._clock.notes = self._clock.notes, []
        return tuple(notes)

    def _left(self, number: int, line: str) -> Unread:
        is_short = len(line) <= _LONGEST_LINE
        has_bytes = is_short and _LOOKS_LIKE_BYTES.search(without_stamp(without_stamp(line)[0])[0]) is not None
        why = UNREADABLE if has_bytes else "no bytes of a frame in this line"
        if not is_short:
            why = f"a line of more than {_LONGEST_LINE:,} characters"
        return unread(self._now, self._offset + number, why, line)

    def _bytes_only(self, lines: list[str]) -> ModbusLog:
        """Read a log of bytes with or without times or prefixes, or a dump."""
        log = None
        if not self._is_prefixed:
            try:
                log = parse_log("\n".join(lines), self._bytes, self._offset)
            except DecodeError:
                if self.form is not None:
                    raise
        if log is None:
            prefixed = self._prefixed(lines)
            if prefixed is None:
                parse_log("\n".join(lines))  # raises its error
                raise AssertionError
            return prefixed
        chunks, numbers = ([*log.chunks], [*log.lines]) if log.timed else _unwrapped(log.chunks, log.lines)
        if self.form is None:
            self._protocol = self._protocol or common_protocol([chunk.data for chunk in chunks])
        items = list[LoggedBytes | Unread]()
        for chunk, number in zip(chunks, numbers):
            of_day = _TIME_OF_DAY.match(lines[number - 1]) is not None
            line = self._offset + number
            at = self._clock.read(Stamp(chunk.at, None, of_day), line) if log.timed else chunk.at
            items.append(LoggedBytes(at, chunk.data, line, None, self._protocol))
        self._bytes = log._replace(chunks=log.chunks[-1:]) if log.chunks else self._bytes
        items = with_transactions(items, self._open_numbers)
        return ModbusLog(tuple(items), "bytes", log.timed, self._new_notes())

    def _prefixed(self, lines: list[str]) -> ModbusLog | None:
        """Read lines that end with bytes, behind any text: `COM3: 01 03 ...`, `FRAME=01-03-...`. None unless frames
        prove it, or if some lines have a text and others do not, as a typing error in a log of bytes makes it."""
        entries: list[LogEntry] = []
        left: list[tuple[int, str]] = []
        prefixes: set[bool] = set()
        for number, line in enumerate(lines, start=1):
            octets = None
            if len(line) <= _LONGEST_LINE:
                plain, stamp = without_stamp(line)
                field = _FRAME.search(plain)
                octets = split_octets(plain[: field.end()] if field else plain)
            if octets is not None and len(octets.data or octets.decimal or b"") >= _SHORTEST:
                entries.append(LogEntry(number, octets.data, None, None, stamp, octets.decimal))
                prefixes.add(bool(octets.before.strip(" \t:,;|-[]()")))
            elif line.strip():
                left.append((number, line))
        if not self._is_prefixed:
            pieces = [piece for entry in entries for piece in (entry.data, entry.decimal) if piece]
            if len(prefixes) != 1 or len(left) > len(entries) or common_protocol(pieces) is None:
                return None
        log = self._assembled("bytes", entries, left)
        self._is_prefixed = True
        return log


def _without_half(lines: list[str]) -> list[str]:
    """Return the lines of a text without the first digit of a byte, with which it ends: it is cut there.

    >>> _without_half(["recv 01 03 04 00 1"]), _without_half(["recv 10 20 30 40 1"])
    (['recv 01 03 04 00'], ['recv 10 20 30 40 1'])
    """
    last = next((place for place in range(len(lines) - 1, -1, -1) if lines[place].strip("` \t")), None)
    half = None if last is None else _HALF.search(lines[last][-_HALF_MAX:])
    if last is None or half is None or not re.search(r"[A-Fa-f]|\b0", half[1]):
        return lines  # decimal numbers
    if any(end == len(half[1]) // 3 + 1 for _, end in whole_frames(bytes.fromhex(f"{half[1]}0{half[2]}"))):
        return lines
    return [*lines[:last], lines[last].rstrip()[:-2]]


def _once(entries: list[LogEntry]) -> tuple[list[LogEntry], list[LogEntry]]:
    """Return the entries, and apart from them those that another logger of the program printed again, at the same
    time."""
    kept, again = entries[:1], list[LogEntry]()
    for entry in entries[1:]:
        (again if _is_again(kept[-1], entry) else kept).append(entry)
    return kept, again


def _is_again(last: LogEntry, entry: LogEntry) -> bool:
    data = entry.data
    if data != last.data or entry.sent is not last.sent or entry.connection != last.connection:
        return False
    if entry.sent is None or not data or len(data) < _SHORTEST or len({*data}) == 1:
        return False
    if last.stamp is None or entry.stamp is None:
        return False
    seconds, before = entry.stamp.seconds, last.stamp.seconds
    is_whole = seconds % 1 == before % 1 == 0  # so it is not known whether they are at the same time
    return not is_whole and entry.stamp.day == last.stamp.day and abs(seconds - before) <= _AT_ONCE


def _told_answers(entries: list[LogEntry], lines: list[str]) -> list[LogEntry]:
    """Return the entries, each exception in a sentence behind the request that it answers, if only one without an
    answer has its unit and function: people tell first what came, and show the log then."""
    told = [entry for entry in entries if entry.stamp is None and len(entry.data or b"") in _EXCEPTION]
    for entry in told if len(lines) <= _TOLD_MAX else ():
        refused = _unit_and_pdu(entry)
        if refused[1:2] < b"\x80" or not PROSE.search(lines[entry.line - 1]):
            continue
        head = refused[:1] + bytes((refused[1] & 0x7F,))
        open_requests = [
            asked
            for asked, behind in zip_longest(entries, entries[1:])
            if asked.sent is not False and _unit_and_pdu(asked)[:2] == head and shapes(_unit_and_pdu(asked)[1:])[0]
            if behind is None or behind.sent or _unit_and_pdu(behind)[:2] not in (head, refused[:2])
        ]
        if len(open_requests) == 1:
            entries = [other for other in entries if other is not entry]
            place = next(place for place, other in enumerate(entries) if other is open_requests[0])
            entries.insert(place + 1, entry._replace(sent=None, from_client=False))
    return entries


def _unit_and_pdu(entry: LogEntry) -> bytes:
    """Return unit and PDU of a frame; nothing if the bytes are none."""
    data = entry.data or b""
    found = (data[:1], frame_pdu("rtu", data)), (data[6:7], frame_pdu("tcp", data))
    return next((unit + pdu for unit, pdu in found if pdu is not None), b"")


def _is_quoted(before: Posted, this: Posted) -> bool:
    """Return whether a response stands twice in a row in a text: the second time it is quoted."""
    pdu = frame_pdu("rtu", this.entry.data or b"") if before.entry.data == this.entry.data else None
    return pdu is not None and shapes(pdu) == (False, True)


def _taken_out(entry: LogEntry) -> LogEntry:
    """Return an entry without its envelope: the RTU frame in it, or nothing if the sender had none."""
    envelope = opened(entry.data) if entry.data and entry.data[0] == ENVELOPE_START else None
    if envelope is None or entry.data is None:
        return entry
    data = envelope.inner if len(envelope.inner) >= _SHORTEST else b""
    return entry._replace(data=data, from_client=envelope.from_client, envelope=entry.data)


def _is_whole(item: LoggedBytes) -> bool:
    return item.protocol is not None and frame_pdu(item.protocol, item.data) is not None


def _framed(log: ModbusLog | None) -> tuple[int, int, bool]:
    """Return how many bytes of a log are in whole frames, in how many entries, and whether one could be a frame."""
    pieces = [item.data for item in log.items if isinstance(item, LoggedBytes)] if log is not None else []
    frames = [sum(end - begin for begin, end in whole_frames(data)) for data in pieces]
    return sum(frames), sum(map(bool, frames)), any(len(data) >= _SHORTEST for data in pieces)


def _with_more_frames(log: ModbusLog | None, posted: ModbusLog | None) -> ModbusLog | None:
    """Return the log, or what was found between words if that has other frames too; where the log has times, twice as
    many. The same frames again are what a program printed twice."""
    if _framed(log)[1] < _LOG:
        return max((log, posted), key=_framed)
    frames = [
        {item.data for item in reading.items if isinstance(item, LoggedBytes) and whole_frames(item.data)}
        for reading in (log, posted)
        if reading is not None
    ]
    assert log is not None
    least = 2 * len(frames[0]) if log.timed else len(frames[0]) + 1
    return posted if len(frames[-1]) >= least else log


def _is_part(entry: LogEntry) -> bool:
    """Return whether an entry has received bytes that are no frame."""
    if not entry.data or (entry.sent is not False and entry.from_client is not False):
        return False
    pdus = filter(None, (frame_pdu(name, entry.data) for name in PROTOCOLS))
    return all(readable(decode_response, pdu) is readable(decode_request, pdu) is None for pdu in pdus if pdu[0] < 0x80)


def _bounded(line: str) -> str:
    """Return a line for the patterns of the forms, some of which take quadratic time for thousands of blanks."""
    if len(line) < _BLANKS_MAX:
        return line
    return _BLANKS.sub(" " * _BLANKS_MAX, line) if len(line) <= _LONGEST_LINE else ""


def _is_by_lines(form: str, lines: list[str]) -> bool:
    """Return whether such a log can be read in parts; the lines are its first ones. A line of a dump or of an export
    has less than an entry."""
    if form == "bytes":
        return not any(map(dump_line, lines))
    names = set(form.split(" and "))
    return names <= _BY_LINES and not _is_json(lines) and ("marked" not in names or without_bytes(lines) is None)


def _is_json(lines: list[str]) -> bool:
    first = next((line.strip() for line in lines if line.strip()), "")
    return first == "[" or first.startswith(('[{"', '{"'))


def _same(found: dict[tuple[int, int], LogEntry], entry: LogEntry) -> bool:
    return any(line == entry.line and other.data == entry.data for (line, _), other in found.items())


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
