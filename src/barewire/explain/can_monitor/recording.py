"""A recording of a CAN bus, whatever its form, listened to once more; and frames written down.

candump      what it prints and what it logs           Vector ASC      text, too
pcapng, pcap SocketCAN frames, link type 227           Vector BLF      bytes

Each bus in a recording has a listener of its own.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from barewire.canopen.frame import AnyFrame
from barewire.errors import DecodeError
from barewire.explain.can_monitor.events import MonitorEvent
from barewire.explain.can_monitor.monitor import CanMonitor
from barewire.explain.canopen.known_node import KnownNode
from barewire.explain.capture import pcapng
from barewire.explain.capture.asc import is_asc, read_asc
from barewire.explain.capture.blf import FILE, read_blf
from barewire.explain.capture.candump import is_candump, log_line, read_candump
from barewire.explain.capture.model import Dropped, Recorded, RecordedItem, Unread, unread
from barewire.explain.capture.socketcan import SOCKETCAN, from_packet, is_can_packet, to_packet

BUSES_MAX = 64
_LOOKED_AT = 0x1_0000
"""So much of a text is looked at to find out what it is."""


def is_can_recording(data: bytes) -> bool:
    """Whether this is a recording of a CAN bus, and not one of Modbus or of anything else.

    >>> is_can_recording(b"(1.5) can0 705#05"), is_can_recording(b"12.5 01 03 00 00 00 02 C4 0B")
    (True, False)
    """
    if data[:4] == FILE:
        return True
    if pcapng.is_capture(data):
        try:
            return any(is_can_packet(packet) for packet in pcapng.iter_packets(data))
        except DecodeError:
            return False
    text = _text(data[:_LOOKED_AT])
    return is_asc(text) or is_candump(text)


def _text(data: bytes) -> str:
    """The text that the bytes are: UTF-8, or what programs on Windows write for the letters in names and remarks."""
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252", "replace")


def read_recording(data: bytes) -> Iterator[RecordedItem]:
    """Frames, and what could not be read, in the order of the file. DecodeError for what is no recording of CAN.

    >>> [str(item.frame) for item in read_recording(b"(1.5) can0 705#05")]
    ['705#05']
    """
    if pcapng.is_capture(data):
        return _read_capture(data)
    if data[:4] == FILE:
        return read_blf(data)
    begin = _text(data[:_LOOKED_AT])
    if is_asc(begin):
        return read_asc(_text(data))
    if is_candump(begin):
        return read_candump(_text(data))
    raise DecodeError("value", data[:16], 0, "no recording of CAN: expected candump, ASC, BLF, pcapng or pcap")


def _read_capture(data: bytes) -> Iterator[RecordedItem]:
    packets = pcapng.iter_packets(data)
    at, number = 0.0, 0
    while True:
        number += 1
        try:
            packet = next(packets)
        except StopIteration:
            return
        except DecodeError as error:
            yield unread(at, number, error, "")
            return
        if not is_can_packet(packet):
            continue
        at = packet.at
        if packet.dropped:
            yield Dropped(at, packet.interface, packet.dropped)
        try:
            yield Recorded(at, packet.interface, from_packet(packet), number)
        except DecodeError as error:
            yield unread(at, number, error, packet.data.hex(" "))


class BusMonitors:
    """All buses of a recording, each with its listener. `feed` an item, then `end`."""

    def __init__(self, known: Iterable[KnownNode] = (), bus: str | None = None) -> None:
        self._known = tuple(known)
        self._only = bus
        self.listeners: dict[str, CanMonitor] = {}

    def feed(self, item: RecordedItem) -> Iterator[tuple[str, MonitorEvent]]:
        """The events of an item, with the bus that they are of."""
        if isinstance(item, Unread):
            yield "", item
            return
        if self._only is not None and item.bus != self._only:
            return
        listener = self.listener(item.bus)
        if listener is None:
            yield item.bus, unread(item.at, 0, f"more than {BUSES_MAX} buses", item.bus)
            return
        for event in listener.feed(item if isinstance(item, Dropped) else item.frame, item.at):
            yield item.bus, event

    def listener(self, bus: str) -> CanMonitor | None:
        """The listener of a bus; None if there are too many of them."""
        if bus not in self.listeners and len(self.listeners) < BUSES_MAX:
            self.listeners[bus] = CanMonitor(self._known)
        return self.listeners.get(bus)

    def end(self) -> Iterator[tuple[str, MonitorEvent]]:
        """The last events of each bus."""
        for bus, listener in self.listeners.items():
            for event in listener.end(listener.now):
                yield bus, event


def replay_can(
    items: Iterable[RecordedItem], known: Iterable[KnownNode] = (), bus: str | None = None
) -> Iterator[tuple[str, MonitorEvent]]:
    """What a recording says, bus by bus, in the order in which it was said.

    >>> next(replay_can(read_recording(b"(1.5) can0 705#00")))[1].kind
    'boot-up'
    """
    heard = BusMonitors(known, bus)
    for item in items:
        yield from heard.feed(item)
    yield from heard.end()


class CanRecordingWriter:
    """A recording that grows: bytes to write for each frame, in the form that a file's name asks for.

    >>> keeper = CanRecordingWriter("bus.log")
    >>> [keeper.put(item.at, item.bus, item.frame) for item in read_recording(b"(1.5) can0 705#05")]
    [b'(0000000001.500000) can0 705#05\\n']
    """

    def __init__(self, name: str) -> None:
        self._capture = not name.lower().endswith((".log", ".txt", ".candump"))
        self._buses: dict[str, int] = {}
        self.start = pcapng.file_header(None) if self._capture else b""

    def put(self, at: float, bus: str, frame: AnyFrame) -> bytes:
        """The bytes of one more frame."""
        name = bus or "can0"
        if not self._capture:
            return f"{log_line(at, name if not name.isdecimal() else f'can{name}', frame)}\n".encode()
        data = b""
        if name not in self._buses:
            self._buses[name] = len(self._buses)
            data = pcapng.interface_block(SOCKETCAN, name)
        return data + pcapng.packet_block(at, to_packet(frame), self._buses[name])
