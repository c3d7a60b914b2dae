"""The LRC of Modbus ASCII: the sum of the bytes, and its two's complement."""

from __future__ import annotations

from barewire.ascii.frame import lrc
from barewire_workbench.steps.model import Steps, StepSection, StepTable, check_length, grouped_bits, spaced_hex

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
        "Add the bytes of the message: the bytes, not the characters that carry them, and without the colon, CR "
        "and LF.",
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
