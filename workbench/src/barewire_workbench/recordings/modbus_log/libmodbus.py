"""The debug output of libmodbus, also in mbpoll -v: every byte in brackets, those that were sent in square ones.

    [01][03][00][00][00][02][C4][0B]            sent
    Waiting for a confirmation...               a client waits for a response; a server for "an indication"
    <01><03><04><00><17><00><07><7A><31>        received

Received bytes are printed as they are read: the line ends when the frame is complete or a time-out is over. The output
has no times.
"""

from __future__ import annotations

import re

from barewire_workbench.recordings.modbus_log.model import FormContent, LogEntry
from barewire_workbench.recordings.modbus_log.stamps import find_stamp

_SENT = re.compile(r"(?:\[[0-9A-F]{2}\]){2,}")
_RECEIVED = re.compile(r"(?:<[0-9A-F]{2}>)+")
_NO_BRACKETS = str.maketrans("", "", "[]<>")
_WAITS = {"Waiting for a confirmation": True, "Waiting for an indication": False, "Waiting for a indication": False}
_SILENT = re.compile(r"ERROR Connection timed out|ERROR .*timed out: select")
_OTHER = re.compile(
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
        if "[" in line or "<" in line:
            rows = [(found, True) for found in _SENT.finditer(line)]
            rows += [(found, False) for found in _RECEIVED.finditer(line)]
            if rows:
                rows.sort(key=lambda row: row[0].start())
                stamp = find_stamp(line[: rows[0][0].start()])
                for found, sent in rows:
                    data = bytes.fromhex(found[0].translate(_NO_BRACKETS))
                    entries.append(LogEntry(number, data, sent, stamp=None if stamp is None else stamp[0]))
                known.add(number)
                continue
        if "Waiting for a" in line:
            client = next((is_client for text, is_client in _WAITS.items() if text in line), client)
        if _SILENT.search(line):
            entries.append(LogEntry(number, b"", False))
        if _OTHER.search(line):
            known.add(number)
    if not any(entry.data for entry in entries) and decided is None:
        return FormContent([], set())
    if client is not None:
        entries = [entry._replace(from_client=entry.sent is client) for entry in entries]
    return FormContent(entries, known, decided="unknown" if client is None else client)
