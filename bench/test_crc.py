"""CRC-16 of 1 byte to 64 KiB: our three forms, crcmod in C and in Python, fastcrc (Rust), and the tables of peers."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from functools import partial

import pytest

from barewire.rtu.crc import crc16, crc16_bit_by_bit, crc16_folded, crc16_table
from bench.race import Factory, Race, Work, entries

Crc = Callable[[bytes], int]


def _crcmod_c() -> Crc:
    import crcmod
    import crcmod._crcfunext  # without it crcmod silently uses its Python form

    return crcmod.mkCrcFun(0x18005, initCrc=0xFFFF, rev=True)


def _crcmod_python() -> Crc:
    import crcmod
    import crcmod._crcfunpy

    table = crcmod.Crc(0x18005, initCrc=0xFFFF, rev=True).table
    one = crcmod._crcfunpy._crc16r
    return lambda data: one(data, 0xFFFF, table)


def _fastcrc() -> Crc:
    from fastcrc import crc16 as fast

    return fast.modbus


def _pymodbus() -> Crc:
    from pymodbus.framer.rtu import FramerRTU

    return FramerRTU.compute_CRC


def _minimalmodbus() -> Crc:
    from minimalmodbus import _calculate_crc

    return _calculate_crc


def _tmodbus() -> Crc:
    from tmodbus.utils.crc import calculate_crc16

    return calculate_crc16


def _umodbus() -> Crc:
    from umodbus.client.serial.redundancy_check import get_crc

    return get_crc


def _modbus_tk() -> Crc:
    from modbus_tk.utils import calculate_crc

    return calculate_crc


FORMS: dict[str, Callable[[], Crc]] = {
    "byte table": lambda: crc16_table,
    "barewire": lambda: crc16,
    "barewire, folded": lambda: crc16_folded,
    "crcmod in C": _crcmod_c,
    "crcmod in Python": _crcmod_python,
    "fastcrc (Rust)": _fastcrc,
    "pymodbus": _pymodbus,
    "tmodbus": _tmodbus,
    "minimalmodbus": _minimalmodbus,
    "uModbus": _umodbus,
    "modbus-tk": _modbus_tk,
    "bit by bit": lambda: crc16_bit_by_bit,
}
LENGTHS = (6, 12, 20, 26, 27, 32, 64, 254, 1024, 4096, 65536)


def _right(found: object, right: int) -> bool:
    """Some libraries return the number, some the two bytes, some the number of the two bytes."""
    sent = right.to_bytes(2, "little")
    return found in (right, sent, int.from_bytes(sent, "big"))


def _factory(form: Callable[[], Crc], data: bytes) -> Factory:
    def make(_: ExitStack) -> Work:
        work = partial(form(), data)
        found = work()
        assert _right(found, crc16_bit_by_bit(data)), found
        return work

    return make


def _race(length: int) -> Race:
    data = bytes(i * 7 & 0xFF for i in range(length))
    # Beyond the length of a frame the bitwise definition and most tables would only make the run longer.
    slow = ("bit by bit", "uModbus", "modbus-tk", "tmodbus", "minimalmodbus")
    forms = {name: form for name, form in FORMS.items() if length < 256 or name not in slow}
    return Race("CRC-16", "one frame", length, {name: _factory(form, data) for name, form in forms.items()})


@pytest.mark.parametrize(("race", "contestant"), entries(*map(_race, LENGTHS)))
def test_crc(enter: Callable[[Race, str], None], race: Race, contestant: str) -> None:
    enter(race, contestant)
