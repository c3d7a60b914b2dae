"""The content of a recording of Modbus, the same for all forms of logs and captures.

    LoggedBytes(at, data, line, from_client, protocol, connection)    bytes that were recorded together
    Unread(at, line, why, text)                                       a line that holds no bytes that can be read
    ModbusLog(items, form, timed, notes)                              all of them, in the order of the file

`at` never decreases. A log without times gets made-up ones: 0.1 s from one entry to the next (`timed` is False).

What a form returns, before times, direction and protocol are decided for the whole log:

    LogEntry(line, data, sent, from_client, stamp, decimal)
"""

from __future__ import annotations

from collections.abc import Set
from typing import NamedTuple

from barewire_workbench.frames.result import ProtocolName
from barewire_workbench.recordings.model import Unread


class LoggedBytes(NamedTuple):
    """Bytes recorded together, the last of them at `at`, in seconds. `line` counts from 1: lines of a text, packets of
    a capture.

    `from_client` is None if the log does not show the direction, `protocol` None if the bytes fit none. `connection`
    tells the TCP connections and the lines of one recording apart. No `data`: the recording program reports that
    nothing came. `envelope` is the frame of another protocol in which the bytes stood (`envelope.py`).
    """

    at: float
    data: bytes
    line: int = 0
    from_client: bool | None = None
    protocol: ProtocolName | None = None
    connection: str = ""
    envelope: bytes = b""


class ModbusLog(NamedTuple):
    """A recording: its items, the name of its form, whether it has times, and notes about the whole of it."""

    items: tuple[LoggedBytes | Unread, ...]
    form: str
    timed: bool
    notes: tuple[str, ...] = ()


class Stamp(NamedTuple):
    """A time as a log states it: seconds of the day, and the day counted from 1970 if the log states it.

    `day` is None for a time of day and for a number of seconds; `of_day` tells these two apart.
    """

    seconds: float
    day: int | None = None
    of_day: bool = False


class LogEntry(NamedTuple):
    """The bytes of one entry of a log; none of the received ones if the program waited in vain.

    `sent` is the direction as seen by the recording program, `from_client` the direction on the line; None if the log
    does not state it. `decimal` are the bytes if the digits are decimal numbers, None if they cannot be.
    `connection` tells several lines of one log apart.
    """

    line: int
    data: bytes | None
    sent: bool | None = None
    from_client: bool | None = None
    stamp: Stamp | None = None
    decimal: bytes | None = None
    connection: str = ""
    envelope: bytes = b""


class FormContent(NamedTuple):
    """What one form reads of a part of a text, in which lines count from 1.

    `known` are the lines without new bytes, `notes` what there is to say, each with its line, `unreadable` the lines
    with words of the form behind which something else than bytes stands. `decided` is given to the form again with the
    next part of the text.
    """

    entries: list[LogEntry]
    known: set[int]
    notes: tuple[tuple[int, str], ...] = ()
    unreadable: Set[int] = frozenset()
    decided: object = None
