"""The steps of CRC and LRC reach what the package computes, and what the ADXL manual prints."""

from __future__ import annotations

import re

import pytest
from hypothesis import given, settings, strategies as st

from barewire.ascii import lrc
from barewire.errors import EncodeError
from barewire.rtu.crc import TABLE, crc16
from barewire_workbench.steps import CrcView, StepTable, crc_steps, lrc_steps

thorough = settings(max_examples=60, deadline=None, derandomize=True, database=None)

# ADXL manual, "CRC calculation", frame 0207h: the register after each line, and the bit that went out.
MANUAL = """\
1111 1111 1111 1111
0000 0010
1111 1111 1111 1101
0111 1111 1111 1110 1
1010 0000 0000 0001
1101 1111 1111 1111
0110 1111 1111 1111 1
1010 0000 0000 0001
1100 1111 1111 1110
0110 0111 1111 1111 0
0011 0011 1111 1111 1
1010 0000 0000 0001
1001 0011 1111 1110
0100 1001 1111 1111 0
0010 0100 1111 1111 1
1010 0000 0000 0001
1000 0100 1111 1110
0100 0010 0111 1111 0
0010 0001 0011 1111 1
1010 0000 0000 0001
0000 0111
1000 0001 0011 1001
0100 0000 1001 1100 1
1010 0000 0000 0001
1110 0000 1001 1101
0111 0000 0100 1110 1
1010 0000 0000 0001
1101 0000 0100 1111
0110 1000 0010 0111 1
1010 0000 0000 0001
1100 1000 0010 0110
0110 0100 0001 0011 0
0010 0100 0000 1001 1
1010 0000 0000 0001
1001 0010 0000 1000
0100 1001 0000 0100 0
0010 0100 1000 0010 0
0001 0010 0100 0001 0
"""


def table_of(data: bytes, view: CrcView) -> StepTable:
    (table,) = crc_steps(data, [view]).tables
    return table


def registers(data: bytes) -> list[str]:
    return [f"{register.strip()} {out}".strip() for _, _, register, out, _ in table_of(data, "register").rows]


def test_the_register_view_is_the_table_of_the_manual() -> None:
    """But for two places: the manual leaves out the last xor of byte 0, and prints 2409h where its own next line, 9208h
    after the polynomial, needs 3209h."""
    ours = registers(bytes.fromhex("0207"))
    assert ours.pop(20) == "1000 0001 0011 1110"
    printed = MANUAL.splitlines()
    assert printed[32] == "0010 0100 0000 1001 1"
    assert 0x3209 ^ 0xA001 == 0x9208
    printed[32] = "0011 0010 0000 1001 1"
    assert ours == printed


@given(st.binary(min_size=1, max_size=40))
@thorough
def test_the_three_views_end_with_the_crc_of_the_package(data: bytes) -> None:
    crc = crc16(data)
    assert table_of(data, "register").rows[-1][4] == f"{crc:04X}h"
    assert table_of(data, "table").rows[-1][4].endswith(f"= {crc:04X}h")
    steps = crc_steps(data)
    assert steps.values == {"crc": crc, "wire": f"{crc & 255:02X} {crc >> 8:02X}"}
    assert steps.result.endswith(str(steps.values["wire"]))


@given(st.binary(min_size=1, max_size=8))
@thorough
def test_the_division_ends_with_the_crc_of_the_package(data: bytes) -> None:
    crc = crc16(data)
    remainder = table_of(data, "polynomial").rows[-1][1].strip()
    assert [int(remainder[place : place + 8][::-1], 2) for place in (0, 8)] == [crc & 255, crc >> 8]
    text = crc_steps(data, ["polynomial"]).sections[-2]
    assert f"bytes on the wire, {crc & 255:02X} {crc >> 8:02X}." in str(text)


@given(st.binary(min_size=1, max_size=8))
@thorough
def test_each_row_of_the_division_is_the_row_above_xor_the_divisor(data: bytes) -> None:
    width = 8 * len(data) + 16
    rest = 0
    for name, bits in table_of(data, "polynomial").rows[1:]:
        number = int(bits.ljust(width, "0").replace(" ", "0"), 2)
        if name.startswith("divisor"):
            assert bits.strip() == "11000000000000101"
            rest ^= number
        elif name == "first 16 bits inverted":
            rest = number
        else:
            assert number == rest


@given(st.binary(min_size=1, max_size=12))
@thorough
def test_the_table_view_looks_up_the_table_of_the_package(data: bytes) -> None:
    for _, _, place, number, _ in table_of(data, "table").rows:
        index = int(place.rpartition("= ")[2].rstrip("h"), 16)
        assert number == f"{TABLE[index]:04X}h"


def test_a_frame_with_its_crc_leaves_zero() -> None:
    steps = crc_steps(bytes.fromhex("02074112"))
    assert steps.values["crc"] == 0
    assert "41 12, are the CRC of those before them" in str(steps.sections[-1])
    assert not any("are the CRC of those" in str(section) for section in crc_steps(b"\x02\x07").sections)


def test_views_can_be_chosen() -> None:
    assert len(crc_steps(b"12", ["table"]).tables) == len(crc_steps(b"12", ["table", "table"]).tables) == 1
    assert len(crc_steps(b"12", ["register", "table"]).tables) == 2
    assert len(crc_steps(b"12").tables) == 3
    assert "has room for 8 bytes; these are 9" in str(crc_steps(bytes(9)).sections[-2])


@pytest.mark.parametrize(("size", "text"), [(0, "0 bytes: expected 1..256"), (257, "257 bytes: expected 1..256")])
def test_a_wrong_number_of_bytes_is_refused(size: int, text: str) -> None:
    with pytest.raises(EncodeError, match=re.escape(text)):
        crc_steps(bytes(size))
    with pytest.raises(EncodeError, match="expected 1"):
        lrc_steps(bytes(size))


def test_a_long_division_is_refused() -> None:
    with pytest.raises(EncodeError, match="9 bytes: the polynomial view has room for 8"):
        crc_steps(bytes(9), ["polynomial"])


# LRC --------------------------------------------------------------------------------------------------------------


@given(st.binary(min_size=1, max_size=255))
@thorough
def test_the_lrc_is_that_of_the_package(data: bytes) -> None:
    steps = lrc_steps(data)
    sums, final = steps.tables
    assert sums.rows[-1][3] == str(sum(data))
    assert final.rows[-1][1] == f"{lrc(data):02X}h"
    assert steps.values == {"lrc": lrc(data), "characters": f"{lrc(data):02X}"}
    for _, digits, bits in final.rows:
        assert int(bits.replace(" ", ""), 2) == int(digits.rstrip("h"), 16)


def test_the_lrc_of_the_manual_is_f3_and_not_f5() -> None:
    """The ADXL manual inverts 0000 1101 to 1111 0010, adds 1, and prints F5h; it is F3h."""
    steps = lrc_steps(bytes.fromhex("0104000008"))
    assert [row[2] for row in steps.tables[1].rows] == ["0000 1101", "0000 1101", "1111 0010", "1111 0011"]
    assert steps.values["lrc"] == 0xF3


def test_a_message_with_its_lrc_sums_to_zero() -> None:
    steps = lrc_steps(bytes.fromhex("01040FB1000239"))
    assert steps.values["lrc"] == 0
    assert "39h, is the LRC of those before it" in str(steps.sections[-1])
