"""`barewire watch`: named values of a machine, again and again, as a table, lines, JSON, CSV or a picture."""

from __future__ import annotations

import csv
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from typing import Protocol

import click
from rich.console import Console
from rich.live import Live
from rich.table import Table
from rich.text import Text

from barewire.cli.arguments import device_argument, endpoint_argument, print_json
from barewire.cli.polling import Poll, Source, polls
from barewire.codecs import Value
from barewire.devices.parameter import Parameter, show
from barewire.devices.raw_address import device_with


@click.command()
@endpoint_argument
@device_argument
@click.argument("names", nargs=-1, required=True, metavar="NAME...")
@click.option("--period", default=0.5, show_default=True, metavar="S", help="Seconds from one poll to the next.")
@click.option("--count", type=click.IntRange(min=1), help="How many polls; without it, until Ctrl-C.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object a poll.")
@click.option("--csv", "as_csv", is_flag=True, help="One line of CSV a poll; failed polls are told on stderr.")
@click.option("--plot", metavar="FILE", help="Draw the values in FILE at the end: .svg, .png or .pdf.")
def watch(
    endpoint: str,
    device: str,
    names: tuple[str, ...],
    period: float,
    count: int | None,
    as_json: bool,
    as_csv: bool,
    plot: str | None,
) -> int:
    """Read named values periodically.

    A poll that fails is shown, and polling goes on; with none that succeeded the exit status is 1. A name that is
    refused is shown as that, and the others go on; in CSV its column is empty, in JSON it is in "refused".

    \b
    barewire watch tcp://192.168.1.10 csd-mt "Position Actual Value" "Velocity Actual Value" --period 0.1
    barewire watch rtu:///dev/ttyUSB0 adxl "L1 current" --count 100 --csv --plot current.svg
    barewire watch tcp://192.168.1.20 raw input:100:f32 --period 1
    """
    if as_json and as_csv:
        raise click.UsageError("--json and --csv: one of them")
    if not 0 < period < 1e6:
        raise click.UsageError(f"--period {period:g}: expected seconds, above 0 and below 1000000")
    machine = device_with(device, names)
    parameters = [machine.find(name) for name in names]
    if plot is not None:
        from barewire.cli.plot import check

        check(plot)
    answered = False
    source = Source(endpoint, machine, names)
    with ExitStack() as stack:
        # Drawn in any case: after Ctrl-C, and when whoever read the output has had enough.
        keep = stack.enter_context(drawn(plot, machine.title, parameters))
        stack.callback(source.close)
        if count is None:
            stack.enter_context(suppress(KeyboardInterrupt))
        teller = stack.enter_context(told(parameters, as_json, as_csv))
        for poll in polls(source, period, count):
            if poll.readings:
                answered = True
                keep(poll)
            teller.tell(poll)
    return 0 if answered else 1


@contextmanager
def drawn(plot: str | None, title: str, parameters: list[Parameter]) -> Iterator[Callable[[Poll], None]]:
    """Who keeps the polls, and draws them at the end, however it ends."""
    if plot is None:
        yield lambda poll: None
        return
    from barewire.cli.plot import Kept, draw

    kept = Kept()
    try:
        yield lambda poll: kept.add(poll.time, _values(poll, parameters))
    finally:
        if kept.samples:
            draw(plot, title, parameters, kept.samples)
        else:
            print(f"barewire: --plot {plot}: no value came, nothing is drawn", file=sys.stderr)
        if kept.every > 1:
            print(f"barewire: --plot {plot}: one poll of {kept.every} is drawn", file=sys.stderr)


def _values(poll: Poll, parameters: list[Parameter]) -> list[Value]:
    """A value for each name; empty text for one that was refused."""
    came = {reading.name: reading.value for reading in poll.readings}
    return [came.get(parameter.name, "") for parameter in parameters]


# How it is told


class Teller(Protocol):
    """Who is told of every poll."""

    def tell(self, poll: Poll) -> None: ...


@contextmanager
def told(parameters: list[Parameter], as_json: bool, as_csv: bool) -> Iterator[Teller]:
    """JSON lines, CSV, a living table on a terminal, or a line for each poll."""
    if as_json:
        yield JsonLines()
    elif as_csv:
        yield Csv(parameters)
    elif sys.stdout.isatty():
        with Live(console=Console(highlight=False), auto_refresh=False) as live:
            yield LiveTable(parameters, live)
    else:
        yield Lines()


class JsonLines:
    """{"time": 0.5, "values": {...}}, or "error" in place of "values"; names that were refused in "refused"."""

    def tell(self, poll: Poll) -> None:
        """One line."""
        said: dict[str, object] = {"values": {reading.name: reading.value for reading in poll.readings}}
        if not poll.readings:
            said = {"error": poll.error}
        elif poll.refused:
            said["refused"] = dict(poll.refused)
        print_json({"time": round(poll.time, 3), **said})


class Csv:
    """time and the names as a header, then numbers; nothing where a name was refused, told on stderr when it begins."""

    def __init__(self, parameters: list[Parameter]) -> None:
        self._parameters = parameters
        self._refused: set[str] = set()
        self._writer = csv.writer(sys.stdout, lineterminator="\n")
        self._writer.writerow(["time", *(parameter.name for parameter in parameters)])

    def tell(self, poll: Poll) -> None:
        """One row; a poll that failed is none."""
        if poll.error:
            print(f"{poll.time:.3f} s: {poll.error}", file=sys.stderr, flush=True)
            return
        for name, words in poll.refused.items():
            if name not in self._refused:
                print(f"{poll.time:.3f} s: {name}: {words}", file=sys.stderr, flush=True)
        self._refused = set(poll.refused)
        self._writer.writerow([f"{poll.time:.3f}", *(_number(value) for value in _values(poll, self._parameters))])
        sys.stdout.flush()


def _number(value: Value) -> str:
    return str(int(value)) if isinstance(value, bool) else show(value)


class Lines:
    """For a pipe: everything of one poll in one line."""

    def tell(self, poll: Poll) -> None:
        """One line."""
        refused = [f"{name}: {words}" for name, words in poll.refused.items()]
        said = "; ".join([*map(str, poll.readings), *refused]) if poll.readings else f"error: {poll.error}"
        print(f"{poll.time:9.3f} s  {said}", flush=True)


@dataclass
class LiveTable:
    """A row for each name: the value, and the least and the greatest so far."""

    parameters: list[Parameter]
    live: Live
    least: dict[str, float] = field(default_factory=dict)
    greatest: dict[str, float] = field(default_factory=dict)
    shown: dict[str, str] = field(default_factory=dict)
    polled: int = 0
    failed: int = 0

    def tell(self, poll: Poll) -> None:
        """Draw the table anew."""
        self.polled += 1
        self.failed += not poll.readings
        for reading in poll.readings:
            name, value = reading.name, reading.value
            self.shown[name] = reading.parameter.text(value)
            if isinstance(value, (int, float)):
                self.least[name] = min(self.least.get(name, value), value)
                self.greatest[name] = max(self.greatest.get(name, value), value)
        self.live.update(self._table(poll), refresh=True)

    def _table(self, poll: Poll) -> Table:
        failed = f", {self.failed} failed" if self.failed else ""
        table = Table(title=f"{poll.time:.1f} s, {self.polled} polls{failed}", title_justify="left")
        for title in ("name", "value", "least", "greatest"):
            table.add_column(title, overflow="fold")
        for parameter in self.parameters:
            name = parameter.name
            limits = (show(held[name]) if name in held else "" for held in (self.least, self.greatest))
            value = Text(self.shown.get(name, ""))
            if name in poll.refused:
                value = Text(poll.refused[name], style="red")
            table.add_row(Text(name), value, *map(Text, limits))
        table.caption = Text(poll.error, style="red") if poll.error else None
        table.caption_justify = "left"
        return table
