"""A default TPDO of the AZ3: eight bytes to four named values, and back."""

from __future__ import annotations

import struct
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

import pytest

from barewire.canopen import MappedObject, PdoMapping
from bench.race import Factory, Race, Work, entries

DATA = bytes.fromhex("3706 E803 6400 9CFF")
NAMES = ("STATUS WORD", "CUSTOM VELOCITY", "IQ RMS", "CUSTOM POSITION")
ENTRIES = ((0x6041, "u16"), (0x2005, "i16"), (0x2002, "i16"), (0x2006, "i16"))
VALUES = dict(zip(NAMES, struct.unpack("<Hhhh", DATA)))


def _ours() -> PdoMapping:
    return PdoMapping([MappedObject(index, 0, 16, kind, name) for (index, kind), name in zip(ENTRIES, NAMES)])


def _theirs() -> Any:
    import canopen

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
    return pdo


def read_by_hand(_: ExitStack) -> Work:
    reader = struct.Struct("<Hhhh")
    return lambda: dict(zip(NAMES, reader.unpack(DATA)))


def read_ours(_: ExitStack) -> Work:
    unpack = _ours().unpack
    return lambda: unpack(DATA)


def read_theirs(_: ExitStack) -> Work:
    pdo = _theirs()

    def read() -> dict[str, Any]:
        pdo.data = bytearray(DATA)
        return {variable.name: variable.raw for variable in pdo.map}

    return read


def write_by_hand(_: ExitStack) -> Work:
    writer = struct.Struct("<Hhhh")
    return lambda: writer.pack(*[VALUES[name] for name in NAMES])


def write_ours(_: ExitStack) -> Work:
    pack = _ours().pack
    return lambda: pack(VALUES)


def write_theirs(_: ExitStack) -> Work:
    pdo = _theirs()

    def write() -> bytes:
        for variable in pdo.map:
            variable.raw = VALUES[variable.name]
        return bytes(pdo.data)

    return write


READING: dict[str, Factory] = {"by hand": read_by_hand, "barewire": read_ours, "canopen": read_theirs}
WRITING: dict[str, Factory] = {"by hand": write_by_hand, "barewire": write_ours, "canopen": write_theirs}
RACES = (
    Race("PDO", "TPDO of the AZ3 to named values", 4, READING, VALUES),
    Race("PDO", "named values to the same PDO", 4, WRITING, DATA),
)


@pytest.mark.parametrize(("race", "contestant"), entries(*RACES))
def test_pdo(enter: Callable[[Race, str], None], race: Race, contestant: str) -> None:
    enter(race, contestant)
