"""The results of a run: rows of pytest-benchmark's JSON with the additions of `conftest.py`; how numbers are shown."""

from __future__ import annotations

from collections import defaultdict
from typing import Any, NamedTuple


class Entry(NamedTuple):
    """One contestant of one race."""

    family: str
    what: str
    size: int | str
    contestant: str
    floor: str
    seconds: float
    ratios: dict[str, dict[str, float]]
    memory: float | None


def read(data: dict[str, Any]) -> list[Entry]:
    """Return the races of a run, in their order."""
    found = []
    for row in data["benchmarks"]:
        extra = row["extra_info"]
        if "family" in extra:
            fields = {key: extra[key] for key in ("family", "what", "size", "contestant", "floor", "ratios")}
            found.append(Entry(**fields, seconds=row["stats"]["median"], memory=extra.get("memory")))
    return found


def races(entries: list[Entry]) -> dict[str, dict[tuple[str, int | str], list[Entry]]]:
    """By family, then by what and size."""
    found: dict[str, dict[tuple[str, int | str], list[Entry]]] = defaultdict(lambda: defaultdict(list))
    for entry in entries:
        found[entry.family][entry.what, entry.size].append(entry)
    return found


def show(seconds: float) -> str:
    """Return a time with three digits and the unit that fits.

    >>> show(2.345e-6), show(0.0123)
    ('2.35 µs', '12.3 ms')
    """
    number, unit = next(
        (seconds * k, u) for k, u in ((1, "s"), (1e3, "ms"), (1e6, "µs")) if seconds * k >= 1 or k == 1e6
    )
    return f"{number:.3g} {unit}" if number < 1000 else f"{number:.0f} {unit}"


def times(ratio: float) -> str:
    """Return a ratio with two decimals, or with two significant digits if it is small.

    >>> times(1.004), times(0.18349), times(0.00642)
    ('1.00', '0.18', '0.0064')
    """
    return f"{ratio:.2f}" if ratio >= 0.1 else f"{ratio:.2g}"
