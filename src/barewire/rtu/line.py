"""The framing state of one RTU line: it finds the frames in a stream of bytes without delimiters.

Three criteria, in this order:

    the count     the first bytes of a message give its length (`rtu.shape`), so a frame ends early
    the CRC       must be right, or there is no frame
    the silence   ends what is left, resynchronises, and is the only end of functions without a known length

**t3.5 is two numbers.** For sending, the line keeps the strict one: `quiet_at`. For receiving, it is patient: operating
systems and USB adapters deliver bytes in batches, up to 16 ms late, and a strict window of 2 ms cuts good frames in
half. `patience` is the longest pause that is accepted inside a frame. `patience=None` follows the standard exactly,
for real UARTs: only t3.5 ends a frame, and a gap above t1.5 inside makes it invalid [MB-SERIAL 2.5.1.1].

    feed:  | noise | unit ... CRC | unit ... CRC | half a fr        ->  Noise, Adu, Adu, and 9 bytes held

After a wrong CRC the line searches, byte by byte, for the next whole frame with a good CRC, and reports the bytes
before it as one Noise.
"""

from __future__ import annotations

from collections.abc import Container
from heapq import heappop, heappush

from barewire.errors import DecodeError, EncodeError, Reason
from barewire.modbus.adu import Adu, Noise, received_adu
from barewire.rtu.crc import crc16
from barewire.rtu.frame import LONGEST, SHORTEST, decode, encode
from barewire.rtu.shape import Role, Shape
from barewire.rtu.timing import Timing

PATIENCE = 0.030
"""Seconds: above the 16 ms in which common USB adapters hand over bytes, far below any time-out."""

_ROUNDING = 1e-7
"""Seconds, far below any character. Times are sums of floats, and a gap of exactly t1.5 or t3.5 must count as such."""

_ENVELOPE = 3
"""Bytes of a frame around the PDU: unit and CRC."""

SILENCE, NEVER = 1 << 62, 1 << 63
"""When to check a place again that no number of bytes decides: at the next silence; never."""


class RtuLine:
    """One line, received in a role: a client receives responses, a server requests (and both of other units).

    >>> line = RtuLine(Timing.of(19200), role="server")
    >>> line.feed(bytes.fromhex("01040FB1 000222F8"), now=1.0)
    [Adu(unit=1, pdu=b'\\x04\\x0f\\xb1\\x00\\x02', transaction=None)]
    >>> line.feed(b"\\xff\\x00\\x07", now=2.0), round(line.deadline, 3)
    ([], 2.03)
    >>> line.feed(None, now=2.03)
    [Noise(data=b'\\xff\\x00\\x07', reason='short', text='3 bytes, then silence')]

    `units` are the server's own addresses: a frame with one of them is a request, never the response of another unit.
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
        self._spoiled: tuple[Reason, str] | None = (
            None  # strict only: why the held bytes are no frame, whatever their CRC
        )
        self._gone = 0  # bytes that were held and removed
        self._again = 0  # with how many bytes to check the first place again
        self._places: list[tuple[int, int]] = []  # a heap of (number of bytes at which to check again, place)
        self._fresh = 0  # the first place that was not checked yet
        self._hunted = 0  # no frame that begins behind the first byte ends up to here
        self._unit = 0

    # Sending

    @property
    def quiet_at(self) -> float:
        """t3.5 after the last byte on the line, sent or received: the strict time, whatever the patience."""
        return self._last + self.timing.t35

    def request(self, unit: int, pdu: bytes) -> bytes:
        """The frame of a request."""
        self._unit = unit
        return encode(unit, pdu)

    def response(self, to: Adu, pdu: bytes) -> bytes:
        """The frame of an answer."""
        return encode(to.unit, pdu)

    def sent(self, now: float) -> None:
        """The last byte of a frame was transmitted at `now`: the silence before the next frame begins here."""
        self._last = max(self._last, now)

    def answers(self, adu: Adu) -> bool:
        """Whether the frame comes from the unit of the last request."""
        return adu.unit == self._unit

    # Receiving

    @property
    def held(self) -> bytes:
        """The bytes that may still become a frame."""
        return bytes(self._held)

    @property
    def deadline(self) -> float | None:
        """When the silence will be long enough to end the held bytes."""
        return self._last + self.gap if self._held else None

    def feed(self, data: bytes | None, now: float) -> list[Adu | Noise]:
        """Bytes that arrived together, the last one at `now`; or None: nothing came until `now`."""
        events: list[Adu | Noise] = []
        if not data:
            if self._held and now >= self._last + self.gap:
                events += self._close()
            return events
        # The bytes came one after the other, so the first began this much earlier.
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
        """Remove and return every frame that count and CRC confirm already."""
        events: list[Adu | Noise] = []
        while self._held:
            end = self._first()
            if end is not None:
                events.append(self._take(end))
            elif self._again != NEVER and len(self._held) < LONGEST:
                break
            elif (found := self._hunt()) is not None:
                events += found
            else:
                excess = len(self._held) - LONGEST
                if excess > 0:
                    events.append(self._drop(excess, "long", f"more than {LONGEST} bytes and no frame in them"))
                break
        return events

    def _close(self) -> list[Adu | Noise]:
        """Silence: the held bytes are one frame, or contain frames, or are noise."""
        events: list[Adu | Noise] = []
        if self._spoiled is not None:
            events.append(self._drop(len(self._held), *self._spoiled))
        self._spoiled = None
        while self._held:
            end = None if self.strict else self._first()
            if end is None and self._shape.is_whole(bytes(self._held)):
                # Only silence ends a function without a known length.
                end = len(self._held)
            if end is not None:
                events.append(self._take(end))
            elif not self.strict and (found := self._hunt()) is not None:
                events += found
            else:
                events.append(self._drop(len(self._held), *self._diagnosis()))
        return events

    def _diagnosis(self) -> tuple[Reason, str]:
        """Why the remaining bytes are no frame."""
        size = f"{len(self._held)} byte{'' if len(self._held) == 1 else 's'}"
        try:
            decode(bytes(self._held))
        except DecodeError as error:
            if error.reason == "short":
                return "short", f"{size}, then silence"
            return error.reason, error.text
        return "short", f"{size}, then silence: the last byte is missing, a 00 of the CRC"

    # Where a frame may begin and end. Places are counted from the first byte that the line ever held, so they stay
    # valid when bytes are removed: held[at] is byte number _gone + at.

    def _first(self) -> int | None:
        """The end of the frame that begins with the first byte. Checked only when enough bytes have come."""
        if self._gone + len(self._held) < self._again:
            return None
        end, self._again = self._look(0)
        return end

    def _look(self, at: int) -> tuple[int | None, int]:
        """The end of the frame that begins at `at`, or None; and the number of bytes at which to check again."""
        here, pdu = len(self._held), bytes(self._held[at + 1 : at + LONGEST])
        if not pdu:
            return None, self._gone + at + 2
        again, counted = NEVER, False
        for size in self._shape.measured(self._held[at], pdu):
            if size is None:
                continue
            counted = True
            end = at + size + _ENVELOPE
            if end - at > LONGEST:
                continue
            if end > here:
                # The count is known and the end has not come, or more bytes are needed to know the count.
                again = min(again, self._gone + (end if size <= len(pdu) else at + 1 + size))
            elif self._gone + end > self._hunted and end - at >= SHORTEST and crc16(self._held[at:end]) == 0:
                return end, again
        return None, again if counted else SILENCE

    def _hunt(self) -> list[Adu | Noise] | None:
        """The first whole frame at a later place, and the bytes before it as Noise; None if there is none yet.

        Each place is checked when enough bytes have come to decide more about it, not with every byte.
        """
        here, due = self._gone + len(self._held), []
        while self._places and self._places[0][0] <= here:
            due.append(heappop(self._places)[1])
        due.sort()
        for index, number in enumerate(due):
            if number > self._gone and (end := self._at(number)) is not None:
                for other in due[index + 1 :]:
                    heappush(self._places, (0, other))
                return self._found(number, end)
        for number in range(max(self._fresh, self._gone + 1), here - SHORTEST + 1):
            self._fresh = number + 1
            if (end := self._at(number)) is not None:
                return self._found(number, end)
        self._hunted = here
        return None

    def _at(self, number: int) -> int | None:
        """The end of the frame that begins with this byte; if it has not come, schedules the next check."""
        end, again = self._look(number - self._gone)
        if end is None and again < SILENCE:
            heappush(self._places, (again, number))
        return end

    def _found(self, number: int, end: int) -> list[Adu | Noise]:
        at = number - self._gone
        noise = self._drop(at, "checksum", f"{at} bytes that are no frame before a good one")
        return [noise, self._take(end - at)]

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
        self._gone += count
        self._again = 0  # another byte is the first one now
