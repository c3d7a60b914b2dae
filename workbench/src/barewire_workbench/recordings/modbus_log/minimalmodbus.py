"""The debug output of MinimalModbus: requests as they are written, answers as they are read.

    MinimalModbus debug mode. Will write to instrument (expecting 9 bytes back): 01 03 00 00 00 02 C4 0B (8 bytes)
    MinimalModbus debug mode. Response from instrument: 01 03 04 00 17 00 07 7A 31 (9 bytes), roundtrip time: 12.3 ms.
    ... Writing to instrument (expecting 9 bytes back): '\\x01\\x03\\x00\\x00'          version 1, in Python 2: a string
    ... Response from instrument: '\\x01\\x83\\x02' (01 83 02) (3 bytes), roundtrip time: 50 ms.

It has no times, but the duration of each exchange. "(0 bytes)" is the end of the time-out: there was no answer.
"""

from __future__ import annotations

import re

from barewire.errors import DecodeError
from barewire_workbench.frames.input import parse_string_literal
from barewire_workbench.recordings.modbus_log.model import FormContent, LogEntry
from barewire_workbench.recordings.modbus_log.stamps import find_stamp

_HEX = r"[0-9A-F]{2}(?: [0-9A-F]{2})*"
_TRAFFIC = re.compile(
    r"(?P<word>Will write to instrument|Writing to instrument|Response from instrument)[^:]{0,60}:\s*"
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
        found = _TRAFFIC.search(line)
        if "MinimalModbus debug mode." in line or found:
            known.add(number)
        if found is None:
            continue
        try:
            data = parse_string_literal(found["string"]) if found["string"] else bytes.fromhex(found["hex"] or "")
        except DecodeError:
            known.discard(number)
            continue
        if data is None and found["string"]:  # a string without escapes: a frame of ASCII
            data = found["string"].lstrip("b")[1:-1].encode("latin-1", "replace")
        stamp = find_stamp(line[: found.start()])
        is_asked = not found["word"].startswith("Response")
        if data or not is_asked:
            entries.append(LogEntry(number, data, is_asked, is_asked, None if stamp is None else stamp[0]))
    return FormContent(entries, known)
