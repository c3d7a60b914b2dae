"""A reading as a number and in formatted text, and values that are given as text."""

from __future__ import annotations

import operator
import random
from collections.abc import Callable
from decimal import Decimal
from fractions import Fraction
from math import isfinite
from typing import Any

import pytest

from barewire.codecs import codec
from barewire.devices import Parameter, Reading, load
from barewire.devices.parameter import show
from barewire.devices.request_checks import to_write
from barewire.errors import EncodeError
from tests.helpers import refused

WARM = Reading(Parameter("Temperature", "i16", unit="°C"), 24.56)
TITLE = Reading(Parameter("Title", "text"), "Hall 4")
OPERATORS = [operator.add, operator.sub, operator.mul, operator.truediv, operator.lt, operator.le, operator.gt]
OPERATORS += [operator.ge]


def test_a_reading_is_converted_to_the_number_of_its_value() -> None:
    assert float(WARM) == 24.56
    assert int(WARM) == 24
    assert round(float(Reading(WARM.parameter, 3)), 1) == 3.0
    assert (float(Reading(Parameter("Relay", "bool"), True)), int(Reading(Parameter("Relay", "bool"), True))) == (
        1.0,
        1,
    )


def test_a_format_is_that_of_the_value_and_no_format_is_the_text() -> None:
    assert f"{WARM:.1f}" == "24.6"
    assert f"{WARM:>8.2f}" == "   24.56"
    assert f"{Reading(WARM.parameter, 0x637):04X}" == "0637"
    assert f"{TITLE:>8}" == "  Hall 4"
    assert f"{WARM}" == str(WARM) == "Temperature = 24.56 °C"


@pytest.mark.parametrize("convert", [float, int])
def test_a_text_has_no_number(convert: Callable[[Any], Any]) -> None:
    with pytest.raises(TypeError, match="<Reading Title = Hall 4>: its value is not a number"):
        convert(TITLE)


def test_number_and_text_are_the_value_or_an_error_that_names_the_other() -> None:
    assert (WARM.number, TITLE.text) == (WARM.value, "Hall 4")
    with pytest.raises(TypeError, match=r"its value is not a number: use \.text"):
        _ = TITLE.number
    with pytest.raises(TypeError, match=r"its value is not a text: use \.number"):
        _ = WARM.text


@pytest.mark.parametrize("operation", OPERATORS)
def test_calculating_with_a_reading_names_the_value(operation: Callable[[Any, Any], Any]) -> None:
    for pair in ((WARM, 24.5), (24.5, WARM)):
        with pytest.raises(TypeError, match=r"<Reading Temperature = 24.56 °C>: use its \.number"):
            operation(*pair)


def test_a_sum_of_readings_names_the_value() -> None:
    readings: list[Any] = [WARM, WARM]
    with pytest.raises(TypeError, match=r"use its \.number"):
        sum(readings)


def test_a_reading_is_a_tuple_of_parameter_and_value() -> None:
    parameter, value = WARM
    assert Reading(parameter, value) == WARM
    assert tuple(WARM) == (parameter, value)
    assert hash(WARM) == hash((parameter, value))
    number: Any = 24.56
    assert (number == WARM) is False
    assert operator.add(WARM, (1,)) == (parameter, 24.56, 1)


AZ3, ADXL = load("az3"), load("adxl")


@pytest.mark.parametrize(
    ("device", "name", "text"),
    [
        (AZ3, "MODES OF OPERATION", "profile velocity"),
        (AZ3, "MODES OF OPERATION", " Profile Velocity "),
        (ADXL, "Motor start command", "execute"),
    ],
)
def test_the_name_of_a_value_is_the_value(device: Any, name: str, text: str) -> None:
    ((parameter, value),) = to_write(device, {name: text}, False)
    assert parameter.values[int(value)].casefold() == text.strip().casefold()
    assert to_write(device, {name: text}, True)[0][1] == value


@pytest.mark.parametrize(("text", "value"), [("on", True), ("OFF", False), ("true", True), ("false", False)])
def test_a_bit_is_on_or_off(text: str, value: bool) -> None:
    relay = Parameter("Relay", "bool")
    assert to_write(AZ3, {relay: text}, False) == [(relay, value)]


@pytest.mark.parametrize("force", [False, True])
def test_an_unknown_name_of_a_value_lists_the_names(force: bool) -> None:
    names = ", ".join(AZ3.find("MODES OF OPERATION").values.values())
    assert "profile velocity" in names.casefold()
    with refused(EncodeError, f"MODES OF OPERATION = 'fast': expected a number, or one of: {names}"):
        to_write(AZ3, {"MODES OF OPERATION": "fast"}, force)
    with refused(EncodeError, "Relay = 'open': expected on or off"):
        to_write(AZ3, {Parameter("Relay", "bool"): "open"}, force)


def test_text_for_a_plain_number_is_refused_and_text_stays_text() -> None:
    with refused(EncodeError, "TARGET VELOCITY = '3000': expected a number"):
        to_write(AZ3, {"TARGET VELOCITY": "3000"}, False)
    title = Parameter("Title", "text", values={1: "on"})
    assert to_write(AZ3, {title: "on"}, False) == [(title, "on")]


def test_the_text_of_a_32_bit_float_is_the_same_32_bit_float() -> None:
    dice, wire = random.Random(4), codec("f32")
    patterns = [bytes.fromhex("7F7FFFFF"), bytes.fromhex("00000001"), *(dice.randbytes(4) for _ in range(5000))]
    for scale in (Fraction(1), Fraction(1, 10)):
        ratio = Parameter("Ratio", "f32", scale=scale)
        for raw in patterns:
            if isfinite(wire.decode(raw)):
                text = ratio.text(ratio.from_raw(wire.decode(raw)))
                assert wire.encode(ratio.to_raw(float(text))) == raw, (raw.hex(), text)
    assert [ratio.text(value) for value in (0.1 * 3.0, float("nan"), float("inf"), 1e300)] == [
        "0.3",
        "nan",
        "inf",
        "1e+300",
    ]


def test_the_text_of_a_scaled_integer_or_a_64_bit_float_has_every_digit() -> None:
    dice = random.Random(5)
    for digits in (1, 2, 3, 6):
        energy = Parameter("Energy", "u64", unit="kWh", scale=Fraction(1, 10**digits))
        for raw in (65432101, 1234567991, *(dice.randrange(1 << dice.randrange(1, 50)) for _ in range(1000))):
            text = energy.text(energy.from_raw(raw)).removesuffix(" kWh")
            assert (Decimal(text), len(text) < 20) == (Decimal(raw).scaleb(-digits), True)
    assert energy.text(654321.01) == "654321.01 kWh"
    assert [Parameter("Energy", "f64").text(value) for value in (12345679.91, 3e7)] == ["12345679.91", "30000000"]


def test_a_float_is_a_step_of_a_scaled_integer_where_it_tells_them_apart_and_is_refused_elsewhere() -> None:
    dice = random.Random(6)
    energy = Parameter("Energy", "i64", unit="kWh", scale=Fraction(1, 10))
    for raw in (dice.randrange(1 << dice.randrange(1, 50)) for _ in range(2000)):
        assert energy.to_raw(energy.from_raw(raw)) == raw
    assert energy.to_raw(70368744177663.9) == 703687441776639
    with refused(EncodeError, "Energy = 70368744177663.94: it goes in steps of 0.1 kWh"):
        energy.to_raw(70368744177663.94)
    for value in (900719925474099.3, 500000000000000000.5):
        with refused(EncodeError, f"Energy = {show(value)}: no float tells its steps of 0.1 kWh apart here"):
            energy.to_raw(value)
    assert energy.to_raw(500000000000000000) == 5000000000000000000
