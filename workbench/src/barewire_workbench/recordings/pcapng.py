"""Capture files: reads pcapng and pcap, writes pcapng. Bytes to packets and back, without file access.

    | type 4 | length 4 | body, padded to 4 | length 4 |       a block; the section header determines the byte order
    section header 0A0D0D0A     interface 1: link type, units of time     packet 6, 3, 2: interface, time, length, bytes

Files are written with one section, little-endian, times in microseconds. Files may be read with several sections and
interfaces, both byte orders, other units and offsets of time; unknown blocks are skipped.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from io import BytesIO
from typing import NamedTuple

from barewire.errors import DecodeError

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
            number, high, low, captured, _ = struct.unpack_from(f"{order}5I", body)
            options = dict(_options(body[20 + captured + -captured % 4 :], order))
            dropped = int.from_bytes(options.get(_DROPPED, b""), "little" if order == "<" else "big")
            if block_type == _OLD:
                number, dropped = struct.unpack_from(f"{order}HH", body)
                dropped = 0 if dropped == 0xFFFF else dropped  # not known
            if number >= len(interfaces):
                text = f"a packet of interface {number} at byte {position}, but the file has {len(interfaces)}"
                raise DecodeError("value", block[:16], 8, text)
            link, unit, name, start = interfaces[number]
            yield Packet(start + ((high << 32) + low) / unit, body[20 : 20 + captured], link, name, dropped)
        elif block_type == _SIMPLE and len(body) >= 4 and interfaces:
            yield Packet(0.0, body[4 : 4 + struct.unpack_from(f"{order}I", body)[0]], interfaces[0].link)
        elif position == 0 and block_type != _SECTION:
            raise DecodeError("value", head, 0, "neither a pcapng nor a pcap file")
        position += size
        head = read(_BLOCK)


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
