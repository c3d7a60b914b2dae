"""The bits of a CAN frame on the bus, each with the field that it belongs to.   [ISO 11898-1; Bosch CAN 2.0]

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

from collections.abc import Iterable, Iterator, Sequence
from typing import Literal, NamedTuple

from barewire.canopen.frame import CanFrame
from barewire.errors import EncodeError

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
    last, equal = RECESSIVE, 0  # the idle bus before SOF does not count
    for bit in bits:
        equal = equal + 1 if bit.level == last else 1
        last = bit.level
        yield bit
        if equal == EQUAL_BITS_MAX:
            last, equal = 1 - last, 1
            yield bit._replace(level=last, is_stuff=True)


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
