"""Modbus in the packets of a capture: TCP segments in their order, RTU frames in datagrams."""

from __future__ import annotations

from collections.abc import Container, Iterator

from barewire_workbench.recordings.modbus_log.model import LoggedBytes
from barewire_workbench.recordings.modbus_packets import ConnectionKey, modbus_payload
from barewire_workbench.recordings.pcapng import read_packets

_EARLY_SEGMENTS = 64
"""The most segments that wait for a missing one before it is skipped."""


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


def read_segments(data: bytes, ports: Container[int]) -> Iterator[LoggedBytes]:
    """Yield the Modbus bytes of a capture; `line` is the number of the packet. Raises DecodeError if it is damaged."""
    reassemblies: dict[tuple[ConnectionKey, bool], _Reassembly] = {}
    for number, packet in enumerate(read_packets(data), start=1):
        payload = modbus_payload(packet, ports)
        if payload is None:
            continue
        piece, name = payload.data, _connection_text(payload.connection)
        if payload.sequence is not None:
            segments = reassemblies.setdefault((payload.connection, payload.from_client), _Reassembly())
            piece = segments.put(payload.sequence, payload.data)
        if piece:
            yield LoggedBytes(payload.at, piece, number, payload.from_client, payload.protocol, name)


def _connection_text(connection: ConnectionKey) -> str:
    client, client_port, server, port = connection
    return f"{_address_text(client)}:{client_port} {_address_text(server)}:{port}"


def _address_text(address: bytes) -> str:
    if len(address) == 4:
        return ".".join(map(str, address))
    return f"[{':'.join(f'{address[at]:x}{address[at + 1]:02x}' for at in range(0, 16, 2))}]"
