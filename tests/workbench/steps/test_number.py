"""The steps of a number reach the bytes of the codecs, for every type, order and kind of number."""

from __future__ import annotations

import math
import re
import struct
from decimal import Decimal
from fractions import Fraction

import pytest
from hypothesis import given, settings, strategies as st

from barewire.codecs import ORDERS, codec, reorder
from barewire.codecs.order import Order
from barewire.errors import DecodeError, EncodeError
from barewire_workbench.steps import NUMBER_TYPES, Steps, number_from_bytes_steps, number_steps
from barewire_workbench.steps.number import ordered, shown_number
from tests.helpers import every_case

thorough = settings(max_examples=100, deadline=None, derandomize=True, database=None)
INTEGERS = [name for name in NUMBER_TYPES if name[0] in "ui"]


def together(steps: Steps) -> tuple[str, ...]:
    """The four cells of bits, and the bytes behind them."""
    table = next(table for table in steps.tables if table.caption.startswith("Together"))
    return (*(row[1].replace(" ", "") for row in table.rows), table.rows[-1][2])


@given(st.floats(width=32, allow_nan=False))
@thorough
def test_a_f32_is_what_struct_packs(number: float) -> None:
    steps = number_steps(repr(number))
    assert steps.values["bytes"] == struct.pack(">f", number).hex(" ").upper()
    sign, exponent, fraction, whole, digits = together(steps)
    assert (len(sign), len(exponent), len(fraction)) == (1, 8, 23)
    assert sign + exponent + fraction == whole
    assert digits == steps.values["bytes"]


@given(st.floats(allow_nan=False, allow_infinity=False))
@thorough
def test_a_f64_is_rounded_as_python_rounds_its_text(number: float) -> None:
    steps = number_steps(repr(number), "f64")
    assert steps.values["bytes"] == struct.pack(">d", number).hex(" ").upper()
    assert "".join(together(steps)[:3]) == together(steps)[3]


@given(st.decimals(min_value=-(10**9), max_value=10**9, allow_nan=False, allow_infinity=False, places=9))
@thorough
def test_decimals_are_rounded_to_the_nearest_f32(number: Decimal) -> None:
    """Against numpy's rule without numpy: no neighbour is nearer, and of two equally near the even one is taken."""
    steps = number_steps(str(number))
    pattern = int(str(steps.values["bytes"]).replace(" ", ""), 16)
    magnitude = pattern & 0x7FFF_FFFF

    def away(place: int) -> Fraction:
        return abs(Fraction(struct.unpack(">f", place.to_bytes(4, "big"))[0]) - abs(Fraction(number)))

    for neighbour in (magnitude - 1, magnitude + 1):
        if neighbour >= 0:
            assert away(magnitude) <= away(neighbour)
            assert away(magnitude) < away(neighbour) or magnitude % 2 == 0


@given(st.sampled_from(INTEGERS), st.data())
@thorough
def test_an_integer_is_what_the_codec_encodes(name: str, data: st.DataObject) -> None:
    plain = codec(name)
    value = data.draw(st.integers(int(plain.minimum), int(plain.maximum)))
    steps = number_steps(str(value), name)
    sent = plain.encode(value).hex(" ").upper()
    assert steps.values["bytes"] == sent
    digits = sent.replace(" ", "")
    if value < 0:
        assert steps.tables[0].rows[-1][2] == f"{digits}h"
        assert steps.tables[0].rows[-1][1].replace(" ", "") == f"{int(digits, 16):0{plain.bits}b}"
    else:
        assert f"in hexadecimal {digits}h." in str(steps.sections[1])


@every_case("name", ["f32", "f64", "u16", "i32", "u64"])
@every_case("order", ORDERS)
def test_the_marked_order_is_the_one_of_the_codec(name: str, order: str) -> None:
    steps = number_steps("1000", name, order)  # type: ignore[arg-type]
    sent = codec(name, order).encode(1000)  # type: ignore[arg-type]
    (marked,) = [row for row in steps.tables[-1].rows if row[-1]]
    assert marked[1] == sent.hex(" ").upper()
    registers = [int.from_bytes(sent[place : place + 2], "big") for place in range(0, len(sent), 2)]
    assert list(marked[2:-2]) == [f"{register:04X}h" for register in registers]
    assert steps.values["registers"] == registers


@given(st.sampled_from([1, 2, 4, 8]).flatmap(lambda size: st.binary(min_size=size, max_size=size)))
@thorough
def test_the_orders_are_those_of_the_codecs(data: bytes) -> None:
    for order in ORDERS:
        assert ordered(data, order) == (reorder(data, order) if len(data) > 1 else data)


def test_the_number_of_the_canopen_guide() -> None:
    steps = number_steps("1.1", "f32", "CDAB")
    assert steps.result == "1.1 as f32 in order CDAB: CC CD 3F 8C"
    doubling = steps.tables[0].rows
    assert [row[2] for row in doubling] == list("00011001100110011001100")
    assert doubling[3] == ("4", "2 x 0.8 = 1.6", "1")
    stored = next(row for table in steps.tables for row in table.rows if row[0] == "stored")
    assert stored[1:] == ("3F 8C CC CD", "1.10000002384185791015625", "2.38e-8")


@pytest.mark.parametrize(
    ("text", "name", "digits"),
    [
        ("0", "f32", "00 00 00 00"),
        ("-0", "f32", "80 00 00 00"),
        ("inf", "f32", "7F 80 00 00"),
        ("-Infinity", "f64", "FF F0 00 00 00 00 00 00"),
        ("nan", "f32", "7F C0 00 00"),
        ("3.4028235e38", "f32", "7F 7F FF FF"),
        ("1e-45", "f32", "00 00 00 01"),
        ("1e-46", "f32", "00 00 00 00"),
        ("1.1754943508222875e-38", "f32", "00 80 00 00"),
        ("16777217", "f32", "4B 80 00 00"),  # a tie, to even
        ("1.99999999", "f32", "40 00 00 00"),  # the carry runs into the exponent
        ("5e-324", "f64", "00 00 00 00 00 00 00 01"),
        ("0xFFFF", "u16", "FF FF"),
        ("-128", "i8", "80"),
    ],
)
def test_corners(text: str, name: str, digits: str) -> None:
    assert number_steps(text, name).values["bytes"] == digits


@every_case(
    ("text", "name", "message"),
    [
        ("abc", "f32", "expected a number for f32"),
        ("1_000", "f32", "expected a number"),
        ("snan", "f32", "expected a number"),
        ("", "f32", "expected a number"),
        ("9" * 2000, "f64", "expected a number"),
        ("1e99", "f32", "does not fit f32"),
        ("3.4028236e38", "f32", "does not fit f32"),
        ("-1.8e308", "f64", "does not fit f64"),
        ("1e309", "f64", "does not fit f64"),
        ("1e999999999", "f32", "powers of ten"),
        ("1e-999999999", "f64", "powers of ten"),
        ("1.5", "u16", "expected a whole number for u16"),
        ("65536", "u16", "expected 0..65535"),
        ("-129", "i8", "expected -128..127"),
        ("9" * 101, "u64", "expected a whole number"),
        ("1", "f16", "expected one of f32, f64"),
    ],
)
def test_wrong_numbers(text: str, name: str, message: str) -> None:
    with pytest.raises(EncodeError, match=message):
        number_steps(text, name)


@pytest.mark.parametrize(
    ("number", "digits", "text"),
    [
        (Fraction(0), 5, "0"),
        (Fraction(1), 5, "1"),
        (Fraction(1200), 5, "1200"),
        (Fraction(120000), 5, "1.2e+5"),
        (Fraction(123456), 5, "1.2345...e+5"),
        (Fraction(1, 3), 5, "0.33333..."),
        (Fraction(100, 3), 5, "33.333..."),
        (Fraction(99999, 1), 5, "99999"),
        (Fraction(12, 1000), 5, "0.012"),
        (Fraction(1, 10**6), 5, "1e-6"),
        (Fraction(10**5 - 1, 10**5), 5, "0.99999"),
    ],
)
def test_numbers_in_decimal(number: Fraction, digits: int, text: str) -> None:
    assert shown_number(number, digits) == text
    if "..." not in text:
        assert Fraction(text) == number


@given(st.fractions(min_value=0, max_value=10**30), st.integers(1, 30))
@thorough
def test_a_number_without_dots_is_exact(number: Fraction, digits: int) -> None:
    text = shown_number(number, digits)
    shown = Fraction(text.replace("...", ""))
    assert shown <= number
    assert ("..." not in text) == (shown == number) or shown == number == 0
    assert math.isclose(shown, number, rel_tol=10.0 ** (1 - digits))


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
