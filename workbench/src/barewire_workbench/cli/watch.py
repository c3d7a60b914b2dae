"""`barewire watch`: named values of a machine, read periodically: as a table, lines, JSON, CSV or a plot.

Poll k is due at t0 + k * period. If a poll takes longer than the period, the polls that became due meanwhile are left
out; later ones are not delayed. If the device refuses a request for several names, they are read one by one; from
then on the refused names are read alone, and the others together.
"""

from __future__ import annotations

import csv
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import partial
from types import MappingProxyType
from typing import NamedTuple, Protocol

import click
from rich.console import Console
from rich.live import Live
from rich.table import Table
from rich.text import Text

from barewire import connect
from barewire.codecs import Value
from barewire.devices import Device, Parameter, Reading
from barewire.devices.parameter import show
from barewire.errors import BarewireError, EncodeError, PortError, Refused
from barewire.io.machine import MachineClient
from barewire_workbench.cli.arguments import (
    check_machine,
    device_argument,
    duration,
    endpoint_argument,
    no_check_option,
    no_wait_option,
)
from barewire_workbench.cli.ending import EndedBySignal, ended_by_signals, late_response_awaited
from barewire_workbench.cli.output import note, print_json, text_with_notes
from barewire_workbench.cli.raw_address import device_with, expanded


@click.command("watch")
@endpoint_argument
@device_argument
@click.argument("names", nargs=-1, required=True, metavar="NAME...")
@click.option(
    "--period", type=duration, default=0.5, show_default=True, metavar="S", help="Seconds from one poll to the next."
)
@click.option("--count", type=click.IntRange(min=1), help="Number of polls; without it, until Ctrl-C.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object a poll.")
@click.option("--csv", "as_csv", is_flag=True, help="Print one line of CSV a poll; failed polls go to stderr.")
@click.option("--plot", metavar="FILE", help="Plot the values into FILE at the end: .svg, .png or .pdf.")
@no_wait_option
@no_check_option
def watch_command(
    endpoint: str,
    device: str,
    names: tuple[str, ...],
    period: float,
    count: int | None,
    as_json: bool,
    as_csv: bool,
    plot: str | None,
    no_wait: bool,
    no_check: bool,
) -> int:
    """Read named values periodically.

    A poll that fails is shown, and polling continues; if no poll succeeds, the exit status is 1. If the device refuses
    a name, the refusal is shown in its place and the other names are still read; in CSV its column is empty, in JSON it
    is in "refused".

    In CSV and JSON, "time" is in seconds after the first poll, "utc" the time of day in UTC (ISO 8601).
    The plot is drawn however the command ends, also by Ctrl-C or SIGTERM. If a response is missing at the end on a
    serial line, the command waits until it is not expected any more (3 time-outs after its request), or Ctrl-C again.

    \b
    barewire watch tcp://192.168.1.10 csd-mt "Position Actual Value" "Velocity Actual Value" --period 0.1
    barewire watch rtu:///dev/ttyUSB0 adxl "L1 current" --count 100 --csv --plot current.svg
    barewire watch tcp://192.168.1.20 raw input:100:f32 --period 1
    """
    if as_json and as_csv:
        raise click.UsageError("--json and --csv: expected only one of them")
    described = device_with(device, endpoint=endpoint)
    names = expanded(names, described)
    description = device_with(described, names)
    parameters = [description.find(name) for name in names]
    if plot is not None:
        from barewire_workbench.cli.plot import check_plot_file

        check_plot_file(plot)
    succeeded = False
    poller = Poller(partial(_connect, description, endpoint, no_check), description, names)
    try:
        with ExitStack() as stack:
            # The plot is drawn however the command ends: also after Ctrl-C, SIGTERM or a closed pipe.
            keep = stack.enter_context(_plotted(plot, description.title, parameters))
            stack.callback(poller.close)
            stack.enter_context(late_response_awaited(lambda: poller.machine, no_wait))
            output = stack.enter_context(_poll_output(parameters, as_json, as_csv))
            with ended_by_signals():
                for poll in polls(poller, period, count):
                    if poll.readings:
                        succeeded = True
                        keep(poll)
                    output.show(poll)
    except EndedBySignal as error:
        return error.status
    except KeyboardInterrupt:
        if count is not None:
            raise
    return 0 if succeeded else 1


# Polling

_NONE_REFUSED: Mapping[str, str] = MappingProxyType({})


class Poll(NamedTuple):
    """One reading of all names. `time` is in seconds after the first poll, `utc` is the time of day in UTC (ISO 8601).

    `refused` holds the names that the device refused, each with the reason. Without any reading, `error` is the reason.
    """

    time: float
    readings: tuple[Reading, ...]
    error: str = ""
    refused: Mapping[str, str] = _NONE_REFUSED
    utc: str = ""


class PolledMachine(Protocol):
    """What a poller uses of a machine."""

    def read(self, name: str, /) -> Reading: ...

    def read_all(self, names: Sequence[str], /) -> list[Reading]: ...

    def close(self) -> None: ...


class Poller:
    """Polls one machine. After a port failed, the next poll connects again."""

    def __init__(self, connect: Callable[[], PolledMachine], device: Device, names: Sequence[str]) -> None:
        self._connect = connect
        self._names = tuple(dict.fromkeys(device.find(name).name for name in names))
        # Names that are read alone: those refused, or all of them if they are refused only together.
        self._alone: set[str] = set()
        # A port that cannot be opened now is an error of the command; later it is the error of a poll.
        self.machine: PolledMachine | None = connect()

    def poll(self, time: float) -> Poll:
        """Read every name once."""
        try:
            if self.machine is None:
                self.machine = self._connect()
            return self._read(self.machine, time)
        except EncodeError:
            raise  # a request that cannot be encoded fails in every poll
        except BarewireError as error:
            if isinstance(error, PortError):
                self.close()
            return Poll(time, (), text_with_notes(error))

    def _read(self, machine: PolledMachine, time: float) -> Poll:
        readings: dict[str, Reading] = {}
        refused: dict[str, str] = {}
        refusal: Refused | None = None
        alone = self._alone
        try:
            together = machine.read_all([name for name in self._names if name not in alone])
            readings.update((reading.name, reading) for reading in together)
        except Refused as error:
            if len(self._names) == 1:
                raise
            refusal, alone = error, set(self._names)
        for name in self._names:
            if name in alone:
                try:
                    readings[name] = machine.read(name)
                except Refused as error:
                    refusal, refused[name] = error, str(error)
        if not readings and refusal is not None:
            raise refusal
        refused_only_together = not refused and len(alone) == len(self._names)
        self._alone = alone if refused_only_together else set(refused)
        return Poll(time, tuple(readings[name] for name in self._names if name in readings), "", refused)

    def close(self) -> None:
        """Close the port."""
        if self.machine is not None:
            self.machine.close()
            self.machine = None


def _connect(device: Device, endpoint: str, no_check: bool) -> MachineClient:
    """Connect, and ask the machine what it is."""
    machine = connect(device, endpoint)
    try:
        check_machine(machine, no_check)
    except BaseException:
        machine.close()
        raise
    return machine


def next_poll(number: int, period: float, elapsed: float) -> int:
    """Return the number of the poll after `number`: the first whose time is not over yet.

    >>> next_poll(0, 0.5, elapsed=0.1), next_poll(1, 0.5, elapsed=1.0), next_poll(2, 0.5, elapsed=2.3)
    (1, 2, 5)
    """
    # A poll that became due less than a thousandth of a period ago is still made.
    due = int(elapsed / period + 0.999)
    return max(number + 1, due)


def polls(poller: Poller, period: float, count: int | None) -> Iterator[Poll]:
    """Poll `count` times, or without end; yield each poll at its time."""
    start, number, polled = time.monotonic(), 0, 0
    while count is None or polled < count:
        time.sleep(max(0.0, start + number * period - time.monotonic()))
        utc = datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
        yield poller.poll(time.monotonic() - start)._replace(utc=utc)
        polled += 1
        number = next_poll(number, period, time.monotonic() - start)


# Output


@contextmanager
def _plotted(plot: str | None, title: str, parameters: list[Parameter]) -> Iterator[Callable[[Poll], None]]:
    """Yield a function that keeps polls; they are drawn when the block ends, with or without an exception."""
    if plot is None:
        yield lambda poll: None
        return
    from barewire_workbench.cli.plot import PlotSamples, draw_plot

    samples = PlotSamples()
    try:
        yield lambda poll: samples.add(poll.time, _values(poll, parameters))
    finally:
        if samples.samples:
            draw_plot(plot, title, parameters, samples.samples)
        else:
            note(f"--plot {plot}: no value was read, nothing is drawn")
        if samples.every > 1:
            note(f"--plot {plot}: one poll in {samples.every} is drawn")


def _values(poll: Poll, parameters: list[Parameter]) -> list[Value]:
    """Return a value for each parameter; empty text for a refused one."""
    values = {reading.name: reading.value for reading in poll.readings}
    return [values.get(parameter.name, "") for parameter in parameters]


class _PollOutput(Protocol):
    """An output format of polls."""

    def show(self, poll: Poll) -> None: ...


@contextmanager
def _poll_output(parameters: list[Parameter], as_json: bool, as_csv: bool) -> Iterator[_PollOutput]:
    """Yield the output: JSON lines, CSV, on a terminal a table that is updated, otherwise one line a poll."""
    if as_json:
        yield _JsonLines()
    elif as_csv:
        yield _Csv(parameters)
    elif sys.stdout.isatty():
        with Live(console=Console(highlight=False), auto_refresh=False) as live:
            yield _LiveTable(parameters, live)
    else:
        yield _Lines()


class _JsonLines:
    """{"time": 0.5, "utc": "...", "values": {...}}, or "error" instead of "values"; refused names are in "refused"."""

    def show(self, poll: Poll) -> None:
        fields: dict[str, object] = {"values": {reading.name: reading.value for reading in poll.readings}}
        if not poll.readings:
            fields = {"error": poll.error}
        elif poll.refused:
            fields["refused"] = dict(poll.refused)
        print_json({"time": round(poll.time, 3), "utc": poll.utc, **fields})


class _Csv:
    """A header of times and names, then numbers, empty for a refused name. stderr gets each refusal when it begins."""

    def __init__(self, parameters: list[Parameter]) -> None:
        self._parameters = parameters
        self._refused: set[str] = set()
        self._writer = csv.writer(sys.stdout, lineterminator="\n")
        self._writer.writerow(["time", "utc", *(parameter.name for parameter in parameters)])

    def show(self, poll: Poll) -> None:
        if poll.error:
            print(f"{poll.time:.3f} s: {poll.error}", file=sys.stderr, flush=True)
            return
        for name, reason in poll.refused.items():
            if name not in self._refused:
                print(f"{poll.time:.3f} s: {name}: {reason}", file=sys.stderr, flush=True)
        self._refused = set(poll.refused)
        self._writer.writerow(
            [f"{poll.time:.3f}", poll.utc, *(_number(value) for value in _values(poll, self._parameters))]
        )
        sys.stdout.flush()


def _number(value: Value) -> str:
    return str(int(value)) if isinstance(value, bool) else show(value)


class _Lines:
    """One line a poll."""

    def show(self, poll: Poll) -> None:
        refused = [f"{name}: {reason}" for name, reason in poll.refused.items()]
        text = "; ".join([*map(str, poll.readings), *refused]) if poll.readings else f"error: {poll.error}"
        print(f"{poll.time:9.3f} s  {text}", flush=True)


@dataclass
class _LiveTable:
    """A row for each name: the value, and the least and the greatest so far."""

    parameters: list[Parameter]
    live: Live
    least: dict[str, float] = field(default_factory=dict)
    greatest: dict[str, float] = field(default_factory=dict)
    texts: dict[str, str] = field(default_factory=dict)
    polled: int = 0
    failed: int = 0

    def show(self, poll: Poll) -> None:
        self.polled += 1
        self.failed += not poll.readings
        for reading in poll.readings:
            name, value = reading.name, reading.value
            self.texts[name] = reading.parameter.text(value)
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
            limits = (show(values[name]) if name in values else "" for values in (self.least, self.greatest))
            text = Text(self.texts.get(name, ""))
            if name in poll.refused:
                text = Text(poll.refused[name], style="red")
            table.add_row(Text(name), text, *map(Text, limits))
        table.caption = Text(poll.error, style="red") if poll.error else None
        table.caption_justify = "left"
        return table
