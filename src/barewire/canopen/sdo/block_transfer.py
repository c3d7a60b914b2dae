"""The two halves of every block transfer: one machine that sends segments, one that hears them.   [CiA 301, SDO block]

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
        01 | 7 bytes                         ->                                      what was 02, numbered anew
        82 | the last 7 bytes                ->
                                             <-              A2 | 02 | 7F | ...
        C1 + 4 * unused | CRC                ->
                                             <-              A1                      whole and right

In a download the client is the sender, in an upload the server: both roles use these two and nothing else. What was
lost is found by the numbers, and when acknowledgements come is not the same with all receivers: at the end of a block,
at its first gap, or when nothing more came. The sender takes each of them at any time.

Our receiver acknowledges when a block has ended, as far as it got. If the end was lost there is nothing to hear, so
after 70 % of the time-out it says what it has; when nothing at all came it repeats its last word, since that may be
what was lost. Segments that do not follow are passed over, before segment 1 too, and one that comes again with other
bytes ends the transfer: then the two no longer talk about the same block.

I know: segments, acknowledgements, times.  I never know: identifiers, objects, which role this is.
"""

from __future__ import annotations

from binascii import crc_hqx

from barewire.canopen.sdo.aborts import AbortCode, ProtocolViolation
from barewire.canopen.sdo.block_segments import FRAME, joined, segments
from barewire.canopen.sdo.messages.block import BLOCK_MAX, LAST, BlockAck, BlockEnd, BlockEnded
from barewire.canopen.sdo.messages.codec import ReceiverMessage
from barewire.canopen.sdo.messages.segment import SEGMENT
from barewire.canopen.sdo.stream import Incoming, Outgoing

BURST = 16
"""Segments of a block that are said before its sender listens again: an abort is heard so many frames late at most."""
REMIND = 0.7
"""The part of the time-out after which a receiver says what it has."""
FUTILE_MAX = 5
"""How often a sender starts over without getting on."""
STRAYS_MAX = 8 * BLOCK_MAX
"""How many segments out of turn a receiver passes over without getting on."""

_ENDED = BlockEnded().encode()
_STEP = 1 / 64
"""The part of the time-out for which a receiver does not move its deadline again."""


def check_blksize(blksize: int) -> int:
    """The block size that the other side wants, or a Breach."""
    if not 1 <= blksize <= BLOCK_MAX:
        raise ProtocolViolation(
            AbortCode.BLOCK_SIZE, f"a block of {blksize} segments was wanted: there are 1 to {BLOCK_MAX}"
        )
    return blksize


class BlockSender:
    """Sends a value in blocks. A machine: acknowledgements in, frames out.

    At most `burst` segments come out at a time, and then `deadline` is now: whoever runs it listens in between, for
    an acknowledgement or an abort may come at any time.
    """

    __slots__ = (
        *("_acknowledged", "_block", "_burst", "_crc", "_final", "_futile", "_held", "_said", "_timeout", "_value"),
        *("deadline", "ended", "over", "with_crc"),
    )

    def __init__(self, value: Outgoing, blksize: int, *, crc: bool, timeout: float, burst: int, now: float) -> None:
        self._value = value
        self._timeout = timeout
        self._burst = burst
        self._held = b""  # what is not acknowledged yet: a block at most
        self._crc = 0
        self._futile = 0
        self._acknowledged: BlockAck | None = None
        self.with_crc = crc
        self.ended = False  # every segment is acknowledged, the end has been said
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
        self._said = 0

    def feed(self, heard: ReceiverMessage | None, now: float) -> list[bytes]:
        """What to say next. Raises Breach when the receiver broke the rules or is silent for too long."""
        if isinstance(heard, BlockEnded):
            if not self.ended:
                raise ProtocolViolation(AbortCode.COMMAND, "the receiver ended the transfer in the middle")
            self.over = True
            return []
        if heard is not None and not self.ended:
            self._take(heard)
            if self.ended:
                self.deadline = now + self._timeout
                unused = len(self._block) * SEGMENT - len(self._held)
                return [BlockEnd(unused, self._crc if self.with_crc else 0).encode()]
        if now >= self.deadline and self._said == len(self._block):
            what = "end" if self.ended else "block"
            raise ProtocolViolation(AbortCode.TIMED_OUT, f"no acknowledgement of the {what} within {self._timeout:g} s")
        return self._say(now)

    def _say(self, now: float) -> list[bytes]:
        """The next burst of this block; nothing if all of it is out."""
        said = self._block[self._said : self._said + self._burst]
        if said:
            self._said += len(said)
            self.deadline = now if self._said < len(self._block) else now + self._timeout
        return said

    def _take(self, ack: BlockAck) -> None:
        check_blksize(ack.blksize)
        whole = self._said == len(self._block)
        if ack.sequence > self._said:
            if ack != self._acknowledged:
                text = f"segment {ack.sequence} was acknowledged, and {self._said} were sent"
                raise ProtocolViolation(AbortCode.SEQUENCE_NUMBER, text)
            # The last one again. If all of this block is out, the receiver has got nothing of it.
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
            raise ProtocolViolation(AbortCode.TIMED_OUT, f"{FUTILE_MAX} times nothing of a block arrived")
        self._said = 0


class BlockReceiver:
    """Hears a value in blocks. A machine: the data of frames in, acknowledgements out.

    `over` is true when the whole value is in the sink; whatever `feed` returned then (A1) is still to be said.
    """

    __slots__ = (
        *("_blksize", "_crc", "_early", "_inside", "_last_sequence", "_last_word", "_late", "_parts", "_reminded"),
        *("_stale", "_step", "_strays", "_timeout", "_value"),
        *("complete", "deadline", "over", "with_crc"),
    )

    def __init__(self, value: Incoming, blksize: int, *, crc: bool, timeout: float, now: float) -> None:
        self._value = value
        self._blksize = blksize
        self._inside = blksize - 1  # the highest number that a segment has to which nothing is said
        self._timeout = timeout
        self._early = timeout * REMIND
        self._late = timeout - self._early
        self._step = timeout * _STEP
        self._parts: list[bytes] = []  # the frames of this block, as far as they came in order
        self._crc = 0
        self._strays = 0
        self._word(0)
        self.with_crc = crc
        self.complete = False  # the last segment is acknowledged, the end is awaited
        self.over = False
        self._alive(now)

    @property
    def next_segment(self) -> int:
        """The number that the next segment in order has; 0 when all of them are here."""
        return 0 if self.complete else len(self._parts) + 1

    def feed(self, data: bytes | None, now: float) -> list[bytes]:
        """What to say to a frame, or to time passing. Raises Breach when the sender broke the rules or is silent."""
        if data is None:
            return self._remind(now) if now >= self.deadline else []
        if self.accept(data, now):
            return []
        if now >= self._stale:
            self._alive(now)
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
        """The way of nearly every frame: the next segment, inside a block. False: it is another, and to be fed."""
        parts = self._parts
        number = len(parts) + 1
        if len(data) != FRAME or data[0] != number or number > self._inside:
            return False
        parts.append(data)
        if now >= self._stale:
            self._alive(now)
        return True

    def _alive(self, now: float) -> None:
        """The sender was heard. Not noted again at once, for it is heard a thousand times a second."""
        self.deadline = now + self._early
        self._stale = now + self._step
        self._reminded = False

    def _acknowledge(self) -> list[bytes]:
        """As far as it came in order. The block with the last segment stays here until the end tells what counts."""
        self._strays = 0
        self._word(len(self._parts))
        if not self.complete:
            self._give_on(joined(self._parts))
            self._parts = []
        return [self._last_word]

    def _word(self, sequence: int) -> None:
        self._last_sequence = sequence
        self._last_word = BlockAck(sequence, self._blksize).encode()

    def _give_on(self, data: bytes) -> None:
        self._crc = crc_hqx(data, self._crc)
        self._value.add(data)

    def _stray(self, data: bytes) -> list[bytes]:
        """A segment that is not the next one: an old one again, or one behind a gap."""
        sequence, last = data[0] & ~LAST, data[0] & LAST
        if not 1 <= sequence <= self._blksize:
            raise ProtocolViolation(
                AbortCode.SEQUENCE_NUMBER, f"segment {sequence} came: there are 1 to {self._blksize}"
            )
        self._strays += 1
        if self._strays > STRAYS_MAX:
            raise ProtocolViolation(AbortCode.SEQUENCE_NUMBER, f"{STRAYS_MAX} segments came out of turn")
        parts = self._parts
        if sequence <= len(parts):
            if parts[sequence - 1][1:] != data[1:]:
                raise ProtocolViolation(AbortCode.SEQUENCE_NUMBER, f"segment {sequence} came again with other bytes")
        elif parts and (last or sequence == self._blksize):
            return self._acknowledge()
        return []

    def _remind(self, now: float) -> list[bytes]:
        if self._reminded:
            raise ProtocolViolation(AbortCode.TIMED_OUT, f"no segment and no end within {self._timeout:g} s")
        self._reminded = True
        self._stale = now
        self.deadline = now + self._late
        if self._parts and not self.complete:
            return self._acknowledge()
        if self._strays and not self.complete:
            self._word(0)  # this block is on its way, but its first segment did not come
        elif self._last_sequence == 1 and not self.complete:
            return []  # could be taken for the acknowledgement of the one segment that is missing now
        return [self._last_word]

    def _end(self, data: bytes) -> list[bytes]:
        sequence, parts = data[0] & ~LAST, self._parts
        if 1 <= sequence <= len(parts) and parts[sequence - 1][1:] == data[1:]:
            return []  # a segment of the last block again
        if not BlockEnd.pattern.matches(data[0]) or len(data) < 3:
            raise ProtocolViolation(AbortCode.COMMAND, f"command {data[0]:02X}h came, and not the end of the transfer")
        end = BlockEnd.decode(data)
        block = joined(parts)
        self._parts = []
        self._give_on(block[: len(block) - end.unused])
        if self.with_crc and end.crc != self._crc:
            raise ProtocolViolation(AbortCode.CRC, f"the CRC is {end.crc:04X}h, of what came it is {self._crc:04X}h")
        self._value.end()
        self.over = True
        return [_ENDED]
