"""Wrong values of requests: one EncodeError that names the field, the value and what was expected."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import FrozenInstanceError
from typing import Any

import pytest

from barewire.errors import EncodeError
from barewire.modbus import (
    ReadCoils,
    ReadHoldingRegisters,
    ReadWriteMultipleRegisters,
    WriteFileRecord,
    WriteMultipleCoils,
    WriteMultipleRegisters,
    WriteSingleRegister,
)
from tests.helpers import every_case, refused

WITH_REGISTERS: list[Callable[[Any], Any]] = [
    lambda values: WriteMultipleRegisters(0, values),
    lambda values: ReadWriteMultipleRegisters(0, 1, 0, values),
    lambda values: WriteFileRecord(((1, 0, values),)),
]


@every_case("values", [b"abc", bytearray(b"abc"), "abc", 1, None, 1.5])
@every_case("message", WITH_REGISTERS)
def test_registers_are_a_list_of_numbers(message: Callable[[Any], Any], values: Any) -> None:
    with refused(EncodeError, f"registers = {values!r}: expected a list of whole numbers in 0..65535"):
        message(values)


@pytest.mark.parametrize("values", [b"\1\0", "ab", 1, None])
def test_coils_are_a_list_of_bits(values: Any) -> None:
    with refused(EncodeError, f"bits = {values!r}: expected a list of True and False"):
        WriteMultipleCoils(0, values)


@pytest.mark.parametrize("message", WITH_REGISTERS)
def test_lists_tuples_and_ranges_are_registers(message: Callable[[Any], Any]) -> None:
    assert message([5, 6]).encode() == message((5, 6)).encode() == message(range(5, 7)).encode()


@pytest.mark.parametrize("value", ["0", 1.0, None, "x"])
def test_numbers_are_whole_numbers(value: Any) -> None:
    with refused(EncodeError, f"address = {value!r}: expected a whole number in 0..65535"):
        ReadHoldingRegisters(value, 1)
    with refused(EncodeError, f"quantity = {value!r}: expected a whole number in 1..2000"):
        ReadCoils(0, value)
    with refused(EncodeError, f"value = {value!r}: expected a whole number in 0..65535"):
        WriteSingleRegister(0, value)


def test_a_whole_number_out_of_range_is_refused_with_the_range() -> None:
    with refused(EncodeError, "address = 65536: expected 0..65535"):
        ReadHoldingRegisters(65536, 1)


def test_no_attribute_of_a_message_can_be_set_or_deleted() -> None:
    message = ReadHoldingRegisters(0, 2)
    for name in ("address", "adress"):
        with pytest.raises(FrozenInstanceError, match=f"cannot assign to field '{name}'"):
            setattr(message, name, 5)
        with pytest.raises(FrozenInstanceError, match=f"cannot delete field '{name}'"):
            delattr(message, name)
