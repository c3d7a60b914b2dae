"""Registers of a planned block to typed values with names: 1 to 60 values of 32 bits, with a scale of a tenth.

pymodbus has names for types, but neither names nor scales for values, so it takes part with its converter and a
division.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from contextlib import ExitStack
from fractions import Fraction

import pytest

from barewire.devices.modbus_access import Member, PlannedRead, block_decoder
from barewire.devices.parameter import ModbusAt, Parameter
from bench.race import Factory, Race, Work, entries


def _race(count: int) -> Race:
    names = [f"value {place}" for place in range(count)]
    raw = [70_001 * place for place in range(count)]
    content = struct.unpack(f">{2 * count}H", struct.pack(f">{count}I", *raw))
    parameters = [
        Parameter(name, "u32", scale=Fraction(1, 10), modbus=ModbusAt("holding", 2 * place, 2))
        for place, name in enumerate(names)
    ]
    members = tuple(Member(parameter, 2 * place) for place, parameter in enumerate(parameters))

    def by_hand(_: ExitStack) -> Work:
        words, values = struct.Struct(f">{2 * count}H"), struct.Struct(f">{count}I")
        return lambda: {name: number / 10 for name, number in zip(names, values.unpack(words.pack(*content)))}

    def barewire(_: ExitStack) -> Work:
        decode = block_decoder(PlannedRead("holding", 0, 2 * count, members, 3))
        return lambda: dict(zip(names, decode(content)))

    def one_by_one(_: ExitStack) -> Work:
        pairs = [(parameter, 2 * place) for place, parameter in enumerate(parameters)]
        return lambda: {parameter.name: parameter.from_registers(content[at : at + 2]) for parameter, at in pairs}

    def pymodbus(_: ExitStack) -> Work:
        from pymodbus.client.mixin import ModbusClientMixin as Mixin

        registers = list(content)  # a list, as in its answers

        def read() -> dict[str, float]:
            found = Mixin.convert_from_registers(registers, Mixin.DATATYPE.UINT32)
            row = found if isinstance(found, list) else [found]
            return {name: number / 10 for name, number in zip(names, row)}

        return read

    contestants: dict[str, Factory] = {
        "by hand": by_hand,
        "barewire": barewire,
        "barewire, one by one": one_by_one,
        "pymodbus": pymodbus,
    }
    return Race("Block", "32-bit values with names", count, contestants, dict(zip(names, [one / 10 for one in raw])))


@pytest.mark.parametrize(("race", "contestant"), entries(*map(_race, (1, 5, 20, 60))))
def test_block(enter: Callable[[Race, str], None], race: Race, contestant: str) -> None:
    enter(race, contestant)
