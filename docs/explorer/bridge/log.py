"""A log for the page: what passed, what was missing, what is wrong, and a sequence diagram."""

from __future__ import annotations

import re
from base64 import b64decode
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from itertools import islice
from typing import Any

from barewire.errors import EncodeError
from barewire_workbench.diagnosis.can_log import CanLogDiagnosis
from barewire_workbench.diagnosis.modbus_log import ModbusLogDiagnosis
from barewire_workbench.diagnosis.verdict import LogFinding
from barewire_workbench.frames.modbus_exchanges import Exchanges
from barewire_workbench.monitor import event_line, is_repeated
from barewire_workbench.monitor.recording import BusMonitors, is_can_recording, read_recording
from barewire_workbench.pictures.picture import html_fragment
from barewire_workbench.pictures.recordings import recording_picture
from barewire_workbench.recordings.modbus_log import read_modbus_log
from barewire_workbench.recordings.modbus_replay import replay_log
from barewire_workbench.recordings.model import Unread

_LONGEST = 200_000
"""The longest log in characters: a page that shows more is no longer read."""
_SECONDS = re.compile(r"(?<![\d.])(1\d{9}\.\d{6})( s\b)?")
"""Seconds since 1970, from 2001 to 2033."""
_LINES = 500
_FINDINGS = 50


def log(text: str = "", data: str = "") -> dict[str, Any]:
    """Return the lines of a log as `barewire sniff` prints them, its diagnosis, and its sequence diagram.

    A file that is not text, such as a capture, comes as base64.
    """
    if not text.strip() and not data:
        raise EncodeError("no log: paste the lines of one")
    if len(text) > _LONGEST:
        raise EncodeError(f"{len(text)} characters: at most {_LONGEST} here; `barewire sniff` reads more")
    recording = b64decode(data) if data else text.encode()
    is_can = is_can_recording(recording)
    lines, notes = _can_lines(recording) if is_can else _modbus_lines(recording)
    kept = list(islice(lines, _LINES + 1))
    if len(kept) > _LINES:
        kept[_LINES:] = [f"... more than {_LINES} lines: `barewire sniff` shows all of them"]
    findings, verdicts = _can_diagnosis(recording) if is_can else _modbus_diagnosis(recording)
    picture = html_fragment(recording_picture("this log", recording), "picture-log")
    if _SECONDS.search(picture):
        picture = picture.replace(">time, s<", ">time<")
    kept, findings, verdicts, (picture,) = _with_times(kept, findings, verdicts, [picture])
    return {
        "findings": findings,
        "verdicts": verdicts,
        "kind": "CAN" if is_can else "Modbus",
        "lines": kept,
        "notes": notes,
        "picture": picture,
    }


def _with_times(*texts: list[str]) -> list[list[str]]:
    """Return texts with the time of day, as the log has it, for seconds since 1970; with the date where it changes."""
    moments = [float(match[1]) for lines in texts for line in lines for match in _SECONDS.finditer(line)]
    days = {int(moment // 86400) for moment in moments}
    form = "%H:%M:%S.%f" if len(days) == 1 else "%Y-%m-%d %H:%M:%S.%f"

    def time(match: re.Match[str]) -> str:
        return datetime.fromtimestamp(float(match[1]), UTC).strftime(form)

    return [[_SECONDS.sub(time, line) for line in lines] for lines in texts]


def _modbus_lines(data: bytes) -> tuple[Iterator[str], list[str]]:
    replayed, events = replay_log(data)
    shown = Exchanges(timed=replayed.timed)
    notes = [*replayed.notes]
    notes += [f"line {item.line}: {item.why}: {item.text}" for item in replayed.items if isinstance(item, Unread)]

    def lines() -> Iterator[str]:
        for event in events:
            yield from map(str, shown.feed(event))
        yield from map(str, shown.end())

    return lines(), notes[:_LINES]


def _can_lines(data: bytes) -> tuple[Iterator[str], list[str]]:
    monitors = BusMonitors([])

    def lines() -> Iterator[str]:
        for item in read_recording(data):
            yield from (event_line(event) for _, event in monitors.feed(item) if not is_repeated(event))
        yield from (event_line(event) for _, event in monitors.end() if not is_repeated(event))

    return lines(), []


def _modbus_diagnosis(data: bytes) -> tuple[list[str], list[str]]:
    diagnosis = ModbusLogDiagnosis(read_modbus_log(data))
    return _sentences(diagnosis.findings()), [verdict.sentence for _, verdict in diagnosis.verdicts()]


def _can_diagnosis(data: bytes) -> tuple[list[str], list[str]]:
    diagnosis = CanLogDiagnosis()

    def found() -> Iterator[LogFinding]:
        for item in read_recording(data):
            yield from diagnosis.feed(item)
        yield from diagnosis.end()

    return _sentences(found()), [verdict.sentence for _, verdict in diagnosis.verdicts()]


def _sentences(findings: Iterable[LogFinding]) -> list[str]:
    """Return the first findings as sentences; all of them are made, since the verdicts count them."""
    kept, number = [], 0
    for number, finding in enumerate(findings, start=1):
        if number <= _FINDINGS:
            kept.append(finding.sentence)
    if number > _FINDINGS:
        kept.append(f"... and {number - _FINDINGS} more: `barewire diagnose --all` shows them")
    return kept
