"""Capture files: reads pcapng and pcap, writes pcapng; the frames of CAN and Modbus in packets. No file access.

    | type 4 | length 4 | body, padded to 4 | length 4 |       a block; the section header determines the byte order
    section header 0A0D0D0A     interface 1: link type, units of time     packet 6, 3, 2: interface, time, length, bytes

Files are written with one section, little-endian, times in microseconds. Files may be read with several sections and
interfaces, both byte orders, other units and offsets of time; unknown blocks are skipped.

**CAN frames in captures: reads and writes link type 227, LINKTYPE_CAN_SOCKETCAN**

        identifier 4, big-endian                    length 1   flags 1   0   0   data
        bit 31 extended, 30 remote, 29 error frame             04: CAN FD, 01: bit rate switch, 02: error passive

A capture of all interfaces has the same frames in the cooked formats of Linux (113, 276).

**Modbus frames in packets, as Wireshark reads and writes them**

    TCP        Ethernet | IPv4 | TCP, port 502 | MBAP | unit | PDU
    RTU        Ethernet | IPv4 | UDP, port 5020 | unit | PDU | CRC        dissected with -o mbrtu.udp.port:5020

No link type for RTU keeps the direction of a frame, so the ports show it: the server has the server port. ASCII frames,
which no dissector reads, are written as RTU frames with the same PDU. Checksums and sequence numbers are correct, so
Wireshark reports no errors. It reads IPv4 and IPv6 over Ethernet (with VLAN tags), raw IP, the cooked formats of Linux
and the BSD loopback; IP fragments are skipped.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Container, Iterator
from io import BytesIO
from typing import NamedTuple

from barewire.canopen.frame import BASE_MAX, DATA_MAX, EXTENDED_MAX, AnyFrame, CanFrame, ErrorFrame, FdFrame
from barewire.errors import DecodeError
from barewire_workbench.frames.result import ProtocolName
from barewire_workbench.recordings.model import FD_MAX

ETHERNET = 1
_SECTION, _INTERFACE, _OLD, _SIMPLE, _ENHANCED = 0x0A0D0D0A, 1, 2, 3, 6
_MAGIC = 0x1A2B3C4D
_BLOCK = 12
"""Bytes of a block without a body."""
_BLOCK_MAX = 0x100_0000
"""The longest possible block or packet, as in Wireshark; a longer one is damaged."""
_PCAP = {0xA1B2C3D4: 1_000_000, 0xA1B23C4D: 1_000_000_000}
"""Magic number of a pcap file -> units of its times per second."""
_RESOLUTION, _NAME, _OFFSET = 9, 2, 14
"""Options of an interface: unit of its times, name, seconds to add to its times."""
_DROPPED = 4
"""Option of a packet: the number of packets lost before it."""


class Packet(NamedTuple):
    """One packet captured at `at`, in seconds since 1970. `link` is the type of its first header."""

    at: float
    data: bytes
    link: int = ETHERNET
    interface: str = ""  # its name, or its number if there are several
    dropped: int = 0  # packets that the recorder lost before this one


def file_header(link: int | None = ETHERNET) -> bytes:
    """Return the beginning of a file: a section, and one interface unless `link` is None."""
    section = struct.pack("<IHHq", _MAGIC, 1, 0, -1)
    return _block(_SECTION, section) + (b"" if link is None else interface_block(link))


def interface_block(link: int, name: str = "") -> bytes:
    """Return the block of one more interface; interfaces are numbered from 0."""
    text = name.encode()
    option = struct.pack("<HH", _NAME, len(text)) + text + bytes(-len(text) % 4) + bytes(4) if text else b""
    return _block(_INTERFACE, struct.pack("<HHI", link, 0, 0) + option)


def packet_block(at: float, data: bytes, interface: int = 0) -> bytes:
    """Return the block of one packet, to append to the file.

    >>> read_packets(file_header() + packet_block(12.5, b"abc"))[0][:3]
    (12.5, b'abc', 1)
    """
    micros = min(max(0, round(at * 1e6)), 0xFFFF_FFFF_FFFF_FFFF)
    start = struct.pack("<IIIII", interface, micros >> 32, micros & 0xFFFFFFFF, len(data), len(data))
    return _block(_ENHANCED, start + data)


def _block(block_type: int, body: bytes) -> bytes:
    body += bytes(-len(body) % 4)
    size = struct.pack("<I", len(body) + 12)
    return struct.pack("<I", block_type) + size + body + size


def is_capture(data: bytes) -> bool:
    """Return whether the bytes begin like a pcapng or pcap file."""
    return data[:4] == _SECTION.to_bytes(4, "big") or _pcap_order(data) is not None


def read_packets(data: bytes) -> list[Packet]:
    """Return the packets of a pcapng or pcap file. Raises DecodeError if it is cut off, damaged or neither of them."""
    return list(iter_packets(BytesIO(data).read))


def iter_packets(read: Callable[[int], bytes]) -> Iterator[Packet]:
    """Iterate over the packets as they come. `read` returns as many bytes as asked for; fewer only at the end."""
    head = read(_BLOCK)
    return _read_pcap(head, read) if _pcap_order(head) else _read_pcapng(head, read)


def numbered_packets(read: Callable[[int], bytes]) -> Iterator[tuple[int, Packet | DecodeError]]:
    """Iterate over the packets with their numbers, from 1. Where the file is damaged, the error is the last of them."""
    number = 0
    try:
        for number, packet in enumerate(iter_packets(read), start=1):
            yield number, packet
    except DecodeError as error:
        yield number + 1, error


def _pcap_order(data: bytes) -> str | None:
    for order in "<>":
        if len(data) >= 4 and struct.unpack_from(f"{order}I", data)[0] in _PCAP:
            return order
    return None


def _read_pcap(head: bytes, read: Callable[[int], bytes]) -> Iterator[Packet]:
    order = _pcap_order(head)
    head += read(24 - len(head))
    if len(head) < 24:
        raise DecodeError("short", head, len(head), f"a pcap file has a header of 24 bytes, here {len(head)}")
    unit = _PCAP[struct.unpack_from(f"{order}I", head)[0]]
    link = struct.unpack_from(f"{order}I", head, 20)[0] & 0xFFFF
    position = 24
    while head := read(16):
        if len(head) < 16:
            raise _cut(head, position)
        seconds, fraction, size, _ = struct.unpack(f"{order}4I", head)
        data = read(size) if size <= _BLOCK_MAX else b""
        if len(data) < size:
            raise _cut(head, position)
        yield Packet(seconds + fraction / unit, data, link)
        position += 16 + size


def _read_pcapng(head: bytes, read: Callable[[int], bytes]) -> Iterator[Packet]:
    order = "<"
    interfaces: list[_Interface] = []
    position = 0
    while head:
        if len(head) < _BLOCK:
            raise _cut(head, position)
        if head[:4] == _SECTION.to_bytes(4, "big"):
            if head[8:] not in (_MAGIC.to_bytes(4, "little"), _MAGIC.to_bytes(4, "big")):
                raise DecodeError("value", head, 8, "a section without its magic number")
            order = "<" if head[8:] == _MAGIC.to_bytes(4, "little") else ">"
            interfaces = []
        block_type, size = struct.unpack_from(f"{order}II", head)
        if size < _BLOCK or size % 4 or size > _BLOCK_MAX:
            raise _cut(head, position)
        block = head + read(size - _BLOCK)
        if len(block) < size:
            raise _cut(block, position)
        body = block[8:-4]
        if block_type == _INTERFACE and len(body) >= 8:
            interfaces.append(_interface(body, order, len(interfaces)))
        elif block_type in (_ENHANCED, _OLD) and len(body) >= 20:
            yield _packet(block, order, interfaces, position, is_old=block_type == _OLD)
        elif block_type == _SIMPLE and len(body) >= 4 and interfaces:
            yield Packet(0.0, body[4 : 4 + struct.unpack_from(f"{order}I", body)[0]], interfaces[0].link)
        elif position == 0 and block_type != _SECTION:
            raise DecodeError("value", head, 0, "neither a pcapng nor a pcap file")
        position += size
        head = read(_BLOCK)


def _packet(block: bytes, order: str, interfaces: list[_Interface], position: int, *, is_old: bool) -> Packet:
    """Return the packet of a block. In an old block the number of the interface has two bytes, two more the losses."""
    body = block[8:-4]
    number, high, low, captured, _ = struct.unpack_from(f"{order}5I", body)
    options = dict(_options(body[20 + captured + -captured % 4 :], order))
    dropped = int.from_bytes(options.get(_DROPPED, b""), "little" if order == "<" else "big")
    if is_old:
        number, dropped = struct.unpack_from(f"{order}HH", body)
        dropped = 0 if dropped == 0xFFFF else dropped  # not known
    if number >= len(interfaces):
        text = f"a packet of interface {number} at byte {position}, but the file has {len(interfaces)}"
        raise DecodeError("value", block[:16], 8, text)
    link, unit, name, start = interfaces[number]
    return Packet(start + ((high << 32) + low) / unit, body[20 : 20 + captured], link, name, dropped)


class _Interface(NamedTuple):
    link: int
    unit: int
    name: str
    start: int


def _interface(body: bytes, order: str, number: int) -> _Interface:
    options = dict(_options(body[8:], order))
    name = options.get(_NAME, b"").decode("utf-8", "replace") or (str(number) if number else "")
    start = int.from_bytes(options.get(_OFFSET, b""), "little" if order == "<" else "big", signed=True)
    return _Interface(struct.unpack_from(f"{order}H", body)[0], _unit(options), name, start)


def _options(data: bytes, order: str) -> Iterator[tuple[int, bytes]]:
    """Yield the options after the fixed part of a block, up to a damaged one."""
    position = 0
    while position + 4 <= len(data):
        code, size = struct.unpack_from(f"{order}HH", data, position)
        if code == 0 or position + 4 + size > len(data):
            return
        yield code, data[position + 4 : position + 4 + size]
        position += 4 + size + -size % 4


def _unit(options: dict[int, bytes]) -> int:
    """Return the units of time per second of an interface: a million by default."""
    resolution = options.get(_RESOLUTION, b"")
    if len(resolution) != 1:
        return 1_000_000
    return int(2 ** (resolution[0] & 0x7F) if resolution[0] & 0x80 else 10 ** resolution[0])


def _cut(block: bytes, position: int) -> DecodeError:
    shown = block[:16]
    return DecodeError("short", shown, len(shown), f"the capture is cut off or damaged at byte {position}")


SOCKETCAN = 227
_COOKED = {113: (14, 16), 276: (0, 20)}
"""Link type -> offset of the protocol type, offset of the frame."""
_KINDS = {b"\x00\x0c": False, b"\x00\x0d": True}
_EXTENDED, _REMOTE, _ERROR = 0x8000_0000, 0x4000_0000, 0x2000_0000
_FD = 0x04
_HEAD = struct.Struct(">IBBBB")


def is_can_packet(packet: Packet) -> bool:
    """Return whether a packet is a CAN frame, readable or not.

    >>> is_can_packet(Packet(0.0, to_packet(CanFrame.parse("705#05")), SOCKETCAN))
    True
    """
    if packet.link == SOCKETCAN:
        return True
    where = _COOKED.get(packet.link)
    return where is not None and packet.data[where[0] : where[0] + 2] in _KINDS


def to_packet(frame: AnyFrame) -> bytes:
    """Return the frame as the data of a packet."""
    if isinstance(frame, ErrorFrame):
        return _HEAD.pack(frame.classes & EXTENDED_MAX | _ERROR, len(frame.data), 0, 0, 0) + frame.data
    word = frame.id | (_EXTENDED if frame.extended else 0)
    if isinstance(frame, FdFrame):
        return _HEAD.pack(word, len(frame.data), _FD | frame.flags & 3, 0, 0) + frame.data
    word |= _REMOTE if frame.remote else 0
    return _HEAD.pack(word, frame.dlc, 0, 0, 0) + frame.data


def from_packet(packet: Packet) -> AnyFrame:
    """Return the frame in a packet. Raises DecodeError if it is cut short or impossible.

    >>> str(from_packet(Packet(0.0, bytes.fromhex("0000060508000000 4041600000000000"), SOCKETCAN)))
    '605#4041600000000000'
    """
    data, fd = packet.data, False
    if packet.link in _COOKED:
        type_at, start = _COOKED[packet.link]
        fd = _KINDS.get(data[type_at : type_at + 2], False)
        data = data[start:]
    if len(data) < _HEAD.size:
        raise DecodeError("short", data, len(data), f"{len(data)} bytes: a CAN frame has 8 before its data")
    word, length, flags, _, _ = _HEAD.unpack_from(data)
    fd = fd or bool(flags & _FD) or length > DATA_MAX
    if length > (FD_MAX if fd else DATA_MAX):
        raise DecodeError("value", data, 4, f"a length of {length} bytes")
    body = data[_HEAD.size : _HEAD.size + length]
    remote = bool(word & _REMOTE) and not fd
    if len(body) < length and not remote:
        raise DecodeError("short", data, len(data), f"{length} bytes of data announced, got {len(body)}")
    if word & _ERROR:
        return ErrorFrame(word & EXTENDED_MAX, bytes(body))
    extended = bool(word & _EXTENDED)
    number = word & EXTENDED_MAX
    if not extended and number > BASE_MAX:
        raise DecodeError("value", data, 0, f"identifier {number:X}h of a base frame")
    if fd:
        return FdFrame(number, bytes(body), extended, flags & 3)
    return CanFrame(number, b"" if remote else bytes(body), extended, remote, length if remote else 0)


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
