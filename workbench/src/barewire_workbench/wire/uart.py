"""The line levels of characters, and what a receiver with other settings reads from them.

        level 1 ------.     .-----.     .--
                      |  0  |  1  |  0  |     one bit lasts 1 / baud rate
        level 0       '-----'     '-----'

    a character    start 0 | data bits, the lowest first | parity | stop 1

A receiver waits for the edge to 0, then samples the middle of each bit of its own length: half a bit after the edge the
start bit, then one bit later each time. If the stop bit is 0 (a framing error) it delivers the byte all the same. Then
it waits for level 1, or takes that bit for the next start bit: serial ports differ in this.

    sent at 9600     01 03 00 00 00 0A C5 CD
    read at 19200    06 1E 00 00 00 98 80 66 E6 F8

`UartLine` reverses that: which characters can have been sent so that a receiver with another baud rate, or with the
two wires exchanged, reads given bytes. Bits that no sample fell on could have had both values, so there may be many
answers.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import NamedTuple

from barewire.errors import EncodeError


class CharacterFormat(NamedTuple):
    """The form of a character: 8E1 has 8 data bits, an even parity bit and 1 stop bit."""

    data_bits: int = 8
    parity: str = "N"
    stop_bits: int = 1

    @classmethod
    def parse(cls, text: str) -> CharacterFormat:
        """Return the format with this name.

        >>> CharacterFormat.parse("7e1")
        CharacterFormat(data_bits=7, parity='E', stop_bits=1)

        Raises EncodeError for any other text.
        """
        found = re.fullmatch(r"([5-8])([NEO])([12])", text.strip().upper())
        if found is None:
            raise EncodeError(
                f"character format {text!r}: expected data bits, parity and stop bits, such as 8E1 or 7O1"
            )
        return cls(int(found[1]), found[2], int(found[3]))

    def __str__(self) -> str:
        return f"{self.data_bits}{self.parity}{self.stop_bits}"

    @property
    def bits(self) -> int:
        """All bits of a character, the start bit included."""
        return 1 + self.data_bits + (self.parity != "N") + self.stop_bits

    def ending(self, data: tuple[int, ...]) -> tuple[int, ...]:
        """Return the parity bit and the stop bits behind the data bits."""
        parity = {"N": (), "E": (sum(data) & 1,), "O": (~sum(data) & 1,)}[self.parity]
        return (*parity, *[1] * self.stop_bits)


FORMATS = (
    CharacterFormat(8, "N", 1),
    CharacterFormat(8, "E", 1),
    CharacterFormat(8, "O", 1),
    CharacterFormat(8, "N", 2),
)
"""8E1 is the default of Modbus, 8N2 and 8O1 are allowed, 8N1 is what most devices have [MB-SERIAL 2.5.1]."""

_DATA_BITS = tuple(tuple(byte >> place & 1 for place in range(8)) for byte in range(256))
"""The bits of each byte in the order in which they are sent."""


def character_levels(byte: int, form: CharacterFormat) -> tuple[int, ...]:
    """Return the level of each bit of one character.

    >>> character_levels(0x01, CharacterFormat(8, "E", 1))
    (0, 1, 0, 0, 0, 0, 0, 0, 0, 1, 1)
    """
    data = tuple(byte >> place & 1 for place in range(form.data_bits))
    return (0, *data, *form.ending(data))


class Receiver(NamedTuple):
    """A receiver at one moment. `wait` is the time until its next sample; None while it waits for an edge."""

    last: int
    wait: int | None = None
    samples: tuple[int, ...] = ()


class ReceiverFault(NamedTuple):
    """How a receiver differs from the sender: its baud rate is `faster` / `slower` times that of the sender.

    `inverted`: the two wires are exchanged, so that each level is read as the other one.
    """

    faster: int = 1
    slower: int = 1
    inverted: bool = False
    resyncs: bool = False
    """Whether a stop bit at level 0 is taken for the start bit of the next character, as a 16550 does."""


class UartLine:
    """A sender and a receiver, and a fault between them.

    Time is counted in ticks: a bit of the receiver has `2 * slower` of them, one of the sender `2 * faster`. `reader`
    is the format that the receiver expects, if it is another one with as many data bits.
    """

    def __init__(self, form: CharacterFormat, fault: ReceiverFault, reader: CharacterFormat | None = None) -> None:
        self.form, self.fault = form, fault
        self.sent_bit, self.read_bit = 2 * fault.faster, 2 * fault.slower
        expected = form if reader is None else reader
        self.size = 2 + expected.data_bits + (expected.parity != "N")
        self.idle = Receiver(last=int(not fault.inverted))
        self._known: dict[tuple[Receiver, tuple[int, ...]], tuple[Receiver, bytes]] = {}

    def read(self, sent: bytes) -> bytes:
        """Return what the receiver reads. The characters follow one another directly, and silence follows the last one.

        >>> UartLine(FORMATS[0], ReceiverFault(faster=2)).read(bytes.fromhex("01 03")).hex(" ")
        '06 1e'
        """
        receiver, found = self.idle, b""
        for byte in sent:
            receiver, more = self._hear(receiver, character_levels(byte, self.form))
            found += more
        return found + self.silence(receiver)

    def silence(self, receiver: Receiver) -> bytes:
        """Return what the receiver still delivers when the line stays idle."""
        return self._hear(receiver, (1,) * (2 * self.size * self.fault.slower))[1]

    def characters(self, receiver: Receiver, heard: bytes) -> Mapping[int, tuple[Receiver, int]]:
        """Return each byte that can be sent next if the receiver reads `heard`: the receiver after it, and the number
        of bytes that it has delivered meanwhile.

        >>> line = UartLine(FORMATS[0], ReceiverFault(faster=2))
        >>> [f"{byte:02X}" for byte in sorted(line.characters(line.idle, bytes.fromhex("06 1e")))][:3]
        ['01', '41', '61']
        """
        found: dict[int, tuple[Receiver, int]] = {}
        start, count = self._step(receiver, (0,), heard, 0)
        branches: list[tuple[tuple[int, ...], Receiver, int]] = [((), start, count)] if start is not None else []
        while branches:
            data, before, count = branches.pop()
            for bit in (0, 1):
                bits = (*data, bit)
                whole = len(bits) == self.form.data_bits
                after, total = self._step(before, (bit, *self.form.ending(bits)) if whole else (bit,), heard, count)
                if after is None:
                    continue
                if whole:
                    found[sum(level << place for place, level in enumerate(bits))] = after, total
                else:
                    branches.append((bits, after, total))
        return found

    def _step(
        self, receiver: Receiver, levels: tuple[int, ...], heard: bytes, count: int
    ) -> tuple[Receiver | None, int]:
        """Let the receiver hear some bits. None if it delivers anything else than `heard` has at `count`, or will do so
        because of the bits that it has sampled of the next byte."""
        after, more = self._hear(receiver, levels)
        total = count + len(more)
        if heard[count:total] != more:
            return None, total
        if after.samples:
            data = after.samples[1 : 1 + self.form.data_bits]
            if total >= len(heard) or _DATA_BITS[heard[total]][: len(data)] != data:
                return None, total
        return after, total

    def _hear(self, receiver: Receiver, levels: tuple[int, ...]) -> tuple[Receiver, bytes]:
        """Return the receiver after some bits of the sender, and the bytes that it has delivered meanwhile."""
        known = self._known.get((receiver, levels))
        if known is None:
            known = self._known[receiver, levels] = self._sampled(receiver, levels)
        return known

    def _sampled(self, receiver: Receiver, levels: tuple[int, ...]) -> tuple[Receiver, bytes]:
        last, wait, samples = receiver
        found = bytearray()
        for bit in levels:
            level, left = bit ^ self.fault.inverted, self.sent_bit
            if wait is None and last == 1 and level == 0:
                wait, samples = self.read_bit // 2, ()
            while wait is not None and wait < left:
                left -= wait
                wait, samples = self.read_bit, (*samples, level)
                if samples[0] == 1:  # a pulse shorter than half a bit
                    wait = None
                elif len(samples) == self.size:
                    found.append(sum(data << place for place, data in enumerate(samples[1 : 1 + self.form.data_bits])))
                    if self.fault.resyncs and level == 0 and any(samples):
                        samples = (0,)
                    else:
                        wait = None
            if wait is None:
                samples = ()
            else:
                wait -= left
            last = level
        return Receiver(last, wait, samples), bytes(found)
