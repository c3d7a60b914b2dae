"""CAN frames in captures: reads and writes link type 227, LINKTYPE_CAN_SOCKETCAN.

        identifier 4, big-endian                    length 1   flags 1   0   0   data
        bit 31 extended, 30 remote, 29 error frame             04: CAN FD, 01: bit rate switch, 02: error passive

A capture of all interfaces has the same frames in the cooked formats of Linux (113, 276).
"""

from __future__ import annotations

import struct

from barewire.canopen.frame import BASE_MAX, DATA_MAX, EXTENDED_MAX, AnyFrame, CanFrame, ErrorFrame, FdFrame
from barewire.errors import DecodeError
from barewire_workbench.recordings.model import FD_MAX
from barewire_workbench.recordings.pcapng import Packet

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
