"""A Table with blocks at any address, read-only ranges, and functions that are called on access."""

from __future__ import annotations

import copy
import pickle
from typing import Any

import pytest

from barewire.errors import EncodeError
from barewire.modbus import (
    MaskWriteRegister,
    ModbusException,
    ReadCoils,
    ReadDiscreteInputs,
    ReadHoldingRegisters,
    ReadInputRegisters,
    ReadWriteMultipleRegisters,
    Table,
    WriteMultipleCoils,
    WriteMultipleRegisters,
    WriteSingleCoil,
    WriteSingleRegister,
)
from barewire.modbus.messages.registry import AnyRequest
from tests.helpers import every_case, refused


def declined(table: Table, request: AnyRequest) -> int:
    """Return the exception code with which the table declines."""
    with pytest.raises(ModbusException) as caught:
        table.handle(request, 0.0)
    return caught.value.code


def read(table: Table, address: int, quantity: int) -> Any:
    return table.handle(ReadHoldingRegisters(address, quantity), 0.0).registers  # type: ignore[union-attr]


# Blocks ---------------------------------------------------------------------------------------------------------------


def holes() -> Table:
    return Table(0, holding_registers={10: [1, 2], 12: [3], 100: range(4)}, coils={8: [True, False]})


def test_blocks_begin_at_their_addresses_and_adjacent_ones_are_one() -> None:
    table = holes()
    assert read(table, 10, 3) == (1, 2, 3)
    assert read(table, 100, 4) == (0, 1, 2, 3)
    assert table.holding_registers[101] == 1
    assert table.handle(ReadCoils(8, 2), 0.0).bits == (True, False)  # type: ignore[union-attr]


@every_case(
    "request_",
    [
        *(ReadHoldingRegisters(address, 1) for address in (0, 9, 13, 99, 104, 65535)),
        ReadHoldingRegisters(9, 2),
        ReadHoldingRegisters(12, 2),
        ReadHoldingRegisters(10, 95),
        WriteSingleRegister(13, 1),
        WriteMultipleRegisters(12, (1, 1)),
        MaskWriteRegister(9, 0, 0),
        ReadWriteMultipleRegisters(10, 4, 10, (1,)),
        ReadWriteMultipleRegisters(10, 1, 12, (1, 1)),
        ReadCoils(0, 1),
        ReadDiscreteInputs(0, 1),
        ReadInputRegisters(0, 1),
        WriteSingleCoil(10, True),
        WriteMultipleCoils(9, (1, 1)),
    ],
)
def test_a_hole_is_exception_02_and_nothing_is_written(request_: AnyRequest) -> None:
    table = holes()
    assert declined(table, request_) == 2
    assert read(table, 10, 3) == (1, 2, 3)


def test_the_program_cannot_use_a_hole_either() -> None:
    table = holes()
    with refused(EncodeError, "holding register 13 does not exist: expected 10..12 or 100..103"):
        table.holding_registers[13] = 1
    with refused(EncodeError, "holding registers 12..13 do not all exist: expected 10..12 or 100..103"):
        table.holding_registers[12:14] = [1, 2]
    gets: list[Any] = [lambda block: block[13], lambda block: block[12:14], lambda block: block[104]]
    for get in gets:
        with refused(IndexError, "expected 10..12 or 100..103"):
            get(table.holding_registers)
    table.holding_registers[100:102] = [7, 8]
    assert list(table.holding_registers[100:104]) == [7, 8, 2, 3]


def test_a_list_for_a_table_begins_at_the_address_of_its_only_block() -> None:
    table: Any = Table(0, holding_registers={40: [0, 0, 9]}, coils=[0, 0], input_registers={0: [1], 5: [1]})
    table.holding_registers = [1, 2]
    table.coils = [True]
    assert read(table, 40, 3) == (1, 2, 0)
    assert table.coils[0] == 1
    with refused(EncodeError, "holding registers: 4 values for 3 holding registers"):
        table.holding_registers = [1, 2, 3, 4]
    with refused(EncodeError, "input registers 0, 5: several blocks; set the values of each, such as block[0:1] = [1]"):
        table.input_registers = [1]


def test_tables_that_are_not_given_have_the_size() -> None:
    table = Table(3, holding_registers={7: [1]}, coils={})
    assert [len(table.discrete_inputs), len(table.input_registers), len(table.coils)] == [3, 3, 0]
    assert declined(table, ReadHoldingRegisters(0, 1)) == 2
    assert declined(table, ReadCoils(0, 1)) == 2
    assert table.handle(ReadInputRegisters(0, 3), 0.0).registers == (0, 0, 0)  # type: ignore[union-attr]


@every_case(
    ("options", "text"),
    [
        ({"coils": 8}, "coils = 8: expected a list of values from address 0, such as [0] * 10, or a dict of address"),
        ({"coils": {0: 8}}, "coils from 0 = 8: expected a list of True or False, such as [0] * 10"),
        ({"holding_registers": {0: 8}}, "holding registers from 0 = 8: expected a list of whole numbers in 0..65535"),
        ({"coils": {"0": [1]}}, "coils from '0': expected an address in 0..65535"),
        ({"coils": {-1: [1]}}, "coils from -1: expected an address in 0..65535"),
        ({"coils": {65535: [1, 1]}}, "coils 65535..65536: expected addresses in 0..65535"),
        ({"input_registers": {0: [1, 2], 1: [3]}}, "input registers 1..1 are given twice"),
        ({"holding_registers": {5: [1, 70000]}}, "holding register 6 = 70000: expected a whole number in 0..65535"),
        ({"coils": {5: [1, 2]}}, "coil 6 = 2: expected True or False"),
        ({"read_only": {"holding": [1]}}, "read_only = 'holding': expected coils or holding_registers; did you mean"),
        ({"read_only": {"input_registers": [1]}}, "read_only = 'input_registers': expected coils or holding_registers"),
        ({"read_only": [1]}, "read_only = [1]: expected a dict, such as {'holding_registers': range(0, 10)}"),
        ({"read_only": {"coils": 5}}, "read_only coils = 5: expected addresses, such as range(0, 10) or [3, 7]"),
        ({"read_only": {"coils": ["x"]}}, "read_only coils = 'x': expected an address in 0..65535"),
        ({"size": 9, "read_only": {"coils": [9]}}, "read_only: coil 9 does not exist: expected 0..8"),
        ({"on_write": 5}, "on_write = 5: expected a function"),
        ({"on_read": "x"}, "on_read = 'x': expected a function"),
    ],
)
def test_wrong_options_are_refused(options: dict[str, Any], text: str) -> None:
    with refused(EncodeError, text):
        Table(**options)


@pytest.mark.parametrize("copied", [copy.deepcopy, copy.copy, lambda table: pickle.loads(pickle.dumps(table))])
def test_a_copy_has_the_same_holes_and_ranges(copied: Any) -> None:
    table = copied(Table(0, holding_registers={10: [1, 2]}, read_only={"holding_registers": [11]}))
    assert read(table, 10, 2) == (1, 2)
    assert declined(table, ReadHoldingRegisters(9, 1)) == 2
    assert declined(table, WriteSingleRegister(11, 1)) == 2
    with refused(EncodeError, "holding register 9 does not exist"):
        table.holding_registers[9] = 1


# Read only ------------------------------------------------------------------------------------------------------------


def test_clients_cannot_write_what_is_read_only_and_the_program_can() -> None:
    table = Table(10, read_only={"holding_registers": range(3, 6), "coils": [0, 9]})
    requests: list[AnyRequest] = [
        WriteSingleRegister(3, 1),
        WriteMultipleRegisters(0, (1, 1, 1, 1)),
        MaskWriteRegister(5, 0, 0xFF),
        ReadWriteMultipleRegisters(0, 1, 5, (1, 1)),
        WriteSingleCoil(9, True),
        WriteMultipleCoils(8, (1, 1)),
    ]
    for request in requests:
        assert declined(table, request) == 2
    assert not any(table.holding_registers)
    assert not any(table.coils)
    table.handle(WriteMultipleRegisters(0, (1, 1, 1)), 0.0)
    table.handle(WriteMultipleCoils(1, (1,) * 8), 0.0)
    table.holding_registers[3] = 7
    assert read(table, 0, 4) == (1, 1, 1, 7)


# Functions ------------------------------------------------------------------------------------------------------------


def test_on_write_is_called_with_the_values_that_are_stored() -> None:
    seen: list[Any] = []
    table = Table(10)
    table.on_write = lambda name, address, values: seen.append(
        (name, address, values, list(table.holding_registers[:3]))
    )
    table.handle(WriteSingleRegister(1, 5), 0.0)
    table.handle(WriteMultipleRegisters(0, (1, 2)), 0.0)
    table.handle(MaskWriteRegister(2, 0, 0xFF), 0.0)
    table.handle(ReadWriteMultipleRegisters(0, 1, 0, (9,)), 0.0)
    table.handle(WriteSingleCoil(3, True), 0.0)
    table.handle(WriteMultipleCoils(4, (True, False)), 0.0)
    table.holding_registers[0] = 4  # the program itself: not a write of a client
    now = [9, 2, 0xFF]
    assert seen == [
        ("holding_registers", 1, (5,), [0, 5, 0]),
        ("holding_registers", 0, (1, 2), [1, 2, 0]),
        ("holding_registers", 2, (0xFF,), [1, 2, 0xFF]),
        ("holding_registers", 0, (9,), now),
        ("coils", 3, (True,), now),
        ("coils", 4, (True, False), now),
    ]
    assert all(type(bit) is bool for _, _, values, _ in seen[-2:] for bit in values)


def test_on_write_may_change_values_and_decline() -> None:
    table = Table(10)

    def limited(name: str, address: int, values: Any) -> None:
        if values[0] > 100:
            raise ModbusException(3)
        table.holding_registers[address] = min(values[0], 50)
        table.input_registers[0] += 1

    table.on_write = limited
    table.handle(WriteSingleRegister(0, 70), 0.0)
    assert (table.holding_registers[0], table.input_registers[0]) == (50, 1)
    assert declined(table, WriteSingleRegister(0, 200)) == 3
    assert declined(table, WriteMultipleRegisters(0, (200, 7))) == 3
    assert list(table.holding_registers[:2]) == [50, 0], "what was declined is not stored"


def test_a_write_whose_function_fails_is_not_stored() -> None:
    table = Table(10, on_write=lambda name, address, values: 1 // 0)
    for request in (WriteSingleRegister(0, 1), WriteMultipleCoils(0, (1, 1))):
        with pytest.raises(ZeroDivisionError):
            table.handle(request, 0.0)
    assert not any(table.holding_registers)
    assert not any(table.coils)


def test_on_read_is_called_before_the_values_are_read() -> None:
    seen: list[Any] = []
    table = Table(10)

    def measured(name: str, address: int, quantity: int) -> None:
        seen.append((name, address, quantity))
        if address == 9:
            raise ModbusException(6)
        if name == "input_registers":
            table.input_registers[0] = 21

    table.on_read = measured
    assert table.handle(ReadInputRegisters(0, 2), 0.0).registers == (21, 0)  # type: ignore[union-attr]
    table.handle(ReadCoils(1, 2), 0.0)
    table.handle(ReadDiscreteInputs(2, 2), 0.0)
    table.handle(ReadWriteMultipleRegisters(3, 2, 0, (1,)), 0.0)
    assert declined(table, ReadHoldingRegisters(9, 1)) == 6
    assert declined(table, ReadHoldingRegisters(9, 2)) == 2
    assert seen == [
        ("input_registers", 0, 2),
        ("coils", 1, 2),
        ("discrete_inputs", 2, 2),
        ("holding_registers", 3, 2),
        ("holding_registers", 9, 1),
    ]


def test_functions_can_be_removed_and_are_checked() -> None:
    table: Any = Table(10, on_write=print)
    table.on_write = None
    table.handle(WriteSingleRegister(0, 1), 0.0)
    with refused(EncodeError, "on_write = 5: expected a function"):
        table.on_write = 5
