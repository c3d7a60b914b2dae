"""Byte orders, and the conversion of bytes to registers and back."""

from __future__ import annotations

import pytest
from hypothesis import given, strategies as st

from barewire.codecs import ORDERS, from_registers, reorder, to_registers
from barewire.codecs.order import Order
from barewire.errors import EncodeError
from tests.helpers import modest, refused


@modest
@given(st.binary(max_size=16).filter(lambda data: len(data) % 2 == 0), st.sampled_from(ORDERS))
def test_each_order_is_its_own_inverse(data: bytes, order: Order) -> None:
    assert reorder(reorder(data, order), order) == data


@pytest.mark.parametrize("order", ORDERS)
def test_a_single_byte_has_no_order(order: Order) -> None:
    assert reorder(b"A", order) == b"A"


@pytest.mark.parametrize("order", ["CDAB", "BADC"])
def test_three_bytes_do_not_fill_registers(order: Order) -> None:
    with refused(EncodeError, f"3 bytes do not fill registers of 2 bytes, so they have no order {order}"):
        reorder(b"ABC", order)


def test_three_bytes_can_still_be_reversed() -> None:
    assert reorder(b"ABC", "DCBA") == b"CBA"


def test_an_unknown_order_is_refused() -> None:
    with refused(EncodeError, "byte order 'abcd': expected one of ABCD, CDAB, BADC, DCBA"):
        reorder(b"ABCD", "abcd")  # type: ignore[arg-type]


@modest
@given(st.lists(st.integers(0, 0xFFFF), max_size=125))
def test_registers_equal_the_encoded_registers(registers: list[int]) -> None:
    assert list(to_registers(from_registers(registers))) == registers


def test_an_odd_number_of_bytes_is_refused() -> None:
    with refused(EncodeError, "3 bytes do not fill registers of 2 bytes"):
        to_registers(b"ABC")


@pytest.mark.parametrize("value", [-1, 0x10000, 1.5, "7", None])
def test_a_value_outside_a_register_is_refused_with_its_place(value: object) -> None:
    with refused(EncodeError, f"register 1 of 3: {value!r} is not a whole number in 0..65535"):
        from_registers([0, value, 0])  # type: ignore[list-item]
