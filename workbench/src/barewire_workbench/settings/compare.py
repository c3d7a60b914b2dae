"""Compare two sets of settings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import NamedTuple

from barewire.codecs import Value, codec
from barewire.devices import Parameter
from barewire.errors import EncodeError
from barewire_workbench.settings.saved import SavedSettings, SavedValue, value_of


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
    """Return whether two values are equal; not-a-number is equal to itself.

    >>> same(0.2, 0.20000000298023224), same(1, True), same(float("nan"), float("nan")), same(70, float("inf"))
    (False, True, True, False)
    """
    if isinstance(first, float) and isinstance(second, float):
        return repr(first) == repr(second)
    return first == second


def same_setting(parameter: Parameter, first: Value, second: Value) -> bool:
    """Return whether two values of a parameter are the same on the wire.

    >>> same_setting(Parameter("Ratio", "f32"), 0.2, 0.20000000298023224)
    True
    """
    if same(first, second):
        return True
    numbers = not isinstance(first, (str, bytes)) and not isinstance(second, (str, bytes))
    if not numbers:
        return False
    try:
        raw = [parameter.to_raw(value) for value in (first, second)]
        if parameter.type in ("f32", "f64"):
            raw = [codec(parameter.type).encode(number) for number in raw]
    except EncodeError:  # one of them is out of range
        return False
    return raw[0] == raw[1]


def differences(
    first: SavedSettings,
    second: SavedSettings,
    parameters: Mapping[str, Parameter] = MappingProxyType({}),
    *,
    communication: bool = True,
) -> Iterator[SettingDifference]:
    """Yield the settings that differ, in the order of the first; then those that only the second has.

    Of `parameters`, by name, values are compared as they are on the wire, those of others as they are in the files."""
    pairs = [(first.settings, second.settings)]
    if communication:
        pairs.append((first.communication, second.communication))
    for ours, theirs in pairs:
        for name in dict.fromkeys((*ours, *theirs)):
            left, right = ours.get(name), theirs.get(name)
            if left is None or right is None:
                yield SettingDifference(name, left, right, first.not_read.get(name) or second.not_read.get(name, ""))
            elif left.unit != right.unit or not _same_saved(parameters.get(name), left, right):
                yield SettingDifference(name, left, right)
    known = {*first.settings, *first.communication, *second.settings, *second.communication}
    for name in dict.fromkeys((*first.not_read, *second.not_read)):
        if name not in known:
            why = dict.fromkeys(side.not_read[name] for side in (first, second) if name in side.not_read)
            yield SettingDifference(name, None, None, "; ".join(why))


def _same_saved(parameter: Parameter | None, first: SavedValue, second: SavedValue) -> bool:
    if parameter is None:
        return same(first.value, second.value)
    try:
        return same_setting(parameter, value_of(parameter, first), value_of(parameter, second))
    except EncodeError:  # one of them is no value of the parameter
        return same(first.value, second.value)
