"""The framing state of one RTU line, which finds the frames in a stream of bytes without delimiters.

Three criteria decide, in this order:

    the count     the first bytes of a message give its length (`rtu.shape`), so a frame is complete before the silence
    the CRC       must be right, or the bytes are not a frame
    the silence   ends the remaining bytes, and is the only end of a function without a known length

**t3.5 is two numbers.** Before sending, the line keeps the strict silence: `quiet_at`. When receiving, it tolerates
longer pauses, because operating systems and USB adapters deliver bytes in batches, up to 16 ms late, and a strict
window of 2 ms would cut good frames in half. `patience` is the longest pause that is accepted inside a frame.
`patience=None` follows the standard exactly, for real UARTs: only t3.5 ends a frame, and a gap above t1.5 inside a
frame makes it invalid [MB-SERIAL 2.5.1.1].

    feed:  | noise | unit ... CRC | unit ... CRC | half a fr        ->  Noise, Adu, Adu, and 9 bytes held

Where both directions are received, the same bytes can be a whole request and a whole response, of different lengths:
a response whose CRC ends with 00 has a good CRC without that byte too. `Shape.likeliest` decides between them.

**After a wrong CRC** a client or server takes nothing before the silence (`gap`), because the data of a damaged frame
can spell a whole frame with a good CRC:

    02 03 06 | 01 03 02 00 63 F9 AD | CRC        unit 2 answers; its registers spell an answer of unit 1

At the silence the held bytes are divided into frames only if nothing is left over: each has a good CRC, and the last
one ends at the silence. So frames of functions without a known length are told apart, and the echo of a request from
the answer. Up to four bytes 00 or FF may come before each frame: a receiver reads them when a transmitter on RS-485 is
turned on.

Bytes that are one damaged bit away from a single frame are not divided, whatever its data spell. Several damages in one
frame can still pass, as with every CRC. So can an image with which the received bytes begin: the first bytes are lost,
a damaged function code gives a shorter frame, or a gap above `patience` precedes it. Its count and CRC end it at once;
waiting for the silence would cost each frame 30 ms.

A listener executes nothing and shows everything: where the bytes cannot be divided, it searches, byte by byte, for the
next whole frame with a good CRC, and reports the bytes before it as one Noise.
"""

from __future__ import annotations

from collections.abc import Container
from heapq import heappop, heappush

from barewire.errors import DecodeError, EncodeError, Reason
from barewire.modbus.adu import Adu, Noise, received_adu
from barewire.rtu.crc import INITIAL, TABLE, crc16, is_one_bit_off
from barewire.rtu.frame import LONGEST, SHORTEST, Timing, decode, encode
from barewire.rtu.shape import Role, Shape

PATIENCE = 0.030
"""Seconds: more than the 16 ms after which common USB adapters deliver bytes, far less than any time-out."""

_ROUNDING = 1e-7
"""Seconds, far less than a character. Times are sums of floats; a gap of exactly t1.5 or t3.5 must count as such."""

_ENVELOPE = 3
"""Bytes of a frame around the PDU: unit and CRC."""

_STRAYS, _MOST_STRAYS = b"\x00\xff", 4
"""What a receiver reads when a transmitter on RS-485 is turned on: few bytes, because it is for less than t3.5."""

_AT_SILENCE, _NEVER = 1 << 62, 1 << 63
"""When to check a place again if no number of bytes can decide about it: at the next silence; never."""


class RtuLine:
    """One line. A client receives responses. A server receives requests, and also the responses of other units.

    >>> line = RtuLine(Timing.of(19200), role="server")
    >>> line.feed(bytes.fromhex("01040FB1 000222F8"), now=1.0)
    [Adu(unit=1, pdu=b'\\x04\\x0f\\xb1\\x00\\x02', transaction=None)]
    >>> line.feed(b"\\xff\\x00\\x07", now=2.0), round(line.deadline, 3)
    ([], 2.03)
    >>> line.feed(None, now=2.03)
    [Noise(data=b'\\xff\\x00\\x07', reason='short', text='3 bytes, then silence')]

        timing      the times of a character and of the two silences
        role        "client" (default), "server", or "listener", which receives both kinds of message
        units       the server's own addresses: a frame with one of them is a request, never another unit's response
        patience    the longest pause inside a frame, in seconds (default 0.03); None follows the standard exactly
    """

    numbered = False
    broken = None

    def __init__(
        self,
        timing: Timing,
        *,
        role: Role = "client",
        units: Container[int] = (),
        patience: float | None = PATIENCE,
    ) -> None:
        if patience is not None and patience < 0:
            raise EncodeError(f"patience {patience}: expected seconds, 0 or more, or None to be strict", "patience")
        self.timing = timing
        self.role: Role = role
        self.strict = patience is None
        self.gap = timing.t35 if patience is None else max(timing.t35, patience)
        """The silence, in seconds, that ends a frame."""
        self._shape = Shape(role, units)
        self._held = bytearray()
        self._last = float("-inf")  # end of the last byte, sent or received
        # Strict only: why the held bytes are not a frame, even if their CRC is right.
        self._spoiled: tuple[Reason, str] | None = None
        self._overlong = False  # the beginning of the damaged bytes was removed: nothing is a frame before the silence
        self._strays = bytearray()  # the beginning of those
        self._removed = 0  # the number of bytes that were held and removed
        self._first_due = 0  # the number of bytes at which to check the first place again
        self._places: list[tuple[int, int]] = []  # a heap of (number of bytes at which to check again, place)
        self._unchecked = 0  # the first place that has not been checked yet
        self._hunted = 0  # up to here no frame ends that begins behind the first byte
        self._unit = 0

    def __repr__(self) -> str:
        return f"<RtuLine: {self.role}>"

    # Sending

    @property
    def delay(self) -> float:
        """How much later than its last byte a frame may be returned: after the silence that ends it."""
        return self.gap

    @property
    def quiet_at(self) -> float:
        """t3.5 after the last byte on the line, sent or received. `patience` does not change it."""
        return self._last + self.timing.t35

    def request(self, unit: int, pdu: bytes) -> bytes:
        """Return the frame of a request."""
        self._unit = unit
        return encode(unit, pdu)

    def response(self, to: Adu, pdu: bytes) -> bytes:
        """Return the frame of a response."""
        return encode(to.unit, pdu)

    def sent(self, now: float) -> None:
        """Record that the last byte of a frame was transmitted at `now`: the silence before the next frame begins."""
        self._last = max(self._last, now)

    def answers(self, adu: Adu) -> bool:
        """Whether the frame comes from the unit of the last request."""
        return adu.unit == self._unit

    # Receiving

    def answer_in(self, data: bytes, now: float) -> bytes | None:
        """Return the PDU if these bytes, the last received at `now`, are one frame with a good CRC from the unit of the
        last request, and no others are held; None if `feed` must decode them.

        The caller must check that the PDU has the length that its count announces: otherwise only a silence ends it.
        """
        # In strict mode only a silence ends a frame [MB-SERIAL 2.5.1.1].
        if self._held or self.strict or not SHORTEST <= len(data) <= LONGEST:
            return None
        if data[0] != self._unit or crc16(data):
            return None
        self._last = now
        return data[1:-2]

    @property
    def held(self) -> bytes:
        """The bytes that may still become a frame."""
        return bytes(self._held)

    @property
    def deadline(self) -> float | None:
        """When the silence will be long enough to end the held bytes."""
        return self._last + self.gap if self._held else None

    def feed(self, data: bytes | None, now: float) -> list[Adu | Noise]:
        """Return the events of bytes that arrived together, the last at `now`; None if nothing arrived until `now`."""
        events: list[Adu | Noise] = []
        if not data:
            if self._held and now >= self._last + self.gap:
                events += self._close()
            return events
        # The bytes were sent one after the other, so the first one began this much earlier.
        silent = now - self.timing.duration(len(data)) - self._last
        if self._held:
            if silent >= self.gap - _ROUNDING:
                events += self._close()
            elif self.strict and silent > self.timing.t15 + _ROUNDING:
                self._spoiled = "silence", "a gap above 1.5 characters inside the frame"
        self._held += data
        self._last = max(self._last, now)
        if not self.strict:
            events += self._cut()
        elif len(self._held) > LONGEST:
            text = f"more than {LONGEST} bytes without silence"
            self._spoiled = "long", text
            events.append(self._drop(len(self._held) - LONGEST, "long", text))
        return events

    def _cut(self) -> list[Adu | Noise]:
        """Remove and return every frame that is confirmed by its count and CRC."""
        events: list[Adu | Noise] = []
        while self._held:
            end = None if self._overlong else self._check_first()
            if end is not None:
                events.append(self._take(end))
            elif self._first_due != _NEVER and len(self._held) < LONGEST:
                break
            elif inside := self._hunt():
                events += inside
            elif self.role != "listener" and len(self._held) > LONGEST and (ends := self._ends(0)):
                # A frame without a known length, and others follow it without a silence.
                events.append(self._take(ends[0]))
            else:
                excess = len(self._held) - LONGEST
                if excess > 0:
                    self._overlong = self.role != "listener" and not self._is_stray(excess)
                    events.append(self._drop(excess, "long", f"more than {LONGEST} bytes and no frame in them"))
                break
        return events

    def _is_stray(self, count: int) -> bool:
        """Whether the first bytes, which are removed because a frame cannot be longer, can come before a frame."""
        if self._overlong:
            return False
        self._strays += self._held[:count]
        return len(self._strays) <= _MOST_STRAYS and not self._strays.strip(_STRAYS)

    def _close(self) -> list[Adu | Noise]:
        """End the held bytes by silence: they are one frame, contain frames, or are noise."""
        events: list[Adu | Noise] = []
        if self._spoiled is not None:
            events.append(self._drop(len(self._held), *self._spoiled))
        self._spoiled = None
        if self._overlong:
            events.append(self._drop(len(self._held), *self._diagnosis()))
        self._overlong = False
        self._strays.clear()
        while self._held:
            end = None if self.strict else self._check(0)[0]
            if end is None and self._shape.is_whole(bytes(self._held)):
                # A function without a known length, which only silence ends.
                end = len(self._held)
            if end is not None:
                events.append(self._take(end))
            elif not self.strict and (inside := self._divide() or self._hunt()):
                events += inside
            else:
                events.append(self._drop(len(self._held), *self._diagnosis()))
        return events

    def _diagnosis(self) -> tuple[Reason, str]:
        """Return why the remaining bytes are not a frame."""
        size = f"{len(self._held)} byte{'' if len(self._held) == 1 else 's'}"
        try:
            decode(bytes(self._held))
        except DecodeError as error:
            if error.reason == "short":
                return "short", f"{size}, then silence"
            return error.reason, error.text
        return "short", f"{size}, then silence: the last byte is missing, a 00 of the CRC"

    # Where a frame may begin and end. Places are counted from the first byte that the line ever held, so they stay
    # valid when bytes are removed: held[at] is byte number _removed + at.

    def _check_first(self) -> int | None:
        """Return the end of the frame that begins with the first byte. Checks only when enough bytes have arrived."""
        if self._removed + len(self._held) < self._first_due:
            return None
        end, self._first_due = self._check(0, True)
        return end

    def _check(self, at: int, may_wait: bool = False) -> tuple[int | None, int]:
        """Return the end of the frame that begins at `at`, or None; and the number of bytes at which to check again.

        `may_wait`: return None also if the bytes are a frame, but a longer one that begins with them is more likely.
        """
        held, pdu = len(self._held), bytes(self._held[at + 1 : at + LONGEST])
        if not pdu:
            return None, self._removed + at + 2
        due, counted = _NEVER, False
        whole: list[int] = []
        sizes = self._shape.measured(self._held[at], pdu)
        for size in sizes:
            if size is None:
                continue
            counted = True
            end = at + size + _ENVELOPE
            if end - at > LONGEST:
                continue
            if end > held:
                # The end has not arrived, or more bytes are needed to know the count.
                due = min(due, self._removed + (end if size <= len(pdu) else at + 1 + size))
            elif self._removed + end > self._hunted and end - at >= SHORTEST and crc16(self._held[at:end]) == 0:
                if len(sizes) == 1:
                    return end, due
                whole.append(size)
        if whole and (size := self._shape.likeliest(self._held[at], pdu, sizes, whole, may_wait)) is not None:
            return at + size + _ENVELOPE, due
        return None, due if counted else _AT_SILENCE

    def _divide(self) -> list[Adu | Noise]:
        """Return the frames that fill the held bytes up to the silence, each behind stray bytes; nothing if they do
        not."""
        frames = self._frames()
        if not frames or is_one_bit_off(self._held):
            return []
        events: list[Adu | Noise] = []
        before = 0
        for start, end in frames:
            if count := start - before:
                events.append(self._drop(count, "checksum", f"{count} bytes that are not a frame before a good one"))
            events.append(self._take_readable(end - start))
            before = end
        return events

    def _frames(self) -> list[tuple[int, int]]:
        """Return where frames with a good CRC, each behind stray bytes, begin and end that fill the held bytes; nothing
        if none do."""
        ways: list[list[tuple[int, int]]] = [[]]
        tried = set()
        while ways:
            way = ways.pop()
            at = way[-1][1] if way else 0
            if at == len(self._held):
                return way
            if at not in tried:  # each place once: there are at most 256 of them
                tried.add(at)
                before = self._held[at : at + _MOST_STRAYS]
                strays = len(before) - len(before.lstrip(_STRAYS))
                starts = range(at, at + strays + 1)
                following = [(start, end) for start in starts for end in self._ends(start)]
                ways += [[*way, frame] for frame in reversed(following)]
        return []

    def _ends(self, at: int) -> list[int]:
        """Return where a frame that begins at `at` can end, by its CRC: where its count says so first."""
        remainder, ends = INITIAL, list[int]()
        if self._overlong:  # the bytes are the end of others, which were removed
            return ends
        for end, byte in enumerate(self._held[at : at + LONGEST], at + 1):
            remainder = remainder >> 8 ^ TABLE[(remainder ^ byte) & 0xFF]
            if remainder == 0 and self._shape.is_whole(bytes(self._held[at:end])):
                ends.append(end)
        counted = self._check(at)[0] if len(ends) > 1 else None
        return sorted(ends, key=lambda end: end != counted)

    def _take_readable(self, size: int) -> Adu | Noise:
        """Remove and return a frame with a good CRC; as Noise if it is a request and the line is that of a client."""
        unit, pdu = self._held[0], bytes(self._held[1 : size - 2])
        if self.role != "client" or self._shape.measured(unit, pdu) == [None] or self._shape.reads(unit, pdu):
            return self._take(size)
        return self._drop(size, "checksum", f"{size} bytes that are not a response before a good one")

    def _hunt(self) -> list[Adu | Noise]:
        """Return the first whole frame at a later place, with the bytes before it as Noise; nothing if there is none
        yet. Only for a listener: to others such a frame may be the data of a damaged one.

        Each place is checked when enough bytes have arrived to decide more about it, not with every byte.
        """
        if self.role != "listener":
            return []
        received, due = self._removed + len(self._held), []
        while self._places and self._places[0][0] <= received:
            due.append(heappop(self._places)[1])
        due.sort()
        for index, number in enumerate(due):
            if number > self._removed and (end := self._check_place(number)) is not None:
                for unchecked in due[index + 1 :]:
                    heappush(self._places, (0, unchecked))
                return self._found(number, end)
        for number in range(max(self._unchecked, self._removed + 1), received - SHORTEST + 1):
            self._unchecked = number + 1
            if (end := self._check_place(number)) is not None:
                return self._found(number, end)
        self._hunted = received
        return []

    def _check_place(self, number: int) -> int | None:
        """Return the end of the frame that begins with this byte, or None, and then schedule the next check."""
        end, due = self._check(number - self._removed)
        if end is None and due < _AT_SILENCE:
            heappush(self._places, (due, number))
        return end

    def _found(self, number: int, end: int) -> list[Adu | Noise]:
        size = number - self._removed
        noise = self._drop(size, "checksum", f"{size} bytes that are not a frame before a good one")
        return [noise, self._take(end - size)]

    def _take(self, end: int) -> Adu:
        adu = received_adu((self._held[0], bytes(self._held[1 : end - 2]), None))
        self._remove(end)
        self._hunted = 0
        return adu

    def _drop(self, count: int, reason: Reason, text: str) -> Noise:
        noise = Noise(bytes(self._held[:count]), reason, text)
        self._remove(count)
        return noise

    def _remove(self, count: int) -> None:
        del self._held[:count]
        self._removed += count
        self._first_due = 0  # another byte is the first one now
