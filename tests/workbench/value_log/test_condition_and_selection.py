"""Conditions: what they are true of, and texts that are none; which samples become rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime
from fractions import Fraction
from math import inf, nan

import pytest

from barewire.devices import Device, Parameter, Reading, UnknownName, load
from barewire.errors import EncodeError
from barewire_workbench.cli.value_text import parse_value
from barewire_workbench.value_log.condition import Condition, condition as parsed_condition, name_in
from barewire_workbench.value_log.sample import Poll, Sample, Watched, cell_text, columns_of, labelled, row_of
from barewire_workbench.value_log.selection import Selection

CSD, ADXL = load("csd-mt"), load("adxl")
ONE = [Watched("tcp://127.0.0.1", CSD, ("Status Word",))]
TWO = labelled([Watched("tcp://127.0.0.1", CSD, ("Status Word",)), Watched("tcp://127.0.0.2", ADXL, ("Status",))])


def condition(text: str, machines: Sequence[Watched]) -> Condition:
    return parsed_condition(text, machines, parse_value)


@pytest.mark.parametrize(
    ("text", "true", "false"),
    [
        ("Status Word.3 == 1", 8, 7),
        ("status word.0 != on", 2, 3),
        ("Status Word == 0x270", 624, 0),
        ("Current Ratio>=70", 70, 69.9),
        ("Current Ratio < 70", 69, 70),
        ("Little Endian / Big Endian <= 0", 0, 1),
    ],
)
def test_a_condition_is_true_and_false(text: str, true: float, false: float) -> None:
    compared = condition(text, ONE)
    assert compared.holds(true)
    assert not compared.holds(false)


def test_a_value_may_be_given_by_its_name() -> None:
    compared = condition("Status == 'Starter ready'", TWO)
    assert (compared.column.title, compared.limit) == ("adxl: Status", 2)
    assert condition("adxl: Status != Starter ready", TWO).limit == 2


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("Status Word.3", "expected NAME[.BIT] OPERATOR VALUE"),
        ("Status Word.3 = 1", "equal is =="),
        ("== 1", "expected NAME"),
        ("Status Word.3 == 2", "a bit is 0 or 1"),
        ("Status Word.64 == 1", "has no bit 64"),
        ("Status Word.16 == 1", "has no bit 16"),
        ("Status Word == high", "expected a number"),
        ("Status Word === 1", "expected NAME"),
        ("Current Ratio == nan", "expected a number"),
        ("Current Ratio < inf", "expected a number"),
        ("__import__('os').system('x') == 1", "no parameter"),
    ],
)
def test_what_is_no_condition_is_refused(text: str, error: str) -> None:
    with pytest.raises((EncodeError, UnknownName)) as caught:
        condition(text, ONE)
    assert error in str(caught.value)


def test_a_name_of_several_machines_needs_its_machine() -> None:
    twice = labelled([ONE[0], ONE[0]._replace(endpoint="tcp://127.0.0.2")])
    assert [watched.label for watched in twice] == ["csd-mt at tcp://127.0.0.1", "csd-mt at tcp://127.0.0.2"]
    with pytest.raises(EncodeError, match="Status Word is a name of several machines: write 'csd-mt at tcp"):
        condition("Status Word == 1", twice)
    assert condition("csd-mt at tcp://127.0.0.2: Status Word == 1", twice).column.machine == 1
    # Of two machines that have the name, the one of which it is read.
    one_is_read = [twice[0], twice[1]._replace(names=("Current Ratio",))]
    assert condition("Status Word == 1", one_is_read).column.machine == 0


def test_a_32_bit_float_is_logged_and_compared_without_its_binary_tail_and_others_with_all_digits() -> None:
    ratio, energy = Parameter("Ratio", "f32"), Parameter("Energy", "u32", scale=Fraction(1, 100))
    machines = [Watched("", Device("mine", "", (ratio, energy)), ("Ratio", "Energy"))]
    readings = (Reading(ratio, 0.20000000298023224), Reading(energy, energy.from_raw(1234567991)))
    row = row_of(Sample(0.0, datetime(2026, 1, 1), (Poll(readings),)), columns_of(machines), machines)
    assert [cell_text(value) for value in row[1:3]] == ["0.2", "12345679.91"]
    assert condition("Ratio == 0.200000003", machines).holds(row[1] or 0)


def test_the_name_in_a_text() -> None:
    assert [name_in(text) for text in ("A.3 == 1", "holding:5 > 2", "nothing")] == ["A", "holding:5", ""]


# Which samples become rows


def taken(selection: Selection, values: Sequence[float | None]) -> list[int]:
    return [
        number
        for number, value in enumerate(values)
        if selection.takes([value], "lost" if value is None else "", float(number))
    ]


COLUMNS = columns_of([Watched("", replace(CSD), ("Current Ratio",))])


def test_without_options_every_sample_is_a_row() -> None:
    assert taken(Selection(COLUMNS), [70, 70, None, 70]) == [0, 1, 2, 3]


def test_a_change_is_counted_from_the_last_row_and_an_error_is_one() -> None:
    values = [70, 71, 72, None, None, 72, 80, 80, 80]
    assert taken(Selection(COLUMNS, change=0), values) == [0, 1, 2, 3, 5, 6]
    assert taken(Selection(COLUMNS, change=3), values) == [0, 3, 5, 6]
    assert taken(Selection(COLUMNS, change=100, at_least=3.0), [70.0] * 8) == [0, 3, 6]


@pytest.mark.parametrize("change", [0, 1])
def test_not_a_number_is_a_change_once_and_so_is_the_number_behind_it(change: float) -> None:
    assert taken(Selection(COLUMNS, change=change), [1.0, nan, nan, 5.0, 5.0, inf, inf, 5.0]) == [0, 1, 3, 5, 7]


def test_one_in_so_many_of_those_that_fulfil_a_condition() -> None:
    machines = [Watched("", CSD, ("Current Ratio",))]
    only = [condition("Current Ratio > 5", machines)]
    assert taken(Selection(COLUMNS, only), [1, 9, 9, 1, None, 9]) == [1, 2, 4, 5]
    assert taken(Selection(COLUMNS, only, every=2), [1, 9, 9, 9, 1, 9]) == [1, 3]


def test_a_device_of_the_user_may_have_dots_in_its_names() -> None:
    parameter = replace(CSD.find("Current Ratio"), name="P08.01")
    own: Device = replace(CSD, parameters=(parameter,))
    found = condition("P08.01 == 1", [Watched("", own, ("P08.01",))])
    assert (found.column.parameter.name, found.bit) == ("P08.01", None)
