"""`barewire plot`, and `--plot` of `watch`: one panel for each unit, over time. The only file that needs matplotlib."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from warnings import catch_warnings, simplefilter

import click

from barewire.errors import EncodeError, PortError
from barewire_workbench.cli.output import (
    check_no_device,
    check_not_overwritten,
    needs_extra,
    note,
    port_error,
    printable,
)
from barewire_workbench.value_log.reader import Curve, broken, read_logs

_FORMATS = (".svg", ".png", ".pdf")
_MOST_CURVES = 100


@click.command("plot")
@click.argument("files", nargs=-1, required=True, metavar="FILE...")
@click.option("--name", "names", multiple=True, metavar="NAME", help="Draw only this value; several times for several.")
@click.option(
    "--to", "path", metavar="FILE", help="Draw into this file: .svg, .png or .pdf; without, NAME.svg beside it."
)
@click.option("--connect", is_flag=True, help="Draw lines over gaps too, as for a log of watch --change.")
def plot_command(files: tuple[str, ...], names: tuple[str, ...], path: str | None, connect: bool) -> None:
    """Draw a log that `barewire watch --to` wrote.

    FILE is a .csv or .db; several, such as the full files of a rotation, are drawn one behind the other. There is a
    panel for each unit. A curve has a gap where its value was not read, and where three intervals or more have no row.

    \b
    barewire plot night.csv
    barewire plot night-*.csv night.csv --name "L1 current" --to currents.png
    """
    target = path or f"{os.path.splitext(files[-1])[0]}.svg"
    check_plot_file("--to", target)
    check_not_overwritten("--to", target, *files)
    for file in files:
        check_no_device(file)
    curves = read_logs(files, names)
    if not curves.curves:
        raise EncodeError(f"{', '.join(files)}: no numbers in it")
    check_number_of_curves("--to", target, len(curves.curves))
    draw_plot(target, target, curves.curves if connect else [broken(curve) for curve in curves.curves])
    drawn = f", one in {curves.every} is drawn" if curves.every > 1 else ""
    left_out = f", {curves.left_out} left out that are damaged" if curves.left_out else ""
    note(f"{target}: {curves.count} rows{drawn}{left_out}")


def check_number_of_curves(option: str, file: str, count: int) -> None:
    """Raise EncodeError for a plot that would be too high to be drawn."""
    if count > _MOST_CURVES:
        raise EncodeError(f"{option} {file}: {count} curves: expected at most {_MOST_CURVES}: --name chooses some")


def check_plot_file(option: str, file: str) -> None:
    """Check before the first poll that the plot can be written at the end. Raises EncodeError, PortError."""
    path = Path(file).absolute()
    if path.suffix.lower() not in _FORMATS:
        raise EncodeError(f"{option} {file}: expected a name that ends in {', '.join(_FORMATS)}")
    if not path.parent.is_dir():
        raise PortError(f"{option} {file}: the directory does not exist")
    if path.is_dir():
        raise EncodeError(f"{option} {file}: expected a file, not a directory")
    if not os.access(path if path.exists() else path.parent, os.W_OK):
        raise PortError(f"{option} {file}: no permission to write there")
    with needs_extra("drawing", "plot", "matplotlib"):
        import matplotlib  # noqa: F401


def draw_plot(name: str, file: str, curves: Sequence[Curve]) -> None:
    """Draw curves into a file. PortError with `name` if it cannot be written."""
    # Without pyplot there is no window and no global state.
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
    from matplotlib.figure import Figure

    units = list(dict.fromkeys(curve.unit for curve in curves))
    heights = [max(2.2, 0.2 * sum(curve.unit == unit for curve in curves)) for unit in units]  # room for the names
    figure = Figure(figsize=(9.0, 1.5 + sum(heights)), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(len(units), sharex=True, squeeze=False, height_ratios=heights)[:, 0]
    for unit, panel in zip(units, panels):
        for curve in curves:
            if curve.unit == unit:
                style = "steps-post" if curve.is_state else "default"
                # A label that begins with _ is not shown.
                title = f"{' ' * curve.title.startswith('_')}{printable(curve.title)}"
                panel.plot(curve.times, curve.values, label=title, drawstyle=style, marker=".", markersize=3)
        panel.set_ylabel(printable(unit), parse_math=False)
        panel.grid(alpha=0.3)
        for text in panel.legend(loc="best", fontsize="small").get_texts():
            text.set_parse_math(False)  # a $ is a $
    zone = curves[0].times[0].tzinfo if curves[0].times else None
    locator = AutoDateLocator(tz=zone)  # type: ignore[no-untyped-call]
    panels[-1].xaxis.set_major_locator(locator)
    panels[-1].xaxis.set_major_formatter(ConciseDateFormatter(locator, tz=zone))  # type: ignore[no-untyped-call]
    with port_error(name), catch_warnings():
        simplefilter("ignore")  # a letter that the font does not have is drawn as a box
        figure.savefig(file)
