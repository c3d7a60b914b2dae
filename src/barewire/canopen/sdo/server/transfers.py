"""The four transfers of a server that take more than one frame.   [CiA 301, SDO]

        SegmentedUpload      60 70 ...           -> 00 10 ... the bytes             the value at the time of the request
        SegmentedDownload    00 10 ... bytes     -> 20 30                           written to the dictionary at the end
        BlockUpload          A3, A2, A1          -> 01 02 03 ..., C1                with a BlockSender
        BlockDownload        01 02 03 ..., C1    -> A2, A1                          with a BlockReceiver

Each is a machine with the same members; a server has at most one at a time. A frame that is not allowed in the present
state ends the transfer: `feed` raises ProtocolViolation or SdoAbort. The request for a new transfer replaces it, if
`gives_way` says that the frame is one.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from barewire.canopen.abort_codes import AbortCode, ProtocolViolation
from barewire.canopen.sdo.block_transfer import BURST, BlockReceiver, BlockSender
from barewire.canopen.sdo.messages import (
    RECEIVER_MESSAGES,
    SEGMENT,
    ExpeditedDownload,
    M,
    NextSegment,
    SdoSegment,
    SegmentTaken,
    StartBlockUpload,
    decode_one_of,
)
from barewire.canopen.sdo.stream import Incoming, Outgoing
from barewire.errors import DecodeError

_Write = Callable[[bytes], None]
"""Writes a whole value, or refuses it by raising SdoAbort."""


class ServerTransfer(Protocol):
    """A transfer that has begun. At its `deadline` it must be fed None."""

    over: bool

    @property
    def deadline(self) -> float: ...

    @property
    def next_segment(self) -> int:
        """The number of the next block segment; 0 if none is expected."""

    def gives_way(self, data: bytes) -> bool:
        """Return whether a frame that looks like the request for a new transfer is one, and replaces this transfer."""

    def accept(self, data: bytes, now: float) -> bool:
        """Accept the next segment inside a block, which needs no response; see `BlockReceiver`."""

    def feed(self, data: bytes | None, now: float) -> list[bytes]: ...


def _never(data: bytes, now: float) -> bool:
    """Return False: the `accept` of transfers that respond to every frame."""
    return False


def _always(data: bytes) -> bool:
    """Return True: the `gives_way` of transfers in which no frame looks like the request for a new one."""
    return True


def _expect(data: bytes, *types: type[M]) -> M:
    """Decode a message of one of these types; any other frame ends the transfer."""
    try:
        return decode_one_of(data, types)
    except DecodeError as error:
        raise ProtocolViolation(AbortCode.COMMAND, error.text) from None


def _check_timeout(now: float, deadline: float) -> list[bytes]:
    if now >= deadline:
        raise ProtocolViolation(AbortCode.TIMED_OUT, "the client was silent")
    return []


class SegmentedUpload:
    """An upload in segments."""

    __slots__ = ("_timeout", "_toggle", "_value", "deadline", "over")
    next_segment = 0
    accept = staticmethod(_never)
    gives_way = staticmethod(_always)

    def __init__(self, value: bytes, timeout: float, now: float) -> None:
        self._value = Outgoing((value,), len(value))
        self._toggle = 0
        self._timeout = timeout
        self.deadline = now + timeout
        self.over = False

    def feed(self, data: bytes | None, now: float) -> list[bytes]:
        """Return the next segment."""
        if data is None:
            return _check_timeout(now, self.deadline)
        toggle = _expect(data, NextSegment).toggle
        if toggle != self._toggle:
            raise ProtocolViolation(
                AbortCode.TOGGLE, f"segment with toggle bit {toggle} requested, {self._toggle} is next"
            )
        part = self._value.take(SEGMENT)
        self.over = self._value.exhausted
        self._toggle ^= 1
        self.deadline = now + self._timeout
        return [SdoSegment(toggle, part, self.over).encode()]


class SegmentedDownload:
    """A download in segments."""

    __slots__ = ("_buffer", "_timeout", "_toggle", "_value", "_write", "deadline", "over")
    next_segment = 0
    accept = staticmethod(_never)
    gives_way = staticmethod(_always)

    def __init__(self, write: _Write, size: int | None, limit: int, timeout: float, now: float) -> None:
        self._buffer = bytearray()
        self._value = Incoming(self._buffer.extend, size, limit=limit)
        self._write = write
        self._toggle = 0
        self._timeout = timeout
        self.deadline = now + timeout
        self.over = False

    def feed(self, data: bytes | None, now: float) -> list[bytes]:
        """Return the confirmation of a segment. The last one is confirmed after the value is written."""
        if data is None:
            return _check_timeout(now, self.deadline)
        segment = _expect(data, SdoSegment)
        if segment.toggle != self._toggle:
            raise ProtocolViolation(
                AbortCode.TOGGLE, f"segment with toggle bit {segment.toggle} came, {self._toggle} is next"
            )
        self._value.add(segment.data)
        if segment.last:
            self._value.end()
            self._write(bytes(self._buffer))
        self.over = segment.last
        self._toggle ^= 1
        self.deadline = now + self._timeout
        return [SegmentTaken(segment.toggle).encode()]


class BlockUpload:
    """An upload in blocks, which begins with the start message of the client."""

    __slots__ = ("_blksize", "_crc", "_sender", "_timeout", "_value", "deadline", "over")
    next_segment = 0
    accept = staticmethod(_never)
    gives_way = staticmethod(_always)

    def __init__(self, value: bytes, blksize: int, crc: bool, timeout: float, now: float) -> None:
        self._value = value
        self._blksize = blksize
        self._crc = crc
        self._timeout = timeout
        self._sender: BlockSender | None = None
        self.deadline = now + timeout
        self.over = False

    @property
    def ended(self) -> bool:
        """Whether the end is sent, and only the A1 of the client is missing."""
        return self._sender is not None and self._sender.ended

    def feed(self, data: bytes | None, now: float) -> list[bytes]:
        """Return the next segments, or the end."""
        sender = self._sender
        if sender is None:
            if data is None:
                return _check_timeout(now, self.deadline)
            _expect(data, StartBlockUpload)
            value = Outgoing((self._value,), len(self._value))
            sender = BlockSender(value, self._blksize, crc=self._crc, timeout=self._timeout, burst=BURST, now=now)
            self._sender, data = sender, None
        frames = sender.feed(None if data is None else _expect(data, *RECEIVER_MESSAGES), now)
        self.deadline, self.over = sender.deadline, sender.over
        return frames


class BlockDownload:
    """A download in blocks."""

    __slots__ = ("_buffer", "_receiver", "_write", "accept", "over")

    def __init__(
        self, write: _Write, size: int | None, limit: int, blksize: int, crc: bool, timeout: float, now: float
    ) -> None:
        self._buffer = bytearray()
        value = Incoming(self._buffer.extend, size, limit=limit)
        self._receiver = BlockReceiver(value, blksize, crc=crc, timeout=timeout, now=now)
        self.accept = self._receiver.accept  # the path of nearly every frame, called directly
        self._write = write
        self.over = False

    @property
    def deadline(self) -> float:
        """When the receiver must be fed None."""
        return self._receiver.deadline

    @property
    def next_segment(self) -> int:
        """The number of the next segment; 0 when all of them have arrived."""
        return self._receiver.next_segment

    def gives_way(self, data: bytes) -> bool:
        """Return whether a frame is the request for a new transfer.

        Between segments it is not: 40h is also segment 64, C6h also the last segment 70. Before the first segment
        these are too far ahead to be segments. Only an expedited download is still not taken, because if it were a
        segment after all, its data would be written to some object.
        """
        receiver = self._receiver
        if receiver.untouched:
            return not ExpeditedDownload.pattern.matches(data[0])
        return receiver.complete and not receiver.has(data)

    def feed(self, data: bytes | None, now: float) -> list[bytes]:
        """Return the acknowledgement of a block. The end is acknowledged after the value is written."""
        receiver = self._receiver
        frames = receiver.feed(data, now)
        if receiver.over:
            self._write(bytes(self._buffer))
            self.over = True
        return frames
