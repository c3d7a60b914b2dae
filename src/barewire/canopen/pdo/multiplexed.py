"""Multiplexed PDOs (MPDO): one object per frame, identified by index and sub-index.   [CiA 301, MPDO]

        COB-ID of a PDO | f addr | index 2 | sub 1 | data 4 |          always 8 bytes; numbers little-endian

        f = 0  SAM, source addressing: addr, index and sub are those of the producer
        f = 1  DAM, destination addressing: addr, index and sub are those of the consumer, where the data is written;
               addr 0 addresses all nodes; an MPDO carries process data, so a communication object (1000h to 1FFFh)
               is written only if its PDOMapping allows an RPDO

        mapping :00  FEh  this PDO is SAM           FFh  this PDO is DAM            its type is 254 or 255

A SAM producer has a list of the objects that it sends when they change (scanner list). A SAM consumer has a list of
the objects that it receives from each producer, and of where it stores them (dispatcher list). One entry of either list
is a block of consecutive sub-indices:

        1FA0h ... 1FCFh   u32    block 1 | index 2 | sub 1
        1FD0h ... 1FFFh   u64    block 1 | own index 2 | own sub 1 | index 2 | sub 1 | node 1       (of the producer)

Data of less than four bytes is filled with zeros.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from barewire.canopen.abort_codes import AbortCode, SdoAbort
from barewire.canopen.cob_ids import NODE_MAX
from barewire.canopen.frame import CanFrame
from barewire.canopen.object_dictionary import ObjectAddress, ObjectDictionary
from barewire.codecs import Layout
from barewire.errors import BarewireError, DecodeError, EncodeError

Addressing = Literal["SAM", "DAM"]

MPDO_COUNTS: dict[int, Addressing] = {0xFE: "SAM", 0xFF: "DAM"}
"""The values of sub-index 00 of the mapping that mean an MPDO."""
_SCANNER, _DISPATCHER = range(0x1FA0, 0x1FD0), range(0x1FD0, 0x2000)
_FIRST_APPLICATION = 0x2000
MPDO_SIZE = 8
_DATA_SIZE = 4
_WAITING_MAX = 32
"""How many DAM messages may wait for the inhibit time. If there are more, the oldest are dropped and counted."""


@dataclass(frozen=True, slots=True)
class Mpdo:
    """One MPDO message.

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
        """Return the frame, with the COB-ID of its PDO. Raise EncodeError as `pack`."""
        return CanFrame(key[0], self.pack(), key[1])

    def pack(self) -> bytes:
        """Return the 8 bytes. Raise EncodeError for more than 4 bytes of data, and for node 0 as a source address."""
        least = 1 if self.addressing == "SAM" else 0
        if not least <= self.node <= NODE_MAX:
            raise EncodeError(f"node {self.node} in a {self.addressing} MPDO: expected {least}..{NODE_MAX}")
        if len(self.data) > _DATA_SIZE:
            raise EncodeError(f"{len(self.data)} bytes of data: an MPDO carries at most {_DATA_SIZE}")
        address = self.node | (self.addressing == "DAM") << 7
        return self.layout.pack(address, self.index, self.sub, tail=self.data.ljust(_DATA_SIZE, b"\0"))

    @classmethod
    def decode(cls, frame: CanFrame) -> Mpdo:
        """Decode a frame. Raise DecodeError for another length than 8 bytes, and for source address 0."""
        data = frame.data
        if len(data) != MPDO_SIZE or frame.remote:
            raise DecodeError(
                "length", data, min(len(data), MPDO_SIZE), f"an MPDO has {MPDO_SIZE} bytes, got {len(data)}"
            )
        address, index, sub, value = cls.layout.unpack(data)
        if not address:
            raise DecodeError("value", data, 0, "a SAM MPDO of node 0: expected 1..127")
        return cls("DAM" if address & 0x80 else "SAM", address & 0x7F, index, sub, value)


def scanner_list(objects: ObjectDictionary) -> list[ObjectAddress]:
    """Return the objects of the scanner list of a dictionary, in order and each once.

    >>> from barewire.canopen.object_dictionary import Entry
    >>> scanner_list(ObjectDictionary([Entry(0x1FA0, 1, "scanner", "u32", "rw", 0x02_6401_01)]))
    [(25601, 1), (25601, 2)]
    """
    scanned: dict[ObjectAddress, None] = {}
    for word in _words(objects, _SCANNER):
        index, sub = word >> 8 & 0xFFFF, word & 0xFF
        scanned |= dict.fromkeys((index, sub + step) for step in range(word >> 24 or 1) if index and sub + step <= 0xFF)
    return list(scanned)


def dispatcher_list(objects: ObjectDictionary) -> dict[tuple[int, int, int], ObjectAddress]:
    """Return the dispatcher list of a dictionary: (node, index, sub) of the producer -> own object.

    >>> from barewire.canopen.object_dictionary import Entry
    >>> word = 0x01_2000_02_6401_01_07
    >>> dispatcher_list(ObjectDictionary([Entry(0x1FD0, 1, "dispatcher", "u64", "rw", word)]))
    {(7, 25601, 1): (8192, 2)}
    """
    table: dict[tuple[int, int, int], ObjectAddress] = {}
    for word in _words(objects, _DISPATCHER):
        own_index, own_sub = word >> 40 & 0xFFFF, word >> 32 & 0xFF
        index, sub, node = word >> 16 & 0xFFFF, word >> 8 & 0xFF, word & 0xFF
        for step in range(word >> 56 or 1):
            if node and max(sub, own_sub) + step <= 0xFF:
                table.setdefault((node, index, sub + step), (own_index, own_sub + step))
    return table


def _words(objects: ObjectDictionary, indices: range) -> Iterator[int]:
    for index in indices:
        for sub in objects.subs(index)[1:]:
            word = int(objects.get(index, sub))
            if word:
                yield word


class MpdoProducer:
    """The messages that an MPDO of this device has to send. `next` returns the first, `sent` removes it.

    A SAM producer sends every object of its scanner list once, then those that change. A DAM producer sends the
    messages given to `queue`. `refused` counts values longer than four bytes or not readable, and dropped messages.
    """

    __slots__ = ("_scanned", "_sent", "_waiting", "addressing", "node", "objects", "refused")

    def __init__(self, addressing: Addressing, node: int, objects: ObjectDictionary) -> None:
        self.addressing = addressing
        self.node = node
        self.objects = objects
        self.refused = 0
        self._scanned = scanner_list(objects) if addressing == "SAM" else []
        self._sent: dict[ObjectAddress, bytes] = {}  # the value of each object as last sent
        self._waiting: deque[bytes] = deque()

    def queue(self, message: Mpdo) -> None:
        """Append a message; drop the oldest one if too many wait."""
        data = message.pack()
        if len(self._waiting) >= _WAITING_MAX:
            self._waiting.popleft()
            self.refused += 1
        self._waiting.append(data)

    def next(self) -> bytes | None:
        """Return the data of the next frame, None if there is nothing to send."""
        if self._waiting:
            return self._waiting[0]
        for address in list(self._scanned):
            value = self._value(address)
            if value is None:
                self._scanned.remove(address)
            elif self._sent.get(address) != value:
                return Mpdo("SAM", self.node, *address, value).pack()
        return None

    def _value(self, address: ObjectAddress) -> bytes | None:
        try:
            value = self.objects.read(*address)
        except BarewireError:
            value = None
        if value is None or len(value) > _DATA_SIZE:
            self.refused += 1
            return None
        return value

    def sent(self, data: bytes) -> None:
        """Record that the data of `next` was sent."""
        if self._waiting:
            self._waiting.popleft()
            return
        _, index, sub, value = Mpdo.layout.unpack(data)
        self._sent[index, sub] = value[: len(self._value((index, sub)) or b"")]


class MpdoConsumer:
    """The receiver of the MPDOs of this device. `refused` counts messages that could not be stored."""

    __slots__ = ("_table", "addressing", "node", "objects", "refused")

    def __init__(self, addressing: Addressing, node: int, objects: ObjectDictionary) -> None:
        self.addressing = addressing
        self.node = node
        self.objects = objects
        self.refused = 0
        self._table = dispatcher_list(objects) if addressing == "SAM" else {}

    def store(self, message: Mpdo) -> bool | None:
        """Store a message. Return True if it was stored, None if it is for other nodes, and False if it is for this
        device but its object is missing or refuses the value."""
        if message.addressing != self.addressing:
            return None
        address: ObjectAddress | None = (message.index, message.sub)
        if self.addressing == "SAM":
            address = self._table.get((message.node, message.index, message.sub))
        elif message.node not in (0, self.node):
            address = None
        if address is None:
            return None
        try:
            entry = self.objects.entry(*address)
            if entry.index < _FIRST_APPLICATION and not entry.is_mappable("RPDO"):
                raise SdoAbort(AbortCode.NOT_MAPPABLE, *address)
            size = self.objects.size(*address)
            self.objects.write(*address, message.data if size is None else message.data[:size])
        except BarewireError:
            self.refused += 1
            return False
        return True
