"""Debug lines of pymodbus, versions 1 to 3.

    2024-04-07 22:26:30,764 DEBUG logging:103 send: 0xb 0x3 0x0 0x30 0x0 0x7 0x4 0xad        3.x, and 1.x
    2024-04-07 22:26:30,820 DEBUG logging:103 recv: 0xb 0x3 0xe 0x0 old_data:  addr=None     3.2 to 3.6
    ... recv: 0xb 0x3 0xe 0x0 0x3 extra data: 0x1 0x2                                        3.7 and later
    2023-02-26 19:03:11.610 DEBUG ... SEND: 0x1 0x4 0x0 0xc 0x0 0x2 0xb1 0xc8                2.x, and 3.0 to 3.6
    (five >) send: 0x1 0x3 ...    the last frames, repeated below an error, or all of them in the line of the error;
                                  they count in a log without others

Only bytes behind send and recv passed the line. `old_data` and `extra data` are bytes that pymodbus had before. The
other lines (Processing, Frame check, Getting Frame ...) repeat the same bytes, and are known to be no traffic. But the
blocking clients of 3.7 and later write no send and no recv: there, Processing shows what was received so far.
"""

from __future__ import annotations

import re
from itertools import zip_longest

from barewire_workbench.frames.result import counted
from barewire_workbench.recordings.modbus_log.model import FormContent, LogEntry
from barewire_workbench.recordings.modbus_log.stamps import find_stamp

_BYTES = r"(?:0x[0-9a-fA-F]{1,2}(?:\s+|$))*"
_WORD = re.compile(r"(?P<repeated>>{5}\s*)?(?<![\w'\"])(?P<word>send|recv|SEND|RECV):")
_WORD_ENDS = ("end:", "ecv:", "END:", "ECV:")
_TRAFFIC = re.compile(rf"\s*(?P<bytes>{_BYTES})(?:old_data:.*|extra data:.*|addr=.*|unexpected data:.*)?$")
"""What stands behind a word, up to the next one."""
_PROCESSING = re.compile(rf"(?<![\w'\"])Processing:\s*(?P<bytes>{_BYTES})$")
_SILENT = re.compile(r"No response received after|No Response received from the remote|\[Input/Output\] No Response")
_OTHER = re.compile(
    r"Processing:|Getting [Ff]rame|Frame (?:check|advanced|- \[)|[Rr]esetting (?:[Ff]rame|header)|"
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
    entries: list[LogEntry] = []
    repeated: list[LogEntry] = []
    processed: list[LogEntry] = []
    silent: list[LogEntry] = []
    known: set[int] = set()
    unreadable: set[int] = set()
    for number, line in enumerate(lines, start=1):
        words = list(_WORD.finditer(line)) if any(text in line for text in _WORD_ENDS) else []
        stamp = find_stamp(line[: words[0].start()]) if words else None
        for word, following in zip_longest(words, words[1:]):
            text = line[word.end() : None if following is None else following.start()]
            found = _TRAFFIC.match(text)
            if found is None:
                unreadable.add(number)
                continue
            known.add(number)
            data = bytes(int(token, 16) for token in found["bytes"].split())
            is_sent = word["word"].lower() == "send"
            if data or not is_sent:
                entry = LogEntry(number, data, is_sent, stamp=None if stamp is None else stamp[0])
                (repeated if word["repeated"] else entries).append(entry)
        if words:
            continue
        if "Processing:" in line and (found := _PROCESSING.search(line)) and found["bytes"]:
            known.add(number)
            stamp = find_stamp(line[: found.start()])
            data = bytes(int(token, 16) for token in found["bytes"].split())
            if processed and len(data) > len(last := processed[-1].data or b"") and data.startswith(last):
                processed.pop()  # the same bytes, and more
            processed.append(LogEntry(number, data, False, False, None if stamp is None else stamp[0]))
        elif "esponse" in line and _SILENT.search(line):
            stamp = find_stamp(line)
            silent.append(LogEntry(number, b"", False, False, None if stamp is None else stamp[0]))
            known.add(number)
        elif _OTHER.search(line):
            known.add(number)
    kinds = {"logged": entries, "processed": processed, "repeated": repeated}
    first = next((kind for kind, found in kinds.items() if found), None)
    counted_kind = first if decided is None or first == "logged" else str(decided)
    if counted_kind is None:
        return FormContent([], set())
    found_entries = kinds[counted_kind]
    notes = _not_counted(repeated, found_entries) if counted_kind != "repeated" else ()
    ordered = sorted([*found_entries, *silent], key=lambda entry: entry.line)
    return FormContent(ordered, known, notes, unreadable, counted_kind)


def _not_counted(repeated: list[LogEntry], entries: list[LogEntry]) -> tuple[tuple[int, str], ...]:
    """Return a note about repeated frames that are not among the entries: their places in time are not known."""
    pieces = {entry.data for entry in entries}
    left = [entry for entry in repeated if entry.data not in pieces]
    if not left:
        return ()
    return ((left[0].line, f"{counted(len(left), 'frame')} below an error, not in the log above: left out"),)
