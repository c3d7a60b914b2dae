"""Bits on a wire: the levels of characters on a serial line, and the bits of a CAN frame.   [ISO 11898-1]

        level 1 ------.     .-----.     .--
                      |  0  |  1  |  0  |     one bit lasts 1 / baud rate
        level 0       '-----'     '-----'

    a character    start 0 | data bits, the lowest first | parity | stop 1

A receiver waits for the edge to 0, then samples the middle of each bit of its own length: half a bit after the edge the
start bit, then one bit later each time. If the stop bit is 0 (a framing error) it delivers the byte all the same. Then
it waits for level 1, or takes that bit for the next start bit: serial ports differ in this.

    sent at 9600     01 03 00 00 00 0A C5 CD
    read at 19200    06 1E 00 00 00 98 80 66 E6 F8

A CAN frame:

    11-bit identifier, a base frame

        SOF | identifier  RTR | IDE  r0  DLC | data        | CRC  CRC delimiter | ACK slot  ACK delimiter | EOF
         1  |     11       1  |  1   1    4  | 0 to 64     |  15        1       |    1            1       |  7
            |   arbitration   |   control    |

    29-bit identifier, an extended frame

        SOF | identifier  SRR  IDE  identifier extension  RTR | r1  r0  DLC | data ...
         1  |     11       1    1            18            1  |  1   1   4  |
            |                  arbitration                    |   control   |

A bit is dominant (0) or recessive (1). If two nodes send at once, the dominant bit wins: the bus is a wired AND.
After five equal bits the sender inserts a bit of the other level, which the receivers remove: a stuff bit. It gives
them an edge to synchronise on. Stuffing begins with SOF and ends with the last bit of the CRC; stuff bits count for the
next five, but not for the CRC.

        data       0 0 0 0 0   0 0 0 ...
        on the bus 0 0 0 0 0 1 0 0 0 ...
                             '-- stuff bit

The sender leaves the ACK slot recessive; each node that has received the frame without an error makes it dominant.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Literal, NamedTuple

from barewire.canopen.frame import CanFrame
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
        match = re.fullmatch(r"([5-8])([NEO])([12])", text.strip().upper())
        if match is None:
            raise EncodeError(
                f"character format {text!r}: expected data bits, parity and stop bits, such as 8E1 or 7O1"
            )
        return cls(int(match[1]), match[2], int(match[3]))

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
        receiver, delivered = self.idle, b""
        for byte in sent:
            receiver, more = self._hear(receiver, character_levels(byte, self.form))
            delivered += more
        return delivered + self.silence(receiver)

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
        possible: dict[int, tuple[Receiver, int]] = {}
        start, count = self._step(receiver, (0,), heard, 0)
        branches: list[tuple[tuple[int, ...], Receiver, int]] = [((), start, count)] if start is not None else []
        # The bits are tried one by one, so that a path is given up at the first wrong bit: of 256 bytes few are left.
        while branches:
            data, before, count = branches.pop()
            for bit in (0, 1):
                bits = (*data, bit)
                whole = len(bits) == self.form.data_bits
                after, total = self._step(before, (bit, *self.form.ending(bits)) if whole else (bit,), heard, count)
                if after is None:
                    continue
                if whole:
                    possible[sum(level << place for place, level in enumerate(bits))] = after, total
                else:
                    branches.append((bits, after, total))
        return possible

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
        delivered = bytearray()
        for bit in levels:
            level, ticks = bit ^ self.fault.inverted, self.sent_bit
            # The edge to 0 begins a character. The first sample is in the middle of its start bit, so that later ones
            # still fall inside their bits if the sender is a little faster or slower.
            if wait is None and last == 1 and level == 0:
                wait, samples = self.read_bit // 2, ()
            while wait is not None and wait < ticks:
                ticks -= wait
                wait, samples = self.read_bit, (*samples, level)
                if samples[0] == 1:  # a pulse shorter than half a bit
                    wait = None
                elif len(samples) == self.size:
                    data = samples[1 : 1 + self.form.data_bits]
                    delivered.append(sum(sample << place for place, sample in enumerate(data)))
                    # A stop bit of 0 is a framing error, unless all bits are 0: that is a break, which is no start bit.
                    if self.fault.resyncs and level == 0 and any(samples):
                        samples = (0,)
                    else:
                        wait = None
            if wait is None:
                samples = ()
            else:
                wait -= ticks
            last = level
        return Receiver(last, wait, samples), bytes(delivered)


# CAN frames ---------------------------------------------------------------------------------------------------------


DOMINANT, RECESSIVE = 0, 1

CAN_CRC_POLYNOMIAL = 0x4599
"""x^15 + x^14 + x^10 + x^8 + x^7 + x^4 + x^3 + 1 without its highest power."""

EQUAL_BITS_MAX = 5
INTERMISSION = 3
"""Recessive bits between two frames."""

CanPart = Literal["start", "arbitration", "control", "data", "CRC", "ACK", "end"]


class CanField(NamedTuple):
    """A field of the frame before stuffing: its name, the part of the frame it belongs to, its bits as a number.

    The data bytes are fields of their own: "data 0" to "data 7".
    """

    name: str
    part: CanPart
    value: int
    width: int

    @property
    def levels(self) -> str:
        """The bits as text, the bit that is sent first in front.

        >>> CanField("DLC", "control", 8, 4).levels
        '1000'
        """
        return f"{self.value:0{self.width}b}"


class CanBit(NamedTuple):
    """One bit on the bus. A stuff bit belongs to the field of the bit before it."""

    level: int
    field: str
    part: CanPart
    is_stuff: bool = False


class CanBits(NamedTuple):
    """A CAN frame as it is sent: its fields, and all its bits with the stuff bits.

    >>> sent = can_bits(CanFrame.parse("000#"))
    >>> "".join(str(bit.level) for bit in sent.bits[:13]), sent.bits[5]
    ('0000010000010', CanBit(level=1, field='identifier', part='arbitration', is_stuff=True))
    >>> len(sent.bits), sent.stuff_count, f"{1e6 * sent.duration(500_000):.0f} us"
    (50, 6, '100 us')
    """

    frame: CanFrame
    crc: int
    fields: tuple[CanField, ...]
    bits: tuple[CanBit, ...]

    @property
    def stuff_count(self) -> int:
        """The number of stuff bits."""
        return sum(bit.is_stuff for bit in self.bits)

    @property
    def levels(self) -> str:
        """The bits as text, from SOF to the end of EOF."""
        return "".join(str(bit.level) for bit in self.bits)

    def duration(self, bitrate: float) -> float:
        """Return the seconds from SOF to the end of EOF at a rate in bit/s. Raise EncodeError unless it is positive."""
        return len(self.bits) / check_bitrate(bitrate)


def check_bitrate(bitrate: float) -> float:
    """Return the bit rate. Raise EncodeError outside 1 bit/s to 1 Mbit/s, the limit of classical CAN."""
    if not 1 <= bitrate <= 1_000_000:
        raise EncodeError(f"bitrate {bitrate}: expected 1..1000000 bit/s", "bitrate")
    return bitrate


def can_crc15(levels: Iterable[int]) -> int:
    """Return the CRC of bits, the first sent first: the remainder by x^15 + x^14 + x^10 + x^8 + x^7 + x^4 + x^3 + 1.

    >>> f"{can_crc15(int(bit) for byte in b'123456789' for bit in f'{byte:08b}'):04X}h"
    '059Eh'
    """
    crc = 0
    for level in levels:
        subtract = crc >> 14 ^ level
        crc = crc << 1 & 0x7FFF
        if subtract:
            crc ^= CAN_CRC_POLYNOMIAL
    return crc


def can_bits(frame: CanFrame, *, acknowledged: bool = True) -> CanBits:
    """Return the bits of a data or remote frame. Without an acknowledging receiver the ACK slot is recessive.

    >>> [field.levels for field in can_bits(CanFrame.parse("605#40")).fields[:8]]
    ['0', '11000000101', '0', '0', '0', '0001', '01000000', '000100101010000']

    Raises EncodeError for a frame that CAN cannot carry.
    """
    CanFrame.checked(frame.id, frame.data, extended=frame.extended, remote=frame.remote, requested=frame.requested)
    covered = (CanField("SOF", "start", DOMINANT, 1), *_header(frame), *_data(frame.data))
    crc = can_crc15(int(level) for field in covered for level in field.levels)
    stuffed = (*covered, CanField("CRC", "CRC", crc, 15))
    tail = (
        CanField("CRC delimiter", "CRC", RECESSIVE, 1),
        CanField("ACK slot", "ACK", DOMINANT if acknowledged else RECESSIVE, 1),
        CanField("ACK delimiter", "ACK", RECESSIVE, 1),
        CanField("EOF", "end", 0x7F, 7),
    )
    bits = (*_with_stuff_bits(_bits(stuffed)), *_bits(tail))
    return CanBits(frame, crc, (*stuffed, *tail), bits)


def _header(frame: CanFrame) -> tuple[CanField, ...]:
    """Return the arbitration and the control field. RTR, SRR and IDE are recessive in the frame that has to wait."""
    remote = CanField("RTR", "arbitration", RECESSIVE if frame.remote else DOMINANT, 1)
    length = CanField("DLC", "control", frame.dlc, 4)
    r0 = CanField("r0", "control", DOMINANT, 1)
    if not frame.extended:
        return (
            CanField("identifier", "arbitration", frame.id, 11),
            remote,
            CanField("IDE", "control", DOMINANT, 1),
            r0,
            length,
        )
    return (
        CanField("identifier", "arbitration", frame.id >> 18, 11),
        CanField("SRR", "arbitration", RECESSIVE, 1),
        CanField("IDE", "arbitration", RECESSIVE, 1),
        CanField("identifier extension", "arbitration", frame.id & 0x3FFFF, 18),
        remote,
        CanField("r1", "control", DOMINANT, 1),
        r0,
        length,
    )


def _data(data: bytes) -> tuple[CanField, ...]:
    return tuple(CanField(f"data {place}", "data", byte, 8) for place, byte in enumerate(data))


def _bits(fields: Iterable[CanField]) -> Iterator[CanBit]:
    for field in fields:
        for level in field.levels:
            yield CanBit(int(level), field.name, field.part)


def _with_stuff_bits(bits: Iterable[CanBit]) -> Iterator[CanBit]:
    """Insert a bit of the other level after five equal ones. The inserted bit is the first of the next five."""
    previous, equal = RECESSIVE, 0  # the idle bus before SOF does not count
    for bit in bits:
        equal = equal + 1 if bit.level == previous else 1
        previous = bit.level
        yield bit
        if equal == EQUAL_BITS_MAX:
            previous, equal = 1 - previous, 1
            yield bit._replace(level=previous, is_stuff=True)


def longest_can_frame(size: int, *, extended: bool = False) -> int:
    """Return an upper limit for the bits of a frame with `size` data bytes, with the stuff bits, up to the end of EOF.

    Of n bits that are stuffed, the first five and then every four need a stuff bit at worst: (n - 1) // 4 of them.

    >>> longest_can_frame(8), longest_can_frame(8, extended=True)
    (132, 157)
    """
    stuffed = (54 if extended else 34) + 8 * size
    return stuffed + (stuffed - 1) // 4 + 10


class Arbitration(NamedTuple):
    """The outcome of frames that begin at the same time.

    `winner` is the place of the frame that is sent on. `lost_at` has for each frame the index of the bit, counted with
    stuff bits, at which it stops: it sends recessive and reads dominant. `collision` is the index of the first bit
    behind the arbitration field at which frames with the same identifier differ, a bit error; then there is no winner.
    """

    winner: int | None
    lost_at: tuple[int | None, ...]
    collision: int | None = None


def arbitrate(frames: Sequence[CanBits]) -> Arbitration:
    """Send frames at the same time, bit by bit, and return the one that wins: that with the lowest identifier.

    >>> heartbeat, request = can_bits(CanFrame.parse("705#05")), can_bits(CanFrame.parse("605#40"))
    >>> arbitrate([heartbeat, request])                 # 11100000101 and 11000000101: the third bit decides
    Arbitration(winner=1, lost_at=(3, None), collision=None)

    Of equal identifiers a data frame wins over a remote frame, and a base frame over an extended one with the same
    first 11 bits. Two equal frames are sent as one, and the first is called the winner.

    Raises EncodeError for no frame at all.
    """
    if not frames:
        raise EncodeError("no frames: expected one or more")
    sending = list(range(len(frames)))
    lost_at: list[int | None] = [None] * len(frames)
    for index in range(min(len(frame.bits) for frame in frames)):
        bus = min(frames[place].bits[index].level for place in sending)
        beaten = [place for place in sending if frames[place].bits[index].level != bus]
        if any(frames[place].bits[index].part not in ("start", "arbitration") for place in beaten):
            return Arbitration(None, tuple(lost_at), index)
        for place in beaten:
            lost_at[place] = index
            sending.remove(place)
        if len(sending) == 1:
            break
    return Arbitration(sending[0], tuple(lost_at))
