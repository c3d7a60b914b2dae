"""One change that makes an RTU frame good: a byte count, a bit, a byte less or more, a number turned round."""

from __future__ import annotations

from collections.abc import Iterator

from barewire.rtu.crc import crc16
from barewire_workbench.diagnosis.modbus.crc_search import CrcFit, changed_bytes, extra_bytes, lost_bytes
from barewire_workbench.diagnosis.modbus.good import HIGHEST_UNIT, good_body, good_rtu, proof_of, without_checksum
from barewire_workbench.frames.findings import Finding
from barewire_workbench.frames.modbus import explain_pdu
from barewire_workbench.frames.result import Explanation, FrameRole, counted

_WITH_QUANTITY = range(0x01, 0x11)
_ALTERNATIVES = 3
"""So many of the frames that fit are in a proof."""


def byte_count(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    """Set the byte count of a response, or of a request that writes, to what follows; the CRC is as it should be."""
    for place, count in byte_counts(data[1:-2], role):
        body = data[: 1 + place] + bytes((count,)) + data[2 + place :]
        text = byte_count_text(data[1 + place], count)
        if (good := good_rtu(body, role)) is not None:
            yield Finding("byte-count", text, f"with {count:02X}h the CRC fits: {proof_of(body, good)}")
        elif crc16(data) == 0 and (good := good_body(body[:-2], role)) is not None:
            yield Finding("byte-count", text, f"the CRC fits; with {count:02X}h it is {without_checksum(good)}")


def byte_counts(pdu: bytes, role: FrameRole | None) -> list[tuple[int, int]]:
    """Return the places where the PDU has a byte count that is wrong, each with the number of bytes that follow it."""
    roles: tuple[FrameRole, ...] = ("request", "response") if role is None else (role,)
    places = {field.offset for which in roles for field in explain_pdu(pdu, which).fields if field.name == "byte_count"}
    # A count of 0 is that of no message: without a given direction the bytes are more likely a request.
    places = {place for place in places if place < len(pdu) and (pdu[place] or role is not None)}
    follow = [(place, len(pdu) - place - 1) for place in sorted(places)]
    return [(place, count) for place, count in follow if count <= 255 and pdu[place] != count]


def byte_count_text(said: int, count: int) -> str:
    """Return the text of a finding about a byte count."""
    return f"the byte count is {said:02X}h ({said}), and {counted(count)} follow{'s' * (count == 1)}"


def pdu_byte_order(pdu: bytes) -> Iterator[Finding]:
    """Turn address and quantity of a request round, if the quantity is allowed only then; or the value of a coil."""
    if len(pdu) < 5 or pdu[0] not in _WITH_QUANTITY or explain_pdu(pdu, "request").error is None:
        return
    what = "coil value" if pdu[0] == 0x05 else "quantity"
    turned = pdu[:1] + (pdu[1:3] if pdu[0] == 0x05 else pdu[2:0:-1]) + pdu[4:2:-1] + pdu[5:]
    explained = explain_pdu(turned, "request")
    if explained.error is None and turned[3:5] != pdu[3:5]:
        text = f"the {what} has its low byte first; the high byte goes first"
        also = "" if pdu[0] == 0x05 else ", and the address turned round as well"
        proof = f"{pdu[3:5].hex().upper()}h is not allowed; with {turned[3:5].hex().upper()}h{also}, it is "
        yield Finding("address-byte-order", text, proof + explained.summary)


def address_byte_order(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    """The same for a frame whose CRC fits, so that the sender means what it sent."""
    if role != "response" and crc16(data) == 0:
        yield from pdu_byte_order(data[1:-2])


def one_bit(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    """Change one bit. Two good frames of the same length differ in at least four bits, so no other bit fits as well."""
    for fit in changed_bytes(data):
        change = data[fit.at] ^ fit.byte
        if change.bit_count() == 1 and (good := _likely(fit, role)) is not None:
            bit = change.bit_length() - 1
            text = f"bit {bit} of byte {fit.at} is wrong: {data[fit.at]:02X}h instead of {fit.byte:02X}h"
            yield Finding("bit-flip", text, proof_of(fit.frame, good))


def one_less(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    """Leave one byte out. A byte beside an equal one leaves the same frame, wherever it is left out."""
    fits = {fit.frame: (fit, good) for fit in extra_bytes(data) if (good := _likely(fit, role)) is not None}
    if fits:
        fit, _ = next(iter(fits.values()))
        text = f"byte {fit.at}, {fit.byte:02X}h, is too many"
        yield Finding("byte-extra", text, _alternatives(list(fits.values())))


def one_more(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    """Put one byte in: first at the start and at the end, where most are lost; then the byte with the fewest 1s."""
    fits = [(fit, good) for fit in lost_bytes(data) if (good := _likely(fit, role)) is not None]
    fits.sort(key=lambda pair: (pair[0].at not in (0, len(data)), pair[0].byte.bit_count(), pair[0].at))
    if not fits:
        return
    fit, good = fits[0]
    if fit.at == len(data):
        text = f"the beginning of a {good.role}, 1 byte is to come"
        yield Finding("cut-frame", text, f"with {fit.byte:02X} the CRC fits: {proof_of(fit.frame, good)}")
        return
    where = f"before byte {fit.at}" if fit.at else "at the start"
    text = f"a byte is missing: {fit.byte:02X}h {where}" if len(fits) == 1 else "a byte is missing inside the frame"
    if fit.at == 0:
        text = f"the first byte is missing: {fit.byte:02X}h"
    yield Finding("byte-lost", text, _alternatives(fits))


def _likely(fit: CrcFit, role: FrameRole | None) -> Explanation | None:
    return good_rtu(fit.frame, role) if fit.frame[0] <= HIGHEST_UNIT else None


def _alternatives(fits: list[tuple[CrcFit, Explanation]]) -> str:
    shown = "; or ".join(proof_of(fit.frame, good) for fit, good in fits[:_ALTERNATIVES])
    more = len(fits) - _ALTERNATIVES
    return shown if more <= 0 else f"{shown}; or {counted(more, 'more place')}"
