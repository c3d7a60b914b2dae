"""What is wrong with bytes that are not a good Modbus TCP frame.

The frame has no checksum, since TCP has its own. What proves a finding is the header: protocol 0 and a length that is
exactly that of the message behind it.
"""

from __future__ import annotations

from collections.abc import Iterator

from barewire.modbus.messages.base import EXCEPTION_BIT
from barewire.modbus.messages.registry import measure_request, measure_response, request_class, response_class
from barewire.rtu.crc import crc16
from barewire.tcp.frame import LENGTHS, LONGEST, PREFIX, SHORTEST
from barewire_workbench.diagnosis.good import (
    Missing,
    digits,
    good_ascii,
    good_body,
    good_rtu,
    good_tcp,
    missing,
    proof_of,
    without_checksum,
)
from barewire_workbench.diagnosis.rtu import (
    Trial,
    byte_count_text,
    byte_counts,
    clipped_digits,
    first_findings,
    pdu_byte_order,
)
from barewire_workbench.frames.findings import Finding
from barewire_workbench.frames.modbus import explain_tcp
from barewire_workbench.frames.result import Explanation, FrameRole, counted

_MOST = 2000
"""Longer input is a recording."""


def diagnose_tcp(data: bytes, role: FrameRole | None = None) -> list[Finding]:
    """Return what is wrong with bytes that should be one Modbus TCP frame, the likeliest first.

    >>> for finding in diagnose_tcp(bytes.fromhex("00 07 00 00 06 00 01 03 00 00 00 01")):
    ...     print(finding.code, finding.text, finding.proof, sep="\\n")
    header-byte-order
    the length has its low byte first: 06 00; the high byte goes first
    00 07 00 00 00 06 01 03 00 00 00 01 is a request to unit 1, Read Holding Registers, 1 from 0000h; transaction 7
    """
    if not data or len(data) > _MOST or explain_tcp(data, role).valid:
        return []
    return first_findings(_TRIALS, data, role)


def _other_role(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    if role is not None and (good := good_tcp(data)) is not None:
        yield Finding("role", f"this is a {good.role}, not a {role}", proof_of(data, good))


def _other_framing(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    text = "an RTU frame, with its CRC and without the header of Modbus TCP"
    if (good := good_rtu(data, role)) is not None:
        yield Finding("rtu-on-tcp", text, proof_of(data, good))
    elif len(data) >= 5 and crc16(data) == 0 and request_class(bytes((data[1] & ~EXCEPTION_BIT,))) is not None:
        yield Finding("rtu-on-tcp", text, f"{digits(data[-2:])} is the CRC of {digits(data[:-2])}")
    if (good := good_ascii(data, role)) is not None:
        text = "the characters of an ASCII frame, without the header of Modbus TCP"
        yield Finding("ascii-on-tcp", text, proof_of(data, good))


def _crc_inside(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    """The CRC of unit and PDU is still there; the length counts it, or does not."""
    body, length = data[PREFIX:], int.from_bytes(data[4:6], "big")
    if data[2:4] != b"\0\0" or (good := good_rtu(body, role)) is None or len(body) - length not in (0, 2):
        return
    counts = "counts it" if length == len(body) else "does not count it"
    frame = data[:4] + (len(body) - 2).to_bytes(2, "big") + body[:-2]
    explained = good_tcp(frame, role) or good
    text = f"the CRC of the serial line is still behind the frame; the length {counts}"
    yield Finding("crc-inside-mbap", text, f"{digits(body[-2:])} is that CRC; {proof_of(frame, explained)}")


def _half_crc_inside(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    """One byte of the CRC is still there."""
    body = data[PREFIX:-1]
    if data[2:4] == b"\0\0" and (good := good_body(body, role)) is not None and data[-1] == crc16(body) & 0xFF:
        text = "one byte of the CRC of the serial line is still behind the frame"
        crc = digits(crc16(body).to_bytes(2, "little"))
        yield Finding("crc-inside-mbap", text, f"{crc} is the CRC of {digits(body)}, which is {without_checksum(good)}")


def _header_byte(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    """A byte 00 of the header is missing; with it protocol, length and message fit."""
    for at in range(min(PREFIX, len(data))):
        frame = data[:at] + b"\0" + data[at:]
        if (good := good_tcp(frame, role)) is not None:
            yield Finding("byte-lost", "a byte 00 of the header is missing", proof_of(frame, good))
            return


def _left_over(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    """Bytes behind a whole message that the length counts."""
    if data[2:4] != b"\0\0" or int.from_bytes(data[4:6], "big") != len(data) - PREFIX:
        return
    for measure in (measure_request, measure_response):
        size = measure(data[PREFIX + 1 :])
        if size is not None and PREFIX + 1 + size < len(data):
            rest = data[PREFIX + 1 + size :]
            frame = data[:4] + (size + 1).to_bytes(2, "big") + data[PREFIX : PREFIX + 1 + size]
            if (good := good_tcp(frame, role)) is not None:
                text = f"{counted(len(rest))} behind the PDU, {clipped_digits(rest)}, which the length includes"
                yield Finding("byte-extra", text, proof_of(frame, good))


def _header_order(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    frame = data[:4] + data[5:3:-1] + data[6:]
    text = f"the length has its low byte first: {digits(data[4:6])}; the high byte goes first"
    if (good := good_tcp(frame, role)) is not None:
        yield Finding("header-byte-order", text, proof_of(frame, good))
    elif data[2:4] == b"\0\0" and len(data) >= SHORTEST and frame[4:6] == (len(data) - PREFIX).to_bytes(2, "big"):
        follow = len(data) - PREFIX
        yield Finding("header-byte-order", text, f"{counted(follow)} follow, {follow:04X}h")


def _header(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    """One of protocol and length is wrong; with the right one the frame is good."""
    length = len(data) - PREFIX
    if length not in LENGTHS:
        return
    right = data[:4] + length.to_bytes(2, "big") + data[6:]
    if (good := good_tcp(right, role)) is not None:
        said = int.from_bytes(data[4:6], "big")
        names = {length - 1: ", which leaves out the unit", len(data): ", that of the whole frame"}
        text = f"the length is {said}{names.get(said, '')}; unit and PDU have {counted(length)}"
        yield Finding("mbap-header", text, proof_of(right, good))
    right = data[:2] + b"\0\0" + data[4:]
    if (good := good_tcp(right, role)) is not None:
        text = f"the protocol identifier is {digits(data[2:4])}; that of Modbus is 00 00"
        yield Finding("mbap-header", text, proof_of(right, good))


def _only_unit(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    """The header of a response without a message: some gateways answer so."""
    if len(data) == PREFIX + 1 and data[2:6] == b"\0\0\0\1":
        text = "a header with length 1: the unit, and no function"
        yield Finding("mbap-header", text, f"transaction {int.from_bytes(data[:2], 'big')}, unit {data[6]}")


def _frames_inside(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    """Good frames up to the end, or with a part of another behind them; or noise before them."""
    for first in range(len(data) - SHORTEST + 1):
        frames = list(_frames_from(data, first, role))
        end = first + sum(len(frame) for frame, _ in frames)
        if not frames or (first and end < len(data)):
            continue
        rest, proof = data[end:], "; ".join(proof_of(frame, good) for frame, good in frames)
        begun = _begun(rest, None)
        if begun:
            proof += f"; {digits(rest)} is {begun[0].text()}"
        if len(frames) + bool(begun) > 1:
            text = (
                "a frame, and a part of another" if begun else f"{counted(len(frames), 'frame')} one behind the other"
            )
            yield Finding("two-frames", text, proof)
        if first:
            yield Finding("noise-before", f"{_before(data, first)}: {clipped_digits(data[:first])}", proof)
        if rest and not begun:
            yield Finding("noise-after", f"{counted(len(rest))} behind the frame: {clipped_digits(rest)}", proof)
        return


def _before(data: bytes, first: int) -> str:
    """Return what precedes the frame: the headers of a captured packet are known by their types and lengths."""
    ip = {first - 20 - tcp: tcp for tcp in range(20, 64, 4)}
    for at in (0, 14, 18):
        if data[at : at + 1] == b"\x45" and data[at + 9 : at + 10] == b"\x06" and at in ip:
            return ("Ethernet, " if at else "") + f"IP and TCP headers, {counted(first)}, before the frame"
    return f"{counted(first)} before the frame"


def _frames_from(data: bytes, at: int, role: FrameRole | None) -> Iterator[tuple[bytes, Explanation]]:
    while True:
        length = int.from_bytes(data[at + 4 : at + 6], "big")
        frame = data[at : at + PREFIX + length]
        if len(frame) != PREFIX + length or not SHORTEST <= len(frame) <= LONGEST:
            return
        if (good := good_tcp(frame, role)) is None:
            return
        yield frame, good
        at += len(frame)


def _byte_count(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    """The byte count inside the PDU contradicts the length of the header, which is right."""
    if int.from_bytes(data[4:6], "big") != len(data) - PREFIX:
        return
    for place, count in byte_counts(data[PREFIX + 1 :], role):
        at = PREFIX + 1 + place
        frame = data[:at] + bytes((count,)) + data[at + 1 :]
        if (good := good_tcp(frame, role)) is not None:
            text = byte_count_text(data[at], count)
            yield Finding("byte-count", text, f"with {count:02X}h {proof_of(frame, good)}")


def _byte_order(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    if role != "response" and data[2:4] == b"\0\0" and int.from_bytes(data[4:6], "big") == len(data) - PREFIX:
        yield from pdu_byte_order(data[PREFIX + 1 :])


def _bare(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    if (good := good_body(data, role)) is not None and data[0]:
        header = digits(b"\0\0\0\0" + len(data).to_bytes(2, "big"))
        text = "the header is missing: these are unit and PDU"
        crc = digits(crc16(data).to_bytes(2, "little"))
        proof = f"with {header} before it, it is {without_checksum(good)}; on a serial line it would end with {crc}"
        yield Finding("mbap-missing", text, proof)


def _cut(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    length = int.from_bytes(data[4:6], "big")
    proof = f"the length is {length}, and {counted(len(data) - PREFIX)} follow"
    # Whether the bytes of a known function are a whole message decides; of another one only the length is known.
    is_known = len(data) >= SHORTEST and response_class(data[PREFIX + 1 :]) is not None
    to_come = PREFIX + length - len(data)
    if len(data) >= PREFIX and data[2:4] == b"\0\0" and length in LENGTHS and to_come > 0 and not is_known:
        text = f"the beginning of a frame, {counted(to_come)} to come"
        yield Finding("cut-frame", text, proof)
    for rest in _begun(data, role):
        pdu = data[PREFIX + 1 :]
        counts = byte_counts(pdu, rest.role) if rest.role == "response" else []
        said = [f"the byte count is {pdu[place]}, and {follow} follow" for place, follow in counts if follow]
        yield Finding("cut-frame", rest.text(), "; ".join([proof, *said]))


def _begun(data: bytes, role: FrameRole | None) -> list[Missing]:
    """Return for each direction how many bytes are to come, if the bytes begin a frame and its header is whole."""
    length = int.from_bytes(data[4:6], "big")
    to_come = PREFIX + length - len(data)
    if data[2:4] != b"\0\0" or length not in LENGTHS or len(data) < SHORTEST or to_come <= 0:
        return []
    found = [rest for rest in missing(data[PREFIX:], 0, role) if rest.to_come == to_come or rest.is_least]
    return [Missing(rest.role, to_come, False) for rest in found if rest.to_come <= to_come]


_TRIALS: tuple[tuple[Trial, ...], ...] = (
    (_other_role, _other_framing, _only_unit, _crc_inside, _header_order),
    (_frames_inside,),
    (_half_crc_inside, _header_byte, _left_over),
    (_bare,),
    (_cut,),
    (_header, _byte_count, _byte_order),
)
