"""Decodes recordings of Modbus (captures, logs, dumps) with the sniffer that also decodes live lines.

pcapng, pcap     TCP port 502 by connection and direction; RTU in datagrams on port 5020
anything else    text, parsed by `bytelog`: RTU or ASCII, judged by all bytes unless `protocol` states it
"""

from __future__ import annotations

from collections.abc import Container, Iterator
from typing import Literal, TypeAlias

from barewire.ascii import AsciiLine
from barewire.errors import DecodeError, EncodeError
from barewire.explain.capture.bytelog import parse_log
from barewire.explain.capture.modbus_packets import MODBUS_PORTS, ConnectionKey, modbus_payload
from barewire.explain.capture.pcapng import is_capture, read_packets
from barewire.modbus.adu import Adu
from barewire.modbus.framing import Line
from barewire.modbus.sniffer import WINDOW, NumberedSniffer, Sniffer, SnifferEvent
from barewire.rtu import RtuLine, Timing
from barewire.tcp import TcpLine

_EARLY_SEGMENTS = 64
"""The most segments that wait for a missing one before it is skipped."""
_ANY_BITRATE = Timing(0.0, 0.0, 0.0)
"""The bit rate of a recording is unknown: only pauses end a frame of unknown length."""


SerialProtocol: TypeAlias = Literal["rtu", "ascii"]

_ASCII_BYTES = b"0123456789ABCDEFabcdef:\r\n"


def _rtu_line() -> Line:
    """Return an RTU line that receives both directions, at any bit rate."""
    return RtuLine(_ANY_BITRATE, role="listener")


def replay(
    data: bytes,
    *,
    window: float = WINDOW,
    ports: Container[int] = MODBUS_PORTS,
    protocol: SerialProtocol | None = None,
) -> Iterator[SnifferEvent]:
    """Return the events of a recording, in order. `protocol` is that of a log or dump; by default its bytes tell.

    >>> [type(event).__name__ for event in replay(b"1.0 01 83 02 C0 F1")]
    ['ResponseSeen']

    Raises DecodeError if the bytes are not a recording, EncodeError for a protocol of a capture, which has its own.
    """
    if is_capture(data):
        if protocol is not None:
            text = "a protocol is stated for a log or dump; in a capture each packet has its own"
            raise EncodeError(text, "protocol")
        return _replay_capture(data, window, ports)
    try:
        text = data.decode()
    except UnicodeDecodeError as error:
        raise DecodeError("character", data[:16], 0, f"neither a capture nor text: {error.reason}") from None
    return _replay_log(text, window, protocol)


def _replay_log(text: str, window: float, protocol: SerialProtocol | None) -> Iterator[SnifferEvent]:
    chunks = parse_log(text).chunks
    if protocol is None:
        protocol = "ascii" if _is_ascii(b"".join(chunk.data for chunk in chunks)) else "rtu"
    sniffer = Sniffer(AsciiLine() if protocol == "ascii" else _rtu_line(), window=window)
    for chunk in chunks:
        yield from _feed(sniffer, chunk.data, chunk.at)
    yield from sniffer.end(chunks[-1].at if chunks else 0.0)


def _is_ascii(data: bytes) -> bool:
    """Return whether these are bytes of an ASCII line, wherever the recording begins, and whatever noise is in it.

    No function code of RTU is a character of ASCII frames. Registers with text may consist of such characters, but
    these make no frame with a correct LRC.

    >>> _is_ascii(b"FB1000239\\r\\n"), _is_ascii(bytes.fromhex("01 83 02 C0 F1"))
    (True, False)
    """
    others = len(data.translate(None, _ASCII_BYTES))
    if not others or 2 * others > len(data):
        return bool(data) and not others
    return any(isinstance(event, Adu) for event in AsciiLine().feed(data, 0.0))


def _feed(sniffer: Sniffer, data: bytes, at: float) -> Iterator[SnifferEvent]:
    """Feed the deadlines before `at`, then the bytes received at that time."""
    while (deadline := sniffer.deadline) is not None and deadline < at:
        yield from sniffer.feed(None, deadline)
    yield from sniffer.feed(data, at)


class _Reassembly:
    """One direction of a TCP connection: puts the segments in order and drops repeated bytes."""

    def __init__(self) -> None:
        self._next: int | None = None
        self._early: dict[int, bytes] = {}

    def put(self, sequence: int, data: bytes) -> bytes:
        """Take a segment; return the bytes that now continue the stream."""
        if self._next is None:
            self._next = sequence
        self._early[sequence] = max(self._early.get(sequence, b""), data, key=len)
        if len(self._early) > _EARLY_SEGMENTS:  # the next one was not captured: skip it
            expected = self._next
            self._next = min(self._early, key=lambda start: start - expected & 0xFFFFFFFF)
        complete = b""
        while (following := self._take_at(self._next)) is not None:
            complete += following
            self._next = self._next + len(following) & 0xFFFFFFFF
        return complete

    def _take_at(self, position: int) -> bytes | None:
        """Return the bytes at this sequence number and drop segments before it; sequence numbers wrap at 32 bits."""
        for start in list(self._early):
            known = position - start & 0xFFFFFFFF
            if known < 0x80000000:
                new = self._early.pop(start)[known:]
                if new:
                    return new
        return None


def _replay_capture(data: bytes, window: float, ports: Container[int]) -> Iterator[SnifferEvent]:
    serial: dict[ConnectionKey, Sniffer] = {}
    numbered: dict[ConnectionKey, NumberedSniffer] = {}
    reassemblies: dict[tuple[ConnectionKey, bool], _Reassembly] = {}
    now = 0.0
    for packet in read_packets(data):
        payload = modbus_payload(packet, ports)
        if payload is None:
            continue
        now, connection = payload.at, payload.connection
        if payload.sequence is None:
            sniffer = serial.setdefault(connection, Sniffer(_rtu_line(), window=window))
            yield from _feed(sniffer, payload.data, now)
            # A datagram is a complete frame, or noise.
            if (deadline := sniffer.line.deadline) is not None:
                yield from sniffer.feed(None, deadline)
        else:
            pair = numbered.setdefault(connection, NumberedSniffer(TcpLine(), TcpLine(), window=window))
            segments = reassemblies.setdefault((connection, payload.from_client), _Reassembly())
            yield from pair.feed(payload.from_client, segments.put(payload.sequence, payload.data), now)
    for sniffer in serial.values():
        yield from sniffer.end(now)
    for pair in numbered.values():
        yield from pair.end(now)
