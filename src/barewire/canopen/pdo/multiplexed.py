"""Multiplexed PDOs: one object in a frame, with the word about which it is.   [CiA 301, MPDO]

        COB-ID of a PDO | f addr | index 2 | sub 1 | data 4 |          8 bytes, always; numbers little-endian

        f = 0  SAM, source addressing: addr, index and sub are the producer's: whoever listens knows what to do with it
        f = 1  DAM, destination addressing: addr, index and sub are the consumer's, and it is written there;
               addr 0 is everybody

        mapping :00  FEh  this PDO is SAM           FFh  this PDO is DAM            its type is 254 or 255

A SAM producer has a list of what it says when it changes (scanner list), a SAM consumer one of what it takes from whom
and puts where (dispatcher list). One line of either stands for a block of sub-indices that follow each other:

        1FA0h ... 1FCFh   u32    block 1 | index 2 | sub 1
        1FD0h ... 1FFFh   u64    block 1 | our index 2 | our sub 1 | index 2 | sub 1 | node 1       (of the producer)

What is shorter than four bytes is filled up with zeros.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from barewire.canopen.cob_ids import NODE_MAX
from barewire.canopen.frame import CanFrame
from barewire.canopen.object_dictionary import ObjectAddress, ObjectDictionary
from barewire.codecs import Layout
from barewire.errors import BarewireError, DecodeError, EncodeError

Addressing = Literal["SAM", "DAM"]

MPDO_COUNTS: dict[int, Addressing] = {0xFE: "SAM", 0xFF: "DAM"}
"""What stands in sub-index 00 of the mapping."""
_SCANNER, _DISPATCHER = range(0x1FA0, 0x1FD0), range(0x1FD0, 0x2000)
MPDO_SIZE = 8
_DATA_SIZE = 4
_WAITING_MAX = 32
"""How many DAM messages may wait for the inhibit time."""


@dataclass(frozen=True, slots=True)
class Mpdo:
    """One object on its way.

    >>> message = Mpdo("DAM", 5, 0x6040, 0, b"\\x0f")
    >>> str(message.encode((0x181, False)))
    '181#854060000F000000'
    >>> Mpdo.decode(CanFrame.parse("181#0564600001020304")).addressing
    'SAM'
    """

    addressing: Addressing
    node: int
    index: int
    sub: int
    data: bytes

    layout = Layout("<BHB", "address", "index", "sub", tail="data")

    def encode(self, key: tuple[int, bool]) -> CanFrame:
        """The frame, on the COB-ID of its PDO."""
        return CanFrame(key[0], self.pack(), key[1])

    def pack(self) -> bytes:
        """The 8 bytes. EncodeError for more than 4 bytes of data, and for node 0 as a source."""
        least = 1 if self.addressing == "SAM" else 0
        if not least <= self.node <= NODE_MAX:
            raise EncodeError(f"node {self.node} in a {self.addressing} MPDO: expected {least}..{NODE_MAX}")
        if len(self.data) > _DATA_SIZE:
            raise EncodeError(f"{len(self.data)} bytes of data: an MPDO carries at most {_DATA_SIZE}")
        address = self.node | (self.addressing == "DAM") << 7
        return self.layout.pack(address, self.index, self.sub, tail=self.data.ljust(_DATA_SIZE, b"\0"))

    @classmethod
    def decode(cls, frame: CanFrame) -> Mpdo:
        """Raises DecodeError for a frame that has not 8 bytes, or a source that is no node."""
        data = frame.data
        if len(data) != MPDO_SIZE or frame.remote:
            raise DecodeError(
                "length", data, min(len(data), MPDO_SIZE), f"an MPDO has {MPDO_SIZE} bytes, here are {len(data)}"
            )
        address, index, sub, value = cls.layout.unpack(data)
        if not address:
            raise DecodeError("value", data, 0, "a SAM MPDO of node 0: that is nobody")
        return cls("DAM" if address & 0x80 else "SAM", address & 0x7F, index, sub, value)


def scanner_list(objects: ObjectDictionary) -> list[ObjectAddress]:
    """What the scanner list of a dictionary names, in its order, each place once.

    >>> from barewire.canopen.object_dictionary import Entry
    >>> scanner_list(ObjectDictionary([Entry(0x1FA0, 1, "scanner", "u32", "rw", 0x02_6401_01)]))
    [(25601, 1), (25601, 2)]
    """
    places: dict[ObjectAddress, None] = {}
    for word in _words(objects, _SCANNER):
        index, sub = word >> 8 & 0xFFFF, word & 0xFF
        places |= dict.fromkeys((index, sub + more) for more in range(word >> 24 or 1) if index and sub + more <= 0xFF)
    return list(places)


def dispatcher_list(objects: ObjectDictionary) -> dict[tuple[int, int, int], ObjectAddress]:
    """Where what comes goes, as the dispatcher list says: (node, index, sub) of the producer -> our place.

    >>> from barewire.canopen.object_dictionary import Entry
    >>> word = 0x01_2000_02_6401_01_07
    >>> dispatcher_list(ObjectDictionary([Entry(0x1FD0, 1, "dispatcher", "u64", "rw", word)]))
    {(7, 25601, 1): (8192, 2)}
    """
    table: dict[tuple[int, int, int], ObjectAddress] = {}
    for word in _words(objects, _DISPATCHER):
        ours, our_sub = word >> 40 & 0xFFFF, word >> 32 & 0xFF
        index, sub, node = word >> 16 & 0xFFFF, word >> 8 & 0xFF, word & 0xFF
        for more in range(word >> 56 or 1):
            if node and max(sub, our_sub) + more <= 0xFF:
                table.setdefault((node, index, sub + more), (ours, our_sub + more))
    return table


def _words(objects: ObjectDictionary, indices: range) -> Iterator[int]:
    for index in indices:
        for sub in objects.subs(index)[1:]:
            word = int(objects.get(index, sub))
            if word:
                yield word


class MpdoProducer:
    """What an MPDO of this device has to say: `next` tells it, `said` that it is out.

    A SAM producer says every object of its scanner list at first, and from then on what has changed. Of a DAM producer
    what `tell` was given, in that order. `refused` counts what does not fit four bytes, and what had to wait too long.
    """

    __slots__ = ("_heard", "_places", "_waiting", "addressing", "node", "objects", "refused")

    def __init__(self, addressing: Addressing, node: int, objects: ObjectDictionary) -> None:
        self.addressing = addressing
        self.node = node
        self.objects = objects
        self.refused = 0
        self._places = scanner_list(objects) if addressing == "SAM" else []
        self._heard: dict[ObjectAddress, bytes] = {}  # what the others know of it
        self._waiting: deque[bytes] = deque()

    def tell(self, message: Mpdo) -> None:
        """One more to be said; the oldest is given up where too many wait."""
        data = message.pack()
        if len(self._waiting) >= _WAITING_MAX:
            self._waiting.popleft()
            self.refused += 1
        self._waiting.append(data)

    def next(self) -> bytes | None:
        """The data of the frame that is to be said next, None for nothing."""
        if self._waiting:
            return self._waiting[0]
        for place in list(self._places):
            value = self._value(place)
            if value is None:
                self._places.remove(place)
            elif self._heard.get(place) != value:
                return Mpdo("SAM", self.node, *place, value).pack()
        return None

    def _value(self, place: ObjectAddress) -> bytes | None:
        try:
            value = self.objects.read(*place)
        except BarewireError:
            value = None
        if value is None or len(value) > _DATA_SIZE:
            self.refused += 1
            return None
        return value

    def said(self, data: bytes) -> None:
        """That went out."""
        if self._waiting:
            self._waiting.popleft()
            return
        _, index, sub, value = Mpdo.layout.unpack(data)
        self._heard[index, sub] = value[: len(self._value((index, sub)) or b"")]


class MpdoConsumer:
    """Where an MPDO that this device receives goes."""

    __slots__ = ("_table", "addressing", "node", "objects", "refused")

    def __init__(self, addressing: Addressing, node: int, objects: ObjectDictionary) -> None:
        self.addressing = addressing
        self.node = node
        self.objects = objects
        self.refused = 0
        self._table = dispatcher_list(objects) if addressing == "SAM" else {}

    def take(self, message: Mpdo) -> bool | None:
        """True: written. False: it was for us, and there is no such object here, or it does not take the value. None:
        it was for others."""
        if message.addressing != self.addressing:
            return None
        place: ObjectAddress | None = (message.index, message.sub)
        if self.addressing == "SAM":
            place = self._table.get((message.node, message.index, message.sub))
        elif message.node not in (0, self.node):
            place = None
        if place is None:
            return None
        try:
            size = self.objects.size(*place)
            self.objects.write(*place, message.data if size is None else message.data[:size])
        except BarewireError:
            self.refused += 1
            return False
        return True
