"""Compare two sets of settings."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from barewire.codecs import Value
from barewire_workbench.settings.saved import SavedSettings, SavedValue

_PRECISION = 6e-8
"""Half a step of a 32-bit float: values that were read from one are written without its binary tail."""


class SettingDifference(NamedTuple):
    """A setting with another value on each side; None where it is not there, with the reason if it was not read."""

    name: str
    first: SavedValue | None
    second: SavedValue | None
    problem: str = ""

    def as_dict(self) -> dict[str, object]:
        """The difference, for JSON and CSV."""
        return {
            "name": self.name,
            "a": None if self.first is None else self.first.value,
            "a_unit": "" if self.first is None else self.first.unit,
            "b": None if self.second is None else self.second.value,
            "b_unit": "" if self.second is None else self.second.unit,
            "error": self.problem,
        }


COLUMNS = ("name", "a", "a_unit", "b", "b_unit", "error")


def same(first: Value, second: Value) -> bool:
    """Return whether two values are equal, floats to the precision of 32 bits.

    >>> same(0.2, 0.20000000298023224), same(0.2, 0.2000001), same(1, True), same(float("nan"), float("nan"))
    (True, False, True, True)
    """
    if isinstance(first, float) or isinstance(second, float):
        if isinstance(first, (str, bytes)) or isinstance(second, (str, bytes)):
            return False
        both_nan = first != first and second != second
        return both_nan or first == second or abs(first - second) <= _PRECISION * max(abs(first), abs(second))
    return first == second


def differences(
    first: SavedSettings, second: SavedSettings, *, communication: bool = True
) -> Iterator[SettingDifference]:
    """Yield the settings that differ, in the order of the first; then those that only the second has."""
    pairs = [(first.settings, second.settings)]
    if communication:
        pairs.append((first.communication, second.communication))
    for ours, theirs in pairs:
        for name in dict.fromkeys((*ours, *theirs)):
            left, right = ours.get(name), theirs.get(name)
            if left is None or right is None:
                yield SettingDifference(name, left, right, first.not_read.get(name) or second.not_read.get(name, ""))
            elif left.unit != right.unit or not same(left.value, right.value):
                yield SettingDifference(name, left, right)
    for name in first.not_read.keys() & second.not_read.keys():
        yield SettingDifference(name, None, None, f"{first.not_read[name]}; {second.not_read[name]}")
