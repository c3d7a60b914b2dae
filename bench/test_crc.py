"""CRC-16: our three forms, crcmod in C and in Python, and pymodbus's table, over the lengths that occur."""

from __future__ import annotations

from collections.abc import Callable

import crcmod
import crcmod._crcfunpy
import pytest
from pymodbus.framer.rtu import FramerRTU
from pytest_benchmark.fixture import BenchmarkFixture

from barewire.rtu.crc import crc16, crc16_bit_by_bit, crc16_folded, crc16_table

in_c = crcmod.mkCrcFun(0x18005, initCrc=0xFFFF, rev=True)


_crcmod = crcmod.Crc(0x18005, initCrc=0xFFFF, rev=True)


def in_python(data: bytes) -> int:
    """crcmod's own loop in Python, for machines where its C extension is not built."""
    value: int = crcmod._crcfunpy._crc16r(data, 0xFFFF, _crcmod.table)
    return value


FORMS: dict[str, Callable[[bytes], int]] = {
    "barewire crc16": crc16,
    "barewire table": crc16_table,
    "barewire folded": crc16_folded,
    "barewire bit by bit": crc16_bit_by_bit,
    "crcmod in C": in_c,
    "crcmod in Python": in_python,
    "pymodbus": FramerRTU.compute_CRC,
}


LENGTHS = (6, 20, 64, 254, 4096, 65536)
# The definition is there to be read: beyond a frame it would only cost time.
CASES = [(form, length) for length in LENGTHS for form in FORMS if length < 256 or form != "barewire bit by bit"]


@pytest.mark.parametrize(("form", "length"), CASES)
def test_crc(benchmark: BenchmarkFixture, form: str, length: int) -> None:
    benchmark.group = f"CRC-16 of {length} bytes"
    data = bytes(i * 7 & 0xFF for i in range(length))
    right = in_c(data)
    # pymodbus gives the two bytes the other way round.
    assert benchmark(FORMS[form], data) in (right, right >> 8 | (right & 0xFF) << 8)
