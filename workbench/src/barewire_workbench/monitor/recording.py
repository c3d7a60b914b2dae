"""Recordings of CAN buses: read in any of the file formats, monitored bus by bus, and written.

The formats:

    candump      its log, and its screen output            Vector ASC      text
    pcapng, pcap SocketCAN frames, link type 227           Vector BLF      binary
    log of the CANopen conformance test tool of CiA        PEAK TRC, python-can, BUSMASTER   text
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Iterator
from itertools import chain

from barewire.canopen.frame import AnyFrame
from barewire.errors import DecodeError
from barewire_workbench.frames.known_node import KnownNode
from barewire_workbench.monitor.events import MonitorEvent
from barewire_workbench.monitor.monitor import CanMonitor
from barewire_workbench.recordings.blf import BLF_MAGIC, read_blf
from barewire_workbench.recordings.can_texts import (
    is_asc,
    is_busmaster,
    is_can_notes,
    is_conformance_log,
    is_python_can_text,
    is_trc,
    read_asc,
    read_busmaster,
    read_can_notes,
    read_conformance_log,
    read_python_can_text,
    read_trc,
)
from barewire_workbench.recordings.candump import are_differences, has_times, is_candump, log_line, read_candump
from barewire_workbench.recordings.capture import (
    MODBUS_PORTS,
    SOCKETCAN,
    file_header,
    from_packet,
    interface_block,
    is_can_packet,
    is_capture,
    modbus_payload,
    packet_block,
    to_packet,
)
from barewire_workbench.recordings.modbus_log.reader import is_can_capture
from barewire_workbench.recordings.model import Dropped, LeftOut, Recorded, RecordedItem, Unread, unread
from barewire_workbench.recordings.source import RecordingSource

BUSES_MAX = 64
_TEXT_FORMS: tuple[tuple[Callable[[str], bool], Callable[[Iterable[str]], Iterator[RecordedItem]]], ...] = (
    (is_trc, read_trc),
    (is_python_can_text, read_python_can_text),
    (is_asc, read_asc),
    (is_busmaster, read_busmaster),
    (is_candump, read_candump),
    (is_conformance_log, read_conformance_log),
    (is_can_notes, read_can_notes),
)
_INSPECTED = 0x1_0000
"""The number of bytes at the beginning that decide which format a text has."""
_LONGEST_LINE = 10_000
"""Characters of a line that are read; a CAN FD frame has less than 300."""


def is_can_recording(data: bytes, ports: Container[int] = MODBUS_PORTS) -> bool:
    """Return whether this is a recording of a CAN bus, in a format that `read_recording` reads.

    >>> is_can_recording(b"(1.5) can0 705#05"), is_can_recording(b"12.5 01 03 00 00 00 02 C4 0B")
    (True, False)
    """
    if data[:4] == BLF_MAGIC:
        return True
    if is_capture(data):
        return is_can_capture(RecordingSource.of(data), ports)
    text = _text(data[:_INSPECTED])
    return any(is_form(text) for is_form, _ in _TEXT_FORMS)


def is_timed(data: bytes) -> bool:
    """Return whether a recording has times; without them its frames are in order only, and count as 1 ms apart.

    >>> is_timed(b"(1.5) can0 705#05"), is_timed(b"  can0  705   [1]  05")
    (True, False)
    """
    if data[:4] == BLF_MAGIC or is_capture(data):
        return True
    text = _text(data[:_INSPECTED])
    if is_asc(text) or is_trc(text) or is_python_can_text(text) or is_busmaster(text):
        return True
    return has_times(text) and not is_conformance_log(text)


def _text(data: bytes) -> str:
    """Return the bytes as text: UTF-8, or Windows-1252 as programs on Windows write names and remarks."""
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return _of_windows(data)


def _of_windows(data: bytes) -> str:
    return data.decode("cp1252", "replace")


def read_recording(recording: bytes | RecordingSource) -> Iterator[RecordedItem]:
    """Return the frames, and the parts that cannot be read, in the order of the file; of a text as they come.

    >>> [str(item.frame) for item in read_recording(b"(1.5) can0 705#05")]
    ['705#05']

    Raises DecodeError if the bytes are not a recording of CAN.
    """
    source = RecordingSource.of(recording)
    if is_capture(source.start):
        return _read_capture(source)
    if source.start[:4] == BLF_MAGIC:
        return read_blf(source)
    start = _text(source.start[:_INSPECTED])
    for is_form, read in _TEXT_FORMS:
        if is_form(start):
            lines = chain.from_iterable(source.text_parts(_of_windows, _LONGEST_LINE))
            return read_candump(lines, are_differences(start)) if read is read_candump else read(lines)
    forms = "candump, ASC, BLF, TRC, pcapng, pcap, text of BUSMASTER or python-can, or a CiA log"
    text = f"not a recording of CAN: expected {forms}"
    raise DecodeError("value", source.start[:16], 0, text)


def _read_capture(source: RecordingSource) -> Iterator[RecordedItem]:
    now, left_out = 0.0, LeftOut("CAN")
    for number, packet in source.packets:
        if isinstance(packet, DecodeError):  # the file is broken after the last packet
            yield unread(now, number, packet, "")
        elif is_can_packet(packet):
            now = packet.at
            if packet.dropped:
                yield Dropped(now, packet.interface, packet.dropped)
            try:
                yield Recorded(now, packet.interface, from_packet(packet), number)
            except DecodeError as error:
                yield unread(now, number, error, packet.data.hex(" "))
        else:
            is_modbus = modbus_payload(packet) is not None
            left_out.of_other_bus += is_modbus
            left_out.neither += not is_modbus
    yield from left_out.items(now)


class BusMonitors:
    """All buses of a recording, each with its own monitor: `feed` each item, then `end`. `bus` selects one bus.

    With `complete` the recording is taken to have every frame: what would be a gap is a violation.
    """

    def __init__(self, known: Iterable[KnownNode] = (), bus: str | None = None, *, complete: bool = False) -> None:
        self._complete = complete
        self._known = tuple(known)
        self._only = bus
        self.monitors: dict[str, CanMonitor] = {}

    def feed(self, item: RecordedItem) -> Iterator[tuple[str, MonitorEvent]]:
        """Take an item, and yield its events, each with the name of the bus."""
        if isinstance(item, Unread):
            yield "", item
            return
        if self._only is not None and item.bus != self._only:
            return
        monitor = self.monitor(item.bus)
        if monitor is None:
            yield item.bus, unread(item.at, 0, f"more than {BUSES_MAX} buses", item.bus)
            return
        for event in monitor.feed(item if isinstance(item, Dropped) else item.frame, item.at):
            yield item.bus, event

    def monitor(self, bus: str) -> CanMonitor | None:
        """Return the monitor of a bus; None if there are too many buses."""
        if bus not in self.monitors and len(self.monitors) < BUSES_MAX:
            self.monitors[bus] = CanMonitor(self._known, complete=self._complete)
        return self.monitors.get(bus)

    def end(self) -> Iterator[tuple[str, MonitorEvent]]:
        """Yield the last events of each bus."""
        for bus, monitor in self.monitors.items():
            for event in monitor.end(monitor.now):
                yield bus, event


def replay_can(
    items: Iterable[RecordedItem], known: Iterable[KnownNode] = (), bus: str | None = None, *, complete: bool = False
) -> Iterator[tuple[str, MonitorEvent]]:
    """Return the events of a whole recording, each with the name of its bus, in order.

    >>> next(replay_can(read_recording(b"(1.5) can0 705#00")))[1].kind
    'boot-up'
    """
    monitors = BusMonitors(known, bus, complete=complete)
    for item in items:
        yield from monitors.feed(item)
    yield from monitors.end()


LOG_ENDINGS = (".log", ".txt", ".candump")
"""The endings of the names of candump logs."""


class CanRecordingWriter:
    """Writes a recording frame by frame, as a candump log or as pcapng: the ending of the file name selects.

    >>> writer = CanRecordingWriter("bus.log")
    >>> [writer.put(item.at, item.bus, item.frame) for item in read_recording(b"(1.5) can0 705#05")]
    [b'(0000000001.500000) can0 705#05\\n']
    """

    def __init__(self, name: str) -> None:
        self._is_pcapng = not name.lower().endswith(LOG_ENDINGS)
        self._buses: dict[str, int] = {}
        self.start = file_header(None) if self._is_pcapng else b""

    def put(self, at: float, bus: str, frame: AnyFrame) -> bytes:
        """Return the bytes to append for one frame."""
        name = bus or "can0"
        if not self._is_pcapng:
            name = f"can{name}" if name.isdecimal() else name
            return f"{log_line(at, name, frame)}\n".encode()
        data = b""
        if name not in self._buses:
            self._buses[name] = len(self._buses)
            data = interface_block(SOCKETCAN, name)
        return data + packet_block(at, to_packet(frame), self._buses[name])
