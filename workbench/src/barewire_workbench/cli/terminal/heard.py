"""What `sniff --live` hears: a thread puts rows and findings, and the screen takes them ten times a second.

    line, bus or recording --> Exchanges or CanMonitor --> Row --> HeardRows --> screen
                          '--> the diagnosis of that kind --> findings, verdicts ---'

A row is what `barewire sniff` prints in one line, with the frames that `barewire explain` explains. Memory is bounded:
the oldest rows are dropped, and counted.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import Any, NamedTuple

from barewire.canopen.frame import CanFrame
from barewire.errors import EncodeError
from barewire.io.endpoint import Endpoint
from barewire.io.ports.serial import SerialSettings
from barewire.modbus.framing import Line
from barewire.modbus.messages.base import EXCEPTION_BIT
from barewire_workbench import Explanation, explain
from barewire_workbench.cli.output import Output
from barewire_workbench.cli.sources import RecordingFile, Source, UnreadPrinter, can_events
from barewire_workbench.diagnosis.can import explain_diagnosed_can
from barewire_workbench.diagnosis.can_log import CanLogDiagnosis
from barewire_workbench.diagnosis.exchange import frame_of
from barewire_workbench.diagnosis.modbus_log import LiveDiagnosis, ModbusLogDiagnosis
from barewire_workbench.diagnosis.verdict import LineVerdict, LogFinding
from barewire_workbench.frames.can import explain_segment
from barewire_workbench.frames.known_node import KnownNode
from barewire_workbench.frames.modbus_exchanges import Exchanges, PairedExchange, UnitNames
from barewire_workbench.frames.result import FrameRole, ProtocolName
from barewire_workbench.live.listen import listen_with
from barewire_workbench.monitor import CanMonitor
from barewire_workbench.monitor.events import (
    MonitorEvent,
    PdoReport,
    SdoTransferReport,
    event_columns,
    event_kind,
    event_line,
    is_wrong,
)
from barewire_workbench.monitor.recording import BusMonitors
from barewire_workbench.recordings.modbus_writer import ModbusRecordingWriter
from barewire_workbench.recordings.model import Recorded, RecordedItem
from barewire_workbench.sniffer import AmbiguousFrame, NoiseSeen, RequestSeen, ResponseSeen, SnifferEvent
from barewire_workbench.wire import longest_can_frame

KEPT = 10_000
"""Rows that are kept."""
_FINDINGS = 200
"""Findings that are kept."""
_SDO_FRAMES, _TRANSFER = 512, 32
"""SDO frames that are kept of all buses, and for one transfer."""
_SDO_IDS = (0x580 >> 7, 0x600 >> 7)
"""The upper four bits of the COB-IDs of SDO answers and requests."""
_SPAN = 10
"""Seconds over which rates are counted."""
_JUDGED = 1.0
"""Seconds from one verdict to the next."""

Explained = list[tuple[str, Explanation]]
"""Frames with what they are: "request", "response"."""


class Row(NamedTuple):
    """One line of the list. `what` is the time until the answer, or the service of CAN; `function` is the function
    code, or the kind of an event; `line` is as `barewire sniff` prints it. `origin` are the events, or the frames of
    CAN, for a recording."""

    at: float
    station: str
    what: str
    text: str
    wrong: bool
    function: str
    line: str
    origin: tuple[Any, ...]
    explained: Callable[[], Explained]


class Filter(NamedTuple):
    """Which rows are shown: those of one unit or node, with one function or service, that hold some text, wrong ones.

    >>> Filter.parse("unit=3 function=read error thermo")
    Filter(unit='3', function='read', errors=True, texts=('thermo',))
    """

    unit: str = ""
    function: str = ""
    errors: bool = False
    texts: tuple[str, ...] = ()

    @classmethod
    def parse(cls, text: str) -> Filter:
        """Return the filter that a text asks for: words, all of which must fit. Raises EncodeError."""
        chosen = cls()
        for word in text.lower().split():
            name, is_pair, value = word.partition("=")
            if word in ("error", "errors"):
                chosen = chosen._replace(errors=True)
            elif is_pair and name == "function":
                chosen = chosen._replace(function=value)
            elif is_pair and name in ("unit", "node"):
                if not value.isdecimal():
                    raise EncodeError(f"{word}: expected a number, such as {name}=3")
                chosen = chosen._replace(unit=value)
            else:
                chosen = chosen._replace(texts=(*chosen.texts, word))
        return chosen

    def fits(self, row: Row) -> bool:
        """Return whether a row is shown."""
        if (self.errors and not row.wrong) or (self.unit and row.station.rpartition(" ")[2] != self.unit):
            return False
        if self.function and self.function != row.function:
            # The text of an exchange begins with the name of its function; `what` is a service, or begins with a digit.
            texts = () if self.function.isdecimal() else (row.text.lower(), row.what.lower())
            if not any(text.startswith(self.function) for text in texts):
                return False
        return all(text in row.line.lower() for text in self.texts)


class Rates:
    """What was counted in the last ten seconds, second by second.

    >>> rates = Rates()
    >>> rates.count(100.2, rows=1), rates.count(103.9, rows=1, busy=0.5)
    (None, None)
    >>> rates.per_second("rows", 103.9), rates.per_second("busy", 103.9)  # of four seconds so far
    (0.5, 0.125)
    """

    def __init__(self) -> None:
        self._seconds: dict[int, dict[str, float]] = {}
        self._first: float | None = None

    def count(self, at: float, **numbers: float) -> None:
        """Count what happened at a time."""
        self._first = at if self._first is None else self._first
        counts = self._seconds.setdefault(int(at), {})
        for name, number in numbers.items():
            counts[name] = counts.get(name, 0) + number
        while len(self._seconds) > _SPAN + 1:
            del self._seconds[min(self._seconds)]

    def per_second(self, name: str, now: float) -> float:
        """Return how often, on average."""
        since = int(now) - _SPAN
        total = sum(counts.get(name, 0) for second, counts in self._seconds.items() if since < second <= now)
        return total / min(_SPAN, max(1, int(now) - int(self._first or now) + 1))


class HeardRows:
    """What was heard. The thread that reads calls `put`, `load`, `find` and `judge`, the screen `take`.

    `live`: its times are those of the clock. At most `limit` rows wait for the screen.
    """

    def __init__(self, *, live: bool = False, limit: int = KEPT, clock: Callable[[], float] = time.time) -> None:
        self.live, self.limit = live, limit
        self.timed = True
        self.noun = "exchanges"
        self.heading = {"station": "unit", "what": "after"}
        self.total = self.errors = self.dropped = 0
        self.findings: deque[LogFinding] = deque(maxlen=_FINDINGS)
        self.found = 0
        self.verdicts: list[str] = []
        self.rates = Rates()
        self.has_load = False
        self.ended = False
        self.error: BaseException | None = None
        self._incoming: deque[Row] = deque()
        self._latest = self._judged = 0.0
        self._clock = clock
        self._lock = threading.Lock()

    @property
    def now(self) -> float:
        """The time to which rates refer: that of the clock, or of the latest row of a recording."""
        return self._clock() if self.live and not self.ended else self._latest

    def put(self, row: Row) -> None:
        """Add a row."""
        with self._lock:
            self._latest = max(self._latest, row.at)
            self.total += 1
            self.errors += row.wrong
            self.rates.count(row.at, rows=1)
            self._append(row)

    def load(self, at: float, seconds: float) -> None:
        """Count the seconds for which a frame has occupied the line or bus."""
        self.has_load = True
        with self._lock:
            self.rates.count(at, busy=seconds)

    def note(self, text: str) -> None:
        """Add a row about the recording itself, which is not counted."""
        with self._lock:
            self._append(Row(self._latest, "", "note", text, False, "", text, (), list))

    def _append(self, row: Row) -> None:
        self._incoming.append(row)
        if len(self._incoming) > self.limit:
            self._incoming.popleft()
            self.dropped += 1

    def find(self, findings: Iterable[LogFinding]) -> None:
        """Add findings."""
        for finding in findings:
            self.found += 1
            self.findings.append(finding)

    def judge(self, verdicts: Callable[[], list[tuple[str, LineVerdict]]], *, at_once: bool = False) -> None:
        """Keep what the numbers show about the line, once a second."""
        now = time.monotonic()
        if at_once or now >= self._judged + _JUDGED:
            self._judged = now
            self.verdicts = [f"{name}  {verdict.sentence}".lstrip() for name, verdict in verdicts()]

    def take(self) -> list[Row]:
        """Return the rows since the last call."""
        with self._lock:
            rows, self._incoming = self._incoming, deque()
            return list(rows)

    def per_second(self, name: str) -> float:
        """Return how many "rows" or seconds "busy" a second has."""
        with self._lock:
            return self.rates.per_second(name, self.now)

    def run(self, read: Callable[[HeardRows], None]) -> None:
        """Read to the end, in a thread; an error is kept for the screen."""
        try:
            read(self)
        except BaseException as error:
            self.error = error
        self.ended = True


# Modbus


def hear_modbus(
    heard: HeardRows,
    traffic: Source,
    *,
    seconds: float | None,
    window: float,
    names: UnitNames | None,
    file: RecordingFile | None,
) -> None:
    """Read a line or a recording of Modbus to its end, or until `traffic.stop`."""
    unread = UnreadPrinter("no bytes of a frame", Output("text"), heard.note)
    if (endpoint := traffic.endpoint) is not None:
        rows = _ModbusRows(heard, names, file, _character(endpoint))

        def listener_of(line: Line) -> LiveDiagnosis:
            framing: ProtocolName = "ascii" if endpoint.framing == "ascii" else "rtu"
            live = LiveDiagnosis(line, framing, window, rows.take)
            rows.verdicts = lambda: [("", verdict) for verdict in live.verdicts()]
            return live

        heard.find(listen_with(endpoint, listener_of, traffic.stop, seconds=seconds))
    else:
        first, others = traffic.modbus_parts(unread)
        heard.timed = first.timed
        rows = _ModbusRows(heard, names, file)
        log = ModbusLogDiagnosis(first, window, traffic.protocol, rows.take)
        rows.verdicts = log.verdicts
        heard.find(log.findings(others))
    rows.end()
    unread.end()


def _character(endpoint: Endpoint) -> float:
    """Return the seconds of one character; 0 behind a serial server, whose line is not known."""
    return SerialSettings.of(endpoint).timing.character if endpoint.is_serial_port else 0.0


class _ModbusRows:
    """Makes rows of the events of a sniffer. `character` is the time of one byte, 0 if it is not known."""

    def __init__(
        self, heard: HeardRows, names: UnitNames | None, file: RecordingFile | None, character: float = 0.0
    ) -> None:
        self.verdicts: Callable[[], list[tuple[str, LineVerdict]]] = list
        self._heard, self._file, self._character = heard, file, character
        self._exchanges = Exchanges(timed=heard.timed, names=names)
        self._protocol: ProtocolName = "rtu"
        self._writer = ModbusRecordingWriter()
        if file is not None:
            file.write(self._writer.start, frame=False)

    def take(self, event: SnifferEvent, protocol: ProtocolName) -> None:
        """Take an event, and its framing."""
        self._protocol = protocol
        if self._file is not None and (packet := self._writer.put(event)):
            self._file.write(packet)
        if self._character and (frame := _frame(event, protocol)) is not None:
            self._heard.load(event.at, len(frame.data) * self._character)
        self._put(self._exchanges.feed(event))
        self._heard.judge(self.verdicts)

    def end(self) -> None:
        """Put what is left."""
        self._put(self._exchanges.end())
        self._heard.judge(self.verdicts, at_once=True)

    def _put(self, exchanges: Iterable[PairedExchange]) -> None:
        for exchange in exchanges:
            frames = [frame for event in exchange.events if (frame := _frame(event, self._protocol)) is not None]
            after = "" if exchange.seconds is None else f"{1e3 * exchange.seconds:.1f} ms"
            self._heard.put(
                Row(
                    exchange.at,
                    exchange.station,
                    after,
                    f"{exchange.text}{exchange.remark}",
                    exchange.wrong,
                    _function(exchange.events[0]),
                    str(exchange),
                    exchange.events,
                    partial(_explained, frames),
                )
            )


class _Frame(NamedTuple):
    """A frame of an exchange: what it is, its bytes, and how they are explained."""

    word: str
    data: bytes
    protocol: ProtocolName
    role: FrameRole | None = None

    @property
    def digits(self) -> str:
        """The bytes in hexadecimal, or the characters of ASCII."""
        return self.data.decode("ascii", "replace").strip() if self.protocol == "ascii" else self.data.hex(" ").upper()


def _frame(event: SnifferEvent, protocol: ProtocolName) -> _Frame | None:
    match event:
        case NoiseSeen():
            return _Frame("no frame", event.noise.data, protocol)
        case AmbiguousFrame():
            return _Frame("seen once", frame_of(protocol, None, event.unit, event.pdu), protocol)
        case RequestSeen() | ResponseSeen():
            role: FrameRole = "request" if isinstance(event, RequestSeen) else "response"
            framing: ProtocolName = protocol if event.transaction is None else "tcp"
            return _Frame(role, frame_of(framing, event.transaction, event.unit, event.pdu), framing, role)
    return None


def _explained(frames: list[_Frame]) -> Explained:
    return [(f"{frame.word}  {frame.digits}", explain(frame.protocol, frame.data, frame.role)) for frame in frames]


def _function(event: SnifferEvent) -> str:
    """Return the function code of a frame."""
    if isinstance(event, RequestSeen | ResponseSeen | AmbiguousFrame):
        return str(event.pdu[0] & ~EXCEPTION_BIT)
    return ""


# CAN


def hear_can(
    heard: HeardRows,
    traffic: Source,
    monitors: KeepingMonitors,
    diagnosis: CanLogDiagnosis,
    *,
    is_shown: Callable[[MonitorEvent], bool],
    file: RecordingFile | None,
) -> None:
    """Read a bus or a recording of CAN to its end, or until `traffic.stop`."""
    heard.noun, heard.heading = "events", {"station": "node", "what": "service"}
    bitrate = int(traffic.endpoint.options.get("bitrate", 0)) if traffic.endpoint is not None else 0

    def items() -> Iterator[RecordedItem | float]:
        for item in traffic.can_items(until_interrupt=False):
            if traffic.stop.is_set():
                return
            heard.find(diagnosis.feed(item))
            if bitrate and isinstance(item, Recorded) and isinstance(item.frame, CanFrame):
                bits = longest_can_frame(len(item.frame.data), extended=item.frame.extended)
                heard.load(item.at, bits / bitrate)
            yield item

    for bus, event in can_events(items(), monitors, diagnosis.only, file):
        if is_shown(event):
            heard.put(monitors.row(bus, event))
        heard.judge(diagnosis.verdicts)
    heard.find(diagnosis.end())
    heard.judge(diagnosis.verdicts, at_once=True)


class KeepingMonitors(BusMonitors):
    """The monitors of all buses, which keep the frames of the transfers under way."""

    def __init__(self, known: Iterable[KnownNode] = (), bus: str | None = None, *, complete: bool = False) -> None:
        super().__init__(known, bus, complete=complete)
        self._sdo: deque[_KeptFrame] = deque(maxlen=_SDO_FRAMES)
        self._now: _KeptFrame | None = None

    def feed(self, item: RecordedItem) -> Iterator[tuple[str, MonitorEvent]]:
        """Take an item, as the monitors do; note what it is while its transfer is under way."""
        self._now = None
        if isinstance(item, Recorded) and (monitor := self.monitor(item.bus)) is not None:
            frame = item.frame
            segment = isinstance(frame, CanFrame) and monitor.takes_segment(frame)
            self._now = _KeptFrame(item, segment)
            if isinstance(frame, CanFrame) and (monitor.channels.find(frame) or frame.id >> 7 in _SDO_IDS):
                self._sdo.append(self._now)
        yield from super().feed(item)

    def row(self, bus: str, event: MonitorEvent) -> Row:
        """Return the row of an event that was yielded last, with its frames."""
        monitor = self.monitors.get(bus)
        frames = [] if self._now is None or event.at < self._now.item.at else [self._now]
        if isinstance(event, SdoTransferReport) and monitor is not None:
            began = event.at if event.began is None else event.began
            frames = [kept for kept in self._sdo if kept.item.bus == bus and kept.item.at >= began]
            frames = [kept for kept in frames if _channel(monitor, kept) == event.channel][-_TRANSFER:]
        explained = partial(_explained_can, frames, monitor)
        if isinstance(event, PdoReport):  # its mapping may change
            frames_now = explained()
            explained = partial(list, frames_now)
        several = len(self.monitors) > 1 and bus
        node, service, text = event_columns(event)
        station, line = (f"{bus} {node}", f"{bus}  {event_line(event)}") if several else (node, event_line(event))
        origin = tuple(kept.item for kept in frames)
        return Row(event.at, station, service, text, is_wrong(event), event_kind(event), line, origin, explained)


class _KeptFrame(NamedTuple):
    """A frame, and whether it was a segment of a block transfer when it came."""

    item: Recorded
    segment: bool


def _channel(monitor: CanMonitor, kept: _KeptFrame) -> int | None:
    """Return the channel of a frame, as the COB-ID of its requests."""
    found = monitor.channels.find(kept.item.frame) if isinstance(kept.item.frame, CanFrame) else None
    return None if found is None else found[0].channel


def _explained_can(frames: list[_KeptFrame], monitor: CanMonitor | None) -> Explained:
    if monitor is None:
        return []
    return [
        (
            str(kept.item.frame),
            explain_segment(kept.item.frame)
            if kept.segment and isinstance(kept.item.frame, CanFrame)
            else explain_diagnosed_can(kept.item.frame, monitor.pdos),
        )
        for kept in frames
    ]
