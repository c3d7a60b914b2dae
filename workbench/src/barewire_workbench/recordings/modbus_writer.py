"""Writes what a sniffer has seen as a capture (pcapng) that Wireshark reads."""

from __future__ import annotations

from barewire.rtu import encode as rtu_frame
from barewire.tcp import encode as tcp_frame
from barewire_workbench.recordings.capture import PacketBuilder, file_header, packet_block
from barewire_workbench.sniffer import (
    AmbiguousFrame,
    NoiseSeen,
    RecordingEnds,
    RequestSeen,
    ResponseMissing,
    SnifferEvent,
)


class ModbusRecordingWriter:
    """Writes a recording event by event: `start`, then what `put` returns.

    >>> writer = ModbusRecordingWriter()
    >>> len(writer.start) > 0, len(writer.put(RequestSeen(1, bytes.fromhex("0300000002"), 1.0))) > 0
    (True, True)
    """

    def __init__(self) -> None:
        self._packets = PacketBuilder()
        self.start = file_header()

    def put(self, event: SnifferEvent) -> bytes:
        """Return the bytes to append for an event; a missing response has none."""
        packet = self._packet(event)
        return b"" if packet is None else packet_block(event.at, packet)

    def _packet(self, event: SnifferEvent) -> bytes | None:
        """Return the frame of an event as a packet; noise becomes a datagram."""
        packets = self._packets
        if isinstance(event, ResponseMissing | RecordingEnds):
            return None
        if isinstance(event, NoiseSeen):
            return packets.rtu(event.noise.data, from_client=True)
        from_client = isinstance(event, RequestSeen | AmbiguousFrame)
        number = None if isinstance(event, AmbiguousFrame) else event.transaction
        if number is None:
            return packets.rtu(rtu_frame(event.unit, event.pdu), from_client=from_client)
        return packets.tcp(tcp_frame(event.unit, event.pdu, number), from_client=from_client)
