"""What is wrong with bytes that are not a good RTU frame: each fault is tried, and a good frame is its proof.

If the CRC does not fit, the order of `RTU_TRIALS` is that of the findings: first readings that use every byte as it is,
then frames inside the bytes, then a checksum in another form, then one change of the bytes, then a whole message
without its CRC, then another reading of the line, and last the beginning of a frame. Another reading of the line takes
longer than all other trials. Of the frames that are read at a wrong baud rate, one in a hundred looks like a whole
message without a CRC, and is not read in another way then.

One change of a byte, a bit or a length is found without trying all of them. A receiver computes the CRC over the whole
frame, its two CRC bytes too; a good frame ends with 0. The computation can be followed from both sides, because each
step of the table can be reversed:

    FFFFh  01  ->  .  03  ->  .  00  ->  .  ...  ->  .  C5  ->  .  CD  ->  0000h
           before[0]  before[1]                                            after[8]

`before[i]` is the remainder in front of byte i, computed from the start; `after[i]` is the remainder that must be there
for the rest to end with 0, computed from the end. A good frame has the same remainders in both rows. A frame with one
fault has equal rows except at the fault:

    a byte too many at i     before[i] == after[i + 1]
    a byte lost before i     one step leads from before[i] to after[i], and only one byte makes that step
    a wrong byte at i        one step leads from before[i] to after[i + 1]

So a frame of n bytes takes about 2 n steps for each of these questions, and not 256 n² of them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from itertools import chain
from typing import NamedTuple

from barewire.ascii.frame import START, lrc
from barewire.modbus.messages.base import EXCEPTION_BIT
from barewire.modbus.messages.registry import measure_request, measure_response, request_class
from barewire.rtu.crc import INITIAL, TABLE, crc16
from barewire.rtu.frame import LONGEST, SHORTEST
from barewire.tcp.frame import PREFIX
from barewire_workbench.diagnosis.good import (
    HIGHEST_UNIT,
    digits,
    good_ascii,
    good_body,
    good_rtu,
    good_tcp,
    missing,
    proof_of,
    without_checksum,
)
from barewire_workbench.diagnosis.resample import misread
from barewire_workbench.frames.findings import Finding
from barewire_workbench.frames.modbus import explain_pdu, explain_rtu
from barewire_workbench.frames.result import Explanation, FrameRole, counted

_ROW_OF = {entry >> 8: row for row, entry in enumerate(TABLE)}
"""The row of the table by the high byte of its entry: each high byte occurs once, so a step can be reversed."""


class CrcFit(NamedTuple):
    """A change with which the CRC fits: the place, the byte that would be there, and the whole frame after it."""

    at: int
    byte: int
    frame: bytes


def step(before: int, byte: int) -> int:
    """Return the remainder after one byte more."""
    return before >> 8 ^ TABLE[(before ^ byte) & 0xFF]


def step_back(after: int, byte: int) -> int:
    """Return the remainder before a byte, from the one after it.

    >>> f"{step_back(0x813E, 0x02):04X}"
    'FFFF'
    """
    row = _ROW_OF[after >> 8]
    return ((after ^ TABLE[row]) << 8 & 0xFF00) | (row ^ byte)


def forward(data: bytes) -> list[int]:
    """Return the remainder before each byte, and at the end.

    >>> [f"{remainder:04X}" for remainder in forward(bytes.fromhex("02074112"))]
    ['FFFF', '813E', '1241', '0012', '0000']
    """
    remainders = [INITIAL]
    for byte in data:
        remainders.append(step(remainders[-1], byte))
    return remainders


def backward(data: bytes) -> list[int]:
    """Return the remainder that each byte must find in order that the frame ends with 0.

    >>> [f"{remainder:04X}" for remainder in backward(bytes.fromhex("02074112"))]
    ['FFFF', '813E', '1241', '0012', '0000']
    """
    remainders = [0]
    for byte in reversed(data):
        remainders.append(step_back(remainders[-1], byte))
    return remainders[::-1]


def _between(before: int, after: int) -> int | None:
    """Return the byte that leads from one remainder to another, None if no byte does."""
    row = _ROW_OF[after >> 8]
    return row ^ (before & 0xFF) if before >> 8 == (after ^ TABLE[row]) & 0xFF else None


def extra_bytes(data: bytes) -> Iterator[CrcFit]:
    """Yield the frames without one of the bytes whose CRC fits.

    >>> [fit.at for fit in extra_bytes(bytes.fromhex("01 03 00 55 00 00 0A C5 CD"))]
    [3]
    """
    before, after = forward(data), backward(data)
    for at, byte in enumerate(data):
        if before[at] == after[at + 1]:
            yield CrcFit(at, byte, data[:at] + data[at + 1 :])


def lost_bytes(data: bytes) -> Iterator[CrcFit]:
    """Yield the frames with one byte more whose CRC fits. The same frame is yielded once.

    >>> [(fit.at, fit.byte) for fit in lost_bytes(bytes.fromhex("01 03 00 00 00 C5 CD"))]
    [(3, 24), (5, 10)]
    """
    before, after = forward(data), backward(data)
    seen = set()
    for at in range(len(data) + 1):
        byte = _between(before[at], after[at])
        if byte is not None and (frame := data[:at] + bytes((byte,)) + data[at:]) not in seen:
            seen.add(frame)
            yield CrcFit(at, byte, frame)


def changed_bytes(data: bytes) -> Iterator[CrcFit]:
    """Yield the frames with another value of one byte whose CRC fits; `byte` is the value that fits.

    >>> [(fit.at, fit.byte) for fit in changed_bytes(bytes.fromhex("01 03 00 40 00 0A C5 CD"))]
    [(3, 0)]
    """
    before, after = forward(data), backward(data)
    for at, was in enumerate(data):
        byte = _between(before[at], after[at + 1])
        if byte is not None and byte != was:
            yield CrcFit(at, byte, data[:at] + bytes((byte,)) + data[at + 1 :])


_SHOWN = 8
"""So many bytes of noise are in the text of a finding."""


def frames_inside(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    """Find good frames with other bytes around them, or one behind the other."""
    first, frames = _good_frames(data)
    if not frames:
        return
    end = first + sum(len(frame) for frame, _ in frames)
    rest, proof = data[end:], "; ".join(proof_of(frame, good) for frame, good in frames)
    begun = missing(rest, 2) if len(rest) >= SHORTEST else []
    if begun:
        proof += f"; {digits(rest)} is {begun[0].text()}"
    if len(frames) + bool(begun) > 1:
        text = (
            f"{counted(len(frames), 'frame')} one behind the other" if not begun else "a frame, and a part of another"
        )
        yield Finding("two-frames", text, proof)
    if first:
        yield Finding("noise-before", f"{counted(first)} before the frame: {clipped_digits(data[:first])}", proof)
    if rest and not begun:
        yield Finding("noise-after", f"{counted(len(rest))} behind the frame: {clipped_digits(rest)}", proof)


def clipped_digits(data: bytes) -> str:
    """Return bytes for the text of a finding, which is one line."""
    return digits(data) if len(data) <= _SHOWN else f"{digits(data[: _SHOWN - 1])} ..."


def _good_frames(data: bytes) -> tuple[int, list[tuple[bytes, Explanation]]]:
    """Return where the first good frame begins, and all good frames that follow one another from there."""
    for first in range(len(data) - SHORTEST + 1):
        frames = list(_frames_from(data, first))
        if frames:
            return first, frames
    return 0, []


def _frames_from(data: bytes, at: int) -> Iterator[tuple[bytes, Explanation]]:
    while (frame := _frame_at(data, at)) is not None:
        yield frame
        at += len(frame[0])


def _frame_at(data: bytes, at: int) -> tuple[bytes, Explanation] | None:
    if at + SHORTEST > len(data) or data[at] > HIGHEST_UNIT:
        return None
    for measure in (measure_request, measure_response):
        size = measure(data[at + 1 : at + LONGEST])
        if size is not None and size + 3 >= SHORTEST and at + size + 3 <= len(data):
            frame = data[at : at + size + 3]
            if (good := good_rtu(frame)) is not None:
                return frame, good
            if data[at + 1] & EXCEPTION_BIT and crc16(frame) == 0:  # to a function that the standard does not have
                return frame, explain_rtu(frame, "response")
    return None


def swapped_crc(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    """The two bytes of the CRC are exchanged."""
    frame = data[:-2] + data[:-3:-1]
    if (good := good_rtu(frame, role)) is not None:
        text = "the two CRC bytes are exchanged; the low byte goes first"
        yield Finding("crc-swapped", text, proof_of(frame, good))


def crc_span(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    """The CRC over fewer bytes, or over some more, in either byte order."""
    body, end = data[:-2], data[-2:]
    if (good := good_body(body, role)) is None:
        return
    spans = {
        body[1:]: "without the unit",
        body[:-1]: "without the last byte",
        body + b"\0": "with a byte 00 behind unit and PDU",
        b"\0" + body: "with a byte 00 before unit and PDU",
        body + end[:1]: "with one byte of the CRC behind unit and PDU",
        body + b"\0\0": "with two bytes 00 behind unit and PDU",
    }
    for size in range(2, len(body) - 1):
        spans.setdefault(body[:size], f"over the first {size} bytes only")
        spans.setdefault(body[-size:], f"over the last {size} bytes before it only")
    for span, what in spans.items():
        crc = crc16(span)
        if span and end in (crc.to_bytes(2, "little"), crc.to_bytes(2, "big")):
            proof = f"{digits(end)} is the CRC of {digits(span)}; with the right one it is {without_checksum(good)}"
            yield Finding("crc-span", f"the CRC was computed {what}", proof)


def crc_kind(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    """Another CRC of 16 bits, or an LRC."""
    body, end = data[:-2], data[-2:]
    if (good := good_body(body, role)) is not None:
        for name, compute in _KINDS.items():
            if end in (compute(body).to_bytes(2, "little"), compute(body).to_bytes(2, "big")):
                proof = (
                    f"{digits(end)} is the {name} of {digits(body)}; with the right CRC it is {without_checksum(good)}"
                )
                yield Finding("crc-kind", f"the checksum is a {name}, not the CRC of Modbus", proof)
    if (good := good_body(data[:-1], role)) is not None and data[-1] == lrc(data[:-1]):
        proof = f"{data[-1]:02X} is the LRC of {digits(data[:-1])}; with the right CRC it is {without_checksum(good)}"
        yield Finding("crc-kind", "the checksum is the LRC of Modbus ASCII, not a CRC", proof)


def crc_missing(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    """A whole message without a CRC, or with a CRC but without a unit."""
    if (good := good_body(data, role)) is not None:
        crc = digits(crc16(data).to_bytes(2, "little"))
        yield Finding("crc-missing", "the CRC is missing", f"with {crc} it is {without_checksum(good)}")


def unit_missing(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    """A PDU with a CRC that fits, without a unit before it. Its second byte is no function code."""
    if request_class(data[1:]) is None and (good := good_body(b"\x01" + data[:-2], role)) is not None:
        proof = f"the CRC fits; for unit 1 it is {without_checksum(good)}"
        yield Finding("byte-lost", "the unit is missing, also in the CRC", proof)


def _mirrored(polynomial: int, start: int, data: bytes) -> int:
    crc = start
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (polynomial if crc & 1 else 0)
    return crc


def _straight(polynomial: int, start: int, data: bytes) -> int:
    crc = start
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ (polynomial if crc & 0x8000 else 0)) & 0xFFFF
    return crc


def _from_zero(data: bytes) -> int:
    crc = 0
    for byte in data:
        crc = crc >> 8 ^ TABLE[(crc ^ byte) & 0xFF]
    return crc


_KINDS: dict[str, Callable[[bytes], int]] = {
    "CRC-16/ARC (which starts with 0000h)": _from_zero,
    "CRC-16/USB (which inverts its bits at the end)": lambda data: crc16(data) ^ 0xFFFF,
    "CRC-16/XMODEM": lambda data: _straight(0x1021, 0, data),
    "CRC-16/IBM-3740 (CCITT from FFFFh)": lambda data: _straight(0x1021, 0xFFFF, data),
    "CRC-16/KERMIT": lambda data: _mirrored(0x8408, 0, data),
    "CRC-16/MCRF4XX": lambda data: _mirrored(0x8408, 0xFFFF, data),
    "CRC-16/IBM-SDLC (X.25)": lambda data: _mirrored(0x8408, 0xFFFF, data) ^ 0xFFFF,
    "CRC-16/UMTS (8005h, not mirrored)": lambda data: _straight(0x8005, 0, data),
    "CRC-16/CMS (8005h, not mirrored, from FFFFh)": lambda data: _straight(0x8005, 0xFFFF, data),
}
"""Other CRCs of 16 bits, by their names in the catalogue of CRC algorithms."""


def byte_count_form(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    """A response without its byte count, or with one of two bytes."""
    body, follow = data[:-2], len(data) - 4
    if role != "request" and int.from_bytes(body[2:4], "big") == follow - 2 > 0:
        right = body[:2] + body[3:]
        if (good := good_body(right, "response")) is not None:
            text = f"the byte count has two bytes, {digits(body[2:4])}; it has one"
            yield Finding("byte-count", text, f"with {digits(body[3:4])} it is {without_checksum(good)}")
    if role == "response" and 0 < follow <= 250:
        right = body[:2] + bytes((follow,)) + body[2:]
        if (good := good_body(right, role)) is not None:
            text = "the byte count is missing, also in the CRC"
            yield Finding("byte-count", text, f"with {follow:02X}h behind the function it is {without_checksum(good)}")


def left_over(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    """Bytes behind a whole message that are counted by the CRC."""
    body = data[:-2]
    for which, measure in (("request", measure_request), ("response", measure_response)):
        size = measure(body[1:])
        if role not in (None, which) or size is None or size + 1 >= len(body):
            continue
        rest = body[size + 1 :]
        if (good := good_body(body[: size + 1], role)) is not None:
            text = f"{counted(len(rest))} behind the PDU, {digits(rest)}, which the CRC includes"
            yield Finding("byte-extra", text, f"without {digits(rest)} it is {without_checksum(good)}")


def cut_before_zero(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    """A good frame without its last byte, 00: behind a CRC that fits, another 00 leaves it so."""
    frame = data + b"\0"
    if len(data) > SHORTEST and (good := good_rtu(frame)) is not None:
        text = f"the beginning of a {good.role}, 1 byte is to come: the CRC fits by chance, since the last byte is 00"
        yield Finding("cut-frame", text, f"with 00 {proof_of(frame, good)}")


def digits_as_text(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    """Hexadecimal digits that are sent as characters, without what Modbus ASCII has around them."""
    text = data.decode("latin-1").strip()
    if len(text) < 2 * SHORTEST or re.fullmatch(r"(?:[0-9A-Fa-f]{2})+", text) is None:
        return
    first, frames = _good_frames(inner := bytes.fromhex(text))
    proof = "; ".join(proof_of(frame, good) for frame, good in frames) if frames else f"{digits(inner)} as digits"
    behind = f"behind {digits(inner[:first])}, " if first else ""
    what = "hexadecimal digits as characters, without the colon and the LRC of Modbus ASCII"
    yield Finding("rtu-on-ascii", what, behind + proof)


def too_short(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    """A message that ends too early, with the CRC of what is there."""
    if len(data) == SHORTEST and data[1] & EXCEPTION_BIT and role != "request":
        proof = f"the CRC of {digits(data[:2])} is {digits(data[2:])}"
        yield Finding("cut-frame", "an exception without its code: the sender made it so", proof)
    for rest in missing(data[:-2], 0, role) if len(data) > 5 else ():
        if not rest.is_least:
            text = f"{rest.text()}, but the CRC fits what is there: the sender made it so"
            yield Finding("cut-frame", text, f"the CRC of {digits(data[:-2])} is {digits(data[-2:])}")


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


_MOST = 600
"""Longer input is a recording, not a frame with one fault."""


def diagnose_rtu(data: bytes, role: FrameRole | None = None) -> list[Finding]:
    """Return what is wrong with bytes that should be one RTU frame, the likeliest first; nothing for a good frame.

    >>> for finding in diagnose_rtu(bytes.fromhex("01 03 00 00 00 0A CD C5")):
    ...     print(finding.code, finding.text, finding.proof, sep="\\n")
    crc-swapped
    the two CRC bytes are exchanged; the low byte goes first
    01 03 00 00 00 0A C5 CD is a request to unit 1, Read Holding Registers, 10 from 0000h; CRC ok
    """
    if not data or len(data) > _MOST or explain_rtu(data, role).valid:
        return []
    return first_findings(RTU_TRIALS if crc16(data) else _TRIALS_OF_CONTENT, data, role)


Trial = Callable[[bytes, FrameRole | None], Iterator[Finding]]


def first_findings(steps: tuple[tuple[Trial, ...], ...], data: bytes, role: FrameRole | None) -> list[Finding]:
    """Return the findings of the first step that has some; the same finding is returned once."""
    for trials in steps:
        found = dict.fromkeys(chain.from_iterable(trial(data, role) for trial in trials))
        if found:
            return list(found)
    return []


def _other_role(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    if role is not None and (good := good_rtu(data)) is not None:
        yield Finding("role", f"this is a {good.role}, not a {role}", proof_of(data, good))


def _ascii(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    frame = data[max(data.rfind(START), 0) :]
    if (good := good_ascii(frame, role)) is not None:
        text = "the characters of an ASCII frame: the device is set to Modbus ASCII"
        before = f"behind {digits(data[: -len(frame)])}, " if len(frame) < len(data) else ""
        yield Finding("ascii-on-rtu", text, before + proof_of(frame, good))


def seven_bit(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    """Characters of 7 bits with parity: bit 7 makes the number of 1s even in each of them, or odd."""
    characters = bytes(byte & 0x7F for byte in data)
    if characters == data or (good := good_ascii(characters, role)) is None:
        return
    parities = {byte.bit_count() & 1 for byte in data}
    if len(parities) == 1:
        form, what = ("7O1", "odd") if parities == {1} else ("7E1", "even")
        proof = f"bit 7 is {what} parity in each byte; without it {proof_of(characters, good)}"
        yield Finding("seven-bit", f"an ASCII frame sent as {form} and read as 8N1", proof)


def _mbap(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    if (good := good_tcp(data, role)) is not None:
        text = "a Modbus TCP frame, with its header and without a CRC"
        yield Finding("mbap-on-serial", text, proof_of(data, good))
    header, frame = data[:PREFIX], data[PREFIX:]
    length = int.from_bytes(header[4:6], "big")
    if header[2:4] == b"\0\0" and len(frame) - length in (0, 2) and (good := good_rtu(frame, role)) is not None:
        text = "the header of Modbus TCP is before an RTU frame; it does not belong on a serial line"
        yield Finding("mbap-on-serial", text, f"without {digits(header)}, {proof_of(frame, good)}")


def _complemented(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    frame = bytes(byte ^ 0xFF for byte in data)
    if (good := good_rtu(frame, role)) is not None:
        yield Finding("inverted", "every data bit is inverted", proof_of(frame, good))


def _without_crc(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    """A whole message without a CRC; it may still be the beginning of a longer one."""
    for finding in crc_missing(data, role):
        yield finding
        yield from _cut(data, role)


def _cut(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    for rest in missing(data, 2, role):
        yield Finding("cut-frame", rest.text(), f"{digits(data)} ...")


_READINGS: tuple[Trial, ...] = (_other_role, _ascii, seven_bit, _mbap)

RTU_TRIALS: tuple[tuple[Trial, ...], ...] = (
    (*_READINGS, digits_as_text, swapped_crc, _complemented),
    (frames_inside,),
    (crc_span, crc_kind),
    (byte_count, one_bit, one_less, one_more),
    (_without_crc,),
    (misread,),
    (_cut,),
)
"""Steps of the diagnosis: a later step is tried only if no earlier one has found anything."""

_TRIALS_OF_CONTENT: tuple[tuple[Trial, ...], ...] = (
    _READINGS,
    (frames_inside,),
    (cut_before_zero,),
    (byte_count, byte_count_form, left_over, address_byte_order),
    (unit_missing, too_short),
)
"""If the CRC fits, the bytes were read as they were sent."""
