"""What is wrong with bytes that are not a good RTU frame: each fault is tried, and a good frame is its proof.

If the CRC does not fit, the order of `RTU_TRIALS` is that of the findings: first readings that use every byte as it is,
then frames inside the bytes, then a checksum in another form, then one change of the bytes, then a whole message
without its CRC, then another reading of the line, and last the beginning of a frame. Another reading of the line takes
longer than all other trials. Of the frames that are read at a wrong baud rate, one in a hundred looks like a whole
message without a CRC, and is not read in another way then.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import chain

from barewire.ascii.frame import START
from barewire.rtu.crc import crc16
from barewire.tcp.frame import PREFIX
from barewire_workbench.diagnosis.modbus import checksum, content, one_change
from barewire_workbench.diagnosis.modbus.frames_inside import frames_inside
from barewire_workbench.diagnosis.modbus.good import digits, good_ascii, good_rtu, good_tcp, missing, proof_of
from barewire_workbench.diagnosis.modbus.resample import misread
from barewire_workbench.frames.findings import Finding
from barewire_workbench.frames.modbus import explain_rtu
from barewire_workbench.frames.result import FrameRole

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
    for finding in checksum.bare(data, role):
        yield finding
        yield from _cut(data, role)


def _cut(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    for rest in missing(data, 2, role):
        yield Finding("cut-frame", rest.text(), f"{digits(data)} ...")


_READINGS: tuple[Trial, ...] = (_other_role, _ascii, seven_bit, _mbap)

RTU_TRIALS: tuple[tuple[Trial, ...], ...] = (
    (*_READINGS, checksum.swapped, _complemented),
    (frames_inside,),
    (checksum.span, checksum.kind),
    (one_change.byte_count, one_change.one_bit, one_change.one_less, one_change.one_more),
    (_without_crc,),
    (misread,),
    (_cut,),
)
"""Steps of the diagnosis: a later step is tried only if no earlier one has found anything."""

_TRIALS_OF_CONTENT: tuple[tuple[Trial, ...], ...] = (
    _READINGS,
    (frames_inside,),
    (one_change.byte_count, content.byte_count_form, content.left_over, one_change.address_byte_order),
    (checksum.without_unit, content.too_short),
)
"""If the CRC fits, the bytes were read as they were sent."""
