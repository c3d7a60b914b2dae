"""The steps from bytes to a number reach what the codecs decode."""

from __future__ import annotations

import math
import re
from fractions import Fraction

import pytest
from hypothesis import given, settings, strategies as st

from barewire.codecs import ORDERS, codec
from barewire.codecs.order import Order
from barewire.errors import DecodeError, EncodeError
from barewire_workbench.steps import NUMBER_TYPES, number_from_bytes_steps, number_steps

thorough = settings(max_examples=150, deadline=None, derandomize=True, database=None)


@given(st.sampled_from(NUMBER_TYPES), st.sampled_from(ORDERS), st.binary(min_size=8, max_size=8))
@thorough
def test_the_number_is_that_of_the_codec(name: str, order: Order, eight: bytes) -> None:
    coder = codec(name, order)
    data = eight[: coder.size]
    steps = number_from_bytes_steps(data, name, order)
    value = coder.decode(data)
    assert steps.values["value"] == value or math.isnan(value)
    assert steps.result.endswith(f" is {value!r}")
    if coder.size > 1:
        (marked,) = [row for row in steps.tables[-1].rows if row[-1]]
        assert marked[2] == repr(value)
    if coder.is_float and math.isfinite(value):
        told = next(text for text in steps.sections if str(text).startswith("The number is"))
        exact = re.fullmatch(r".* = (\S+?)[.]", str(told))
        assert exact is not None
        if "..." in exact[1]:
            assert float(exact[1].replace("...", "")) == pytest.approx(value, rel=1e-12, abs=0)
        else:
            assert Fraction(exact[1]) == Fraction(value)
    if not coder.is_float:
        told = steps.sections[-3 if coder.size > 1 else -1]
        assert re.search(rf"(= ){re.escape(str(value))}[.]", str(told))


@given(st.floats(width=32, allow_nan=False, allow_infinity=False), st.sampled_from(ORDERS))
@thorough
def test_there_and_back(number: float, order: Order) -> None:
    sent = bytes.fromhex(str(number_steps(repr(number), "f32", order).values["bytes"]))
    assert number_from_bytes_steps(sent, "f32", order).values["value"] == number


def test_all_orders_are_shown() -> None:
    steps = number_from_bytes_steps(bytes.fromhex("CCCD3F8C"), "f32", "CDAB")
    assert [row[0] for row in steps.tables[-1].rows] == list(ORDERS)
    assert steps.tables[-1].rows[1] == ("CDAB", "3F 8C CC CD", "1.100000023841858", "<--")
    assert [row[0] for row in number_from_bytes_steps(b"12", "u16", "BADC").tables[-1].rows] == ["AB", "BA"]
    assert not number_from_bytes_steps(b"1", "u8").tables


@pytest.mark.parametrize(
    ("digits", "text"),
    [
        ("7F800000", "a fraction of 0 mean infinity"),
        ("7FC00000", "a fraction other than 0 mean NaN"),
        ("80000000", "The number is -0 x 2^-126 = -0."),
        ("00000001", "no 1 in front of the fraction: 1 / 2^23"),
        ("3F8CCCCD", "In front of the fraction stands a 1: 1 + 838861 / 2^23"),
    ],
)
def test_kinds_of_floats(digits: str, text: str) -> None:
    assert text in " ".join(map(str, number_from_bytes_steps(bytes.fromhex(digits)).sections))


def test_what_cannot_be_read_is_refused() -> None:
    for size in (0, 2, 5):
        with pytest.raises(DecodeError, match="but f32 has 4"):
            number_from_bytes_steps(bytes(size))
    with pytest.raises(EncodeError, match="expected one of f32"):
        number_from_bytes_steps(bytes(4), "f16")
