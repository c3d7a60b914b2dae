"""The checksums of Modbus: the CRC of RTU in three views, and the LRC of ASCII.

    register     eight shifts for each byte, as the ADXL manual prints them for 02 07
    table        one look-up for each byte
    polynomial   the long division whose remainder the other two compute

    LRC          the sum of the bytes, and its two's complement

The package computes them in `rtu.crc` and `ascii.frame`; the steps here do not use that.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal, get_args

from barewire.ascii.frame import lrc
from barewire.errors import EncodeError
from barewire.rtu.crc import crc16
from barewire_workbench.steps.model import Steps, StepSection, StepTable, check_length, grouped_bits, spaced_hex

CrcView = Literal["register", "table", "polynomial"]
CRC_VIEWS: tuple[CrcView, ...] = get_args(CrcView)

LONGEST_MESSAGE = 256
"""Bytes of the longest RTU frame."""

DIVIDED_MAX = 8
"""Bytes whose division still fits a screen: one line for each bit, and as wide."""

_DIVISOR = 0b1_1000_0000_0000_0101
"""x^16 + x^15 + x^2 + 1, the highest power first."""

_MIRRORED = 0xA001
"""8005h, the powers below x^16, with the lowest bit first: the order in which a serial line sends bits."""


def crc_steps(data: bytes, views: Iterable[CrcView] = CRC_VIEWS) -> Steps:
    """Work out the CRC of some bytes in each of the views.

    >>> crc_steps(bytes.fromhex("0207"))
    <Steps crc: CRC 1241h, sent low byte first: 41 12>

    Raises EncodeError for no bytes, for more than an RTU frame has, and for a division of more than 8 bytes.
    """
    check_length(data, LONGEST_MESSAGE)
    chosen = list(dict.fromkeys(views))
    sections: list[StepSection] = []
    for view in chosen:
        if view == "register":
            sections += _register(data)
        elif view == "table":
            sections += _table(data)
        elif len(data) <= DIVIDED_MAX:
            sections += _polynomial(data)
        elif len(chosen) > 1:
            sections.append(
                f"Polynomial view: the picture of the division has room for {DIVIDED_MAX} bytes; these are {len(data)}."
            )
        else:
            raise EncodeError(f"{len(data)} bytes: the polynomial view has room for {DIVIDED_MAX}")
    crc = crc16(data)
    wire = crc.to_bytes(2, "little")
    if crc == 0 and len(data) > 2:
        sections.append(
            f"The CRC is 0: the last two bytes, {spaced_hex(data[-2:])}, are the CRC of those before them. "
            "A receiver checks a whole frame like this."
        )
    elif len(data) <= LONGEST_MESSAGE - 2:
        sections.append(f"With the CRC behind: {spaced_hex(data)} {spaced_hex(wire)}.")
    return Steps(
        "crc",
        f"CRC of {spaced_hex(data)}",
        "Modbus over Serial Line 1.02, 6.2.2: CRC-16, polynomial 8005h (A001h with its bits mirrored), start FFFFh",
        tuple(sections),
        f"CRC {crc:04X}h, sent low byte first: {spaced_hex(wire)}",
        {"crc": crc, "wire": spaced_hex(wire)},
    )


def _register(data: bytes) -> list[StepSection]:
    rows = [("", "start: all ones", grouped_bits(0xFFFF, 16), "", "FFFFh")]
    crc = 0xFFFF
    for place, byte in enumerate(data):
        rows.append((f"byte {place}", f"load {byte:02X}h", f"{'':10}{grouped_bits(byte, 8)}", "", ""))
        crc ^= byte
        rows.append(("", "xor", grouped_bits(crc, 16), "", f"{crc:04X}h"))
        for shift in range(1, 9):
            out, crc = crc & 1, crc >> 1
            rows.append(("", f"shift {shift}", grouped_bits(crc, 16), str(out), f"{crc:04X}h"))
            if out:
                rows.append(("", "out 1: polynomial", grouped_bits(_MIRRORED, 16), "", ""))
                crc ^= _MIRRORED
                rows.append(("", "xor", grouped_bits(crc, 16), "", f"{crc:04X}h"))
    return [
        "Register view. The register has 16 bits and starts with ones, so that zeros in front of a message "
        "count. Each byte is combined with the low half of the "
        "register by exclusive or (xor: 1 where the two bits differ). Then eight times: shift right by one place, a 0 "
        "comes in at the left; if the bit that goes out at the right is 1, xor the register with A001h.",
        StepTable("", ("", "step", "register", "out", "hex"), tuple(rows)),
    ]


def _eight_shifts(number: int) -> int:
    for _ in range(8):
        number = number >> 1 ^ (_MIRRORED if number & 1 else 0)
    return number


def _table(data: bytes) -> list[StepSection]:
    rows, crc = [], 0xFFFF
    for byte in data:
        index = crc & 0xFF ^ byte
        entry = _eight_shifts(index)
        after = crc >> 8 ^ entry
        low = f"{crc & 0xFF:02X}h xor {byte:02X}h = {index:02X}h"
        rows.append(
            (f"{byte:02X}h", f"{crc:04X}h", low, f"{entry:04X}h", f"{crc >> 8:04X}h xor {entry:04X}h = {after:04X}h")
        )
        crc = after
    return [
        "Table view. What eight shifts do depends on the low byte alone, so a table of 256 numbers replaces them: the "
        "number at place i is what eight shifts make of i. For each byte: the place is the low byte of the register "
        "xor the byte; the new register is the high byte of the old one, moved down, xor the number found there.",
        StepTable("", ("byte", "register", "place: low byte xor byte", "number", "new register"), tuple(rows)),
    ]


def _polynomial(data: bytes) -> list[StepSection]:
    sent = "".join(f"{byte:08b}"[::-1] for byte in data)  # the line sends the lowest bit of a byte first
    size = len(sent)
    start = (int(sent, 2) << 16) ^ (0xFFFF << size)
    width = size + 16
    rows = [("message, 16 zeros behind", f"{int(sent, 2) << 16:0{width}b}")]
    rows.append(("first 16 bits inverted", f"{start:0{width}b}"))
    rest = start
    for place in range(size):
        power = width - 1 - place
        if not rest >> power & 1:
            continue
        rest ^= _DIVISOR << power - 16
        rows.append((f"divisor from x^{power}", f"{'':{place}}{_DIVISOR:b}"))
        rows.append(("rest", f"{'':{place + 1}}{rest:0{width - place - 1}b}"))
    rows.append(("remainder", f"{'':{size}}{rest:016b}"))
    low, high = (int(f"{rest:016b}"[place : place + 8][::-1], 2) for place in (0, 8))
    return [
        "Polynomial view. Write the bits in the order in which the line sends them, each byte with its lowest bit "
        f"first: {' '.join(sent[place : place + 8] for place in range(0, size, 8))}. Put 16 zeros behind. Invert the "
        "first 16 bits, which is what the start value FFFFh does. Divide by x^16 + x^15 + x^2 + 1, that is "
        f"{_DIVISOR:b}, where to subtract is to xor: wherever the first bit that is left is 1, xor the divisor there. "
        "The quotient is of no interest. What remains is the CRC in the order in which it is sent.",
        StepTable("", ("", "bits"), tuple(rows)),
        f"The remainder as two bytes, the lowest bit first: {f'{rest:016b}'[:8]} is {low:02X}h, "
        f"{f'{rest:016b}'[8:]} is {high:02X}h. These are the bytes on the wire, {low:02X} {high:02X}.",
    ]


# LRC ----------------------------------------------------------------------------------------------------------------


_LONGEST = 255
"""Bytes in the longest ASCII frame: the unit, a PDU of 253, the LRC."""


def lrc_steps(data: bytes) -> Steps:
    """Work out the LRC of some bytes, that of the unit first.

    >>> lrc_steps(bytes.fromhex("0104000008"))
    <Steps lrc: LRC F3h, sent as the two characters 'F3'>

    Raises EncodeError for no bytes and for more than an ASCII frame has.
    """
    check_length(data, _LONGEST)
    total, rows = 0, []
    for byte in data:
        total += byte
        rows.append((f"{byte:02X}h", str(byte), grouped_bits(byte, 8), str(total), f"{total:X}h"))
    low = total % 256
    inverted = 255 - low
    complement = (inverted + 1) % 256
    final = [
        ("sum", f"{total:X}h", grouped_bits(total, max(8, total.bit_length()))),
        ("its low 8 bits", f"{low:02X}h", grouped_bits(low, 8)),
        ("all bits inverted", f"{inverted:02X}h", grouped_bits(inverted, 8)),
        ("plus 1", f"{complement:02X}h", grouped_bits(complement, 8)),
    ]
    sections: list[StepSection] = [
        "Add the bytes of the message: the bytes, not the characters that carry them, and without the colon, CR and "
        "LF.",
        StepTable("", ("byte", "decimal", "binary", "sum", "hex"), tuple(rows)),
        "Keep 8 bits, and take the two's complement: invert all bits, add 1. That is the number which makes the sum 0.",
        StepTable("", ("step", "hex", "binary"), tuple(final)),
        f"Check: {low:02X}h + {complement:02X}h = {low + complement:X}h, whose low 8 bits are 0.",
    ]
    if low == 0 and len(data) > 1:
        sections.append(
            f"The LRC is 0: the last byte, {data[-1]:02X}h, is the LRC of those before it. "
            "A receiver checks a whole frame like this."
        )
    checksum = lrc(data)
    if low:
        sections.append(f"As a frame: :{data.hex().upper()}{checksum:02X}, then CR LF.")
    return Steps(
        "lrc",
        f"LRC of {spaced_hex(data)}",
        "Modbus over Serial Line 1.02, 6.2.1",
        tuple(sections),
        f"LRC {checksum:02X}h, sent as the two characters '{checksum:02X}'",
        {"lrc": checksum, "characters": f"{checksum:02X}"},
    )
