"""The plots of the page, drawn by matplotlib (extra `plot`) in docs/reference/gateway/."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from bench.plots import COLOURS, OUR_COLOURS
from tools.gateway_lab.programs import ROOT

FOLDER = ROOT / "docs" / "reference" / "gateway"
SLICE = 0.25
"""Seconds of one point of a rate over time."""


class Curve(NamedTuple):
    """One curve; with `on_the_right` it has an axis of its own."""

    label: str
    times: Sequence[float]
    values: Sequence[float]
    on_the_right: bool = False

    @staticmethod
    def of_moments(label: str, moments: Sequence[float], until: float) -> Curve:
        """The rate, in a second, of what happened at these times."""
        counts = [0] * int(until / SLICE)
        for moment in moments:
            if 0.0 <= moment < len(counts) * SLICE:
                counts[int(moment / SLICE)] += 1
        return Curve(label, [SLICE * place for place in range(len(counts))], [count / SLICE for count in counts])


def plot_over_time(
    name: str,
    what: str,
    curves: Sequence[Curve],
    absences: Sequence[tuple[float, float]] = (),
    *,
    unit: str = "s",
    right: str = "",
) -> str:
    """Draw curves over time, grey where something was absent, into an SVG; return its place on the page."""
    import matplotlib

    matplotlib.use("svg")
    matplotlib.rcParams |= {"svg.hashsalt": "barewire", "svg.fonttype": "none", "font.size": 9}
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(8, 3))
    other: Any = axes.twinx() if any(curve.on_the_right for curve in curves) else None
    for curve, colour in zip(curves, (OUR_COLOURS[0], COLOURS[1], COLOURS[2], COLOURS[3])):
        target = other if curve.on_the_right else axes
        target.plot(curve.times, curve.values, label=curve.label, color=colour, linewidth=1.2)
    for begin, end in absences:
        axes.axvspan(begin, end, color="#cccccc", alpha=0.6, linewidth=0)
    axes.set(xlabel=unit, ylabel=what, ylim=(0, None))
    if other is not None:
        other.set(ylabel=right, ylim=(0, None))
    axes.grid(True, alpha=0.3)
    figure.legend(fontsize=7, loc="upper center", ncols=len(curves), bbox_to_anchor=(0.5, 1.0))
    FOLDER.mkdir(parents=True, exist_ok=True)
    figure.savefig(FOLDER / f"{name}.svg", bbox_inches="tight", metadata={"Date": None})
    pyplot.close(figure)
    return f"![{what}, over time: {', '.join(curve.label for curve in curves)}](gateway/{name}.svg)"
