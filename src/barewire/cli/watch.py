"""`barewire watch`: named values of a machine, again and again, at times that do not drift.

poll k is due at t0 + k * period; one that took too long makes the next ones be left out, never pushed back
"""

from __future__ import annotations

import csv
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import click
from rich.console import Console
from rich.live import Live
from rich.table import Table
from rich.text import Text

from barewire.cli.arguments import device_argument, endpoint_argument, print_json
from barewire.codecs import Value
from barewire.devices import Device, Reading
from barewire.devices.parameter import Parameter, show
from barewire.devices.raw import device_with
from barewire.errors import BarewireError, EncodeError, PortError
from barewire.shells import connect
from barewire.shells.client import Client


class Poll(NamedTuple):
    """One reading of all names: what came, or why not; `time` is in seconds from the first one on."""

    time: float
    readings: tuple[Reading, ...]
    error: str = ""


def due(number: int, period: float, passed: float) -> int:
    """The number of the next poll after `number`: the first whose time is not past yet.

    >>> due(0, 0.5, passed=0.1), due(1, 0.5, passed=1.0), due(2, 0.5, passed=2.3)
    (1, 2, 5)
    """
    # Nearer than a thousandth of a period counts as now.
    missed = int(passed / period + 0.999)
    return max(number + 1, missed)


class Source:
    """Polls one device. A port that failed is opened anew at the next poll."""

    def __init__(self, endpoint: str, device: Device, names: tuple[str, ...]) -> None:
        self.endpoint, self.device, self.names = endpoint, device, names
        # The first time a port that is not there is an error; later it may have been unplugged for a while.
        self.client: Client | None = connect(endpoint)

    def poll(self, time: float) -> Poll:
        """Read once."""
        try:
            if self.client is None:
                self.client = connect(self.endpoint)
            return Poll(time, tuple(self.client.read(self.device, *self.names)))
        except EncodeError:
            raise  # what cannot be asked for today cannot be asked for tomorrow
        except BarewireError as error:
            if isinstance(error, PortError):
                self.close()
            return Poll(time, (), "; ".join([str(error), *getattr(error, "__notes__", [])]))

    def close(self) -> None:
        """Give the port back."""
        if self.client is not None:
            self.client.close()
            self.client = None


def polls(source: Source, period: float, count: int | None) -> Iterator[Poll]:
    """Poll after poll, each at its time, until `count` of them were made."""
    began, number, made = time.monotonic(), 0, 0
    while count is None or made < count:
        time.sleep(max(0.0, began + number * period - time.monotonic()))
        yield source.poll(time.monotonic() - began)
        made += 1
        number = due(number, period, time.monotonic() - began)


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

    A poll that fails is shown, and polling goes on; with none that succeeded the exit status is 1.

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
        yield lambda poll: kept.add(poll.time, _values(poll))
    finally:
        if kept.samples:
            draw(plot, title, parameters, kept.samples)
        else:
            print(f"barewire: --plot {plot}: no value came, nothing is drawn", file=sys.stderr)
        if kept.every > 1:
            print(f"barewire: --plot {plot}: one poll of {kept.every} is drawn", file=sys.stderr)


def _values(poll: Poll) -> list[Value]:
    return [reading.value for reading in poll.readings]


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
        yield Csv([parameter.name for parameter in parameters])
    elif sys.stdout.isatty():
        with Live(console=Console(highlight=False), auto_refresh=False) as live:
            yield LiveTable(parameters, live)
    else:
        yield Lines()


class JsonLines:
    """{"time": 0.5, "values": {...}}, or "error" in place of "values"."""

    def tell(self, poll: Poll) -> None:
        """One line."""
        said = {"values": {r.name: r.value for r in poll.readings}} if poll.readings else {"error": poll.error}
        print_json({"time": round(poll.time, 3), **said})


class Csv:
    """time and the names as a header, then numbers."""

    def __init__(self, names: list[str]) -> None:
        self._writer = csv.writer(sys.stdout, lineterminator="\n")
        self._writer.writerow(["time", *names])

    def tell(self, poll: Poll) -> None:
        """One row; a poll that failed is none."""
        if poll.error:
            print(f"{poll.time:.3f} s: {poll.error}", file=sys.stderr, flush=True)
            return
        self._writer.writerow([f"{poll.time:.3f}", *(_number(value) for value in _values(poll))])
        sys.stdout.flush()


def _number(value: Value) -> str:
    return str(int(value)) if isinstance(value, bool) else show(value)


class Lines:
    """For a pipe: everything of one poll in one line."""

    def tell(self, poll: Poll) -> None:
        """One line."""
        said = "; ".join(str(reading) for reading in poll.readings) if poll.readings else f"error: {poll.error}"
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
            table.add_row(*(Text(cell) for cell in (name, self.shown.get(name, ""), *limits)))
        table.caption = Text(poll.error, style="red") if poll.error else None
        table.caption_justify = "left"
        return table
