"""Reading: a parameter with its value, as a number and in formatted text."""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

import pytest

from barewire.devices import Parameter, Reading

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


@pytest.mark.parametrize("operation", OPERATORS)
def test_calculating_with_a_reading_names_the_value(operation: Callable[[Any, Any], Any]) -> None:
    for pair in ((WARM, 24.5), (24.5, WARM)):
        with pytest.raises(TypeError, match=r"<Reading Temperature = 24.56 °C>: use its \.value"):
            operation(*pair)


def test_a_sum_of_readings_names_the_value() -> None:
    readings: list[Any] = [WARM, WARM]
    with pytest.raises(TypeError, match=r"use its \.value"):
        sum(readings)


def test_a_reading_is_a_tuple_of_parameter_and_value() -> None:
    parameter, value = WARM
    assert Reading(parameter, value) == WARM
    assert tuple(WARM) == (parameter, value)
    assert hash(WARM) == hash((parameter, value))
    number: Any = 24.56
    assert (number == WARM) is False
    assert operator.add(WARM, (1,)) == (parameter, 24.56, 1)
