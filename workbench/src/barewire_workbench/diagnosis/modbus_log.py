"""Diagnosis of all lines of a log of Modbus, and of one serial line as it is received.

ModbusLog --> LogSniffers --> one TrackedLine and one LineDiagnosis for each line or connection --> findings
bytes, times --> Sniffer ---> the same for one line, findings as they are certain
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from itertools import chain

from barewire_workbench.diagnosis.modbus_line import LineDiagnosis
from barewire_workbench.diagnosis.modbus_noise import Located
from barewire_workbench.diagnosis.modbus_pieces import TrackedLine
from barewire_workbench.diagnosis.modbus_responses import STRAY, Envelopes
from barewire_workbench.diagnosis.tcp import diagnose_tcp
from barewire_workbench.diagnosis.verdict import LineVerdict, LogFinding
from barewire_workbench.frames.result import ProtocolName, counted
from barewire_workbench.recordings.modbus_log import UNREADABLE, LoggedBytes, ModbusLog
from barewire_workbench.recordings.modbus_log.marked import frame_pdu
from barewire_workbench.recordings.modbus_log.programs import BELOW_ERROR
from barewire_workbench.recordings.modbus_replay import LogSniffers, SerialProtocol
from barewire_workbench.recordings.model import LEFT_OUT
from barewire_workbench.sniffer import WINDOW, HeardLine, Sniffer, SnifferEvent, shapes

_NEAR = 4
"""So many damaged pieces on, the beginning of one may follow its end."""


def _ignore(event: SnifferEvent, protocol: ProtocolName) -> None:
    """Take an event, and do nothing."""


class ModbusLogDiagnosis:
    """A whole log of Modbus: each serial line and each TCP connection in it has its own diagnosis. `on_event` gets each
    event of the sniffer, and its framing, before the findings that follow from it. Not `whole`: other parts come.

    >>> from barewire_workbench.recordings.modbus_log import read_modbus_log
    >>> log = ModbusLogDiagnosis(read_modbus_log(b"1.0 01 03 00 00 00 02 C4 0B\\n1.1 01 83 02 C0 F1\\n"))
    >>> list(log.findings()), log.verdicts()[0][1].text
    ([], 'a device refused or reported something')
    """

    def __init__(
        self,
        log: ModbusLog,
        window: float = WINDOW,
        protocol: SerialProtocol | None = None,
        on_event: Callable[[SnifferEvent, ProtocolName], object] = _ignore,
        *,
        whole: bool = True,
    ) -> None:
        self.log = log = _with_framing(log)
        self._in_seconds = log.timed and all(item.at % 1 == 0 for item in log.items)
        window += 1.0 if self._in_seconds else 0.0
        self._on_event = on_event
        pieces = [item.data for item in log.items if isinstance(item, LoggedBytes) and len(item.data) > STRAY]
        tails = {data[before:] for data in pieces for before in range(1, STRAY + 1)}
        self._repeated = frozenset(data for data, count in Counter(pieces).items() if count > 1 or data in tails)
        self.lines: dict[str, LineDiagnosis] = {}
        self._tracked: dict[str, list[TrackedLine]] = {}
        self._place: tuple[int, bool | None] = (0, None)
        self._unreadable = 0  # lines
        self._left_out: list[str] = []
        self._envelopes = Envelopes()
        self._one_side = _one_side(log) if whole else ""
        behind = (item for item in reversed(log.items) if isinstance(item, LoggedBytes) or item.text.strip("`"))
        last = next(behind, None) if whole else None
        self._is_cut = isinstance(last, LoggedBytes) and len(last.data) > 0
        self._halves = _halves(log) if whole else {}
        self._sniffers = LogSniffers(log, window, protocol, self._wrapped)

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {len(self.lines)} lines>"

    def _wrapped(self, line: HeardLine, name: str, protocol: ProtocolName) -> HeardLine:
        tracked = TrackedLine(line, protocol)
        tracked.place(*self._place)
        self._tracked.setdefault(name, []).append(tracked)
        if name not in self.lines:
            self.lines[name] = LineDiagnosis(protocol, timed=self.log.timed)
            self.lines[name].one_side, self.lines[name].in_seconds = self._one_side, self._in_seconds
            self.lines[name].pieces.repeated, self.lines[name].pieces.is_cut = self._repeated, self._is_cut
            self.lines[name].pieces.halves = self._halves
        if len(self.lines) == 2:  # one alone has no name
            for other, diagnosis in self.lines.items():
                diagnosis.name = other
        elif len(self.lines) > 2:
            self.lines[name].name = name
        return tracked

    def findings(self, others: Iterable[ModbusLog] = ()) -> Iterator[LogFinding]:
        """Yield the findings, in the order in which they are certain. `others` are the parts behind the log."""
        for item in chain(self.log.items, chain.from_iterable(part.items for part in others)):
            if isinstance(item, LoggedBytes):
                self._place = item.line, item.from_client
                for tracked in self._tracked.get(item.connection, ()):
                    tracked.place(*self._place)
                around = self._envelopes.take(item.envelope) if item.envelope else None
                if around is not None and item.connection in self.lines:
                    yield self.lines[item.connection].note(Located(0, around, item.at, item.line))
                yield from self._taken(self._sniffers.feed(item))
            elif item.why == UNREADABLE:
                self._unreadable += 1
                for diagnosis in self.lines.values():
                    diagnosis.unread_at = item.at
            elif LEFT_OUT in item.why:
                self._left_out.append(item.why)
        for tracked in chain.from_iterable(self._tracked.values()):
            if self.log.form != "capture":  # whose end may be in the middle of a frame
                tracked.end()
        yield from self._taken(self._sniffers.end())
        for diagnosis in self.lines.values():
            yield from diagnosis.flush()
            # Of which line or connection they are is not known.
            diagnosis.unsettled.unseen += self._left_out
            if self._unreadable:
                diagnosis.unsettled.unseen.append(f"{counted(self._unreadable, 'line')} whose bytes cannot be read")

    def _taken(self, events: Iterable[tuple[str, SnifferEvent]]) -> Iterator[LogFinding]:
        by_line: dict[str, list[SnifferEvent]] = {}
        for name, event in events:
            self._on_event(event, self.lines[name].protocol)
            by_line.setdefault(name, []).append(event)
        for name in self._sniffers.touched:
            pieces = [piece for tracked in self._tracked[name] for piece in tracked.take()]
            if pieces or name in by_line:
                yield from self.lines[name].take(pieces, by_line.get(name, ()))

    def verdicts(self) -> list[tuple[str, LineVerdict]]:
        """Return the verdicts on each line or connection, with its name; the name is empty if there is only one."""
        named = list(self.lines.items()) or [("", LineDiagnosis("rtu"))]
        return [(diagnosis.name, verdict) for _, diagnosis in named for verdict in diagnosis.verdicts()]


def _one_side(log: ModbusLog) -> str:
    """Return what a log shows, if that is one side only, and no wait in vain for the other one; empty otherwise. A
    capture shows both, and bytes with times alone are those of a line."""
    pieces = [item for item in log.items if isinstance(item, LoggedBytes)]
    is_partial = any(BELOW_ERROR in note for note in log.notes)
    if log.form == "capture" or is_partial or not pieces or not all(item.data for item in pieces):
        return ""
    sides = {item.from_client for item in pieces}
    if None in sides and not log.timed:
        pdus = [frame_pdu(item.protocol, item.data) if item.protocol else None for item in pieces]
        sides = {(None if pdu is None or len(set(shapes(pdu))) == 1 else shapes(pdu)[0]) for pdu in pdus}
    return {True: "requests", False: "responses", None: ""}[sides.pop()] if len(sides) == 1 else ""


def _halves(log: ModbusLog) -> dict[bytes, str]:
    """Return the pieces of which two are one frame of RTU, the end printed before the beginning, and what to say of the
    beginning: their reader took them apart, and printed the end as left over."""
    found: dict[bytes, str] = {}
    items = (item for item in log.items if isinstance(item, LoggedBytes) and len(item.data) > STRAY)
    pieces = [item for item in items if item.protocol == "rtu" and frame_pdu("rtu", item.data) is None]
    for place, end in enumerate(pieces):
        for begin in pieces[place + 1 : place + _NEAR]:
            if frame_pdu("rtu", begin.data + end.data) is not None:
                sizes = f"{len(begin.data)} bytes in line {begin.line} and {len(end.data)} in line {end.line}"
                found[end.data] = ""
                found[begin.data] = f"response that its reader took apart: {sizes}, whose CRC fits together"
    return found


def _with_framing(log: ModbusLog) -> ModbusLog:
    """Return a log without any whole frame as one of Modbus TCP, if that framing explains what is wrong with one."""

    def is_tcp(data: bytes) -> bool:
        codes = {finding.code for finding in diagnose_tcp(data)} if data[2:4] == b"\0\0" else set()
        return bool(codes & {"mbap-header", "header-byte-order", "byte-count", "noise-after", "noise-before"})

    pieces = [item for item in log.items if isinstance(item, LoggedBytes)]
    if any(item.protocol is not None for item in pieces) or not any(is_tcp(item.data) for item in pieces):
        return log
    # An exception is a response.
    items = (
        item._replace(protocol="tcp", from_client=item.from_client is not False and item.data[7:8] < b"\x80")
        if isinstance(item, LoggedBytes)
        else item
        for item in log.items
    )
    return log._replace(items=tuple(items))


class LiveDiagnosis:
    """One serial line as it is received. A machine: feed bytes, and None at every `deadline`; `end` it once.

    >>> from barewire.rtu import RtuLine, Timing, encode
    >>> live = LiveDiagnosis(RtuLine(Timing.of(19200), role="listener"), "rtu")
    >>> for place in range(2):
    ...     _ = live.feed(encode(1, bytes.fromhex("03 0000 0001")), 0.2 * place)
    ...     _ = live.feed(encode(1, bytes.fromhex("03 02 0017")), 0.2 * place + 0.05)
    >>> live.end(0.5), live.verdicts()[0].text
    ([], 'nothing wrong')
    """

    def __init__(
        self,
        line: HeardLine,
        protocol: ProtocolName,
        window: float = WINDOW,
        on_event: Callable[[SnifferEvent, ProtocolName], object] = _ignore,
    ) -> None:
        self._on_event = on_event
        self._tracked = TrackedLine(line, protocol)
        self._sniffer = Sniffer(self._tracked, window=window)
        self._diagnosis = LineDiagnosis(protocol)

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self._diagnosis!r}>"

    @property
    def deadline(self) -> float | None:
        """When to feed None if nothing arrived."""
        return self._sniffer.deadline

    def feed(self, data: bytes | None, now: float) -> list[LogFinding]:
        """Take bytes, the last of them received at `now`, or None if only time has passed. Return the findings."""
        return self._taken(self._sniffer.feed(data, now))

    def end(self, now: float) -> list[LogFinding]:
        """End the reception, and return the last findings."""
        return [*self._taken(self._sniffer.end(now)), *self._diagnosis.flush()]

    def _taken(self, events: list[SnifferEvent]) -> list[LogFinding]:
        for event in events:
            self._on_event(event, self._diagnosis.protocol)
        return self._diagnosis.take(self._tracked.take(), events)

    def verdicts(self) -> list[LineVerdict]:
        """Return what the numbers show about the line."""
        return self._diagnosis.verdicts()
