"""One RTU frame: its bytes, the duration of a character, and the two silences, t1.5 and t3.5.

    | unit 1 | PDU 1..253 | CRC 2, low byte first |        4 to 256 bytes            [MB-SERIAL 2.5.1]

    one character, 11 bits:   | start | 8 data bits, lowest first | parity | stop |       [MB-SERIAL 2.5.1]
                                                    no parity: a second stop bit takes its place
    ...|char|char|char| <- at least t3.5, silence -> |char|char|char|char|...             [MB-SERIAL 2.5.1.1]
                         ends a frame                  no gap above t1.5 inside

t1.5 and t3.5 are 1.5 and 3.5 characters up to 19200 bit/s. Above that they are fixed at 750 us and 1750 us, because
the timers of small devices have no finer resolution. Lines with 8N1, not standard but common, send 10 bits a character.
"""

from __future__ import annotations

from typing import NamedTuple

from barewire.errors import DecodeError, EncodeError
from barewire.modbus.adu import PDU_LIMIT, Adu, check_pdu, check_unit, received_adu
from barewire.rtu.crc import crc16

SHORTEST, LONGEST = 4, 256
FIXED_ABOVE = 19200
FIXED_T15 = 750e-6
FIXED_T35 = 1750e-6


def encode(unit: int, pdu: bytes) -> bytes:
    """Return the frame that carries a PDU.

    >>> encode(1, bytes.fromhex("040FB10002")).hex(" ").upper()
    '01 04 0F B1 00 02 22 F8'

    Raises EncodeError for a unit outside 0..255 and a PDU outside 1..253 bytes.
    """
    if not (0 <= unit <= 255 and 1 <= len(pdu) <= PDU_LIMIT):
        check_unit(unit)
        check_pdu(pdu)
    body = bytes((unit,)) + pdu
    return body + crc16(body).to_bytes(2, "little")


def decode(data: bytes) -> Adu:
    """Return the unit and the PDU of a frame.

    >>> decode(bytes.fromhex("01040FB1000222F8"))
    Adu(unit=1, pdu=b'\\x04\\x0f\\xb1\\x00\\x02', transaction=None)

    Raises DecodeError: "short", "long", or "checksum", with the expected CRC in the text.
    """
    if len(data) < SHORTEST:
        raise DecodeError("short", data, len(data), f"an RTU frame has at least {SHORTEST} bytes, got {len(data)}")
    if len(data) > LONGEST:
        raise DecodeError("long", data, LONGEST, f"an RTU frame has at most {LONGEST} bytes, got {len(data)}")
    # The CRC of a frame with its own CRC is 0. The expected CRC is computed only for the error.
    if crc16(data):
        right = crc16(data[:-2]).to_bytes(2, "little")
        received, expected = data[-2:].hex(" ").upper(), right.hex(" ").upper()
        raise DecodeError("checksum", data, len(data) - 2, f"CRC is {received}, should be {expected}")
    return received_adu((data[0], bytes(data[1:-2]), None))


class Timing(NamedTuple):
    """The times of a line, in seconds.

    >>> timing = Timing.of(19200)
    >>> [f"{1e6 * t:.1f} us" for t in timing]
    ['572.9 us', '859.4 us', '2005.2 us']
    >>> Timing.of(115200).t35
    0.00175
    """

    character: float
    t15: float
    t35: float

    @classmethod
    def of(cls, baudrate: int, bits: int = 11) -> Timing:
        """Return the times for a rate in bit/s and the bits per character: 11, or 10 with 8N1 and with 7E1 of ASCII.

        Raises EncodeError for a rate that is not positive, and for fewer than 7 or more than 12 bits.
        """
        if baudrate <= 0:
            raise EncodeError(f"baudrate {baudrate}: expected a positive number of bits per second", "baudrate")
        if not 7 <= bits <= 12:
            raise EncodeError(f"{bits} bits per character: expected 7..12", "bits")
        character = bits / baudrate
        if baudrate > FIXED_ABOVE:
            return cls(character, FIXED_T15, FIXED_T35)
        return cls(character, 1.5 * character, 3.5 * character)

    def duration(self, length: int) -> float:
        """Return the seconds that `length` characters take on the wire without gaps."""
        return length * self.character


def character_bits(data_bits: int, parity: str, stop_bits: float) -> int:
    """Return the bits of one character with these port settings: start, data, parity if any, stop.

    >>> character_bits(8, "E", 1), character_bits(8, "N", 2), character_bits(8, "N", 1), character_bits(7, "E", 1)
    (11, 11, 10, 10)
    """
    return 1 + data_bits + (parity.upper() != "N") + int(stop_bits + 0.5)
