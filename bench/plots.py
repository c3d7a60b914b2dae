"""One picture for each family of races, drawn by matplotlib (extra `plot`)."""

from __future__ import annotations

from collections import defaultdict
from itertools import cycle
from pathlib import Path
from typing import Any

from bench.results import Entry, show

SIZES = {
    "CRC-16": "bytes of the frame",
    "RTU response": "registers",
    "ASCII response": "registers",
    "TCP response": "registers",
    "RTU chunk": "frames in one read",
    "ASCII chunk": "frames in one read",
    "TCP chunk": "frames in one read",
    "Block": "values",
    "TCP server, connections": "connections",
    "Idle connections": "connections",
    "Named read": "values",
}
"""The label of the sizes, for the families that have several."""
OUR_COLOURS = ("#1f77b4", "#17becf", "#08306b")
COLOURS = (
    *("#7f7f7f", "#d62728", "#2ca02c", "#ff7f0e", "#9467bd", "#8c564b", "#e377c2", "#bcbd22", "#000000"),
    *("#c49c94", "#98df8a"),
)


def plot(family: str, groups: dict[tuple[str, int | str], list[Entry]], folder: Path) -> str:
    """Write one SVG for a family: cost against size if there are sizes, else a row for each. Returns its file name."""
    import matplotlib

    matplotlib.use("svg")
    matplotlib.rcParams |= {"svg.hashsalt": "barewire", "svg.fonttype": "none", "font.size": 9}
    from matplotlib import pyplot

    lines: dict[str, list[tuple[float, float]]] = defaultdict(list)
    for (what, size), rows in groups.items():
        for row in rows:
            label = row.contestant if len({what for what, _ in groups}) == 1 else f"{row.contestant}: {what}"
            lines[label].append((float(size) if isinstance(size, int) else 0.0, cost(row)))
    figure, axes = pyplot.subplots(figsize=(8, 4.5))
    if min(len({size for size, _ in points}) for points in lines.values()) > 1:
        _draw_lines(axes, lines)
        axes.set_xlabel(SIZES.get(family, "size"))
        axes.set_ylabel("bytes a connection" if family == "Idle connections" else "µs, median")
    else:
        figure.set_size_inches(8, _draw_rows(axes, groups))
        axes.set_xlabel("µs, median")
    axes.set_title(family)
    folder.mkdir(parents=True, exist_ok=True)
    name = f"{family.lower().replace(',', '').replace(' ', '-')}.svg"
    figure.savefig(folder / name, bbox_inches="tight", metadata={"Date": None})
    pyplot.close(figure)
    return name


def cost(row: Entry) -> float:
    """Return the plotted number: bytes of idle connections, microseconds of all other work."""
    return row.memory if row.family == "Idle connections" and row.memory else row.seconds * 1e6


def _draw_lines(axes: Any, lines: dict[str, list[tuple[float, float]]]) -> None:
    """Draw a line for each contestant, ours thick and blue."""
    ours, others = cycle(OUR_COLOURS), cycle(COLOURS)
    for contestant, points in lines.items():
        is_ours = contestant.startswith("barewire")
        style = {"color": next(ours if is_ours else others), "linewidth": 2.2 if is_ours else 1.0}
        axes.plot(*zip(*sorted(points)), label=contestant, marker="o", markersize=3, **style)
    axes.set(xscale="log", yscale="log")
    axes.grid(True, which="major", alpha=0.3)
    axes.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5))


def _draw_rows(axes: Any, groups: dict[tuple[str, int | str], list[Entry]]) -> float:
    """Draw a dot with its number for each contestant, by race; return the height. Bars make no sense on a log axis."""
    labels: list[str] = []
    for (what, size), rows in groups.items():
        labels.append(f"{what}, {size}")
        for row in rows:
            colour = OUR_COLOURS[0] if row.contestant.startswith("barewire") else "#777777"
            axes.plot(cost(row), len(labels), marker="o", markersize=4, color=colour)
            axes.annotate(show(row.seconds), (cost(row), len(labels)), (6, -2), textcoords="offset points", fontsize=6)
            labels.append(row.contestant)
    titles = {f"{what}, {size}" for what, size in groups}
    axes.set_yticks(range(len(labels)), labels, fontsize=6)
    for text in axes.get_yticklabels():
        text.set_fontweight("bold" if text.get_text() in titles else "normal")
    axes.set(xscale="log", ylim=(len(labels), -1))
    axes.margins(x=0.1)
    axes.grid(True, axis="x", which="major", alpha=0.3)
    return max(3.0, 0.15 * len(labels) + 1)
