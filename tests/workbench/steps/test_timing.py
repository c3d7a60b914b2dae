"""The steps of the times of a line reach `rtu.frame`, and the numbers of the standard."""

from __future__ import annotations

import pytest
from hypothesis import given, settings, strategies as st

from barewire import ascii as ascii_framing, rtu
from barewire.errors import EncodeError
from barewire.modbus.messages import ReadHoldingRegisters
from barewire.rtu.frame import Timing, character_bits
from barewire.rtu.line import PATIENCE
from barewire_workbench.steps import Steps, timing_steps
from barewire_workbench.steps.timing import shown_time
from barewire_workbench.wire import CharacterFormat

thorough = settings(max_examples=100, deadline=None, derandomize=True, database=None)
FORMATS = [CharacterFormat.parse(text) for text in ("8E1", "8N1", "8N2", "8O1", "7E1", "7N2", "8E2")]


def cells(steps: Steps, name: str) -> tuple[str, ...]:
    return next(row for table in steps.tables for row in table.rows if row[0] == name)


def texts(seconds: float) -> set[str]:
    """The texts of a time: two where it lies between two of them, as 21.875 ms does, and a float on either side."""
    return {shown_time(seconds * (1 - 1e-12)), shown_time(seconds * (1 + 1e-12))}


@given(st.one_of(st.sampled_from([300, 1200, 9600, 19199, 19200, 19201, 38400]), st.integers(1, 10**8)))
@thorough
def test_the_times_are_those_of_the_package(baudrate: int) -> None:
    for form in FORMATS:
        steps = timing_steps(baudrate, form)
        bits = character_bits(form.data_bits, form.parity, form.stop_bits)
        timing = Timing.of(baudrate, bits)
        assert steps.values["bits"] == bits == sum(int(row[1]) for row in steps.tables[0].rows[:-1])
        assert cells(steps, "a character")[1] == str(bits)
        assert cells(steps, "a character")[2] in texts(timing.character)
        if form.data_bits == 8:
            assert cells(steps, "t1.5")[2] in texts(timing.t15)
            assert cells(steps, "t3.5")[2] in texts(timing.t35)
            assert (steps.values["t1.5"], steps.values["t3.5"]) == (timing.t15, timing.t35)
        else:
            assert "t3.5" not in steps.values


def test_the_numbers_of_the_standard() -> None:
    assert timing_steps(19200, FORMATS[0]).result.endswith("a character lasts 572.9 us, t1.5 859.4 us, t3.5 2.005 ms")
    fast = timing_steps(115200, FORMATS[0])
    assert fast.result.endswith("t1.5 750 us, t3.5 1.75 ms")
    assert cells(fast, "t3.5")[3] == "3.5 x 95.49 us = 334.2 us"


@pytest.mark.parametrize(("form", "framing", "silences"), [("8E1", rtu.encode, 2), ("7E1", ascii_framing.encode, 0)])
def test_an_exchange_is_the_length_of_its_frames(form: str, framing: object, silences: int) -> None:
    character = CharacterFormat.parse(form)
    steps = timing_steps(9600, character)
    timing = Timing.of(9600, character.bits)
    _, request, lasts, response, answers, whole, per_second = cells(steps, "read 10 registers")
    assert int(request) == len(framing(1, ReadHoldingRegisters(0, 10).encode()))  # type: ignore[operator]
    assert int(response) == len(framing(1, bytes((3, 20, *bytes(20)))))  # type: ignore[operator]
    assert lasts == shown_time(timing.duration(int(request)))
    assert answers == shown_time(timing.duration(int(response)))
    seconds = timing.duration(int(request) + int(response)) + silences * timing.t35
    assert whole == shown_time(seconds)
    assert float(per_second) == pytest.approx(1 / seconds, rel=1e-3)


def test_both_meanings_of_t35_are_told() -> None:
    text = " ".join(section for section in timing_steps(9600, FORMATS[0]).sections if isinstance(section, str))
    assert "t3.5 is two numbers" in text
    assert f"pauses of {shown_time(PATIENCE)} inside a frame" in text


def test_a_character_that_is_not_standard_is_told() -> None:
    told = {str(form): "The standard has" in str(timing_steps(9600, form).sections[2]) for form in FORMATS}
    assert told == {"8E1": False, "8N1": True, "8N2": False, "8O1": False, "7E1": False, "7N2": False, "8E2": True}


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0, "0 us"),
        (1e-6, "1 us"),
        (0.00099996, "1000 us"),
        (0.001, "1 ms"),
        (0.9999, "999.9 ms"),
        (1, "1 s"),
        (2550, "2550 s"),
        (25500.4, "25500 s"),
    ],
)
def test_times_are_shown_with_four_digits(seconds: float, text: str) -> None:
    assert shown_time(seconds) == text


def test_what_no_line_has_is_refused() -> None:
    for baudrate in (0, -1, 10**9):
        with pytest.raises(EncodeError, match="bits per second"):
            timing_steps(baudrate, FORMATS[0])
    with pytest.raises(EncodeError, match="5 data bits"):
        timing_steps(9600, CharacterFormat.parse("5E1"))
