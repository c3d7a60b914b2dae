"""`barewire watch`: named values of machines, read periodically, on the screen, into a log, and as a plot."""

from __future__ import annotations

import re
import sys
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from functools import partial
from typing import Protocol

import click
from rich.console import Console
from rich.live import Live
from rich.table import Table
from rich.text import Text

from barewire.codecs import Value
from barewire.devices.parameter import show
from barewire.errors import PortError, shown
from barewire_workbench.cli.arguments import (
    check_machine,
    check_no_file_name,
    device_argument,
    duration,
    endpoint_argument,
    endpoint_url,
    no_check_option,
    no_wait_option,
)
from barewire_workbench.cli.completion import complete_name
from barewire_workbench.cli.ending import EndedBySignal, ended_by_signals, late_response_awaited
from barewire_workbench.cli.log_file import kept, open_log, signals_later
from barewire_workbench.cli.output import note, print_json
from barewire_workbench.cli.raw_address import device_with, expanded, is_raw_address, names_to_read
from barewire_workbench.cli.value_text import parse_value
from barewire_workbench.live.polling import Clock, PolledLine, by_port, samples
from barewire_workbench.live.read_values import is_pattern
from barewire_workbench.value_log.condition import Condition, condition, name_in
from barewire_workbench.value_log.csv_file import csv_line
from barewire_workbench.value_log.rotating_log import RotatingLog, rotation
from barewire_workbench.value_log.sample import (
    Column,
    Sample,
    Watched,
    cell_text,
    columns_of,
    error_text,
    headings,
    labelled,
    row_of,
    time_text,
    values_of,
)
from barewire_workbench.value_log.selection import Selection

_AND = "--and"
_AND_WORD = "\0and"
"""What stands for --and among the names."""


class _WatchCommand(click.Command):
    """A command whose names may be followed by `--and ENDPOINT DEVICE NAME...`, any number of times."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse the arguments, with --and as one of the names."""
        return super().parse_args(ctx, [_AND_WORD if word == _AND else word for word in args])


@click.command("watch", cls=_WatchCommand)
@endpoint_argument
@device_argument
@click.argument("names", nargs=-1, required=True, metavar="NAME...", shell_complete=complete_name)
@click.option(
    _AND,
    expose_value=False,  # it is among the names
    metavar="ENDPOINT DEVICE NAME...",
    help="Another machine, with its names; any number of times.",
)
@click.option(
    "--period", type=duration, default=0.5, show_default=True, metavar="S", help="Seconds from one poll to the next."
)
@click.option("--count", type=click.IntRange(min=1), help="Number of polls; without it, until Ctrl-C.")
@click.option("--for", "seconds", type=duration, metavar="TIME", help="How long, such as 90, 15m, 12h or 7d.")
@click.option("--until", metavar="TIME", help="Until a time of day, 06:00, or of a date, 2026-11-29T06:00.")
@click.option("--to", "path", metavar="FILE", help="Write the values into a log: .csv, or .db for SQLite.")
@click.option("--append", is_flag=True, help="Add to the file of --to if it exists.")
@click.option("--rotate", multiple=True, metavar="WHEN", help="Begin the file anew: day, or a size such as 10MB.")
@click.option("--keep", type=click.IntRange(min=1), help="Keep so many full files, and remove older ones.")
@click.option("--when", "conditions", multiple=True, metavar="CONDITION", help='Only while "STATUS WORD.3 == 1".')
@click.option("--every", type=click.IntRange(min=1), default=1, help="Write only one poll in so many.")
@click.option(
    "--change", type=float, metavar="X", help="Write only if a value differs by X or more from the last row; 0: at all."
)
@click.option("--at-least", type=duration, metavar="TIME", help="With --change: write a row at least so often.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object a poll.")
@click.option("--csv", "as_csv", is_flag=True, help="Print one line of CSV a poll, as --to writes it.")
@click.option("--plot", metavar="FILE", help="Plot the values into FILE at the end: .svg, .png or .pdf.")
@no_wait_option
@no_check_option
def watch_command(
    endpoint: str,
    device: str,
    names: tuple[str, ...],
    period: float,
    count: int | None,
    seconds: float | None,
    until: str | None,
    path: str | None,
    append: bool,
    rotate: tuple[str, ...],
    keep: int | None,
    conditions: tuple[str, ...],
    every: int,
    change: float | None,
    at_least: float | None,
    as_json: bool,
    as_csv: bool,
    plot: str | None,
    no_wait: bool,
    no_check: bool,
) -> int:
    """Read named values periodically, and log them.

    A poll that fails is shown, and polling continues; if no poll succeeds, the exit status is 1. If the device refuses
    a name, the refusal is shown in its place and the other names are still read. In CSV and JSON, "time" is the time of
    day with its zone (ISO 8601), "error" what was not read.

    The rows of a log are in the file before they are shown, and after SIGTERM, SIGHUP, SIGKILL; at most a second later
    they are on the disk, also after a power cut. While the disk is full, 10000 rows wait in memory.

    The plot is drawn however the command ends, also by Ctrl-C or SIGTERM. If a response is missing at the end on a
    serial line, the command waits until it is not expected any more (3 time-outs after its request), or Ctrl-C again.

    \b
    barewire watch tcp://192.168.1.10 csd-mt "Position Actual Value" "Velocity Actual Value" --period 0.1
    barewire watch rtu:///dev/ttyUSB0 adxl "L1 current" --to night.csv --append --period 10 --for 12h --rotate day
    barewire watch tcp://192.168.1.10 csd-mt "Velocity Actual Value" --when "Status Word.3 == 1" --csv
    barewire watch can://socketcan/can0 az3 "DC BUS" --and rtu:///dev/ttyUSB0 adxl Status --to both.db
    """
    if as_json and as_csv:
        raise click.UsageError("--json and --csv: expected only one of them")
    if path is None and (append or rotate or keep):
        raise click.UsageError("--append, --rotate and --keep are for the file of --to FILE")
    if at_least is not None and change is None:
        raise click.UsageError("--at-least is for rows that --change leaves out")
    if change is not None and not change >= 0:
        raise click.UsageError("--change: expected 0 or more")
    limit = min((end for end in (seconds, seconds_until(until, datetime.now())) if end is not None), default=None)
    given = labelled([_watched(*group, conditions) for group in _groups(endpoint, device, names)])
    machines = [watched for group in by_port(given) for watched in group]  # in the order in which they are read
    chosen = [condition(text, machines, parse_value) for text in conditions]
    machines = [_with_conditions(number, watched, chosen) for number, watched in enumerate(machines)]
    lines = [PolledLine(group, partial(check_machine, no_check=no_check)) for group in by_port(machines)]
    columns = columns_of(machines)
    selection = Selection(columns, chosen, every, change, at_least)
    if plot is not None:
        from barewire_workbench.cli.plot import check_number_of_curves, check_plot_file

        check_plot_file("--plot", plot)
        check_number_of_curves("--plot", plot, len(columns))
    log = None
    if path is not None:
        log = open_log(path, headings(columns), append=append, rotation=rotation(rotate, keep or 0))
    succeeded, clock = False, Clock()
    try:
        with ExitStack() as stack:
            # The plot is drawn however the command ends: also after Ctrl-C, SIGTERM or a closed pipe.
            draw = stack.enter_context(_plotted(plot, columns))
            if log is not None:
                problems = stack.enter_context(kept(log, clock))
            for line in lines:
                stack.callback(line.close)
                stack.enter_context(late_response_awaited(partial(getattr, line, "machine"), no_wait))
            with ended_by_signals():
                for line in lines:
                    _check(line, is_needed=log is None and len(lines) == 1)
                output = stack.enter_context(_output(machines, columns, log, as_json, as_csv))
                for sample in samples(lines, period, clock=clock, count=count, until=limit):
                    values, error = values_of(sample, columns), error_text(sample, machines)
                    is_row = selection.takes(values, error, sample.seconds)
                    if any(poll.readings for poll in sample.polls):
                        succeeded = True
                        draw(sample)
                    if log is not None:
                        with signals_later():
                            if is_row:
                                log.add([time_text(sample.at), *values, error], clock.now())
                            else:
                                log.advance(clock.now())
                        problems.show()
                    output.show(sample, is_row)
    except EndedBySignal as error:
        return error.status
    except KeyboardInterrupt:
        if count is not None or limit is not None:
            raise
    return 0 if succeeded and not (log and log.lost) else 1


def _check(line: PolledLine, *, is_needed: bool) -> None:
    """Open a port, and ask the machines on it what they are: another one is an error of the command. One that cannot be
    reached is an error of a poll, unless it is needed, and later also then."""
    try:
        line.check()
    except PortError:
        if is_needed:
            raise


# Arguments


def _groups(endpoint: str, device: str, names: Sequence[str]) -> Iterator[tuple[str, str, list[str]]]:
    """Yield the machines of the arguments: endpoint, device, names."""
    groups: list[list[str]] = [[endpoint, device]]
    for word in names:
        if word == _AND_WORD:
            groups.append([])
        else:
            groups[-1].append(word)
    for words in groups:
        if len(words) < 3:
            raise click.UsageError(f"{_AND} {' '.join(words)}: expected ENDPOINT DEVICE NAME...")
        yield endpoint_url(words[0]), words[1], words[2:]


def _watched(endpoint: str, device: str, names: Sequence[str], conditions: Sequence[str]) -> Watched:
    check_no_file_name(names)
    described = device_with(device, endpoint=endpoint)
    all_names = expanded(names, described)
    addresses = [name for name in map(name_in, conditions) if is_raw_address(name)]
    description = device_with(described, [*(name for name in all_names if not is_pattern(name)), *addresses])
    return Watched(endpoint, description, tuple(names_to_read(description, endpoint, all_names)))


def _with_conditions(number: int, watched: Watched, conditions: Sequence[Condition]) -> Watched:
    """Return the machine with the names of its conditions: they are read too, and are columns."""
    needed = [each.column.parameter.name for each in conditions if each.column.machine == number]
    return watched._replace(names=tuple(dict.fromkeys([*watched.names, *needed])))


def seconds_until(text: str | None, now: datetime) -> float | None:
    """Return the seconds until a time: of the next day if it is over today. `now` is local, without a zone: the zone of
    this day need not be that of the next."""
    if text is None:
        return None
    try:
        if re.fullmatch(r"\d{1,2}:\d\d(:\d\d)?", text):
            hour, minute, second = (*map(int, text.split(":")), 0)[:3]
            end = now.replace(hour=hour, minute=minute, second=second, microsecond=0)
            end += timedelta(days=end <= now)
        else:
            end = datetime.fromisoformat(text)
        seconds = end.timestamp() - now.timestamp()
    except (ValueError, OverflowError, OSError):  # the latter of a year that the computer cannot count
        expected = "expected a time such as 06:00, or 2026-11-29T06:00"
        raise click.UsageError(f"--until {shown(text)}: {expected}") from None
    if seconds <= 0:
        raise click.UsageError(f"--until {shown(text)}: that is over, now it is {now:%Y-%m-%dT%H:%M:%S}")
    return seconds


# Output


@contextmanager
def _plotted(plot: str | None, columns: Sequence[Column]) -> Iterator[Callable[[Sample], None]]:
    """Yield a function that keeps samples; they are drawn when the block ends, with or without an exception."""
    if plot is None:
        yield lambda sample: None
        return
    from barewire_workbench.cli.plot import draw_plot
    from barewire_workbench.value_log.reader import Curves

    curves = Curves([(column.title, column.parameter.unit) for column in columns])
    try:
        yield lambda sample: curves.add(sample.at, values_of(sample, columns))
    finally:
        if curves.count:
            draw_plot(f"--plot {plot}", plot, curves.curves)
        else:
            note(f"--plot {plot}: no value was read, nothing is drawn")
        if curves.every > 1:
            note(f"--plot {plot}: one poll in {curves.every} is drawn")


class _Output(Protocol):
    """An output format of samples. `is_row` says whether the sample is one that is logged."""

    def show(self, sample: Sample, is_row: bool) -> None: ...


@contextmanager
def _output(
    machines: Sequence[Watched], columns: Sequence[Column], log: RotatingLog | None, as_json: bool, as_csv: bool
) -> Iterator[_Output]:
    """Yield the output: JSON lines, CSV, on a terminal a table that is updated, otherwise one line a sample, or nothing
    beside a log."""
    if as_json:
        yield _JsonLines(machines, columns)
    elif as_csv:
        yield _Csv(machines, columns)
    elif sys.stdout.isatty():
        with Live(console=Console(highlight=False), auto_refresh=False) as live:
            yield _LiveTable(machines, columns, live, log)
    elif log is not None:
        yield _Nothing()
    else:
        yield _Lines(machines)


class _Nothing:
    """No output."""

    def show(self, sample: Sample, is_row: bool) -> None:
        """Print nothing."""


@dataclass
class _JsonLines:
    """{"time": "...", "seconds": 0.5, "values": {...}, "error": "..."}, without values or error if there are none."""

    machines: Sequence[Watched]
    columns: Sequence[Column]

    def show(self, sample: Sample, is_row: bool) -> None:
        """Print a row as an object."""
        if not is_row:
            return
        values = zip(self.columns, values_of(sample, self.columns))
        fields = {
            "values": {column.title: value for column, value in values if value is not None},
            "error": error_text(sample, self.machines),
        }
        told = {key: value for key, value in fields.items() if value}
        print_json({"time": time_text(sample.at), "seconds": round(sample.seconds, 3), **told})


class _Csv:
    """The heading and the rows of a log."""

    def __init__(self, machines: Sequence[Watched], columns: Sequence[Column]) -> None:
        self._machines, self._columns = machines, columns
        self._print(headings(columns))

    def show(self, sample: Sample, is_row: bool) -> None:
        """Print a row."""
        if is_row:
            self._print([cell_text(value) for value in row_of(sample, self._columns, self._machines)])

    def _print(self, cells: Sequence[str]) -> None:
        print(csv_line(cells).decode(), end="", flush=True)


@dataclass
class _Lines:
    """One line a sample."""

    machines: Sequence[Watched]

    def show(self, sample: Sample, is_row: bool) -> None:
        """Print a row: the values of each machine, or its error."""
        if not is_row:
            return
        parts = []
        for watched, poll in zip(self.machines, sample.polls):
            refused = [f"{name}: {reason}" for name, reason in poll.refused.items()]
            text = "; ".join([*map(str, poll.readings), *refused]) if poll.readings else f"error: {poll.error}"
            parts.append(f"{watched.label}: {text}" if watched.label else text)
        print(f"{sample.seconds:9.3f} s  {' | '.join(parts)}", flush=True)


_TREND = 40
"""Values of which the trend of a live table is drawn."""
_HEIGHTS = "▁▂▃▄▅▆▇█"


def trend(values: Sequence[float]) -> str:
    """Return a curve of one line, from the least of the values to the greatest.

    >>> trend([0, 5, 10, 10, 0])
    '▁▅██▁'
    """
    least, greatest = min(values), max(values)
    scale = (len(_HEIGHTS) - 1) / (greatest - least) if greatest > least else 0.0
    return "".join(_HEIGHTS[int((value - least) * scale + 0.5)] for value in values)


@dataclass
class _LiveTable:
    """A row for each value: what it is, its least and greatest so far, and its trend."""

    machines: Sequence[Watched]
    columns: Sequence[Column]
    live: Live
    log: RotatingLog | None
    numbers: dict[Column, deque[float]] = field(default_factory=dict)
    least: dict[Column, float] = field(default_factory=dict)
    greatest: dict[Column, float] = field(default_factory=dict)
    texts: dict[Column, str] = field(default_factory=dict)
    polled: int = 0
    failed: int = 0

    def show(self, sample: Sample, is_row: bool) -> None:
        """Show a sample in the table."""
        self.polled += 1
        self.failed += not any(poll.readings for poll in sample.polls)
        for column, value in zip(self.columns, values_of(sample, self.columns)):
            if value is not None:
                self._keep(column, value)
        self.live.update(self._table(sample), refresh=True)

    def _keep(self, column: Column, value: Value) -> None:
        self.texts[column] = column.parameter.text(value)
        if isinstance(value, (int, float)) and abs(value) < float("inf"):
            self.least[column] = min(self.least.get(column, value), value)
            self.greatest[column] = max(self.greatest.get(column, value), value)
            self.numbers.setdefault(column, deque(maxlen=_TREND)).append(value)

    def _table(self, sample: Sample) -> Table:
        failed = f", {self.failed} failed" if self.failed else ""
        title = f"{sample.seconds:.1f} s, {self.polled} polls{failed}"
        if self.log is not None:
            waits = f", {self.log.problem}: rows wait" if self.log.problem else ""
            title += f"; {self.log.path}: {self.log.written} rows{waits}"
        table = Table(title=title, title_justify="left")
        for heading in ("name", "value", "least", "greatest", "trend"):
            table.add_column(heading, overflow="fold")
        for column in self.columns:
            limits = (show(values[column]) if column in values else "" for values in (self.least, self.greatest))
            text = Text(self.texts.get(column, ""))
            if reason := sample.polls[column.machine].refused.get(column.parameter.name):
                text = Text(reason, style="red")
            curve = trend(self.numbers[column]) if column in self.numbers else ""
            table.add_row(Text(column.title), text, *map(Text, limits), Text(curve))
        errors = [
            f"{watched.label}: {poll.error}" if watched.label else poll.error
            for watched, poll in zip(self.machines, sample.polls)
            if poll.error
        ]
        table.caption = Text("\n".join(errors), style="red") if errors else None
        table.caption_justify = "left"
        return table
