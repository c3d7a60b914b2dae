"""Encode and decode one whole RTU frame.

| unit 1 | PDU 1..253 | CRC 2, low byte first |        4 to 256 bytes            [MB-SERIAL 2.5.1]
"""

from __future__ import annotations

from barewire.errors import DecodeError
from barewire.modbus.adu import PDU_LIMIT, Adu, check_pdu, check_unit, received_adu
from barewire.rtu.crc import crc16

SHORTEST, LONGEST = 4, 256


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
        found, expected = data[-2:].hex(" ").upper(), right.hex(" ").upper()
        raise DecodeError("checksum", data, len(data) - 2, f"CRC is {found}, should be {expected}")
    return received_adu((data[0], bytes(data[1:-2]), None))
