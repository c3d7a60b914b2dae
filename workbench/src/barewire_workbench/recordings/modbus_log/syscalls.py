"""System calls of a program, as strace prints them: what it writes to a port and reads from it.

    30617 05:35:17.903343 write(3, "\\1\\3\\0\\5\\0\\2\\324\\n", 8) = 8     strace -e trace=read,write (-s, -tt, -x, -f)
    sendto(4</dev/ttyUSB0>, "\\x00\\x01...", 12, 0, NULL, 0) = 12            and send, recv, sendto, recvfrom

Only the descriptors on which frames pass are read; each is a line of its own. strace cuts strings after 32 bytes unless
-s is given: the bytes of a cut string are not known, and its line cannot be read.
"""

from __future__ import annotations

import re

from barewire.errors import DecodeError
from barewire_workbench.frames.input import parse_string_literal
from barewire_workbench.recordings.modbus_log.direction import frame_pdu
from barewire_workbench.recordings.modbus_log.model import FormContent, LogEntry
from barewire_workbench.recordings.modbus_log.stamps import find_stamp

_CALL = re.compile(
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
        found = _CALL.fullmatch(line)
        if found is None:
            continue
        if '"...' not in line:
            known.add(number)
        if found["cut"] or int(found["size"]) <= 0:
            continue
        try:
            data = parse_string_literal(found["string"])
        except DecodeError:
            continue
        if data is None:
            data = found["string"][1:-1].encode("latin-1", "replace")
        stamp = find_stamp(found["before"])
        sent = found["call"] in _WRITES
        at = None if stamp is None else stamp[0]
        entries.append(LogEntry(number, data[: int(found["size"])], sent, stamp=at, connection=found["number"]))
    names = dict(decided) if isinstance(decided, dict) else {}
    others = (entry for entry in entries if entry.connection not in names)
    carrying = {entry.connection for entry in others if _is_frame(entry.data or b"")}
    names |= {number: "" if not names and len(carrying) == 1 else number for number in carrying}
    entries = [entry._replace(connection=names[entry.connection]) for entry in entries if entry.connection in names]
    return FormContent(entries, known if names else set(), decided=names)


def _is_frame(data: bytes) -> bool:
    return any(frame_pdu(protocol, data) is not None for protocol in ("rtu", "tcp", "ascii"))
