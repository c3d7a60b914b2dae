"""What a wrong checksum of an RTU frame is instead: in the other byte order, over other bytes, or of another kind."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from barewire.ascii.frame import lrc
from barewire.modbus.messages.registry import request_class
from barewire.rtu.crc import TABLE, crc16
from barewire_workbench.diagnosis.modbus.good import digits, good_body, good_rtu, proof_of, without_checksum
from barewire_workbench.frames.findings import Finding
from barewire_workbench.frames.result import FrameRole


def swapped(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    """The two bytes of the CRC are exchanged."""
    frame = data[:-2] + data[:-3:-1]
    if (good := good_rtu(frame, role)) is not None:
        text = "the two CRC bytes are exchanged; the low byte goes first"
        yield Finding("crc-swapped", text, proof_of(frame, good))


def span(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
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
    for taken, what in spans.items():
        crc = crc16(taken)
        if taken and end in (crc.to_bytes(2, "little"), crc.to_bytes(2, "big")):
            proof = f"{digits(end)} is the CRC of {digits(taken)}; with the right one it is {without_checksum(good)}"
            yield Finding("crc-span", f"the CRC was computed {what}", proof)


def kind(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
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


def bare(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    """A whole message without a CRC, or with a CRC but without a unit."""
    if (good := good_body(data, role)) is not None:
        crc = digits(crc16(data).to_bytes(2, "little"))
        yield Finding("crc-missing", "the CRC is missing", f"with {crc} it is {without_checksum(good)}")


def without_unit(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
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
