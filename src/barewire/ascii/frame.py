"""Encode and decode one whole ASCII frame, and compute its checksum, the LRC.

    : | unit, 2 characters | PDU, 2 characters a byte | LRC, 2 characters | CR LF        [MB-SERIAL 2.5.2]

A frame has 9 to 513 characters. Digits are sent in upper case; lower case is accepted.

The LRC is the two's complement of the sum of the bytes, so that all bytes and the LRC sum to zero: 02 07 -> F7
[MB-SERIAL 6.2.1]. The ADXL manual works an example, 01 04 00 00 08, and prints F5h. The arithmetic gives F3h: the sum
is 0Dh and 100h - 0Dh is F3h. F5h is the LRC of 01 04 00 00 06.
"""

from __future__ import annotations

from barewire.errors import DecodeError
from barewire.modbus.adu import PDU_LIMIT, Adu, check_pdu, check_unit, received_adu

START, END = b":", b"\r\n"
SHORTEST, LONGEST = 9, 513
DIGITS = b"0123456789ABCDEFabcdef"


def lrc(data: bytes) -> int:
    """Return the LRC of the bytes that the characters encode, not of the characters themselves.

    >>> f"{lrc(bytes.fromhex('0104000008')):02X}h"
    'F3h'
    """
    return -sum(data) & 0xFF


def encode(unit: int, pdu: bytes) -> bytes:
    """Return the frame that carries a PDU.

    >>> encode(1, bytes.fromhex("040FB10002"))
    b':01040FB1000239\\r\\n'

    Raises EncodeError for a unit outside 0..255 and a PDU outside 1..253 bytes.
    """
    if not (0 <= unit <= 255 and 1 <= len(pdu) <= PDU_LIMIT):
        check_unit(unit)
        check_pdu(pdu)
    body = bytes((unit,)) + pdu
    return b":%s%02X\r\n" % (body.hex().upper().encode(), lrc(body))


def decode(data: bytes) -> Adu:
    """Return the unit and the PDU of a frame.

    >>> decode(b":01040FB1000239\\r\\n")
    Adu(unit=1, pdu=b'\\x04\\x0f\\xb1\\x00\\x02', transaction=None)

    Raises DecodeError: "delimiter", "character", "short", "long", or "checksum", with the expected LRC in the text.
    """
    if data[:1] != START:
        raise DecodeError("delimiter", data, 0, "an ASCII frame begins with ':'")
    if data[-2:] != END:
        raise DecodeError("delimiter", data, max(len(data) - 2, 1), "an ASCII frame ends with CR LF")
    digits = data[1:-2]
    if digits.translate(None, DIGITS):  # the characters that are left are not digits
        at = next(place for place, character in enumerate(digits, start=1) if character not in DIGITS)
        found = f"{chr(data[at])!r}" if 0x20 <= data[at] < 0x7F else f"{data[at]:02X}h"
        raise DecodeError("character", data, at, f"{found} is not a hexadecimal digit")
    if len(data) < SHORTEST:
        text = f"an ASCII frame has at least {SHORTEST} characters, got {len(data)}"
        raise DecodeError("short", data, len(data), text)
    if len(data) > LONGEST:
        raise DecodeError("long", data, LONGEST, f"an ASCII frame has at most {LONGEST} characters, got {len(data)}")
    if len(digits) % 2:
        raise DecodeError("short", data, len(data) - 2, f"{len(digits)} digits: the last byte has only one")
    body = bytes.fromhex(digits.decode("ascii"))
    right = lrc(body[:-1])
    if body[-1] != right:
        raise DecodeError("checksum", data, len(data) - 4, f"LRC is {body[-1]:02X}, should be {right:02X}")
    return received_adu((body[0], body[1:-1], None))
