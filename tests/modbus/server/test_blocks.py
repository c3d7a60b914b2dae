"""The four blocks of a Table: what cannot be a coil or a register is refused when it is assigned."""

from __future__ import annotations

import copy
import pickle
from array import array
from typing import Any

import pytest

from barewire.errors import EncodeError
from barewire.modbus import ReadCoils, ReadHoldingRegisters, Table, WriteMultipleCoils, WriteMultipleRegisters
from tests.helpers import refused


@pytest.mark.parametrize("value", [70000, -1, "x", 1.5, None, [1], b"\1"])
@pytest.mark.parametrize(
    ("block", "name"), [("holding_registers", "holding register"), ("input_registers", "input register")]
)
def test_a_register_is_checked_when_it_is_set(block: str, name: str, value: Any) -> None:
    registers = getattr(Table(10), block)
    with refused(EncodeError, f"{name} 3 = {value!r}: expected a whole number in 0..65535"):
        registers[3] = value
    with refused(EncodeError, f"{name} 3 = {value!r}: expected a whole number in 0..65535"):
        registers[2:4] = [1, value]
    with refused(EncodeError, f"{name} 9 = {value!r}: expected a whole number in 0..65535"):
        registers[-1] = value
    assert not any(registers)


@pytest.mark.parametrize("value", [2, -1, "x", 1.5, None, 255])
@pytest.mark.parametrize(("block", "name"), [("coils", "coil"), ("discrete_inputs", "discrete input")])
def test_a_bit_is_checked_when_it_is_set(block: str, name: str, value: Any) -> None:
    bits = getattr(Table(10), block)
    with refused(EncodeError, f"{name} 0 = {value!r}: expected True or False"):
        bits[0] = value
    with refused(EncodeError, f"{name} 6 = {value!r}: expected True or False"):
        bits[2:8:2] = [True, 0, value]
    assert not any(bits)


def test_good_values_are_set() -> None:
    table = Table(6)
    table.holding_registers[0], table.holding_registers[-1] = 65535, True
    table.holding_registers[1:3] = (1, 2)
    table.holding_registers[3:5] = array("H", [3, 4])
    assert list(table.holding_registers) == [65535, 1, 2, 3, 4, 1]
    table.coils[0], table.coils[1:3] = True, b"\1\1"
    table.coils[4:6] = (False, True)
    assert list(table.coils) == [1, 1, 1, 0, 0, 1]


@pytest.mark.parametrize("values", [[1], [1, 2, 3], []])
def test_a_slice_keeps_its_length(values: list[int]) -> None:
    table = Table(6)
    with refused(EncodeError, f"holding registers 2..3: {len(values)} values for 2 holding registers"):
        table.holding_registers[2:4] = values
    with refused(EncodeError, f"coils 2..3: {len(values)} values for 2 coils"):
        table.coils[2:4] = values
    assert (len(table.holding_registers), len(table.coils)) == (6, 6)


@pytest.mark.parametrize("values", [5, "ab", b"ab", None])
def test_a_slice_of_registers_takes_a_list_of_numbers(values: Any) -> None:
    table: Any = Table(6)
    with refused(EncodeError, f"holding registers 2..3 = {values!r}: expected a list of whole numbers in 0..65535"):
        table.holding_registers[2:4] = values
    with refused(EncodeError, f"holding registers = {values!r}: expected a list of whole numbers in 0..65535"):
        table.holding_registers = values


def test_an_assigned_list_fills_the_block_from_its_beginning() -> None:
    table: Any = Table(6)
    table.holding_registers[5] = 9
    table.holding_registers = [1, 2]
    table.coils = (True, False, True)
    assert list(table.holding_registers) == [1, 2, 0, 0, 0, 0]
    assert table.handle(ReadHoldingRegisters(0, 6), 0.0).registers == (1, 2, 0, 0, 0, 0)
    assert table.handle(ReadCoils(0, 6), 0.0).bits == (True, False, True, False, False, False)
    with refused(EncodeError, "holding register 0 = 70000: expected a whole number in 0..65535"):
        table.holding_registers = [70000, "x"]
    with refused(EncodeError, "coil 1 = 2: expected True or False"):
        table.coils = [1, 2]
    with refused(EncodeError, "input registers: 7 values for 6 input registers"):
        table.input_registers = range(7)
    with refused(EncodeError, "holding register 1 = 70000"):
        table.holding_registers[1] = 70000  # the new block checks as the first one did
    assert list(table.holding_registers) == [1, 2, 0, 0, 0, 0]


@pytest.mark.parametrize("copied", [copy.deepcopy, copy.copy, lambda table: pickle.loads(pickle.dumps(table))])
def test_the_blocks_of_a_copied_table_check_too(copied: Any) -> None:
    table: Any = Table(4)
    table.holding_registers[1] = 7
    other = copied(table)
    assert list(other.holding_registers) == [0, 7, 0, 0]
    with refused(EncodeError, "holding register 1 = 70000"):
        other.holding_registers[1] = 70000
    with refused(EncodeError, "coil 1 = 2"):
        other.coils[1] = 2


def test_writes_of_clients_are_stored() -> None:
    table = Table(200)
    table.handle(WriteMultipleRegisters(1, tuple(range(123))), 0.0)
    table.handle(WriteMultipleCoils(3, (True, False, True)), 0.0)
    assert list(table.holding_registers[1:124]) == list(range(123))
    assert list(table.coils[:7]) == [0, 0, 0, 1, 0, 1, 0]


@pytest.mark.parametrize(
    "resize",
    [
        lambda block: block.append(1),
        lambda block: block.extend([1]),
        lambda block: block.insert(0, 1),
        lambda block: block.pop(),
        lambda block: block.remove(0),
        lambda block: block.__iadd__([1]),
        lambda block: block.__imul__(2),
        lambda block: block.__delitem__(0),
        lambda block: block.__delitem__(slice(1, 3)),
    ],
)
def test_a_block_keeps_its_size(resize: Any) -> None:
    table = Table(6)
    for block, name in ((table.holding_registers, "holding registers"), (table.coils, "coils")):
        with refused(
            EncodeError, f"{name}: a block keeps its size; set values in place, such as block[0:3] = [1, 0, 1]"
        ):
            resize(block)
        assert len(block) == 6


@pytest.mark.parametrize("move", ["reverse", "byteswap"])
def test_values_stay_at_their_addresses(move: str) -> None:
    table = Table(0, holding_registers={10: [1, 2], 20: [3]}, coils={1: [True]})
    for block, name in ((table.holding_registers, "holding registers"), (table.coils, "coils")):
        before = block.stored(slice(None))
        with refused(EncodeError, f"{name}: values keep their addresses; set them, such as block[0:3] = [1, 0, 1]"):
            getattr(block, move)()
        assert block.stored(slice(None)) == before


def test_a_block_of_another_table_is_copied() -> None:
    one, other = Table(4), Table(4)
    one.holding_registers[1] = 7
    block = other.holding_registers
    other.holding_registers = one.holding_registers
    one.holding_registers[1] = 8
    assert other.holding_registers is block
    assert list(block) == [0, 7, 0, 0]
    with refused(EncodeError, "holding registers: 5 values for 4 holding registers"):
        other.holding_registers = Table(5).holding_registers
    with refused(EncodeError, "expected a list of whole numbers in 0..65535"):
        other.holding_registers = one.coils  # type: ignore[assignment]
    one.input_registers[0] = 2
    with refused(EncodeError, "coil 0 = 2: expected True or False"):
        other.coils = one.input_registers  # type: ignore[assignment]


def test_a_block_is_shown_in_one_line() -> None:
    assert repr(Table().coils) == "<coils 0..65535>"
    assert repr(Table().coils[:3]) == repr(Table().holding_registers[:3]) == "[0, 0, 0]"
    assert str(Table().coils) == "<coils 0..65535>"
    assert f"{Table(4).holding_registers}" == "<holding registers 0..3>"
    assert repr(Table(0).input_registers) == "<input registers: none>"
    assert repr(Table(holding_registers={7: [1], 100: [1, 2]}).holding_registers) == "<holding registers 7, 100..101>"


class Truth:
    """A bit that is no index, as the bool of numpy: it is equal to True, and has its hash."""

    def __hash__(self) -> int:
        return hash(True)

    def __eq__(self, other: object) -> bool:
        return other == 1


def test_bits_and_registers_may_be_of_another_type() -> None:
    table = Table(coils=[Truth(), 0])  # type: ignore[list-item]
    table.discrete_inputs[1] = Truth()
    table.discrete_inputs[2:4] = [Truth(), False]
    assert (list(table.coils), list(table.discrete_inputs[:4])) == ([1, 0], [0, 1, 1, 0])
    table.coils = [0, Truth()]  # type: ignore[assignment]
    assert list(table.coils) == [0, 1]
