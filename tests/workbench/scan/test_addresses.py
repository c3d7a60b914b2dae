"""The addresses that exist are found, whatever they are, by reading."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import pytest
from hypothesis import given, strategies as st

from barewire.errors import NoAnswer, PortError
from barewire.modbus.exceptions import ModbusException
from barewire_workbench.scan.addresses import AddressRange, find_addresses
from tests.helpers import modest


def unit_with(existing: set[int], asked: list[int], code: int = 2) -> Callable[[int, int], None]:
    def read(address: int, count: int) -> None:
        asked.append(address)
        if not set(range(address, address + count)) <= existing:
            raise ModbusException(code)

    return read


@modest
@given(st.sets(st.integers(0, 300)), st.integers(1, 125), st.sampled_from([2, 3]))
def test_exactly_the_existing_addresses_are_found(existing: set[int], limit: int, code: int) -> None:
    asked: list[int] = []
    found = list(find_addresses(unit_with(existing, asked, code), 0, 300, limit=limit))
    assert {address for piece in found for address in range(piece.first, piece.last + 1)} == existing
    assert all(before.last + 1 < after.first for before, after in pairwise(found))
    assert len(asked) <= 2 * 301


def test_an_area_that_exists_takes_one_request_for_each_block() -> None:
    asked: list[int] = []
    assert list(find_addresses(unit_with(set(range(1000)), asked), 0, 999, limit=125)) == [AddressRange(0, 999)]
    assert asked == list(range(0, 1000, 125))


def test_another_exception_is_shown_with_its_address() -> None:
    def read(address: int, count: int) -> None:
        if address <= 5 < address + count:
            raise ModbusException(4)

    found = list(map(str, find_addresses(read, 0, 9, limit=125)))
    assert found == ["0-4", "5: exception 04", "6-9"]


def test_a_block_that_is_ignored_is_halved_and_a_silent_unit_given_up() -> None:
    def ignores_long_ones(address: int, count: int) -> None:
        if count > 8:
            raise NoAnswer("silence")

    assert list(map(str, find_addresses(ignores_long_ones, 0, 15, limit=16))) == ["0-15"]

    asked: list[int] = []

    def silent(address: int, count: int) -> None:
        asked.append(address)
        raise NoAnswer("silence")

    with pytest.raises(NoAnswer):
        list(find_addresses(silent, 0, 999, limit=125))
    assert len(asked) == 3


@pytest.mark.parametrize("error", [NoAnswer("silence"), PortError("unplugged"), KeyboardInterrupt()])
def test_what_was_found_before_an_error_is_not_lost(error: BaseException) -> None:
    def read(address: int, count: int) -> None:
        if address + count > 10:
            raise error

    found: list[str] = []
    with pytest.raises(type(error)):
        found.extend(map(str, find_addresses(read, 0, 39, limit=10)))
    assert found == ["0-9"]
