"""What differs between two sets of settings."""

from __future__ import annotations

from fractions import Fraction

import pytest

from barewire.codecs import Value
from barewire.devices import Parameter
from barewire_workbench.settings.compare import SettingDifference, differences
from barewire_workbench.settings.saved import SavedSettings, SavedValue


def of(values: dict[str, SavedValue], **others: object) -> SavedSettings:
    return SavedSettings("mine", settings=values, **others)  # type: ignore[arg-type]


def test_values_units_and_what_one_side_has_alone() -> None:
    first = of({"a": SavedValue(1), "b": SavedValue(2, "A"), "c": SavedValue(0.2), "d": SavedValue(4)})
    second = of({"e": SavedValue(5), "a": SavedValue(1), "b": SavedValue(2, "mA"), "c": SavedValue(0.2)})
    assert list(differences(first, second)) == [
        SettingDifference("b", SavedValue(2, "A"), SavedValue(2, "mA")),
        SettingDifference("d", SavedValue(4), None),
        SettingDifference("e", None, SavedValue(5)),
    ]


@pytest.mark.parametrize(
    ("type_", "scale", "pairs"),
    [
        ("f32", Fraction(1), [(0.2, 0.20000000298023224, True), (0.2, 0.2000001, False), (0.2, "0.2", False)]),
        ("f64", Fraction(1), [(300000.125, 300000.12, False)]),
        ("u32", Fraction(1, 1000), [(300000.125, 300000.12, False), (429496729.5, 429496705.0, False)]),
        ("u16", Fraction(1, 3), [(0.33333, 1 / 3, True), (0.33333, 2 / 3, False)]),
    ],
)
def test_values_are_compared_as_they_are_on_the_wire(
    type_: str, scale: Fraction, pairs: list[tuple[Value, Value, bool]]
) -> None:
    known = {"a": Parameter("a", type_, scale=scale)}
    for left, right, is_same in pairs:
        sides = of({"a": SavedValue(left)}), of({"a": SavedValue(right)})
        assert (list(differences(*sides, known)) == []) is is_same, (left, right)
        assert list(differences(*sides)), "without the description they are compared as they are in the files"


def test_what_was_not_read_is_a_problem_and_no_difference_of_values() -> None:
    first, second = of({"a": SavedValue(1)}), of({}, not_read={"a": "exception 02", "b": "silent"})
    found, nowhere = differences(first, second)
    assert (found.name, found.problem) == ("a", "exception 02")
    assert (nowhere.name, nowhere.problem) == ("b", "silent")
    (one, both) = differences(
        of({}, not_read={"b": "exception 04"}), of({"a": SavedValue(1)}, not_read={"b": "silent"})
    )
    assert (one.name, one.problem) == ("a", "")
    assert (both.name, both.problem) == ("b", "exception 04; silent")


def test_communication_can_be_left_out() -> None:
    first = of({}, communication={"node": SavedValue(1)})
    second = of({}, communication={"node": SavedValue(2)})
    assert [found.name for found in differences(first, second)] == ["node"]
    assert list(differences(first, second, communication=False)) == []
