"""Modbus frames in packets, as Wireshark reads and writes them.

    TCP        Ethernet | IPv4 | TCP, port 502 | MBAP | unit | PDU
    RTU        Ethernet | IPv4 | UDP, port 5020 | unit | PDU | CRC        dissected with -o mbrtu.udp.port:5020

No link type for RTU keeps the direction of a frame, so the ports show it: the server has the server port. ASCII frames,
which no dissector reads, are written as RTU frames with the same PDU. Checksums and sequence numbers are correct, so
Wireshark reports no errors. It reads IPv4 and IPv6 over Ethernet (with VLAN tags), raw IP, the cooked formats of Linux
and the BSD loopback; IP fragments are skipped.
"""

from __future__ import annotations

import struct
from collections.abc import Container
from typing import NamedTuple

from barewire_workbench.frames.result import ProtocolName
from barewire_workbench.recordings.pcapng import ETHERNET, Packet

MODBUS_PORTS = frozenset({502})
RTU_PORT = 5020
_CLIENT_PORT = 50000
_CLIENT, _SERVER = bytes([127, 0, 0, 1]), bytes([127, 0, 0, 2])
_TCP, _UDP = 6, 17
_VERSIONS = {b"\x08\x00": 4, b"\x86\xdd": 6}
_FRAGMENT = 44
_EXTENSIONS = frozenset({0, 43, _FRAGMENT, 60})
"""IPv6 headers that may come before TCP or UDP: hop by hop, routing, fragment, destination."""
_LINKS = {ETHERNET: 14, 0: 4, 101: 0, 228: 0, 12: 0, 113: 16, 276: 20}
"""Link type -> bytes before the IP packet."""

ConnectionKey = tuple[bytes, int, bytes, int]


class ModbusPayload(NamedTuple):
    """Modbus bytes of one packet. `connection` is the address and port of the client, then of the server."""

    at: float
    protocol: ProtocolName
    from_client: bool
    data: bytes
    connection: ConnectionKey
    sequence: int | None = None


class PacketBuilder:
    """Builds packets from frames, with the sequence numbers of one TCP connection."""

    def __init__(self, port: int = 502) -> None:
        self._port = port
        self._next = {True: 1, False: 1}

    def rtu(self, frame: bytes, *, from_client: bool) -> bytes:
        """Return an RTU frame in a datagram.

        >>> modbus_payload(Packet(0.0, PacketBuilder().rtu(b"abcd", from_client=True))).data
        b'abcd'
        """
        source, target = (_CLIENT_PORT, RTU_PORT) if from_client else (RTU_PORT, _CLIENT_PORT)
        return _ip(_UDP, struct.pack(">HHHH", source, target, 8 + len(frame), 0) + frame, 6, from_client)

    def tcp(self, frame: bytes, *, from_client: bool) -> bytes:
        """Return a Modbus TCP frame in a segment of the connection."""
        source, target = (_CLIENT_PORT, self._port) if from_client else (self._port, _CLIENT_PORT)
        numbers = self._next[from_client], self._next[not from_client]
        self._next[from_client] = numbers[0] + len(frame) & 0xFFFFFFFF
        segment = struct.pack(">HHIIBBHHH", source, target, *numbers, 0x50, 0x18, 0xFFFF, 0, 0) + frame
        return _ip(_TCP, segment, 16, from_client)


def _ip(protocol: int, payload: bytes, checksum_at: int, from_client: bool) -> bytes:
    source, target = (_CLIENT, _SERVER) if from_client else (_SERVER, _CLIENT)
    pseudo = source + target + struct.pack(">BBH", 0, protocol, len(payload))
    checksum = _checksum(pseudo + payload) or 0xFFFF
    payload = payload[:checksum_at] + checksum.to_bytes(2, "big") + payload[checksum_at + 2 :]
    start = struct.pack(">BBHHHBBH", 0x45, 0, 20 + len(payload), 0, 0x4000, 64, protocol, 0)
    checksum = _checksum(start + source + target)
    return bytes(12) + b"\x08\x00" + start[:10] + checksum.to_bytes(2, "big") + source + target + payload


def _checksum(data: bytes) -> int:
    """Return the checksum of IP, UDP and TCP: the one's complement of the one's complement sum."""
    total: int = sum(struct.unpack(f">{(len(data) + 1) // 2}H", data + bytes(len(data) % 2)))
    while total > 0xFFFF:
        total = (total & 0xFFFF) + (total >> 16)
    return total ^ 0xFFFF


def modbus_payload(packet: Packet, ports: Container[int] = MODBUS_PORTS) -> ModbusPayload | None:
    """Return the Modbus bytes of a packet to or from one of `ports` on TCP, or 5020 on UDP. None for other packets."""
    data, version = packet.data, 0
    skip = _LINKS.get(packet.link)
    if skip is None:
        return None
    if packet.link == ETHERNET:
        while data[skip - 2 : skip] in (b"\x81\x00", b"\x88\xa8"):
            skip += 4
        version = _VERSIONS.get(data[skip - 2 : skip], -1)
    opened = _ip_payload(data[skip:])
    if opened is None or version not in (0, data[skip] >> 4):
        return None
    protocol, ends, inner = opened
    source, target = (int.from_bytes(inner[offset : offset + 2], "big") for offset in (0, 2))
    if protocol == _UDP and len(inner) > 8 and RTU_PORT in (source, target):
        return _carried(packet.at, "rtu", target == RTU_PORT, inner[8:], ends, (source, target))
    if protocol == _TCP and len(inner) >= 20 and (source in ports or target in ports):
        payload = inner[4 * (inner[12] >> 4) :]
        if payload:
            carried = _carried(packet.at, "tcp", target in ports, payload, ends, (source, target))
            return carried._replace(sequence=int.from_bytes(inner[4:8], "big"))
    return None


_Ends = tuple[bytes, bytes]
"""Source and destination address: 4 bytes each, or 16."""


def _ip_payload(ip: bytes) -> tuple[int, _Ends, bytes] | None:
    """Return protocol, addresses and payload of an IPv4 or IPv6 packet; None for fragments and other packets."""
    version = ip[0] >> 4 if ip else 0
    if version == 6:
        return _ipv6_payload(ip)
    if version != 4 or len(ip) < 20:
        return None
    head, size = 4 * (ip[0] & 0x0F), int.from_bytes(ip[2:4], "big")
    if int.from_bytes(ip[6:8], "big") & 0x3FFF or head < 20:
        return None
    # A size of 0 is left to the network card.
    return ip[9], (bytes(ip[12:16]), bytes(ip[16:20])), ip[head : size or None]


def _ipv6_payload(ip: bytes) -> tuple[int, _Ends, bytes] | None:
    """Return protocol, addresses and payload behind the header of 40 bytes and the extension headers."""
    if len(ip) < 40:
        return None
    size, protocol = int.from_bytes(ip[4:6], "big"), ip[6]
    inner = ip[40 : 40 + size if size else None]
    while protocol in _EXTENSIONS:
        if len(inner) < 8:
            return None
        if protocol == _FRAGMENT:
            if int.from_bytes(inner[2:4], "big") & 0xFFF9:
                return None
            protocol, inner = inner[0], inner[8:]
        else:
            protocol, inner = inner[0], inner[8 * (inner[1] + 1) :]
    return protocol, (bytes(ip[8:24]), bytes(ip[24:40])), inner


def _carried(
    at: float, protocol: ProtocolName, from_client: bool, data: bytes, ends: _Ends, ports: tuple[int, int]
) -> ModbusPayload:
    both = [(ends[0], ports[0]), (ends[1], ports[1])]
    client, server = both if from_client else reversed(both)
    return ModbusPayload(at, protocol, from_client, bytes(data), (*client, *server))
