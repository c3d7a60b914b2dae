"""Encode and decode one whole Modbus TCP frame.

| transaction 2 | protocol 2 = 0 | length 2 | unit 1 | PDU 1..253 |                  [MB-TCP 3.1.3]
  '----------------- MBAP header ------------------'
                                   length counts the unit and the PDU: 2..254
"""

from __future__ import annotations

import struct

from barewire.errors import DecodeError, EncodeError
from barewire.modbus.adu import PDU_LIMIT, Adu, check_pdu, check_unit, received_adu

HEADER = struct.Struct(">HHHB")
BEGINNING = struct.Struct(">HHH")  # the header up to the length field
PREFIX = 6
"""Bytes that the length does not count: transaction, protocol, length."""

SHORTEST, LONGEST = 8, 260
LENGTHS = range(2, 255)


def encode(unit: int, pdu: bytes, transaction: int = 0) -> bytes:
    """Return the frame that carries a PDU.

    >>> encode(1, bytes.fromhex("0300000001"), transaction=7).hex(" ").upper()
    '00 07 00 00 00 06 01 03 00 00 00 01'

    Raises EncodeError for a unit outside 0..255, a PDU outside 1..253 bytes and a transaction outside 0..65535.
    """
    size = len(pdu)
    if 1 <= size <= PDU_LIMIT:
        try:
            return HEADER.pack(transaction, 0, size + 1, unit) + pdu
        except struct.error:
            pass  # the checks below say what does not fit
    check_unit(unit)
    check_pdu(pdu)
    raise EncodeError(f"transaction {transaction}: expected 0..65535", "transaction")


def other_protocol(data: bytes) -> str:
    """Return what these first bytes belong to: "HTTP", "SSH" or "TLS"; empty if it is not known.

    >>> other_protocol(b"SSH-2.0-OpenSSH"), other_protocol(bytes(6))
    ('SSH', '')
    """
    if data[:2] in (b"\x15\x03", b"\x16\x03"):
        return "TLS"
    return {b"SSH-": "SSH", b"HTTP": "HTTP", b"GET ": "HTTP", b"POST": "HTTP"}.get(data[:4], "")


def check_header(data: bytes) -> int:
    """Return the length of the whole frame, from its first 6 bytes (or more).

    Raises DecodeError("protocol") or ("length"), with the wrong bytes. No frame can be found behind such a header.
    """
    protocol = int.from_bytes(data[2:4], "big")
    if protocol != 0:
        found = data[2:4].hex(" ").upper()
        other = other_protocol(data)
        hint = f"; the other side speaks {other}" if other else ""
        raise DecodeError("protocol", data, 2, f"protocol identifier is {found}, Modbus has 00 00{hint}")
    length = int.from_bytes(data[4:6], "big")
    if length not in LENGTHS:
        found = data[4:6].hex(" ").upper()
        raise DecodeError("length", data, 4, f"length is {found} ({length}): expected 2..254, the unit and a PDU")
    return PREFIX + length


def decode(data: bytes) -> Adu:
    """Return the unit, the PDU and the transaction number of a frame.

    >>> decode(bytes.fromhex("000700000006010300000001"))
    Adu(unit=1, pdu=b'\\x03\\x00\\x00\\x00\\x01', transaction=7)

    Raises DecodeError: "short", "protocol", "length" (outside 2..254), or "long" for bytes behind the frame.
    """
    size = len(data)
    if SHORTEST <= size <= LONGEST:
        transaction, protocol, length, unit = HEADER.unpack_from(data)
        if protocol == 0 and PREFIX + length == size:
            return received_adu((unit, bytes(data[7:]), transaction))
    if size < PREFIX:
        raise DecodeError("short", data, size, f"the MBAP header is not all there: {size} of 7 bytes")
    promised = check_header(data)
    if size < promised:
        text = f"length {promised - PREFIX} promises {promised} bytes, got {size}"
        raise DecodeError("short", data, size, text)
    raise DecodeError("long", data, promised, f"length {promised - PREFIX} ends at byte {promised}, got {size}")
