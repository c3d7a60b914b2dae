"""Arguments of messages that are numbers, but no `int`: numpy has such; and rows that are not lists."""

from __future__ import annotations

from array import array
from collections.abc import Callable
from typing import Any

import pytest

from barewire.errors import EncodeError
from barewire.modbus import (
    MaskWriteRegister,
    ReadCoils,
    ReadFifoQueue,
    ReadHoldingRegisters,
    ReadInputRegisters,
    ReadWriteMultipleRegisters,
    Request,
    WriteFileRecord,
    WriteMultipleCoils,
    WriteMultipleRegisters,
    WriteSingleCoil,
    WriteSingleRegister,
)
from tests.helpers import every_case, refused


class Whole:
    """A whole number as numpy has them: it can be an index, and arithmetic with it may wrap."""

    def __init__(self, value: int) -> None:
        self.value = value

    def __index__(self) -> int:
        return self.value

    def __repr__(self) -> str:
        return f"Whole({self.value})"


class Vector:
    """A row as numpy has them: of items that are not `int`."""

    def __init__(self, *items: Any) -> None:
        self.items = items

    def __len__(self) -> int:
        return len(self.items)

    def __getitem__(self, place: int) -> Any:
        return self.items[place]


TWO: Any = Whole(2)
SEVEN: Any = Whole(7)


def any_of(value: object) -> Any:
    """Return the value, with a type that every argument takes."""
    return value


@pytest.mark.parametrize(
    ("given", "plain"),
    [
        (lambda: ReadCoils(SEVEN, TWO), ReadCoils(7, 2)),
        (lambda: ReadHoldingRegisters(SEVEN, TWO), ReadHoldingRegisters(7, 2)),
        (lambda: ReadInputRegisters(SEVEN, TWO), ReadInputRegisters(7, 2)),
        (lambda: WriteSingleCoil(SEVEN, True), WriteSingleCoil(7, True)),
        (lambda: WriteSingleRegister(SEVEN, TWO), WriteSingleRegister(7, 2)),
        (lambda: WriteMultipleCoils(SEVEN, any_of(Vector(True, 0))), WriteMultipleCoils(7, (True, False))),
        (lambda: WriteMultipleRegisters(SEVEN, any_of(Vector(TWO, 3))), WriteMultipleRegisters(7, (2, 3))),
        (lambda: WriteMultipleRegisters(7, range(3)), WriteMultipleRegisters(7, (0, 1, 2))),
        (lambda: WriteMultipleRegisters(7, array("H", [1, 2])), WriteMultipleRegisters(7, (1, 2))),
        (lambda: WriteMultipleCoils(7, array("B", [1, 0])), WriteMultipleCoils(7, (True, False))),
        (lambda: MaskWriteRegister(SEVEN, TWO, TWO), MaskWriteRegister(7, 2, 2)),
        (
            lambda: ReadWriteMultipleRegisters(SEVEN, TWO, SEVEN, any_of(Vector(TWO))),
            ReadWriteMultipleRegisters(7, 2, 7, (2,)),
        ),
        (lambda: ReadFifoQueue(SEVEN), ReadFifoQueue(7)),
        (lambda: WriteFileRecord([(1, 0, any_of(Vector(TWO)))]), WriteFileRecord([(1, 0, (2,))])),
    ],
)
def test_whole_numbers_become_plain_ones(given: Callable[[], Request[Any]], plain: Request[Any]) -> None:
    request = given()
    assert request == plain
    assert repr(request) == repr(plain), "a number of another kind is in it"
    assert request.encode() == plain.encode()


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: ReadCoils(any_of(Whole(65536)), 1), "address = Whole(65536): expected 0..65535"),
        (lambda: ReadCoils(any_of(1.0), 1), "address = 1.0: expected a whole number in 0..65535"),
        (lambda: WriteSingleRegister(0, any_of(Whole(-1))), "value = Whole(-1): expected 0..65535"),
        (
            lambda: WriteMultipleRegisters(0, any_of([Whole(70000)])),
            "register 0 of 1: Whole(70000) is not a whole number in",
        ),
        (lambda: WriteMultipleRegisters(0, any_of([1.5])), "register 0 of 1: 1.5 is not a whole number in 0..65535"),
        (
            lambda: WriteMultipleRegisters(0, any_of([[1, 2]])),
            "register 0 of 1: [1, 2] is not a whole number in 0..65535",
        ),
        (lambda: WriteMultipleCoils(0, any_of([True, [1]])), "bit 1 of 2: [1] is not True or False"),
        (lambda: WriteSingleCoil(0, any_of([1])), "value = [1]: expected True or False"),
    ],
)
def test_other_numbers_are_refused(make: Callable[[], object], text: str) -> None:
    with refused(EncodeError, text):
        make()


@every_case("row", [5, None, (number for number in [1]), map(int, "1"), {1}, frozenset([1]), {1: 1}, "1", b"1"])
@every_case(
    ("make", "text"),
    [
        (lambda row: WriteMultipleRegisters(0, row), ": expected a list of whole numbers in 0..65535"),
        (lambda row: ReadWriteMultipleRegisters(0, 1, 0, row), ": expected a list of whole numbers in 0..65535"),
        (lambda row: WriteFileRecord([(1, 0, row)]), ": expected a list of whole numbers in 0..65535"),
        (lambda row: WriteMultipleCoils(0, row), ": expected a list of True and False"),
    ],
)
def test_what_has_no_length_or_no_order_is_refused(make: Callable[[Any], object], row: Any, text: str) -> None:
    with refused(EncodeError, text):
        make(row)
