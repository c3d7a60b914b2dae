"""Capture files, in and out: pcapng as Wireshark writes it, and its forerunner pcap. Pure: bytes to packets and back.

    | type 4 | length 4 | body, filled up to 4 | length 4 |       a block; which end comes first is told by the section
    section header 0A0D0D0A     interface 1: link type, units of time     packet 6, 3: interface, time, length, bytes

Written is one section with one interface, little-endian, times in microseconds. Read is what is needed of the rest:
several sections and interfaces, both byte orders, other units of time; unknown blocks are passed over.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from typing import NamedTuple

from barewire.errors import DecodeError

ETHERNET = 1
_SECTION, _INTERFACE, _SIMPLE, _ENHANCED = 0x0A0D0D0A, 1, 3, 6
_MAGIC = 0x1A2B3C4D
_PCAP = {0xA1B2C3D4: 1_000_000, 0xA1B23C4D: 1_000_000_000}
"""What a pcap file begins with, and so many units of its times are a second."""
_RESOLUTION = 9
"""The option of an interface that says in which units times are counted."""


class Packet(NamedTuple):
    """What was captured at `at`, in seconds since 1970, and how to read its first bytes."""

    at: float
    data: bytes
    link: int = ETHERNET


def header(link: int = ETHERNET) -> bytes:
    """How a file begins: a section, and its interface."""
    section = struct.pack("<IHHq", _MAGIC, 1, 0, -1)
    return _block(_SECTION, section) + _block(_INTERFACE, struct.pack("<HHI", link, 0, 0))


def packet(at: float, data: bytes) -> bytes:
    """One packet: what is put behind the header, as often as there is something to put.

    >>> read(header() + packet(12.5, b"abc"))
    [Packet(at=12.5, data=b'abc', link=1)]
    """
    micros = max(0, round(at * 1e6))
    return _block(_ENHANCED, struct.pack("<IIIII", 0, micros >> 32, micros & 0xFFFFFFFF, len(data), len(data)) + data)


def _block(kind: int, body: bytes) -> bytes:
    body += bytes(-len(body) % 4)
    size = struct.pack("<I", len(body) + 12)
    return struct.pack("<I", kind) + size + body + size


def is_capture(data: bytes) -> bool:
    """Whether the bytes begin like a file of either kind."""
    return data[:4] == _SECTION.to_bytes(4, "big") or _pcap_order(data) is not None


def read(data: bytes) -> list[Packet]:
    """The packets of a pcapng or pcap file. DecodeError says where it is none, or where it is cut off."""
    return list(_read_pcap(data) if _pcap_order(data) else _read_pcapng(data))


def _pcap_order(data: bytes) -> str | None:
    for order in "<>":
        if len(data) >= 4 and struct.unpack_from(f"{order}I", data)[0] in _PCAP:
            return order
    return None


def _read_pcap(data: bytes) -> Iterable[Packet]:
    order = _pcap_order(data)
    if len(data) < 24:
        raise DecodeError("short", data[:32], len(data[:32]), f"a pcap file has a header of 24 bytes, here {len(data)}")
    unit = _PCAP[struct.unpack_from(f"{order}I", data)[0]]
    link = struct.unpack_from(f"{order}I", data, 20)[0] & 0xFFFF
    at = 24
    while at < len(data):
        if at + 16 > len(data):
            raise _cut(data, at)
        seconds, fraction, size, _ = struct.unpack_from(f"{order}4I", data, at)
        if at + 16 + size > len(data):
            raise _cut(data, at)
        yield Packet(seconds + fraction / unit, data[at + 16 : at + 16 + size], link)
        at += 16 + size


def _read_pcapng(data: bytes) -> Iterable[Packet]:
    order = "<"
    interfaces: list[tuple[int, int]] = []
    at = 0
    while at < len(data):
        if at + 12 > len(data):
            raise _cut(data, at)
        if data[at : at + 4] == _SECTION.to_bytes(4, "big"):
            magic = data[at + 8 : at + 12]
            if magic not in (_MAGIC.to_bytes(4, "little"), _MAGIC.to_bytes(4, "big")):
                raise DecodeError("value", data[at : at + 12], 8, "a section without the number that tells the order")
            order = "<" if magic == _MAGIC.to_bytes(4, "little") else ">"
            interfaces = []
        kind, size = struct.unpack_from(f"{order}II", data, at)
        if size < 12 or size % 4 or at + size > len(data):
            raise _cut(data, at)
        body = data[at + 8 : at + size - 4]
        if kind == _INTERFACE and len(body) >= 8:
            interfaces.append((struct.unpack_from(f"{order}H", body)[0], _unit(body[8:], order)))
        elif kind == _ENHANCED and len(body) >= 20:
            number, high, low, captured, _ = struct.unpack_from(f"{order}5I", body)
            if number < len(interfaces):
                link, unit = interfaces[number]
                yield Packet(((high << 32) + low) / unit, body[20 : 20 + captured], link)
        elif kind == _SIMPLE and len(body) >= 4 and interfaces:
            yield Packet(0.0, body[4 : 4 + struct.unpack_from(f"{order}I", body)[0]], interfaces[0][0])
        elif at == 0 and kind != _SECTION:
            raise DecodeError("value", data[:12], 0, "neither a pcapng nor a pcap file")
        at += size


def _unit(options: bytes, order: str) -> int:
    """How many units of the times of an interface are a second: a million where nothing is said."""
    at = 0
    while at + 4 <= len(options):
        code, size = struct.unpack_from(f"{order}HH", options, at)
        if code == _RESOLUTION and size == 1 and at + 4 < len(options):
            exponent = options[at + 4]
            return int(2 ** (exponent & 0x7F) if exponent & 0x80 else 10**exponent)
        at += 4 + size + -size % 4
    return 1_000_000


def _cut(data: bytes, at: int) -> DecodeError:
    shown = data[at : at + 16]
    return DecodeError("short", shown, len(shown), f"the capture is cut off or damaged at byte {at} of {len(data)}")
