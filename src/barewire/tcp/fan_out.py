"""Several requests in flight on one connection: each response goes to the line of its transaction number.

    line 1   -- 0007 -->  |
    line 2   -- 0008 -->  |  one connection  -- 0007, 0008, 0009 -->  server
    line 3   -- 0009 -->  |                  <-- 0009, 0007, ... --   in any order     [MB-TCP 4.2.1: 1 to 16]

Each line has its own `Bus`, so the rules of a bus hold for each. Received bytes are cut into frames once, here. An
invalid header goes to all lines, so that each of them reports it. Transaction numbers begin at `first_number`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from barewire.tcp.frame import BEGINNING, LENGTHS, PREFIX
from barewire.tcp.line import DatagramLine, TcpLine


class FanOut:
    """`count` lines that share one connection. `feed` assigns each received frame to a place in `lines`.

    >>> fan = FanOut(2)
    >>> [line.request(1, b"\\x07").hex(" ") for line in fan.lines]
    ['00 01 00 00 00 02 01 07', '00 02 00 00 00 02 01 07']
    >>> fan.feed(bytes.fromhex("00 02 00 00 00 03 01 07 6D") + b"\\x00")
    [(1, b'\\x00\\x02\\x00\\x00\\x00\\x03\\x01\\x07m')]
    """

    def __init__(self, count: int, *, datagrams: bool = False, any_unit: bool = False, first_number: int = 1) -> None:
        self.strays = 0
        """The number of frames that answer no open request."""
        self.on_stray: Callable[[bytes], object] | None = None
        """Called with each of these frames."""
        self._datagrams = datagrams
        self._held = b""
        self._last = first_number - 1
        self._asked: dict[int, int] = {}  # transaction -> place
        self._numbers = [-1] * count  # place -> its transaction, -1 before the first
        line_class = DatagramLine if datagrams else TcpLine
        self.lines = [line_class(any_unit=any_unit, number=partial(self._number, place)) for place in range(count)]

    def __repr__(self) -> str:
        return f"<FanOut: {len(self.lines)} lines>"

    def _number(self, place: int) -> int:
        self._asked.pop(self._numbers[place], None)
        # A request may still wait when 65,535 others were answered: its number is skipped.
        while (number := self._last + 1 & 0xFFFF) in self._asked:
            self._last = number
        self._last = self._numbers[place] = number
        self._asked[number] = place
        return number

    def feed(self, data: bytes) -> list[tuple[int, bytes]]:
        """Cut received bytes into frames, and return each with the place of its line."""
        if self._datagrams:
            return self._assigned(int.from_bytes(data[:2], "big"), data) if data else []
        held = self._held + data if self._held else data
        frames: list[tuple[int, bytes]] = []
        at, end = 0, len(held)
        while end - at >= PREFIX:
            number, protocol, length = BEGINNING.unpack_from(held, at)
            if protocol or length not in LENGTHS:
                frames += [(place, held[at:]) for place in range(len(self.lines))]
                at = end
                break
            next_at = at + PREFIX + length
            if next_at > end:
                break
            frames += self._assigned(number, held[at:next_at])
            at = next_at
        self._held = held[at:]
        return frames

    def _assigned(self, number: int, frame: bytes) -> list[tuple[int, bytes]]:
        """Return the frame with the place of the line that sent its request; nothing if there is no such line."""
        place = self._asked.get(number) if len(frame) > PREFIX else None
        if place is None:
            self.strays += 1
            if self.on_stray is not None:
                self.on_stray(frame)
            return []
        return [(place, frame)]
