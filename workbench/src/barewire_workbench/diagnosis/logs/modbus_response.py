"""Whether bytes are the response to a request: one that fits it, one to another request, one that lacks its ends."""

from __future__ import annotations

from barewire.ascii import frame as ascii_frame
from barewire.modbus.messages.registry import measure_response
from barewire.modbus.sniffer import RequestSeen, ResponseSeen
from barewire.rtu.crc import crc16
from barewire.rtu.frame import encode
from barewire.tcp import frame as tcp_frame
from barewire_workbench.diagnosis.modbus.exchange import diagnose_exchange
from barewire_workbench.diagnosis.modbus.rtu import diagnose_rtu
from barewire_workbench.frames.findings import DiagnosisCode, Finding
from barewire_workbench.frames.result import ProtocolName

_SHOWN = 32
"""The most bytes in the text of a finding."""


def exchange_findings(
    protocol: ProtocolName, request: RequestSeen, response: ResponseSeen, code: DiagnosisCode
) -> list[Finding]:
    """Return the findings with this code on a request and what came after it.

    A response whose byte count is wrong is a wrong answer, too: it has a finding of its own.
    """
    asked = frame_of(protocol, request.transaction, request.unit, request.pdu)
    answered = frame_of(protocol, request.transaction, response.unit, response.pdu)
    found = [finding for finding in diagnose_exchange(protocol, asked, answered) if finding.code == code]
    if not found and code == "wrong-answer" and response.message is None and response.pdu[0] == request.pdu[0]:
        whole = encode(response.unit, response.pdu)
        return [finding for finding in diagnose_rtu(whole, "response") if finding.code == "byte-count"]
    return found


def frame_of(protocol: ProtocolName, transaction: int | None, unit: int, pdu: bytes) -> bytes:
    """Return the frame with this PDU. The transaction is that of the request in both, since the sniffer paired them."""
    if protocol == "tcp":
        return tcp_frame.encode(unit, pdu, transaction or 0)
    return (ascii_frame.encode if protocol == "ascii" else encode)(unit, pdu)


def response_size(pdu: bytes) -> int | None:
    """Return the bytes of the whole RTU frame that answers a request, None if the request does not tell.

    >>> response_size(bytes.fromhex("03 0000 0002")), response_size(bytes.fromhex("06 0001 0003"))
    (9, 8)
    """
    if len(pdu) == 5 and pdu[0] in (1, 2, 3, 4):
        count = int.from_bytes(pdu[3:5], "big")
        return 5 + (2 * count if pdu[0] > 2 else (count + 7) // 8)
    if pdu[0] in (5, 6, 15, 16):
        return 8
    return None


def lost_end(data: bytes, unit: int, request: bytes, size: int | None) -> Finding | None:
    """Return the finding of an RTU response that lacks its first or its last bytes, None if the CRC shows neither.

    >>> lost_end(bytes.fromhex("03 04 00 17 00 07 0B F5"), 1, bytes.fromhex("03 0000 0002"), 9).proof
    'with 01 the CRC fits: 01 03 04 00 17 00 07 0B F5'
    """
    head = bytes((unit, request[0]))
    for lost in (head[:1], head):
        whole = lost + data
        if crc16(whole) == 0 and measure_response(whole[1:]) == len(whole) - 3:
            which = "byte is" if len(lost) == 1 else "2 bytes are"
            return Finding(
                "byte-lost",
                f"the first {which} missing",
                f"with {shown_digits(lost)} the CRC fits: {shown_digits(whole)}",
            )
    if size is not None and len(data) == size - 1 and data[:2] == head:
        check = crc16(data[:-1]).to_bytes(2, "little")
        if check[:1] == data[-1:]:
            return Finding(
                "byte-lost", "the last byte is missing", f"the CRC is {shown_digits(check)}, its first byte is there"
            )
    return None


def shown_digits(data: bytes) -> str:
    """Return bytes as the texts of findings show them."""
    return data[:_SHOWN].hex(" ").upper() + (" ..." if len(data) > _SHOWN else "")
