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
_WAITS = {"Waiting for a confirmation": True, "Waiting for an indication": False, "Waiting for a indication": False}
_SILENT = re.compile(r"ERROR Connection timed out|ERROR .*timed out: select")
_OTHER = re.compile(
    r"Waiting for an? (?:confirmation|indication)|ERROR |Opening |[Bb]ytes flushed|Connect|Client connection|"
    r"Request for slave|Sending request using RTS|Reconnect|Quit|Waiting for"
)


def read_libmodbus(lines: list[str]) -> FormContent:
    """Return the entries of a debug output.

    >>> [entry.sent for entry in read_libmodbus(["[01][83]", "Waiting for a confirmation...", "<01><83>"]).entries]
    [True, False]
    """
    entries: list[LogEntry] = []
    known: set[int] = set()
    client: bool | None = None
    for number, line in enumerate(lines, start=1):
        for text, is_client in _WAITS.items():
            client = is_client if text in line else client
        rows = [(found, True) for found in _SENT.finditer(line)]
        rows += [(found, False) for found in _RECEIVED.finditer(line)]
        stamp = find_stamp(line[: min(found.start() for found, _ in rows)]) if rows else None
        for found, sent in sorted(rows, key=lambda row: row[0].start()):
            data = bytes.fromhex(re.sub(r"[^0-9A-F]", "", found[0]))
            entries.append(LogEntry(number, data, sent, stamp=None if stamp is None else stamp[0]))
        if not rows and _SILENT.search(line):
            entries.append(LogEntry(number, b"", False))
        if rows or _OTHER.search(line):
            known.add(number)
    if not any(entry.data for entry in entries):
        return FormContent([], set())
    if client is not None:
        entries = [entry._replace(from_client=entry.sent is client) for entry in entries]
    return FormContent(entries, known)
