"""The scope of `panel --terminal`: chosen values over time, drawn with bars of characters."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence

from rich.text import Text
from textual.widget import Widget

from barewire_workbench.cli.terminal.screen import FAINT, columns

MOST_TRACES = 4
_SPANS = (60, 600, 10)
"""Seconds from the left to the right side, one after the other."""
_COLOURS = ("cyan", "yellow", "green", "magenta")
_BARS = " ▁▂▃▄▅▆▇█"


def bars(values: Sequence[float | None], height: int) -> list[str]:
    """Return lines of bars, one column a value: the lowest value is one eighth of a line high; None is a gap.

    >>> bars([0, 4, 7, None, 3], 1)
    ['▁▅█ ▄']
    >>> bars([0, 15, 8, 8], 2)
    [' █▁▁', '▁███']
    """
    known = [value for value in values if value is not None]
    low, extent = (min(known), max(known) - min(known) or 1) if known else (0, 1)
    heights = [0 if value is None else 1 + round((value - low) / extent * (8 * height - 1)) for value in values]
    return ["".join(_BARS[max(0, min(8, eighths - 8 * row))] for eighths in heights) for row in reversed(range(height))]


class Scope(Widget):
    """Up to four traces, one below the other, each with its own scale."""

    DEFAULT_CSS = "Scope { height: 1fr; }"

    def __init__(self, names: Sequence[str]) -> None:
        super().__init__(id="scope")
        self.names = [*names][:MOST_TRACES]
        self._texts: Mapping[str, str] = {}
        self._samples: deque[tuple[float, Mapping[str, float]]] = deque()
        self._span = 0

    def switch(self, name: str) -> None:
        """Add a trace, or remove it."""
        if name in self.names:
            self.names.remove(name)
        else:
            self.names.append(name)
        self.refresh()

    def next_span(self) -> None:
        """Show another time."""
        self._span = (self._span + 1) % len(_SPANS)
        self.refresh()

    def take(self, at: float, numbers: Mapping[str, float], texts: Mapping[str, str]) -> None:
        """Take the numbers of the traces at a time in seconds; none from a silent machine, which is a gap."""
        if not numbers and self._samples and not self._samples[-1][1]:
            return
        self._texts = texts
        self._samples.append((at, numbers))
        while self._samples[0][0] < at - max(_SPANS):
            self._samples.popleft()
        self.refresh()

    def _columns(self, name: str, width: int) -> list[float | None]:
        """Return the value in each column: that of the latest sample before its end."""
        seconds, newest = _SPANS[self._span], self._samples[-1][0] if self._samples else 0.0
        values: list[float | None] = [None] * width
        for at, numbers in self._samples:
            begin = width - 1 - int((newest - at) / seconds * width)
            if begin > -width:
                values[max(0, begin) :] = [numbers.get(name)] * (width - max(0, begin))
        return values

    def render(self) -> Text:
        """Draw the traces, and the time below them."""
        width, height = self.size
        if not self.names:
            return Text("p: the chosen value, over time", FAINT)
        lines = []
        each = max(2, (height - 1) // len(self.names))
        for name, colour in zip(self.names, _COLOURS):
            values = self._columns(name, width)
            known = [value for value in values if value is not None]
            limits = f"{min(known):g} … {max(known):g}" if known else ""
            lines.append(columns(width, (f"{name}  {self._texts.get(name, '…')}", width * 2 // 3), (limits, 0)))
            lines += [Text(line, colour) for line in bars(values, each - 1)]
        lines.append(Text(f"-{_SPANS[self._span]} s".ljust(width - 3) + "now", FAINT))
        return Text("\n").join(lines)
