"""The plot of `barewire watch`: one panel for each unit, over time. The only file that needs the extra `plot`."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from barewire.codecs import Value
from barewire.devices.parameter import Parameter
from barewire.errors import EncodeError, PortError
from barewire_workbench.cli.output import port_error

_FORMATS = (".svg", ".png", ".pdf")

_Samples = Sequence[tuple[float, Sequence[Value]]]
"""(seconds, a value for each parameter)."""


class PlotSamples:
    """The samples to draw: at most `most` polls, evenly spread, however long the command runs.

    >>> kept = PlotSamples(most=4)
    >>> for number in range(11):
    ...     kept.add(float(number), [number])
    >>> [time for time, _ in kept.samples], kept.every
    ([0.0, 4.0, 8.0], 4)
    """

    def __init__(self, most: int = 20_000) -> None:
        self.most = most
        self.samples: list[tuple[float, Sequence[Value]]] = []
        self.every = 1
        """One poll in so many is kept."""
        self._polls = 0

    def add(self, time: float, values: Sequence[Value]) -> None:
        """Keep a poll, or skip it."""
        if self._polls % self.every == 0:
            self.samples.append((time, values))
        self._polls += 1
        if len(self.samples) > self.most:
            self.samples = self.samples[::2]
            self.every *= 2


def check_plot_file(file: str) -> None:
    """Check before the first poll that the plot can be written at the end. Raises EncodeError, PortError."""
    path = Path(file).absolute()
    if path.suffix.lower() not in _FORMATS:
        raise EncodeError(f"--plot {file}: expected a name that ends in {', '.join(_FORMATS)}")
    if not path.parent.is_dir():
        raise PortError(f"--plot {file}: the directory does not exist")
    if path.is_dir():
        raise EncodeError(f"--plot {file}: expected a file, not a directory")
    if not os.access(path if path.exists() else path.parent, os.W_OK):
        raise PortError(f"--plot {file}: no permission to write there")
    try:
        import matplotlib  # noqa: F401
    except ModuleNotFoundError:
        raise PortError("drawing needs the extra 'plot': pip install 'barewire[plot]'") from None


def draw_plot(file: str, title: str, parameters: Sequence[Parameter], samples: _Samples) -> None:
    """Draw the samples into a file. PortError if it cannot be written."""
    # Without pyplot there is no window and no global state.
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    units = list(dict.fromkeys(parameter.unit for parameter in parameters))
    figure = Figure(figsize=(9.0, 1.5 + 2.2 * len(units)), layout="constrained")
    FigureCanvasAgg(figure)
    times = [time for time, _ in samples]
    panels = figure.subplots(len(units), sharex=True, squeeze=False)[:, 0]
    for unit, panel in zip(units, panels):
        for place, parameter in enumerate(parameters):
            if parameter.unit == unit:
                values = [_plot_value(row[place]) for _, row in samples]
                # A state is drawn as steps: it does not pass through the numbers between.
                steps = bool(parameter.values or parameter.bits or parameter.type == "bool")
                panel.plot(
                    times, values, label=parameter.name, drawstyle="steps-post" if steps else "default", marker="."
                )
        panel.set_ylabel(unit)
        panel.grid(alpha=0.3)
        panel.legend(loc="best", fontsize="small")
    panels[0].set_title(title)
    panels[-1].set_xlabel("seconds")
    with port_error(f"--plot {file}"):
        figure.savefig(file)


def _plot_value(value: Value) -> float:
    """Return a value as a number; text leaves a gap in the curve."""
    return float(value) if isinstance(value, (int, float)) else float("nan")
