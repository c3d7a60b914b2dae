"""Vector BLF: binary recordings of CAN buses, objects in compressed containers.

    "LOGG" | header size 4 | ... 32 ... | start: year month weekday day hour minute second ms, 2 each | ...    the file
    "LOBJ" | header size 2 | version 2 | size 4 | type 4 |                                                   an object
           | flags 4 | ... 4 | time 8 |  in 10 us (flags 1) or 1 ns, since the start
           | body ... | up to 3 padding bytes

    type 10   container   packing 2 (0 none, 2 zlib) | 6 | size unpacked 4 | 4 |  objects, also across containers
    1, 86     frame       channel 2 | flags 1 (80 remote) | length 1 | identifier 4 (bit 31 extended) | data 8
    100       CAN FD      ... | length in bits 4 | 1 | FD 1 (1 FD, 2 BRS, 4 ESI) | data bytes 1 | 5 | data 64
    101       CAN FD      channel 1 | code 1 | data bytes 1 | 1 | identifier 4 | 4 | flags 4 (10h remote, 1000h FD ...)
    2, 73     error frame                       125   the recorder lost something here

All numbers are little-endian. Other objects (statistics, markers, other buses) are skipped. After bytes that are not an
object, reading continues at the next "LOBJ", and the bytes in between are reported.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from itertools import chain

from barewire.canopen.frame import BASE_MAX, DATA_MAX, EXTENDED_MAX, AnyFrame, CanFrame, ErrorFrame, FdFrame
from barewire.errors import DecodeError
from barewire_workbench.recordings.model import FD_LENGTHS, FD_MAX, Dropped, Recorded, RecordedItem, unread
from barewire_workbench.recordings.source import RecordingSource

BLF_MAGIC, _OBJECT = b"LOGG", b"LOBJ"
_CONTAINER, _LOST = 10, 125
_HEADER_MAX = 0x1_0000
"""The longest possible header of a file; Vector's tools write 144 bytes."""
_OBJECT_MAX = 0x80_0000
"""The longest possible object; a longer one is damaged."""
_CONTAINER_MAX = 0x400_0000
"""The most bytes of a container when unpacked; Vector's tools write containers of 128 KiB."""
_FRAME_OBJECT_MAX = 1024
_FRAME, _FRAME_2, _ERROR, _ERROR_EXT, _FD, _FD_64 = 1, 86, 2, 73, 100, 101
_FRAMES = (_FRAME, _FRAME_2, _ERROR, _ERROR_EXT, _FD, _FD_64)
_START_AT, _TIMES = 40, struct.Struct("<8H")
_HEAD, _STAMP = struct.Struct("<4sHHLL"), struct.Struct("<LHHQ")
_BARE = _HEAD.size + _STAMP.size
_CLASSICAL, _FD_BODY = struct.Struct("<HBBL8s"), struct.Struct("<HBBLLBBB5x")
_FD_64_BODY = struct.Struct("<BBBBLLL18xBBL")
_EXTENDED = 0x8000_0000
_BUS_ERROR = ErrorFrame(0x80)  # an error on the bus without details


class _Objects:
    """Splits a stream, received in pieces, into objects."""

    def __init__(self) -> None:
        self._pieces: list[bytes] = []
        self._needed = 0  # bytes of the object that is not complete
        self._lost = 0

    def feed(self, data: bytes, *, last: bool) -> Iterator[bytes | int]:
        """Yield complete objects; a number stands for that many bytes before the next one that are not an object."""
        self._pieces.append(data)
        if not last and sum(map(len, self._pieces)) < self._needed:
            return
        data, position, lost = b"".join(self._pieces), 0, self._lost
        self._pieces, self._needed, self._lost = [], 0, 0
        while True:
            start = data.find(_OBJECT, position)
            if start < 0:
                rest = data[position:]
                if not last:
                    self._pieces = [rest[-len(_OBJECT) + 1 :]]
                    rest = rest[: -len(_OBJECT) + 1]
                lost += len(rest) if len(rest) > 3 or any(rest) else 0
                break
            lost += start - position if start - position > 3 or lost else 0
            size, object_type = _HEAD.unpack_from(data, start)[3:] if start + _HEAD.size <= len(data) else (0, 0)
            is_possible = _HEAD.size <= size <= (_FRAME_OBJECT_MAX if object_type in _FRAMES else _OBJECT_MAX)
            if not last and (is_possible or not size) and start + max(size, _HEAD.size) > len(data):
                self._pieces, self._needed = [data[start:]], size
                break
            if not is_possible or start + size > len(data):
                if object_type == _CONTAINER and is_possible and data.find(_OBJECT, start + 4) < 0:
                    yield data[start:]  # the file is cut off in it; the part that is there can be unpacked
                    lost += start + size - len(data)
                    break
                position, lost = start + len(_OBJECT), lost + len(_OBJECT)
                continue
            if lost:
                yield lost
                lost = 0
            yield data[start : start + size]
            position = start + size
        if lost and last:
            yield lost
        else:
            self._lost = lost


def read_blf(recording: bytes | RecordingSource) -> Iterator[RecordedItem]:
    """Yield the frames of a BLF file, and its damaged parts.

    >>> list(read_blf(b"LOGG"))[0].why
    'the BLF file is damaged: its header is cut off'
    """
    source = RecordingSource.of(recording)
    head = source.take(_START_AT + 2 * _TIMES.size)
    if len(head) < _START_AT + _TIMES.size:
        yield unread(0.0, 1, "the BLF file is damaged: its header is cut off", "")
        return
    size = max(int.from_bytes(head[4:8], "little"), _START_AT + 2 * _TIMES.size)
    if size > _HEADER_MAX or len(head) + len(source.take(size - len(head))) < size:
        yield unread(0.0, 1, f"the BLF file is damaged: a header of {size} bytes", "")
        return
    start = _start(head)
    now, number, buses = start, 0, set[str]()
    for piece in _pieces(source.parts()):
        if isinstance(piece, str):
            number += 1
            yield unread(now, number, f"the BLF file is damaged here: {piece}", "")
            continue
        for item in _items(piece, start, now, number + 1, buses):
            now, number = item.at, number + 1
            if isinstance(item, Recorded):
                buses.add(item.bus)
            yield item


def _pieces(parts: Iterable[bytes]) -> Iterator[bytes | int | str]:
    """Yield objects, also from containers; a number for bytes outside of objects; a text for a damaged container."""
    splitter, inner = _Objects(), _Objects()
    for outer in chain.from_iterable(splitter.feed(part, last=not part) for part in chain(parts, [b""])):
        if isinstance(outer, int) or _kind(outer) != _CONTAINER:
            yield outer
            continue
        unpacked = _unpack(outer)
        if isinstance(unpacked, str):
            yield unpacked
        else:
            yield from inner.feed(unpacked, last=False)
    yield from inner.feed(b"", last=True)


def _start(data: bytes) -> float:
    """Return the start of the measurement in seconds since 1970; 0 if it is not a time."""
    year, month, _, day, hour, minute, second, millisecond = _TIMES.unpack_from(data, _START_AT)
    try:
        return datetime(year, month, day, hour, minute, second, millisecond * 1000, UTC).timestamp()
    except ValueError:
        return 0.0


def _kind(piece: bytes) -> int:
    return int.from_bytes(piece[12:16], "little")


def _unpack(container: bytes) -> bytes | str:
    """Return the content of a container, or the reason why it cannot be unpacked. Part of it if it is cut off."""
    body = container[_HEAD.size + 16 :]
    if len(container) < _HEAD.size + 16:
        return "a container is cut off"
    method = int.from_bytes(container[16:18], "little")
    if method == 0:
        return body
    if method != 2:
        return f"a container is packed with the unknown method {method}"
    unpacking = zlib.decompressobj()
    try:
        data = unpacking.decompress(body, _CONTAINER_MAX)
    except zlib.error as error:
        return f"a container cannot be unpacked: {' '.join(str(error).split())}"
    return data if not unpacking.unconsumed_tail else f"a container holds more than {_CONTAINER_MAX >> 20} MiB"


def _items(piece: bytes | int, start: float, now: float, number: int, buses: set[str]) -> Iterator[RecordedItem]:
    """Yield the item of an object, if it is an object for CAN."""
    if isinstance(piece, int):
        yield unread(now, number, f"the BLF file is damaged here: {piece} bytes that are not an object", "")
        return
    object_type = _kind(piece)
    if object_type not in _FRAMES and object_type != _LOST:
        return
    head = int.from_bytes(piece[4:6], "little")
    if not _BARE <= head <= len(piece):
        yield unread(now, number, f"an object with a header of {head} bytes", piece.hex(" "))
        return
    flags, _, _, time = _STAMP.unpack_from(piece, _HEAD.size)
    now = start + time * (1e-5 if flags == 1 else 1e-9)
    if object_type == _LOST:
        yield from (Dropped(now, bus, 0) for bus in buses)
        return
    try:
        channel, frame = _frame(object_type, piece, head)
    except struct.error:
        yield unread(now, number, "an object that is too short for its type", piece.hex(" "))
    except DecodeError as error:
        yield unread(now, number, error, piece.hex(" "))
    else:
        yield Recorded(now, str(channel - 1), frame, number)


def _frame(object_type: int, piece: bytes, head: int) -> tuple[int, AnyFrame]:
    """Return the channel, from 1, and the frame."""
    body = piece[head:]
    if object_type in (_ERROR, _ERROR_EXT):
        return struct.unpack_from("<H", body)[0], _BUS_ERROR
    if object_type in (_FRAME, _FRAME_2):
        channel, flags, length, word, data = _CLASSICAL.unpack_from(body)
        number, extended = _identifier(word, body)
        length = min(length, DATA_MAX)
        if flags & 0x80:
            return channel, CanFrame(number, b"", extended, True, length)
        return channel, CanFrame(number, data[:length], extended)
    if object_type == _FD:
        channel, flags, code, word, _, _, fd, length = _FD_BODY.unpack_from(body)
        data, remote = body[_FD_BODY.size :], bool(flags & 0x80)
        is_fd, speed = bool(fd & 1), fd >> 1 & 3
    else:
        channel, code, length, _, word, _, fd, _, end, _ = _FD_64_BODY.unpack_from(body)
        # `end` counts from the start of the object. Zeros at the end of the data may be left out.
        data = piece[head + _FD_64_BODY.size : end or None].ljust(length, b"\0")
        remote = bool(fd & 0x10)
        is_fd, speed = bool(fd & 0x1000), fd >> 13 & 3
    number, extended = _identifier(word, body)
    if not is_fd:
        length = min(length, DATA_MAX)
        if remote:
            return channel, CanFrame(number, b"", extended, True, min(code, DATA_MAX))
        return channel, CanFrame(number, data[:length], extended)
    if length > FD_MAX or len(data) < length or length > FD_LENGTHS[code & 15]:
        raise DecodeError("value", body, 0, f"a length of {length} bytes with the code {code}")
    return channel, FdFrame(number, data[:length], extended, speed)


def _identifier(word: int, body: bytes) -> tuple[int, bool]:
    number, extended = word & EXTENDED_MAX, bool(word & _EXTENDED)
    if not extended and number > BASE_MAX:
        raise DecodeError("value", body, 0, f"identifier {number:X}h of a base frame")
    return number, extended
