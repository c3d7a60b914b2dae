"""Values as text: the names of values are written in programs as on the command line."""

from __future__ import annotations

from typing import Any

import pytest

from barewire.devices import Parameter, load
from barewire.devices.request_checks import parse_value, to_write
from barewire.errors import EncodeError
from tests.helpers import refused

AZ3, ADXL = load("az3"), load("adxl")


@pytest.mark.parametrize(
    ("device", "name", "text"),
    [
        (AZ3, "MODES OF OPERATION", "profile velocity"),
        (AZ3, "MODES OF OPERATION", " Profile Velocity "),
        (ADXL, "Motor start command", "execute"),
    ],
)
def test_the_name_of_a_value_is_the_value_in_programs_and_on_the_command_line(
    device: Any, name: str, text: str
) -> None:
    ((parameter, value),) = to_write(device, {name: text}, False)
    assert value == parse_value(parameter, text)
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
