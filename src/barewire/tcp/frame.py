"""One whole Modbus TCP frame, in and out. Pure: bytes to a letter and back, nothing remembered.

| transaction 2 | protocol 2 = 0 | length 2 | unit 1 | PDU 1..253 |                  [MB-TCP 3.1.3]
  '----------------- MBAP header ------------------'
                                   length counts the unit and the PDU: 2..254
"""

from __future__ import annotations

import struct

from barewire.errors import DecodeError, EncodeError
from barewire.modbus.adu import Adu, check_pdu, check_unit

HEADER = struct.Struct(">HHHB")
PREFIX = 6
"""The bytes before the length counts: transaction, protocol, length."""

SHORTEST, LONGEST = 8, 260
LENGTHS = range(2, 255)


def encode(unit: int, pdu: bytes, transaction: int = 0) -> bytes:
    """The frame that carries a PDU.

    >>> encode(1, bytes.fromhex("0300000001"), transaction=7).hex(" ").upper()
    '00 07 00 00 00 06 01 03 00 00 00 01'

    Raises EncodeError for a unit outside 0..255, a PDU outside 1..253 bytes, a transaction outside 0..65535.
    """
    check_unit(unit)
    check_pdu(pdu)
    if not 0 <= transaction <= 0xFFFF:
        raise EncodeError(f"transaction {transaction}: expected 0..65535", "transaction")
    return HEADER.pack(transaction, 0, len(pdu) + 1, unit) + pdu


def check_header(data: bytes) -> int:
    """The length of the whole frame, told from its first 6 bytes (or more).

    Raises DecodeError("protocol") or ("length"), naming the bytes: after that nobody knows where a frame begins.
    """
    protocol = int.from_bytes(data[2:4], "big")
    if protocol != 0:
        said = data[2:4].hex(" ").upper()
        raise DecodeError("protocol", data, 2, f"protocol identifier is {said}, Modbus has 00 00")
    length = int.from_bytes(data[4:6], "big")
    if length not in LENGTHS:
        said = data[4:6].hex(" ").upper()
        raise DecodeError("length", data, 4, f"length is {said} ({length}): expected 2..254, the unit and a PDU")
    return PREFIX + length


def decode(data: bytes) -> Adu:
    """The frame as unit, PDU and transaction.

    >>> decode(bytes.fromhex("000700000006010300000001"))
    Adu(unit=1, pdu=b'\\x03\\x00\\x00\\x00\\x01', transaction=7)

    Raises DecodeError: "short", "protocol", "length" (outside 2..254), or "long" for bytes behind the frame.
    """
    if len(data) < PREFIX:
        raise DecodeError("short", data, len(data), f"the MBAP header is not all there: {len(data)} of 7 bytes")
    size = check_header(data)
    if len(data) < size:
        raise DecodeError(
            "short", data, len(data), f"length {size - PREFIX} promises {size} bytes, here are {len(data)}"
        )
    if len(data) > size:
        raise DecodeError("long", data, size, f"length {size - PREFIX} ends at byte {size}, here are {len(data)}")
    transaction, _, _, unit = HEADER.unpack_from(data)
    return Adu(unit, bytes(data[7:]), transaction)
