"""Modbus in the packets of a capture: TCP segments in their order, RTU frames in datagrams."""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator
from itertools import chain

from barewire.errors import DecodeError
from barewire_workbench.recordings.modbus_log.model import LoggedBytes
from barewire_workbench.recordings.modbus_packets import MODBUS_PORTS, ConnectionKey, modbus_payload
from barewire_workbench.recordings.model import LeftOut, Unread, unread
from barewire_workbench.recordings.pcapng import Packet
from barewire_workbench.recordings.socketcan import is_can_packet
from barewire_workbench.recordings.source import RecordingSource

_EARLY_SEGMENTS = 64
"""The most segments that wait for a missing one before it is skipped."""
_DIRECTIONS = 4096
"""The most directions of connections whose order is known: of the others the next segment is the first."""


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


def read_segments(
    packets: Iterable[tuple[int, Packet | DecodeError]], ports: Container[int]
) -> Iterator[LoggedBytes | Unread]:
    """Yield the Modbus bytes of a capture; `line` is the number of the packet. The place where it is damaged is the
    last item. Raises DecodeError if nothing is before it."""
    reassemblies: dict[tuple[ConnectionKey, bool], _Reassembly] = {}
    at: float | None = None
    left_out = LeftOut("Modbus")
    for number, packet in packets:
        if isinstance(packet, DecodeError):
            if at is None:
                raise packet
            yield unread(at, number, packet, "")
            break
        payload = modbus_payload(packet, ports)
        if payload is None:
            is_can = is_can_packet(packet)
            left_out.of_other_bus += is_can
            left_out.neither += not is_can
            continue
        piece, name = payload.data, _connection_text(payload.connection)
        if payload.sequence is not None:
            direction = payload.connection, payload.from_client
            known = reassemblies.pop(direction, None)
            segments = reassemblies[direction] = known or _Reassembly()
            if len(reassemblies) > _DIRECTIONS:
                del reassemblies[next(iter(reassemblies))]
            piece = segments.put(payload.sequence, payload.data)
        if piece:
            at = payload.at
            yield LoggedBytes(at, piece, number, payload.from_client, payload.protocol, name)
    yield from left_out.items(at or 0.0)


def is_can_capture(source: RecordingSource, ports: Container[int] = MODBUS_PORTS) -> bool:
    """Return whether the first packet of CAN or of Modbus is one of CAN. Those before it, which are neither, are passed
    over, so that they need not be kept."""
    for found in source.packets:
        packet = found[1]
        is_can = isinstance(packet, Packet) and is_can_packet(packet)
        if is_can or isinstance(packet, DecodeError) or modbus_payload(packet, ports) is not None:
            source.packets = chain([found], source.packets)
            return is_can
    return False


def _connection_text(connection: ConnectionKey) -> str:
    client, client_port, server, port = connection
    return f"{_address_text(client)}:{client_port} {_address_text(server)}:{port}"


def _address_text(address: bytes) -> str:
    if len(address) == 4:
        return ".".join(map(str, address))
    return f"[{':'.join(f'{address[at]:x}{address[at + 1]:02x}' for at in range(0, 16, 2))}]"
