"""Several questions under way on one connection: what comes in goes to the line that asked, by transaction number.

    line 1   -- 0007 -->  |
    line 2   -- 0008 -->  |  one connection  -- 0007, 0008, 0009 -->  server
    line 3   -- 0009 -->  |                  <-- 0009, 0007, ... --   in whatever order     [MB-TCP 4.2.1: 1 to 16]

Each line is a line of its own with a bus of its own, so all that a bus knows holds here too. Framing is done once,
here; a header that cannot be right goes to everybody who waits: each of them says so.
"""

from __future__ import annotations

from functools import partial

from barewire.errors import DecodeError
from barewire.tcp.frame import HEADER, PREFIX, check_header
from barewire.tcp.line import DatagramLine, TcpLine


class FanOut:
    """`lines` share one connection. `feed` says which bytes are for which of them (its place in `lines`).

    >>> fan = FanOut(2)
    >>> [line.request(1, b"\\x07").hex(" ") for line in fan.lines]
    ['00 01 00 00 00 02 01 07', '00 02 00 00 00 02 01 07']
    >>> fan.feed(bytes.fromhex("00 02 00 00 00 03 01 07 6D") + b"\\x00")
    [(1, b'\\x00\\x02\\x00\\x00\\x00\\x03\\x01\\x07m')]
    """

    def __init__(self, count: int, *, datagrams: bool = False, any_unit: bool = False) -> None:
        self.strays = 0
        """Frames that answer nothing that was asked here."""
        self._datagrams = datagrams
        self._held = bytearray()
        self._last = 0
        self._asked: dict[int, int] = {}  # transaction -> place
        self._numbers = [0] * count  # place -> its transaction
        kind = DatagramLine if datagrams else TcpLine
        self.lines = [kind(any_unit=any_unit, number=partial(self._number, place)) for place in range(count)]

    def _number(self, place: int) -> int:
        self._asked.pop(self._numbers[place], None)
        # A question may wait while 65,535 others come and go: its number is not given to anybody else.
        while (number := self._last + 1 & 0xFFFF) in self._asked:
            self._last = number
        self._last = self._numbers[place] = number
        self._asked[number] = place
        return number

    def feed(self, data: bytes) -> list[tuple[int, bytes]]:
        """Bytes that arrived, cut into frames, each with the place of the line that it is for."""
        self._held += data
        frames: list[tuple[int, bytes]] = []
        while len(self._held) >= PREFIX or (self._datagrams and self._held):
            try:
                size = len(self._held) if self._datagrams else check_header(bytes(self._held[:PREFIX]))
            except DecodeError:
                frames += [(place, bytes(self._held)) for place in range(len(self.lines))]
                self._held.clear()
                break
            if len(self._held) < size:
                break
            frame = bytes(self._held[:size])
            del self._held[:size]
            number = HEADER.unpack_from(frame)[0] if size > PREFIX else -1
            if number in self._asked:
                frames.append((self._asked[number], frame))
            else:
                self.strays += 1
        return frames
