"""Recordings of Modbus, decoded: captures, logs and dumps, by the sniffer that also decodes live lines.

pcapng, pcap     TCP port 502 by connection and direction; RTU in datagrams on port 5020
anything else    text, as `bytelog` reads it: RTU, or ASCII where the bytes begin with a colon
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator

from barewire.ascii import AsciiLine
from barewire.errors import DecodeError
from barewire.explain.capture.bytelog import parse_log
from barewire.explain.capture.modbus_packets import MODBUS_PORTS, ConnectionKey, modbus_payload
from barewire.explain.capture.pcapng import is_capture, read_packets
from barewire.modbus.framing import Line
from barewire.modbus.sniffer.numbered import NumberedSniffer
from barewire.modbus.sniffer.sniffer import WINDOW, Sniffer, SnifferEvent
from barewire.rtu import RtuLine, Timing
from barewire.tcp import TcpLine

_SEGMENTS = 64
_ANY_SPEED = Timing(0.0, 0.0, 0.0)
"""The bit rate of a recording is unknown: only pauses end a frame of unknown length."""


def _rtu_line() -> Line:
    """An RTU line that receives both directions, at any bit rate."""
    return RtuLine(_ANY_SPEED, role="listener")


def replay(data: bytes, *, window: float = WINDOW, ports: Container[int] = MODBUS_PORTS) -> Iterator[SnifferEvent]:
    """The events of a recording, in order.

    >>> [type(event).__name__ for event in replay(b"1.0 01 83 02 C0 F1")]
    ['ResponseSeen']

    Raises DecodeError if the bytes are not a recording.
    """
    if is_capture(data):
        return _replay_capture(data, window, ports)
    try:
        text = data.decode()
    except UnicodeDecodeError as error:
        raise DecodeError("character", data[:16], 0, f"neither a capture nor text: {error.reason}") from None
    return _replay_log(text, window)


def _replay_log(text: str, window: float) -> Iterator[SnifferEvent]:
    chunks = parse_log(text).chunks
    new_line: Callable[[], Line] = AsciiLine if chunks and chunks[0].data[:1] == b":" else _rtu_line
    sniffer = Sniffer(new_line(), window=window)
    for chunk in chunks:
        yield from _feed(sniffer, chunk.data, chunk.at)
    yield from sniffer.end(chunks[-1].at if chunks else 0.0)


def _feed(sniffer: Sniffer, data: bytes, at: float) -> Iterator[SnifferEvent]:
    """Take bytes received at this time, after the deadlines before it."""
    while (deadline := sniffer.deadline) is not None and deadline < at:
        yield from sniffer.feed(None, deadline)
    yield from sniffer.feed(data, at)


class _Stream:
    """One direction of a TCP connection: puts segments in order, each byte once."""

    def __init__(self) -> None:
        self._next: int | None = None
        self._early: dict[int, bytes] = {}

    def put(self, sequence: int, data: bytes) -> bytes:
        """Take a segment: the bytes that are complete now."""
        if self._next is None:
            self._next = sequence
        self._early[sequence] = max(self._early.get(sequence, b""), data, key=len)
        if len(self._early) > _SEGMENTS:  # the missing one was not captured: continue after it
            expected = self._next
            self._next = min(self._early, key=lambda number: number - expected & 0xFFFFFFFF)
        out = b""
        while (found := self._following(self._next)) is not None:
            out += found
            self._next = self._next + len(found) & 0xFFFFFFFF
        return out

    def _following(self, at: int) -> bytes | None:
        for number in list(self._early):
            behind = at - number & 0xFFFFFFFF
            if behind < 0x80000000:
                rest = self._early.pop(number)[behind:]
                if rest:
                    return rest
        return None


def _replay_capture(data: bytes, window: float, ports: Container[int]) -> Iterator[SnifferEvent]:
    serial: dict[ConnectionKey, Sniffer] = {}
    numbered: dict[ConnectionKey, NumberedSniffer] = {}
    streams: dict[tuple[ConnectionKey, bool], _Stream] = {}
    now = 0.0
    for packet in read_packets(data):
        carried = modbus_payload(packet, ports)
        if carried is None:
            continue
        now, where = carried.at, carried.connection
        if carried.sequence is None:
            sniffer = serial.setdefault(where, Sniffer(_rtu_line(), window=window))
            yield from _feed(sniffer, carried.data, now)
            # A datagram is a complete frame, or noise.
            if (ends := sniffer.line.deadline) is not None:
                yield from sniffer.feed(None, ends)
        else:
            pair = numbered.setdefault(where, NumberedSniffer(TcpLine(), TcpLine(), window=window))
            stream = streams.setdefault((where, carried.from_client), _Stream())
            yield from pair.feed(carried.from_client, stream.put(carried.sequence, carried.data), now)
    for sniffer in serial.values():
        yield from sniffer.end(now)
    for pair in numbered.values():
        yield from pair.end(now)
