"""Drawing what was watched: one panel for each unit, time along the bottom. Needs the extra `plot`, only here."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from barewire.codecs import Value
from barewire.devices.parameter import Parameter
from barewire.errors import EncodeError, PortError

FORMATS = (".svg", ".png", ".pdf")

Samples = Sequence[tuple[float, Sequence[Value]]]
"""(seconds, a value for each parameter)."""


class Kept:
    """What is kept to be drawn, of a watch that may go on for weeks: at most `most` polls, evenly spread.

    >>> kept = Kept(most=4)
    >>> for number in range(11):
    ...     kept.add(float(number), [number])
    >>> [time for time, _ in kept.samples], kept.every
    ([0.0, 4.0, 8.0], 4)
    """

    def __init__(self, most: int = 20_000) -> None:
        self.most = most
        self.samples: list[tuple[float, Sequence[Value]]] = []
        self.every = 1
        """One of so many polls is kept."""
        self._came = 0

    def add(self, time: float, values: Sequence[Value]) -> None:
        """One poll."""
        if self._came % self.every == 0:
            self.samples.append((time, values))
        self._came += 1
        if len(self.samples) > self.most:
            self.samples = self.samples[::2]
            self.every *= 2


def check(file: str) -> None:
    """Whether it can be drawn at the end, told before anything is watched."""
    path = Path(file).absolute()
    if path.suffix.lower() not in FORMATS:
        raise EncodeError(f"--plot {file}: expected a name that ends in {', '.join(FORMATS)}")
    if not path.parent.is_dir():
        raise EncodeError(f"--plot {file}: there is no such directory")
    if path.is_dir():
        raise EncodeError(f"--plot {file}: that is a directory")
    if not os.access(path if path.exists() else path.parent, os.W_OK):
        raise EncodeError(f"--plot {file}: no permission to write there")
    try:
        import matplotlib  # noqa: F401
    except ModuleNotFoundError:
        raise PortError("drawing needs the extra 'plot': pip install 'barewire[plot]'") from None


def draw(file: str, title: str, parameters: Sequence[Parameter], samples: Samples) -> None:
    """Draw the samples in a file."""
    # The object-oriented way: no window, no state that is shared with anybody.
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
                values = [_height(row[place]) for _, row in samples]
                # What has names instead of sizes does not pass through the values between.
                steps = bool(parameter.values or parameter.bits or parameter.type == "bool")
                panel.plot(
                    times, values, label=parameter.name, drawstyle="steps-post" if steps else "default", marker="."
                )
        panel.set_ylabel(unit)
        panel.grid(alpha=0.3)
        panel.legend(loc="best", fontsize="small")
    panels[0].set_title(title)
    panels[-1].set_xlabel("seconds")
    try:
        figure.savefig(file)
    except OSError as error:
        raise PortError(f"--plot {file}: {error.strerror or error}") from None


def _height(value: Value) -> float:
    """A value as a number; what is none is left out of the curve."""
    return float(value) if isinstance(value, (int, float)) else float("nan")
