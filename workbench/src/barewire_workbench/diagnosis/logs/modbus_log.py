"""Diagnosis of Modbus traffic: a log with all lines and connections in it, or one line as it is received.

The two ways:

        log      items --> LogSniffers --+--> one LineDiagnosis for each line --> findings, verdicts
        live     bytes --> Sniffer ------'
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import chain

from barewire.modbus.framing import Line
from barewire.modbus.sniffer import WINDOW, Sniffer, SnifferEvent
from barewire_workbench.diagnosis.logs.modbus_line import LineDiagnosis
from barewire_workbench.diagnosis.logs.modbus_pieces import TrackedLine
from barewire_workbench.diagnosis.logs.verdict import LineVerdict, LogFinding
from barewire_workbench.frames.result import ProtocolName, counted
from barewire_workbench.recordings.modbus_log import UNREADABLE, LoggedBytes, ModbusLog
from barewire_workbench.recordings.modbus_replay import LogSniffers, SerialProtocol
from barewire_workbench.recordings.model import LEFT_OUT


class ModbusLogDiagnosis:
    """A whole log of Modbus: each serial line and each TCP connection in it has its own diagnosis.

    >>> from barewire_workbench.recordings.modbus_log import read_modbus_log
    >>> log = ModbusLogDiagnosis(read_modbus_log(b"1.0 01 03 00 00 00 02 C4 0B\\n1.1 01 83 02 C0 F1\\n"))
    >>> list(log.findings()), log.verdicts()[0][1].text
    ([], 'a device refused or reported something')
    """

    def __init__(self, log: ModbusLog, window: float = WINDOW, protocol: SerialProtocol | None = None) -> None:
        self.log = log
        self.lines: dict[str, LineDiagnosis] = {}
        self._tracked: dict[str, list[TrackedLine]] = {}
        self._place: tuple[int, bool | None] = (0, None)
        self._unreadable = 0  # lines
        self._left_out: list[str] = []
        self._sniffers = LogSniffers(log, window, protocol, self._wrapped)

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {len(self.lines)} lines>"

    def _wrapped(self, line: Line, name: str, protocol: ProtocolName) -> Line:
        tracked = TrackedLine(line, protocol)
        tracked.place(*self._place)
        self._tracked.setdefault(name, []).append(tracked)
        if name not in self.lines:
            self.lines[name] = LineDiagnosis(protocol, timed=self.log.timed)
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
                yield from self._taken(self._sniffers.feed(item))
            elif item.why == UNREADABLE:
                self._unreadable += 1
            elif LEFT_OUT in item.why:
                self._left_out.append(item.why)
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
            by_line.setdefault(name, []).append(event)
        for name in self._sniffers.touched:
            pieces = [piece for tracked in self._tracked[name] for piece in tracked.take()]
            if pieces or name in by_line:
                yield from self.lines[name].take(pieces, by_line.get(name, ()))

    def verdicts(self) -> list[tuple[str, LineVerdict]]:
        """Return the verdicts on each line or connection, with its name; the name is empty if there is only one."""
        named = list(self.lines.items()) or [("", LineDiagnosis("rtu"))]
        return [(diagnosis.name, verdict) for _, diagnosis in named for verdict in diagnosis.verdicts()]


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

    def __init__(self, line: Line, protocol: ProtocolName, window: float = WINDOW) -> None:
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
        events = self._sniffer.feed(data, now)
        return self._diagnosis.take(self._tracked.take(), events)

    def end(self, now: float) -> list[LogFinding]:
        """End the reception, and return the last findings."""
        events = self._sniffer.end(now)
        return [*self._diagnosis.take(self._tracked.take(), events), *self._diagnosis.flush()]

    def verdicts(self) -> list[LineVerdict]:
        """Return what the numbers show about the line."""
        return self._diagnosis.verdicts()
