"""Logs with words of their own: of libraries, of strace, of sniffers that print every byte with its character.

**Debug lines of pymodbus, versions 1 to 3**

    2024-04-07 22:26:30,764 DEBUG logging:103 send: 0xb 0x3 0x0 0x30 0x0 0x7 0x4 0xad        3.x, and 1.x
    2024-04-07 22:26:30,820 DEBUG logging:103 recv: 0xb 0x3 0xe 0x0 old_data:  addr=None     3.2 to 3.6
    ... recv: 0xb 0x3 0xe 0x0 0x3 extra data: 0x1 0x2                                        3.7 and later
    2023-02-26 19:03:11.610 DEBUG ... SEND: 0x1 0x4 0x0 0xc 0x0 0x2 0xb1 0xc8                2.x, and 3.0 to 3.6
    (five >) send: 0x1 0x3 ...    the last frames, repeated below an error, or all of them in the line of the error;
                                  they count in a log without others

Only bytes behind send and recv passed the line. `old_data` and `extra data` are bytes that pymodbus had before. The
other lines (Processing, Frame check, Getting Frame ...) repeat the same bytes, and are known to be no traffic. But the
blocking clients of 3.7 and later write no send and no recv: there, Processing shows what was received so far.

**The debug output of libmodbus, also in mbpoll -v: every byte in brackets, those that were sent in square ones**

    [01][03][00][00][00][02][C4][0B]            sent
    Waiting for a confirmation...               a client waits for a response; a server for "an indication"
    <01><03><04><00><17><00><07><7A><31>        received

Received bytes are printed as they are read: the line ends when the frame is complete or a time-out is over. The output
has no times.

**The debug output of MinimalModbus: requests as they are written, answers as they are read**

    MinimalModbus debug mode. Will write to instrument (expecting 9 bytes back): 01 03 00 00 00 02 C4 0B (8 bytes)
    MinimalModbus debug mode. Response from instrument: 01 03 04 00 17 00 07 7A 31 (9 bytes), roundtrip time: 12.3 ms.
    ... Writing to instrument (expecting 9 bytes back): '\x01\x03\x00\x00'          version 1, in Python 2: a string
    ... Response from instrument: '\x01\x83\x02' (01 83 02) (3 bytes), roundtrip time: 50 ms.

It has no times, but the duration of each exchange. "(0 bytes)" is the end of the time-out: there was no answer.

**System calls of a program, as strace prints them: what it writes to a port and reads from it**

    30617 05:35:17.903343 write(3, "\1\3\0\5\0\2\324\n", 8) = 8     strace -e trace=read,write (-s, -tt, -x, -f)
    sendto(4</dev/ttyUSB0>, "\x00\x01...", 12, 0, NULL, 0) = 12            and send, recv, sendto, recvfrom

Only the descriptors on which frames pass are read; each is a line of its own. strace cuts strings after 32 bytes unless
-s is given: the bytes of a cut string are not known, and its line cannot be read.

**Logs of serial sniffers that print every byte with its character**

    > 	0x01 (SOH)                                 interceptty: > to the device, < from it; one byte a line
    < 0x83
    Host   --> [SOH] (001) [ETX] (003) ...         slsnif: decimal; (01) with --hex
    Device --> [SOH] (001) ...                     above each line its time, with --timestamp
    2.821799000000000,'1' (0x01),,                 Saleae Logic 1, "Async Serial": seconds and one byte
    2.821799,0x01,,                                its export with hexadecimal values
    "Async Serial","data",2.821799,0.00104,0x01    Saleae Logic 2: start and duration

Bytes of one direction belong together until the other direction begins; where there are times, pauses end frames.
"""

from __future__ import annotations

import re
from itertools import zip_longest

from barewire.errors import DecodeError
from barewire_workbench.frames.input import parse_string_literal
from barewire_workbench.frames.result import counted
from barewire_workbench.recordings.modbus_log.marked import frame_pdu, has_direction
from barewire_workbench.recordings.modbus_log.model import FormContent, LogEntry, Stamp
from barewire_workbench.recordings.modbus_log.octets import find_stamp, stamp_in

_HEX_BYTES = r"(?:0x[0-9a-fA-F]{1,2}(?:\s+|$))*"
_PYMODBUS_WORD = re.compile(r"(?P<repeated>>{5}\s*)?(?<![\w'\"])(?P<word>send|recv|SEND|RECV):")
_PYMODBUS_WORD_ENDS = ("end:", "ecv:", "END:", "ECV:")
_PYMODBUS_BYTES = re.compile(
    rf"\s*(?P<bytes>{_HEX_BYTES})(?:old_data:.*|extra data:.*|addr=.*|unexpected data:.*|0x)?$"
)
"""What stands behind a word, up to the next one; a text may be cut within a byte."""
_PYMODBUS_MORE = re.compile(r"(?:0x[0-9a-fA-F]{1,2}(?:\s+|$))+")
_PYMODBUS_PROCESSING = re.compile(rf"(?<![\w'\"])(?:Processing|Handling data):\s*(?P<bytes>{_HEX_BYTES})$")
_PYMODBUS_OTHER = re.compile(
    r"Processing:|Getting [Ff]rame|Frame (?:check|advanced|- (?:\[|not ready))|[Rr]esetting (?:[Ff]rame|header)|"
    r"Current transaction state|Running transaction|[Tt]ransaction state|Factory Re|decoded PDU|"
    r"[Aa]dding transaction|[Gg]etting transaction|[Dd]elTransaction|Changing (?:transaction )?state|"
    r"Frame is not ready|Sending available data in recv|will sleep|Connect(?:ing|ed|ion)|-> transport|callback_|"
    r">>>>> |Handling|Incomplete message received|pymodbus|Waiting for 3\.5 char"
)


def read_pymodbus(lines: list[str], decided: object = None) -> FormContent:
    """Return the entries of lines with send and recv. `decided` is which lines counted in the part of the log before.

    >>> read_pymodbus(["DEBUG:pymodbus:recv: 0x1 0x83 0x2 0xc0 0xf1 extra data:"]).entries[0].data.hex(" ")
    '01 83 02 c0 f1'
    """
    log = _PymodbusLog()
    for number, line in enumerate(lines, start=1):
        words = list(_PYMODBUS_WORD.finditer(line)) if any(text in line for text in _PYMODBUS_WORD_ENDS) else []
        if words:
            log.add_words(number, line, words)
        else:
            log.add_other(number, line)
    return log.content(decided)


_PYMODBUS_EXTRA = re.compile(r"\s*extra data: ((?:0[xX][0-9a-fA-F]{1,2}\s*)+)")


class _PymodbusLog:
    """The entries of a log of pymodbus, by the kind of their lines: one kind counts, the others repeat it."""

    def __init__(self) -> None:
        self.logged: list[LogEntry] = []
        self.processed: list[LogEntry] = []
        self.repeated: list[LogEntry] = []
        self.known: set[int] = set()
        self.unreadable: set[int] = set()
        self._handled = b""  # of the line before, if that has "Handling data"
        self._cut: tuple[int, list[LogEntry]] = (-1, [])  # the line that ended within bytes, and their entries

    def add_words(self, number: int, line: str, words: list[re.Match[str]]) -> None:
        """Take a line with send and recv, each with the bytes behind it."""
        stamp = stamp_in(line[: words[0].start()])
        self._go_on(number, line[: words[0].start()])
        is_repeated = any(word["repeated"] for word in words)  # a quotation begins within the line of an error
        for word, following in zip_longest(words, words[1:]):
            text = line[word.end() : None if following is None else following.start()]
            match = _PYMODBUS_BYTES.match(text)
            if match is None:
                self.unreadable.add(number)
                continue
            self.known.add(number)
            data = bytes(int(token, 16) for token in match["bytes"].split())
            is_sent = word["word"].lower() == "send"
            if data or not is_sent:
                entries = self.repeated if is_repeated else self.logged
                extra = None if is_sent else _PYMODBUS_EXTRA.match(text, match.end("bytes"))
                if (
                    extra is not None
                ):  # what the buffer had before: data of the last entry, or of a line that is not there
                    kept = bytes(int(token, 16) for token in extra[1].split())
                    is_known = entries and entries[-1].sent is False and (entries[-1].data or b"").endswith(kept)
                    data = ((entries.pop().data if is_known else kept) or b"") + data
                entries.append(LogEntry(number, data, is_sent, stamp=stamp))
                if following is None and data and match.end("bytes") == len(text):
                    self._cut = number, entries

    def _go_on(self, number: int, text: str) -> None:
        """Take the bytes with which a line begins: those of the last entry, if its line ended within them."""
        more, (line, entries) = _PYMODBUS_MORE.match(text), self._cut
        if more is not None and line == number - 1:
            data = bytes(int(token, 16) for token in more[0].split())
            entries[-1] = entries[-1]._replace(data=(entries[-1].data or b"") + data)
            self.known.add(number)

    def add_other(self, number: int, line: str) -> None:
        """Take any other line: some show what was received so far."""
        self._go_on(number, line)
        is_processed = "Processing:" in line or "Handling data:" in line
        if is_processed and (match := _PYMODBUS_PROCESSING.search(line)) and match["bytes"]:
            data = bytes(int(token, 16) for token in match["bytes"].split())
            if self._handled and data.endswith(self._handled):
                self.processed.pop()  # the same read, and what was received before
            self._handled = b"" if "Processing:" in line else data
            before = self.processed[-1].data or b"" if self.processed else b""
            if before and len(data) > len(before) and data.startswith(before):
                self.processed.pop()  # the same bytes, and more
            self.processed.append(LogEntry(number, data, False, False, stamp_in(line[: match.start()])))
        elif not _PYMODBUS_OTHER.search(line) or "Unable to decode" in line:  # the program goes on behind its bytes
            return
        self.known.add(number)

    def content(self, decided: object) -> FormContent:
        """Return the entries that count: those with send and recv if there are some."""
        kinds = {"logged": self.logged, "processed": self.processed, "repeated": self.repeated}
        first = next((kind for kind, entries in kinds.items() if entries), None)
        kind = first if decided is None or first == "logged" else str(decided)
        if kind is None:
            return FormContent([], set())
        notes = _not_counted(self.repeated, kinds[kind]) if kind != "repeated" else ()
        return FormContent(kinds[kind], self.known, notes, self.unreadable, kind)


BELOW_ERROR = "below an error, not in the log above: left out"


def _not_counted(repeated: list[LogEntry], entries: list[LogEntry]) -> tuple[tuple[int, str], ...]:
    """Return a note about repeated frames that are not among the entries: their places in time are not known."""
    pieces = {entry.data for entry in entries}
    left = [entry for entry in repeated if entry.data not in pieces]
    if not left:
        return ()
    return ((left[0].line, f"{counted(len(left), 'frame')} {BELOW_ERROR}"),)


_LIBMODBUS_SENT = re.compile(r"(?:\[ ?[0-9A-Fa-f]{2} ?\] ?){2,}")
_LIBMODBUS_RECEIVED = re.compile(r"(?:< ?[0-9A-Fa-f]{2} ?> ?)+")
_NO_BRACKETS = str.maketrans("", "", "[]<> ")
_LIBMODBUS_WAITS = {
    "Waiting for a confirmation": True,
    "Waiting for an indication": False,
    "Waiting for a indication": False,
}
_LIBMODBUS_OTHER = re.compile(
    r"Waiting for an? (?:confirmation|indication)|ERROR |Opening |[Bb]ytes flushed|Connect|Client connection|"
    r"Request for slave|Sending request using RTS|Reconnect|Quit|Waiting for"
)


def read_libmodbus(lines: list[str], decided: object = None) -> FormContent:
    """Return the entries of a debug output. `decided` is whether a client wrote the part before.

    >>> [entry.sent for entry in read_libmodbus(["[01][83]", "Waiting for a confirmation...", "<01><83>"]).entries]
    [True, False]
    """
    entries: list[LogEntry] = []
    known: set[int] = set()
    client = decided if isinstance(decided, bool) else None
    for number, line in enumerate(lines, start=1):
        rows = (
            [*_LIBMODBUS_SENT.finditer(line), *_LIBMODBUS_RECEIVED.finditer(line)] if "[" in line or "<" in line else []
        )
        if rows:
            rows.sort(key=re.Match.start)
            if has_direction(line[: rows[0].start()]):
                continue  # of another program, which has both directions in the same brackets
            stamp = stamp_in(line[: rows[0].start()])
            for row in rows:
                data = bytes.fromhex(row[0].translate(_NO_BRACKETS))
                entries.append(LogEntry(number, data, row.re is _LIBMODBUS_SENT, stamp=stamp))
            known.add(number)
            continue
        if "Waiting for a" in line:
            client = next((is_client for text, is_client in _LIBMODBUS_WAITS.items() if text in line), client)
        if _LIBMODBUS_OTHER.search(line):
            known.add(number)
    if not any(entry.data for entry in entries) and decided is None:
        return FormContent([], set())
    if client is not None:
        entries = [entry._replace(from_client=entry.sent is client) for entry in entries]
    return FormContent(entries, known, decided="unknown" if client is None else client)


_HEX = r"[0-9A-F]{2}(?: [0-9A-F]{2})*"
_MINIMALMODBUS_TRAFFIC = re.compile(
    r"(?P<word>Will write to instrument|Writing to instrument|Response from instrument|The response is)[^:]{0,60}:\s*"
    rf"(?:(?P<string>b?(?:'(?:[^'\\]|\\.)*'|\"(?:[^\"\\]|\\.)*\"))|(?P<hex>{_HEX})|(?= ?\(0 bytes\)))"
)


def read_minimalmodbus(lines: list[str]) -> FormContent:
    r"""Return the entries of a debug output.

    >>> read_minimalmodbus([r"Response from instrument: '\x01\x83\x02\xc0\xf1'"]).entries[0][:3]
    (1, b'\x01\x83\x02\xc0\xf1', False)
    """
    entries: list[LogEntry] = []
    known: set[int] = set()
    for number, line in enumerate(lines, start=1):
        traffic = _MINIMALMODBUS_TRAFFIC.search(line)
        if "MinimalModbus debug mode." in line or traffic:
            known.add(number)
        if traffic is None:
            continue
        try:
            data = parse_string_literal(traffic["string"]) if traffic["string"] else bytes.fromhex(traffic["hex"] or "")
        except DecodeError:
            known.discard(number)
            continue
        if data is None and traffic["string"]:  # a string without escapes: a frame of ASCII
            data = traffic["string"].lstrip("b")[1:-1].encode("latin-1", "replace")
        stamp = stamp_in(line[: traffic.start()])
        is_asked = "rit" in traffic["word"]
        if data or not is_asked:
            entries.append(LogEntry(number, data, is_asked, is_asked, stamp))
    return FormContent(entries, known)


_SYSTEM_CALL = re.compile(
    r"(?P<before>.*?)(?<!\w)(?P<call>write|read|send|recv|sendto|recvfrom)\((?P<number>\d+)(?:<[^>]*>)?, "
    r'(?P<string>"(?:[^"\\]|\\.)*")(?P<cut>\.\.\.)?(?:, [^=]*)?\)\s+= (?P<size>-?\d+).*'
)
_WRITES = frozenset({"write", "send", "sendto"})


def read_syscalls(lines: list[str], decided: object = None) -> FormContent:
    r"""Return the calls on the descriptors that carry frames. `decided` has the names of those known before.

    >>> read_syscalls([r'write(3, "\1\203\2\300\361", 5) = 5']).entries[0][1:3]
    (b'\x01\x83\x02\xc0\xf1', True)
    """
    entries: list[LogEntry] = []
    known: set[int] = set()
    for number, line in enumerate(lines, start=1):
        call = _SYSTEM_CALL.fullmatch(line)
        if call is None:
            continue
        if '"...' not in line:
            known.add(number)
        if call["cut"] or int(call["size"]) <= 0:
            continue
        try:
            data = parse_string_literal(call["string"])
        except DecodeError:
            continue
        if data is None:
            data = call["string"][1:-1].encode("latin-1", "replace")
        sent, stamp = call["call"] in _WRITES, stamp_in(call["before"])
        entries.append(LogEntry(number, data[: int(call["size"])], sent, stamp=stamp, connection=call["number"]))
    names = dict(decided) if isinstance(decided, dict) else {}
    others = (entry for entry in entries if entry.connection not in names)
    carrying = {entry.connection for entry in others if _is_frame(entry.data or b"")}
    names |= {number: "" if not names and len(carrying) == 1 else number for number in carrying}
    entries = [entry._replace(connection=names[entry.connection]) for entry in entries if entry.connection in names]
    return FormContent(entries, known if names else set(), decided=names)


def _is_frame(data: bytes) -> bool:
    return any(frame_pdu(protocol, data) is not None for protocol in ("rtu", "tcp", "ascii"))


_INTERCEPTTY = re.compile(r"(?:\[\d\d:\d\d[ :]\d\d\.\d+\]|\s*)(?P<mark>[<>]) \s*0x(?P<byte>[0-9a-f]{2})(?: \(.*\))?\s*")
_INTERCEPTTY_TIME = re.compile(r"\[(\d\d):(\d\d)[ :](\d\d\.\d+)\]")
_SLSNIF = re.compile(r"(?P<word>Host  |Device|      ) --> (?P<bytes>.+)")
_SLSNIF_BYTE = re.compile(r"(?:\[[^\]]{2,5}\]|<[^>]{2,5}>|[A-Z0-9]{2,5}|.) \((?P<byte>[0-9a-f]{2,3})\) ?", re.DOTALL)
_SALEAE = (
    re.compile(r"(?P<at>-?\d+\.\d+),.{0,24}?\(?0x(?P<byte>[0-9A-Fa-f]{2})\)?(?:,.*)?"),
    re.compile(r'"?[^",]{1,60}"?,"?data"?,(?P<at>-?\d+\.?\d*),[\d.eE+-]*,"?0x(?P<byte>[0-9A-Fa-f]{2})"?(?:,.*)?'),
)
_SALEAE_HEAD = re.compile(r'(?i)"?(?:time ?\[s\]|name)"?,.*(?:value|data|type).*')


def read_bytewise(lines: list[str]) -> FormContent:
    """Return the entries of such a log.

    >>> [entry.data.hex() for entry in read_bytewise(["> \\t0x01", "> \\t0x83", "< 0x02"]).entries]
    ['0183', '02']
    """
    entries: list[LogEntry] = []
    known: set[int] = set()
    stamp: Stamp | None = None
    for number, line in enumerate(lines, start=1):
        plain = line.strip()
        if row := _INTERCEPTTY.fullmatch(line):
            _add_interceptty(entries, row, number, follows=number - 1 in known)
            known.add(number)
        elif row := _SLSNIF.match(line):
            if _add_slsnif(entries, row, number, stamp):
                known.add(number)
                stamp = None
        elif row := _SALEAE[0].fullmatch(plain) or _SALEAE[1].fullmatch(plain):
            entries.append(LogEntry(number, bytes.fromhex(row["byte"]), stamp=Stamp(float(row["at"]))))
            known.add(number)
        elif line.startswith("Total bytes transmitted:") or _SALEAE_HEAD.fullmatch(plain):
            known.add(number)
        elif plain and (above := find_stamp(line)) and not line[above[2] :].strip(" 0123456789"):
            stamp = above[0]  # the line above those of slsnif
            known.update({number} if number < len(lines) and _SLSNIF.match(lines[number]) else ())
    return FormContent(entries, known)


def _add_interceptty(entries: list[LogEntry], row: re.Match[str], number: int, *, follows: bool) -> None:
    """Add a byte to the last entry if that is of the same direction and time, and in the line before."""
    sent, data = row["mark"] == ">", bytes.fromhex(row["byte"])
    time = _INTERCEPTTY_TIME.match(row[0])
    at = None if time is None else Stamp(60 * (60 * int(time[1]) + int(time[2])) + float(time[3]), None, True)
    last = entries[-1] if entries else None
    if last is not None and follows and last.sent is sent and at in (None, last.stamp):
        entries[-1] = last._replace(data=(last.data or b"") + data)
    else:
        entries.append(LogEntry(number, data, sent, stamp=at))


def _add_slsnif(entries: list[LogEntry], row: re.Match[str], number: int, stamp: Stamp | None) -> bool:
    """Add the bytes of a line; one without a word goes on with the entry above. Return whether it has bytes."""
    digits = [piece["byte"] for piece in _SLSNIF_BYTE.finditer(row["bytes"])]
    if not digits:
        return False
    base = 10 if len(digits[0]) == 3 else 16
    data = bytes(int(byte, base) & 0xFF for byte in digits)
    if row["word"].strip():
        entries.append(LogEntry(number, data, row["word"] == "Host  ", stamp=stamp))
    elif entries:
        entries[-1] = entries[-1]._replace(data=(entries[-1].data or b"") + data)
    return True
