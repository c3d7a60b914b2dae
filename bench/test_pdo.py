"""A default TPDO of the AZ3, from eight bytes to named values."""

from __future__ import annotations

import struct
from typing import Any

import canopen
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from barewire.canopen import Mapped, PdoMapping

DATA = bytes.fromhex("3706 E803 6400 9CFF")
NAMES = ("STATUS WORD", "CUSTOM VELOCITY", "IQ RMS", "CUSTOM POSITION")
ENTRIES = ((0x6041, "u16"), (0x2005, "i16"), (0x2002, "i16"), (0x2006, "i16"))
VALUES = dict(zip(NAMES, struct.unpack("<Hhhh", DATA)))


def by_hand() -> Any:
    reader = struct.Struct("<Hhhh")
    return lambda data: dict(zip(NAMES, reader.unpack(data)))


def ours() -> Any:
    entries = [Mapped(index, 0, 16, kind, name) for (index, kind), name in zip(ENTRIES, NAMES)]
    return PdoMapping(entries).unpack


def theirs() -> Any:
    kinds = {"u16": canopen.objectdictionary.UNSIGNED16, "i16": canopen.objectdictionary.INTEGER16}
    objects = canopen.ObjectDictionary()
    for (index, kind), name in zip(ENTRIES, NAMES):
        variable = canopen.objectdictionary.ODVariable(name, index)
        variable.data_type = kinds[kind]
        objects.add_object(variable)
    node = canopen.RemoteNode(1, objects)
    pdo = canopen.pdo.base.PdoMap(node.tpdo, canopen.objectdictionary.ODRecord("c", 0x1800), None)
    pdo.map = []
    pdo.length = 0
    for index, _ in ENTRIES:
        pdo.add_variable(index)

    def read(data: bytes) -> dict[str, Any]:
        pdo.data = bytearray(data)
        return {variable.name: variable.raw for variable in pdo.map}

    return read


@pytest.mark.parametrize("reader", ["by hand", "barewire", "canopen"])
def test_tpdo_to_named_values(benchmark: BenchmarkFixture, reader: str) -> None:
    benchmark.group = "TPDO1 of the AZ3 to named values"
    read = {"by hand": by_hand, "barewire": ours, "canopen": theirs}[reader]()
    assert benchmark(read, DATA) == VALUES
