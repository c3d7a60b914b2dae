"""The sender and the receiver of a block transfer, which client and server share.   [CiA 301, SDO block]

        BlockSender                                          BlockReceiver
        01 | 7 bytes                         ->
        02 | 7 bytes                         ->
        ...
        7F | 7 bytes                         ->
                                             <-              A2 | 7F | 7F | ...      all of them; send 127 again
        01 | 7 bytes                         ->
        02 | 7 bytes                         -x              lost
        83 | the last 7 bytes                ->
                                             <-              A2 | 01 | 7F | ...      only the first
        01 | 7 bytes                         ->                                      the former 02, renumbered
        82 | the last 7 bytes                ->
                                             <-              A2 | 02 | 7F | ...
        C1 + 4 * unused | CRC                ->
                                             <-              A1                      complete, CRC correct

In a download the client is the sender, in an upload the server. Sequence numbers reveal lost segments. Receivers differ
in when they acknowledge: at the end of a block, at its first gap, or after a silence; the sender accepts an
acknowledgement at any time.

This receiver acknowledges the segments received in order when a block has ended. If the last segment was lost, no frame
marks the end, so after 70 % of the time-out it acknowledges the segments it has. If no segment arrived at all, it
repeats its last acknowledgement, which may have been lost. Segments out of order are ignored, also before segment 1.
A repeated segment with different data ends the transfer, because the two sides no longer refer to the same block.
"""

from __future__ import annotations

from binascii import crc_hqx
from struct import unpack

from barewire.canopen.abort_codes import AbortCode, ProtocolViolation
from barewire.canopen.sdo.messages import BLOCK_MAX, LAST, SEGMENT, BlockAck, BlockEnd, BlockEnded, ReceiverMessage
from barewire.canopen.sdo.stream import Incoming, Outgoing

BURST = 16
"""Segments sent before the sender listens again, so an abort is noticed at most this many frames late."""
FRAME = 1 + SEGMENT
"""Bytes of the frame of a segment: its number and the data."""
FUTILE_MAX = 5
"""How often a sender starts a block over before it gives up."""
STRAYS_MAX = 8 * BLOCK_MAX
"""How many segments out of order a receiver ignores, without progress, before it gives up."""

_REMIND = 0.7  # part of the time-out after which a receiver acknowledges what it has
_STEP = 1 / 64  # part of the time-out for which a receiver does not move its deadline again
_ENDED = BlockEnded().encode()
_NUMBERS = bytes(range(1, BLOCK_MAX + 1))


def segments(data: bytes, *, last: bool) -> list[bytes]:
    """Return the frames of a block.

    >>> [frame.hex(" ") for frame in segments(b"CANopen32", last=True)]
    ['01 43 41 4e 6f 70 65 6e', '82 33 32 00 00 00 00 00']

    Every eighth byte of a block is a number and the rest is data, so seven slices build all frames, without a loop
    over segments.
    """
    count = max(1, -(-len(data) // SEGMENT))
    padded = data.ljust(count * SEGMENT, b"\0")
    block = bytearray(count * FRAME)
    block[::FRAME] = _NUMBERS[:count]
    for place in range(SEGMENT):
        block[place + 1 :: FRAME] = padded[place::SEGMENT]
    if last:
        block[-FRAME] |= LAST
    return list(unpack(f"{FRAME}s" * count, block))


def joined(block: list[bytes]) -> bytes:
    """Return the data of a block's frames: the inverse of `segments`, with the padding of the last one.

    >>> joined(segments(b"CANopen32", last=True))
    b'CANopen32\\x00\\x00\\x00\\x00\\x00'
    """
    whole = bytearray(b"".join(block))
    del whole[::FRAME]
    return bytes(whole)


def check_blksize(blksize: int) -> int:
    """Return the block size that the peer requests. Raise ProtocolViolation if there is no such size."""
    if not 1 <= blksize <= BLOCK_MAX:
        raise ProtocolViolation(
            AbortCode.BLOCK_SIZE, f"a block of {blksize} segments was requested: expected 1..{BLOCK_MAX}"
        )
    return blksize


class BlockSender:
    """The sender of a value in blocks. A machine: acknowledgements in, frames out.

    It returns at most `burst` segments at a time. Until the block is sent, `deadline` is now: the caller listens
    between the bursts, because an acknowledgement or an abort may arrive at any time.
    """

    __slots__ = (
        *("_acknowledged", "_block", "_burst", "_crc", "_final", "_futile", "_held", "_sent", "_timeout", "_value"),
        *("deadline", "ended", "over", "with_crc"),
    )

    def __init__(self, value: Outgoing, blksize: int, *, crc: bool, timeout: float, burst: int, now: float) -> None:
        self._value = value
        self._timeout = timeout
        self._burst = burst
        self._held = b""  # the data not acknowledged yet: a block at most
        self._crc = 0
        self._futile = 0
        self._acknowledged: BlockAck | None = None
        self.with_crc = crc
        self.ended = False  # every segment is acknowledged, the end is sent
        self.over = False
        self.deadline = now
        self._load(check_blksize(blksize))

    def _load(self, blksize: int) -> None:
        """Prepare the block that begins with the first byte not acknowledged."""
        room = blksize * SEGMENT
        fresh = self._value.take(room - len(self._held))
        held = self._held = self._held + fresh
        self._crc = crc_hqx(fresh, self._crc)
        self._final = len(held) <= room and self._value.exhausted
        self._block = segments(held[:room], last=self._final)
        self._sent = 0

    def feed(self, message: ReceiverMessage | None, now: float) -> list[bytes]:
        """Return the next frames. Raise ProtocolViolation if the receiver broke the rules or its time ran out."""
        if isinstance(message, BlockEnded):
            if not self.ended:
                raise ProtocolViolation(AbortCode.COMMAND, "the receiver ended the transfer before its end")
            self.over = True
            return []
        if message is not None and not self.ended:
            self._acknowledged_by(message)
            if self.ended:
                self.deadline = now + self._timeout
                unused = len(self._block) * SEGMENT - len(self._held)
                return [BlockEnd(unused, self._crc if self.with_crc else 0).encode()]
        if now >= self.deadline and self._sent == len(self._block):
            part = "end" if self.ended else "block"
            raise ProtocolViolation(AbortCode.TIMED_OUT, f"no acknowledgement of the {part} within {self._timeout:g} s")
        return self._next_burst(now)

    def _next_burst(self, now: float) -> list[bytes]:
        burst = self._block[self._sent : self._sent + self._burst]
        if burst:
            self._sent += len(burst)
            self.deadline = now if self._sent < len(self._block) else now + self._timeout
        return burst

    def _acknowledged_by(self, ack: BlockAck) -> None:
        check_blksize(ack.blksize)
        whole = self._sent == len(self._block)
        if ack.sequence > self._sent:
            if ack != self._acknowledged:
                text = f"segment {ack.sequence} was acknowledged, but only {self._sent} were sent"
                raise ProtocolViolation(AbortCode.SEQUENCE_NUMBER, text)
            # The last acknowledgement is repeated. If all of this block is sent, the receiver has nothing of it.
            if whole:
                self._start_over()
            return
        if ack.sequence == 0:
            self._start_over()
        else:
            self._futile = 0
        self._acknowledged = ack
        if whole and self._final and ack.sequence == len(self._block):
            self.ended = True
            return
        self._held = self._held[ack.sequence * SEGMENT :]
        self._load(ack.blksize)

    def _start_over(self) -> None:
        self._futile += 1
        if self._futile > FUTILE_MAX:
            raise ProtocolViolation(AbortCode.TIMED_OUT, f"{FUTILE_MAX} times no segment of a block was acknowledged")
        self._sent = 0


class BlockReceiver:
    """The receiver of a value in blocks. A machine: the data of frames in, acknowledgements out.

    `over` is true when the whole value is in the sink; the frame that `feed` returned with it (A1) must still be sent.
    """

    __slots__ = (
        *("_blksize", "_crc", "_early", "_inside", "_last_ack", "_last_sequence", "_late", "_parts", "_reminded"),
        *("_stale", "_step", "_strays", "_timeout", "_value"),
        *("complete", "deadline", "over", "with_crc"),
    )

    def __init__(self, value: Incoming, blksize: int, *, crc: bool, timeout: float, now: float) -> None:
        self._value = value
        self._blksize = blksize
        self._inside = blksize - 1  # the highest number of a segment that needs no reaction
        self._timeout = timeout
        self._early = timeout * _REMIND
        self._late = timeout - self._early
        self._step = timeout * _STEP
        self._parts: list[bytes] = []  # the frames of this block received in order
        self._crc = 0
        self._strays = 0
        self._prepare_ack(0)
        self.with_crc = crc
        self.complete = False  # the last segment is acknowledged, the end is expected
        self.over = False
        self._move_deadline(now)

    @property
    def next_segment(self) -> int:
        """The number of the next segment in order; 0 when all of them have arrived."""
        return 0 if self.complete else len(self._parts) + 1

    @property
    def untouched(self) -> bool:
        """Whether no segment has arrived yet, not even one out of order."""
        return not (self._parts or self._strays or self._last_sequence or self.complete)

    def has(self, data: bytes) -> bool:
        """Return whether a frame repeats a segment of this block."""
        sequence = data[0] & ~LAST
        return 1 <= sequence <= len(self._parts) and self._parts[sequence - 1][1:] == data[1:]

    def feed(self, data: bytes | None, now: float) -> list[bytes]:
        """Return the reaction to a frame, or to time passing.

        Raise ProtocolViolation if the sender broke the rules or sent nothing for too long.
        """
        if data is None:
            return self._remind(now) if now >= self.deadline else []
        if self.accept(data, now):
            return []
        if now >= self._stale:
            self._move_deadline(now)
        if self.complete:
            return self._end(data)
        command, parts = data[0], self._parts
        sequence = command & ~LAST
        if sequence != len(parts) + 1 or sequence > self._blksize:
            return self._stray(data)
        parts.append(data)
        if command != sequence:
            self.complete, self._inside = True, 0
        return self._acknowledge()

    def accept(self, data: bytes, now: float) -> bool:
        """Accept the next segment inside a block: the path of nearly every frame. If it returns False, call `feed`."""
        parts = self._parts
        number = len(parts) + 1
        if len(data) != FRAME or data[0] != number or number > self._inside:
            return False
        parts.append(data)
        if now >= self._stale:
            self._move_deadline(now)
        return True

    def _move_deadline(self, now: float) -> None:
        # Not for each of the thousand frames a second, only when the last move is stale.
        self.deadline = now + self._early
        self._stale = now + self._step
        self._reminded = False

    def _acknowledge(self) -> list[bytes]:
        self._strays = 0
        self._prepare_ack(len(self._parts))
        # The last block is kept until the end states how many of its bytes are unused.
        if not self.complete:
            self._deliver(joined(self._parts))
            self._parts = []
        return [self._last_ack]

    def _prepare_ack(self, sequence: int) -> None:
        self._last_sequence = sequence
        self._last_ack = BlockAck(sequence, self._blksize).encode()

    def _deliver(self, data: bytes) -> None:
        self._crc = crc_hqx(data, self._crc)
        self._value.add(data)

    def _stray(self, data: bytes) -> list[bytes]:
        """Handle a segment that is not the next one: a repeated segment, or one after a gap."""
        sequence, is_last = data[0] & ~LAST, data[0] & LAST
        if not 1 <= sequence <= self._blksize:
            raise ProtocolViolation(AbortCode.SEQUENCE_NUMBER, f"segment {sequence} came: expected 1..{self._blksize}")
        self._count_stray()
        parts = self._parts
        if sequence <= len(parts):
            if not self.has(data):
                raise ProtocolViolation(AbortCode.SEQUENCE_NUMBER, f"segment {sequence} came again with different data")
        elif parts and (is_last or sequence == self._blksize):
            return self._acknowledge()
        return []

    def _count_stray(self) -> None:
        self._strays += 1
        if self._strays > STRAYS_MAX:
            raise ProtocolViolation(AbortCode.SEQUENCE_NUMBER, f"{STRAYS_MAX} segments came out of order")

    def _remind(self, now: float) -> list[bytes]:
        if self._reminded:
            raise ProtocolViolation(AbortCode.TIMED_OUT, f"no segment and no end within {self._timeout:g} s")
        self._reminded = True
        self._stale = now
        self.deadline = now + self._late
        if self._parts and not self.complete:
            return self._acknowledge()
        if self._strays and not self.complete:
            self._prepare_ack(0)  # the block is being sent, but its first segment did not arrive
        elif self._last_sequence == 1 and not self.complete:
            return []  # it would also acknowledge the one segment that is missing now
        return [self._last_ack]

    def _end(self, data: bytes) -> list[bytes]:
        if self.has(data):
            self._count_stray()
            return []
        if not BlockEnd.pattern.matches(data[0]) or len(data) < 3:
            raise ProtocolViolation(
                AbortCode.COMMAND, f"command {data[0]:02X}h came instead of the end of the transfer"
            )
        end = BlockEnd.decode(data)
        block = joined(self._parts)
        self._parts = []
        self._deliver(block[: len(block) - end.unused])
        if self.with_crc and end.crc != self._crc:
            raise ProtocolViolation(
                AbortCode.CRC, f"the CRC is {end.crc:04X}h, that of the received data {self._crc:04X}h"
            )
        self._value.end()
        self.over = True
        return [_ENDED]
