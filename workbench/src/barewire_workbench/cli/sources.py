"""What `sniff`, `diagnose` and `record` have in common: the line, bus or recording that they read, the options for it,
the lines of a recording that hold no frame, and the file of `--write`.
"""

from __future__ import annotations

import signal
import sys
import threading
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from io import BufferedReader
from pathlib import Path
from typing import BinaryIO, Self, cast

import click

from barewire.errors import BarewireError, DecodeError, EncodeError, PortError
from barewire.io.canopen.bus.port import listen_can
from barewire.io.endpoint import Endpoint
from barewire.io.ports.network import reason
from barewire_workbench.cli.arguments import Choice, duration
from barewire_workbench.cli.output import Output, note, opened_file, print_json
from barewire_workbench.monitor.events import MonitorEvent
from barewire_workbench.monitor.recording import (
    BUSES_MAX,
    LOG_ENDINGS,
    BusMonitors,
    CanRecordingWriter,
    is_can_recording,
    read_recording,
)
from barewire_workbench.recordings.capture import MODBUS_PORTS, is_capture
from barewire_workbench.recordings.modbus_log import (
    UNREADABLE,
    LoggedBytes,
    ModbusLog,
    read_modbus_log,
    read_modbus_parts,
)
from barewire_workbench.recordings.modbus_log.reader import is_can_capture
from barewire_workbench.recordings.modbus_replay import SerialProtocol
from barewire_workbench.recordings.model import Recorded, RecordedItem, Unread
from barewire_workbench.recordings.source import RecordingSource
from barewire_workbench.sniffer import WINDOW

FORMATS = "a recording: pcapng, pcap, candump, ASC, BLF, a log of a Modbus program, or lines of bytes in hexadecimal"
_LIVE_BUS = "can0"
_DECISIVE = 0x1_0000
"""Bytes that show whether a recording is of CAN."""

seconds_option = click.option(
    "--seconds", type=duration, metavar="S", help="Stop after this time; without it, at Ctrl-C."
)
window_option = click.option(
    "--window",
    type=duration,
    metavar="S",
    help=f"Modbus: longest time from a request to its response, in seconds; by default {WINDOW:g}.",
)
protocol_option = click.option(
    "--protocol",
    type=Choice(["rtu", "ascii"]),
    help="Of a log or hex dump of a serial line; by default its bytes tell.",
)
ports_option = click.option(
    "--port",
    "ports",
    type=click.IntRange(1, 65535),
    multiple=True,
    help="TCP port of servers in a capture, besides 502.",
)


class Source:
    """The ENDPOINT, FILE or - that a command reads; a FILE is opened here, and no more of it read than is needed to
    know whether it is of CAN.

    Raises BarewireError for an empty recording, EncodeError for --seconds of one.
    """

    def __init__(
        self,
        name: str,
        seconds: float | None,
        ports: tuple[int, ...] = (),
        protocol: SerialProtocol | None = None,
        *,
        whole: bool = False,
        stop: threading.Event | None = None,
    ) -> None:
        self.name = name
        self.ports = MODBUS_PORTS.union(ports)
        self.protocol = protocol
        self._seconds = seconds
        self._only_recorded: dict[str, object] = {"--port": ports, "--protocol": protocol}
        self.stop = stop or threading.Event()
        """Ends the reception, and the reading of a FILE."""
        self.endpoint = Endpoint.parse(name) if "://" in name else None
        if self.endpoint is not None:
            self.is_can = self.endpoint.scheme == "can"
            return
        self.recording = _opened(name, seconds, self.stop)
        if whole:
            self.recording.whole()
        self.is_can = _is_can(self.recording, self.ports)

    def check_options(self, for_modbus: Mapping[str, object], for_can: Mapping[str, object]) -> None:
        """Raise EncodeError for the first option that is given and is for the other kind of line, bus or recording."""
        kind, others = ("Modbus", for_modbus) if self.is_can else ("a CAN bus", for_can)
        refused = {option: (given, kind) for option, given in others.items()}
        if self.endpoint is not None:  # a line has no ports, and its URL the protocol
            for option, given in self._only_recorded.items():
                refused.setdefault(option, (given, "a recording"))
        for option, (given, kind) in refused.items():
            if given:
                raise EncodeError(f"{option} is for {kind}, which {self.name} is not")

    def not_a_recording(self, error: DecodeError) -> BarewireError:
        """Return the error of a recording that cannot be read."""
        return BarewireError(f"{self.name}: {error.text}; expected {FORMATS}")

    def can_items(self, *, until_interrupt: bool = True) -> Iterator[RecordedItem | float]:
        """Yield the frames of a CAN bus or its recording; of a bus, until `stop` or Ctrl-C, a time alone when none was
        received."""
        if self.endpoint is None:
            yield from read_recording(self.recording)
            return
        with stopped_by_interrupt(self.stop) if until_interrupt else nullcontext():
            for now, frame in listen_can(self.endpoint, self.stop, seconds=self._seconds):
                yield now if frame is None else Recorded(now, _LIVE_BUS, frame)

    def modbus_parts(self, unread: UnreadPrinter) -> tuple[ModbusLog, Iterator[ModbusLog]]:
        """Return the first part of a recording of Modbus, and the others as they come."""
        if self.protocol is not None and is_capture(self.recording.start):
            raise EncodeError(f"--protocol is for a log or dump: in {self.name} each packet has its own")

        def read() -> Iterator[ModbusLog]:
            try:
                yield from read_modbus_parts(self.recording, ports=self.ports, protocol=self.protocol)
            except DecodeError as error:
                raise self.not_a_recording(error) from None

        parts = unread.parts(read())
        return next(parts), parts

    def note_cut_lines(self) -> None:
        """Print which lines of a recording were too long."""
        if self.endpoint is None and (cut := self.recording.cut):
            lines = f"line {cut[0]}" if len(cut) == 1 else f"{len(cut)} lines, the first of them line {cut[0]},"
            note(f"the end of {lines} was left out: too many characters")


def _opened(name: str, seconds: float | None, stop: threading.Event) -> RecordingSource:
    if seconds is not None:
        raise EncodeError("--seconds is for a line; a recording ends by itself")
    if name == "-":
        if sys.stdin is None:  # `<&-`
            raise PortError("-: standard input is closed")
        stream: BinaryIO = sys.stdin.buffer
    else:
        stream = opened_file(name)
        click.get_current_context().call_on_close(stream.close)

    def read(size: int) -> bytes:
        if stop.is_set():
            return b""
        try:
            return cast(BufferedReader, stream).read1(size)
        except KeyboardInterrupt:
            if Path(name).is_file():
                raise
            return b""  # Ctrl-C ends what is still being written
        except OSError as error:
            raise PortError(f"{name}: {error.strerror or error}") from None

    recording = RecordingSource(read)
    if not recording.start:
        raise BarewireError(f"{name}: the {'input' if name == '-' else 'file'} is empty; expected {FORMATS}")
    return recording


def _is_can(recording: RecordingSource, ports: frozenset[int]) -> bool:
    if is_capture(recording.start):
        return is_can_capture(recording, ports)
    while not is_can_recording(recording.start):
        if len(recording.start) > _DECISIVE or _has_modbus(recording.start) or not recording.more():
            return False
    return True


def _has_modbus(start: bytes) -> bool:
    try:
        log = read_modbus_log(start[: start.rfind(b"\n") + 1])
    except DecodeError:
        return False
    return any(isinstance(item, LoggedBytes) for item in log.items)


@contextmanager
def stopped_by_interrupt(stop: threading.Event) -> Iterator[None]:
    """Let the first Ctrl-C end the reception, so that the summary is printed; the second one ends the program."""

    def end_reception(number: int, frame: object) -> None:
        stop.set()
        signal.signal(signal.SIGINT, before)

    before = signal.getsignal(signal.SIGINT)
    signal.signal(signal.SIGINT, end_reception)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


class UnreadPrinter:
    """Prints the lines that hold no frame, as objects or in short on stderr, and the notes about a log.

    A screen shows the notes itself: it gives another `note`.
    """

    def __init__(self, nothing: str, output: Output, note: Callable[[str], object] = note) -> None:
        self._nothing, self._output, self._note = nothing, output, note
        self._first: dict[bool, Unread] = {}  # by whether they look as if they held bytes
        self._numbers: Counter[bool] = Counter()

    def items(self, items: Iterable[LoggedBytes | RecordedItem]) -> None:
        """Print or count those of the items that are unread."""
        for item in items:
            if not isinstance(item, Unread):
                continue
            if self._output.as_json:
                print_json({"event": "unread", "line": item.line, "text": item.text, "why": item.why})
            if not item.line:  # several packets at once
                if not self._output.as_json:
                    self._note(item.why)
                continue
            self._first.setdefault(item.why == UNREADABLE, item)
            self._numbers[item.why == UNREADABLE] += 1

    def parts(self, parts: Iterable[ModbusLog]) -> Iterator[ModbusLog]:
        """Yield the parts of a log, with their notes and unread lines printed."""
        for log in parts:
            for text in log.notes:
                self._note(text)
            self.items(log.items)
            yield log

    def end(self) -> None:
        """Print how many lines are unread, unless each was printed."""
        for has_bytes, first in sorted(self._first.items()) if not self._output.as_json else ():
            number = self._numbers[has_bytes]
            lines = "1 line holds" if number == 1 else f"{number} lines hold"
            what = "bytes that cannot be read" if has_bytes else self._nothing
            self._note(f"{lines} {what}, the first is line {first.line}: {first.text or first.why}")


def can_events(
    items: Iterable[RecordedItem | float], monitors: BusMonitors, bus: str | None, file: RecordingFile | None
) -> Iterator[tuple[str, MonitorEvent]]:
    """Yield the events of the items of a `Source`, each with its bus; the file gets the frames."""
    writer, buses = CanRecordingWriter("" if file is None else file.name), dict[str, None]()
    if file is not None:
        file.write(writer.start, frame=False)
    for item in items:
        if isinstance(item, float):
            # Nothing was received up to now: a message that is due is missing.
            for bus_name, monitor in monitors.monitors.items():
                for event in monitor.feed(None, item):
                    yield bus_name, event
            continue
        if file is not None and isinstance(item, Recorded) and bus in (None, item.bus):
            file.write(writer.put(item.at, item.bus, item.frame))
        if not isinstance(item, Unread) and len(buses) < BUSES_MAX:
            buses[item.bus] = None
        yield from monitors.feed(item)
    yield from monitors.end()
    check_bus(bus, buses)


def check_bus(bus: str | None, seen: Collection[str]) -> None:
    """Raise BarewireError if no frame was on the bus of `--bus`, and on others some were."""
    if bus is not None and seen and bus not in seen:
        raise BarewireError(f"--bus {bus}: no frames on it; there are frames on {', '.join(seen)}")


# The file of --write


def recording_file(name: str | None) -> AbstractContextManager[RecordingFile | None]:
    """Return the file of `--write`, or nothing without that option."""
    return nullcontext() if name is None else RecordingFile(name)


def check_ending(name: str, is_can: bool) -> None:
    """Raise EncodeError for a file whose ending promises another format than the one that would be written. A name
    without an ending, such as that of a pipe, gets pcapng."""
    endings = (".pcapng", *LOG_ENDINGS) if is_can else (".pcapng",)
    ending = Path(name).suffix
    if ending and ending.lower() not in endings:
        listed = " or ".join(filter(None, (", ".join(endings[:-1]), endings[-1])))
        raise EncodeError(f"--write {name}: expected a name that ends in {listed}")


class RecordingFile:
    """A file for `--write`, complete after every frame, however the command ends: it has no buffer, and the part of a
    frame for which the disk had no room is removed."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._frames = 0
        self._size = 0
        self._refused: PortError | None = None
        try:
            self._file = Path(name).open("wb", buffering=0)  # noqa: SIM115 - closed in `__exit__`
        except OSError as error:
            raise PortError(f"{name}: {error.strerror}") from None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, _: object, error: object, __: object) -> None:
        self._file.close()
        if isinstance(error, PortError) and error is not self._refused:  # of the line or bus
            content = f"the {self._frames} frames before" if self._frames else "no frame"
            error.add_note(f"{self.name} has {content}")

    def write(self, data: bytes, *, frame: bool = True) -> None:
        """Write a frame, or the head of the file. Raises PortError if that fails, and keeps the frames before."""
        unwritten = memoryview(data)
        try:
            while unwritten:
                unwritten = unwritten[self._file.write(unwritten) :]
        except OSError as error:
            with suppress(OSError):
                self._file.truncate(self._size)
            content = f"it has the {self._frames} frames before" if self._frames else "nothing was written"
            self._refused = PortError(f"{self.name}: {reason(error)}; {content}")
            raise self._refused from None
        self._size += len(data)
        self._frames += frame
