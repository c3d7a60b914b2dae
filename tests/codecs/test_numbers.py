"""Numbers of every width in every order: both limits, and the errors that give them."""

from __future__ import annotations

import math
import struct
from itertools import product

import pytest
from hypothesis import given, strategies as st

from barewire.codecs import ORDERS, Number, codec
from barewire.codecs.order import Order
from barewire.errors import DecodeError, EncodeError
from tests.helpers import every_case, modest, refused, unhex

INTEGERS = [f"{sign}{bits}" for sign in "ui" for bits in range(8, 65, 8)]
ALL = [*INTEGERS, "f32", "f64"]
MIXED = ("CDAB", "BADC")


def whole_registers(name: str) -> bool:
    """Whether the mixed orders exist for this type: they cut a number into registers of two bytes."""
    return int(name[1:]) % 16 == 0 or name[1:] == "8"


TYPES_AND_ORDERS = [(n, o) for n, o in product(ALL, ORDERS) if o not in MIXED or whole_registers(n)]


@every_case(("name", "order"), TYPES_AND_ORDERS)
def test_both_limits_are_encoded_and_decoded(name: str, order: Order) -> None:
    number = codec(name, order)
    for value in (number.minimum, 0, 1, number.maximum):
        data = number.encode(value)
        assert len(data) == number.size
        assert number.decode(data) == value


@every_case(("name", "order"), [(n, o) for n, o in TYPES_AND_ORDERS if n in INTEGERS])
def test_a_value_beyond_a_limit_is_refused_with_the_limits(name: str, order: Order) -> None:
    number = codec(name, order)
    for value in (number.minimum - 1, number.maximum + 1):
        text = f"{value} does not fit {name}: expected {number.minimum}..{number.maximum}"
        with refused(EncodeError, text):
            number.encode(value)


@every_case("name", INTEGERS)
def test_limits_are_those_of_twos_complement(name: str) -> None:
    number, bits = codec(name), int(name[1:])
    low, high = (0, 2**bits - 1) if name[0] == "u" else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    assert (number.minimum, number.maximum) == (low, high)


@every_case(
    ("name", "order", "value", "wire"),
    [
        ("u32", "ABCD", 0x0A0B0C0D, "0A 0B 0C 0D"),
        ("u32", "CDAB", 0x0A0B0C0D, "0C 0D 0A 0B"),
        ("u32", "BADC", 0x0A0B0C0D, "0B 0A 0D 0C"),
        ("u32", "DCBA", 0x0A0B0C0D, "0D 0C 0B 0A"),
        ("u64", "CDAB", 0x0102030405060708, "07 08 05 06 03 04 01 02"),
        ("u64", "BADC", 0x0102030405060708, "02 01 04 03 06 05 08 07"),
        ("u48", "CDAB", 0x010203040506, "05 06 03 04 01 02"),
        ("u16", "CDAB", 0x0102, "01 02"),
        ("u16", "BADC", 0x0102, "02 01"),
        ("u24", "DCBA", 0x010203, "03 02 01"),
        ("i24", "ABCD", -2, "FF FF FE"),
        ("i40", "DCBA", -2, "FE FF FF FF FF"),
        ("i8", "BADC", -1, "FF"),
        ("f32", "ABCD", 1.1, "3F 8C CC CD"),
        ("f32", "CDAB", 1.1, "CC CD 3F 8C"),
        ("f64", "BADC", 1.0, "F0 3F 00 00 00 00 00 00"),
    ],
)
def test_each_order_places_the_bytes_as_its_name_says(name: str, order: Order, value: float, wire: str) -> None:
    assert codec(name, order).encode(value) == unhex(wire)
    assert codec(name, order).decode(unhex(wire)) == pytest.approx(value)


@pytest.mark.parametrize("name", ["f32", "f64"])
@pytest.mark.parametrize("order", ORDERS)
def test_infinity_and_not_a_number_are_values_of_floats(name: str, order: Order) -> None:
    number = codec(name, order)
    assert number.decode(number.encode(math.inf)) == math.inf
    assert number.decode(number.encode(-math.inf)) == -math.inf
    assert math.isnan(number.decode(number.encode(math.nan)))
    assert math.copysign(1, number.decode(number.encode(-0.0))) == -1


@pytest.mark.parametrize("value", [3.5e38, -3.5e38, 3.4028235677973366e38, 1e300, 10**400])
def test_a_number_that_rounds_beyond_the_largest_float_is_refused(value: float) -> None:
    with refused(EncodeError, "does not fit f32: at most ±3.40282e+38"):
        codec("f32").encode(value)


@pytest.mark.parametrize("value", [3.4028234663852886e38, 3.4028235e38, 3.402823466e38])
def test_the_largest_float_may_be_written_with_fewer_digits(value: float) -> None:
    assert codec("f32").encode(value) == unhex("7F 7F FF FF")


def test_an_integer_too_large_for_any_float_is_refused() -> None:
    with refused(EncodeError, "does not fit f64"):
        codec("f64").encode(10**400)


@pytest.mark.parametrize("value", [1.5, math.nan, math.inf, "7", b"\x07", None, [7], 1j])
def test_an_integer_takes_whole_numbers_only(value: object) -> None:
    with refused(EncodeError, f"{value!r} is not a whole number for u16"):
        codec("u16").encode(value)  # type: ignore[arg-type]


@pytest.mark.parametrize("value", ["1.0", b"1", None, [1.0], 1j])
def test_a_float_takes_numbers_only(value: object) -> None:
    with refused(EncodeError, f"{value!r} is not a number for f32"):
        codec("f32").encode(value)  # type: ignore[arg-type]


def test_a_float_that_is_whole_is_a_whole_number() -> None:
    assert codec("u16").encode(7.0) == codec("u16").encode(7)


@every_case(("name", "order"), TYPES_AND_ORDERS)
def test_a_wrong_number_of_bytes_is_short_or_long(name: str, order: Order) -> None:
    number = codec(name, order)
    for length, reason in ((number.size - 1, "short"), (number.size + 1, "long")):
        with refused(DecodeError, f"{name} takes {number.size} bytes, got {length}") as caught:
            number.decode(bytes(length))
        error = caught.value
        assert isinstance(error, DecodeError)
        assert (error.reason, error.at) == (reason, min(length, number.size))


@pytest.mark.parametrize("name", ["u12", "u0", "u72", "i128", "f16", "x32", "u", "", "u16 ", "u016", "u１６", "u-8"])
def test_an_unknown_type_is_refused(name: str) -> None:
    with refused(EncodeError, f"type {name!r}: expected u8..u64"):
        Number(name)


def test_an_unknown_order_name_is_refused() -> None:
    with refused(EncodeError, "byte order 'ACBD': expected one of ABCD, CDAB, BADC, DCBA"):
        Number("u32", "ACBD")  # type: ignore[arg-type]


@pytest.mark.parametrize("order", MIXED)
@pytest.mark.parametrize("name", ["u24", "i40", "u56"])
def test_an_order_of_registers_for_half_a_register_is_refused_at_once(name: str, order: Order) -> None:
    with refused(EncodeError, f"do not fill registers of 2 bytes, so they have no order {order}"):
        Number(name, order)


def test_codec_returns_the_same_object_again() -> None:
    assert codec("u32", "CDAB") is codec("u32", "CDAB")
    assert codec("u32", "CDAB") is not codec("u32")


@modest
@given(st.sampled_from([pair for pair in TYPES_AND_ORDERS if pair[0] in INTEGERS]), st.data())
def test_any_bytes_decode_to_an_integer_that_encodes_to_them(pair: tuple[str, Order], data: st.DataObject) -> None:
    number = codec(*pair)
    wire = data.draw(st.binary(min_size=number.size, max_size=number.size))
    assert number.encode(number.decode(wire)) == wire


@modest
@given(st.floats(width=32), st.sampled_from(ORDERS))
def test_floats_equal_struct(value: float, order: Order) -> None:
    number = codec("f32", order)
    assert struct.pack(">f", number.decode(number.encode(value))) == struct.pack(">f", value)
