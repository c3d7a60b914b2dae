"""Which samples become rows of a log: those of which all conditions hold, one in so many, and those that bring news."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from barewire.codecs import Value
from barewire_workbench.value_log.condition import Condition
from barewire_workbench.value_log.sample import Column


@dataclass
class Selection:
    """Chooses samples.

    columns      the columns of their values
    conditions   all of them must hold; a value that was not read is no reason to leave out its error
    every        one in so many of the samples under which they hold
    change       by how much a value must differ from that of the last row; None: rows without a change are written too
    at_least     seconds after which a row is written although nothing changed; None: never

    >>> from barewire import load
    >>> chosen = Selection([Column(0, "", load("csd-mt").find("Current Ratio"))], change=5)
    >>> [chosen.takes([value], "", float(at)) for at, value in enumerate([70, 72, 75, 76, 70])]
    [True, False, True, False, True]
    """

    columns: Sequence[Column]
    conditions: Sequence[Condition] = ()
    every: int = 1
    change: float | None = None
    at_least: float | None = None
    _count: int = field(default=-1, init=False)
    _last: tuple[Sequence[Value | None], str, float] | None = field(default=None, init=False)

    def takes(self, values: Sequence[Value | None], error: str, seconds: float) -> bool:
        """Return whether a sample becomes a row; `seconds` is its time."""
        if not all(self._holds(condition, values, error) for condition in self.conditions):
            return False
        self._count += 1
        if self._count % self.every:
            return False
        if self._last is not None and self.change is not None and not self._is_new(values, error, seconds):
            return False
        self._last = values, error, seconds
        return True

    def _holds(self, condition: Condition, values: Sequence[Value | None], error: str) -> bool:
        value = values[self.columns.index(condition.column)]
        return bool(error) if value is None else condition.holds(value)

    def _is_new(self, values: Sequence[Value | None], error: str, seconds: float) -> bool:
        assert self._last is not None
        before, last_error, last_seconds = self._last
        is_due = self.at_least is not None and seconds - last_seconds >= self.at_least
        return is_due or error != last_error or any(map(self._has_changed, before, values))

    def _has_changed(self, before: Value | None, value: Value | None) -> bool:
        numbers = isinstance(before, (int, float)) and isinstance(value, (int, float))
        if before != before or value != value:  # NaN, which is not equal to itself
            return (before != before) != (value != value)
        if numbers and self.change:
            assert isinstance(before, (int, float))
            assert isinstance(value, (int, float))
            return abs(value - before) >= self.change
        return before != value
