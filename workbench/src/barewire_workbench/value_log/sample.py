"""What is read at one time: a sample has a poll of each machine, and becomes a row with a column for each value.

watch A az3 SPEED "DC BUS" --and B adxl Status

sample    polls of az3, adxl
columns  time    az3: SPEED [rpm]    az3: DC BUS [V]    adxl: Status    error
row      ...     1500                320                                adxl: unit 1 did not answer ...
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from types import MappingProxyType
from typing import NamedTuple, TypeAlias

from barewire.codecs import Value
from barewire.devices import Device, Parameter, Reading
from barewire.devices.parameter import show

_NONE_REFUSED: Mapping[str, str] = MappingProxyType({})

TIME, ERROR = "time", "error"
"""The first and the last column."""

_LONGEST_ERROR = 500

Row: TypeAlias = Sequence[Value | None]
"""The time as text, the values, None for one that was not read, and the error as text."""


class Watched(NamedTuple):
    """A machine with the names that are read of it. `label` tells it from the others; empty if it is the only one."""

    endpoint: str
    device: Device
    names: tuple[str, ...]
    label: str = ""


class Poll(NamedTuple):
    """One reading of all names of a machine.

    `refused` has the names that the machine refused, each with the reason. Without any reading, `error` is the reason.
    """

    readings: tuple[Reading, ...]
    error: str = ""
    refused: Mapping[str, str] = _NONE_REFUSED


class Sample(NamedTuple):
    """A poll of each machine; `seconds` are those after the first sample, `at` is the time of day with its zone."""

    seconds: float
    at: datetime
    polls: tuple[Poll, ...]


class Column(NamedTuple):
    """A value of a log: which machine it is of, by its number, and which parameter."""

    machine: int
    label: str
    parameter: Parameter

    @property
    def title(self) -> str:
        """The name, with the label of the machine if there are several."""
        return f"{self.label}: {self.parameter.name}" if self.label else self.parameter.name

    @property
    def heading(self) -> str:
        """The title with the unit, such as 'Speed [rpm]'."""
        return f"{self.title} [{self.parameter.unit}]" if self.parameter.unit else self.title


def columns_of(machines: Sequence[Watched]) -> list[Column]:
    """Return a column for each value, in the order of the machines and names."""
    return [
        Column(number, watched.label, watched.device.find(name))
        for number, watched in enumerate(machines)
        for name in watched.names
    ]


def labelled(machines: Sequence[Watched]) -> list[Watched]:
    """Return the machines with labels: none for a single one, otherwise the device, with the endpoint if it is there
    twice."""
    if len(machines) == 1:
        return list(machines)
    devices = [watched.device.name for watched in machines]
    return [
        watched._replace(label=name if devices.count(name) == 1 else f"{name} at {watched.endpoint}")
        for name, watched in zip(devices, machines)
    ]


def headings(columns: Sequence[Column]) -> list[str]:
    """Return the heading of a log."""
    return [TIME, *(column.heading for column in columns), ERROR]


def plain_value(value: Value | None) -> int | float | str | None:
    """Return a value for JSON, CSV and SQLite: bytes in hexadecimal, times in milliseconds, "?" for half a character of
    UTF-16, which a UNICODE_STRING may have and UTF-8 has not.

    >>> plain_value(b"\\x01\\xAB"), plain_value("A\\ud800B")
    ('01 AB', 'A?B')
    """
    if isinstance(value, bytes):
        return value.hex(" ").upper()
    if isinstance(value, str):
        return value.encode(errors="replace").decode()
    return int(value) if isinstance(value, int) and not isinstance(value, bool) else value


def values_of(sample: Sample, columns: Sequence[Column]) -> list[Value | None]:
    """Return the value of each column, a 32-bit float without its binary tail; None for one that was not read."""
    values = [
        {reading.name: plain_value(reading.parameter.shortened(reading.value)) for reading in poll.readings}
        for poll in sample.polls
    ]
    return [values[column.machine].get(column.parameter.name) for column in columns]


def error_text(sample: Sample, machines: Sequence[Watched]) -> str:
    """Return what was not read, and why, in one line; empty if nothing."""
    parts = []
    for watched, poll in zip(machines, sample.polls):
        start = f"{watched.label}: " if watched.label else ""
        parts += [f"{start}{poll.error}"] if poll.error else []
        parts += [f"{start}{name}: {reason}" for name, reason in poll.refused.items()]
    return " ".join("; ".join(parts).split())[:_LONGEST_ERROR]


def time_text(at: datetime) -> str:
    """Return a time as a log has it: ISO 8601 with milliseconds and zone."""
    return at.isoformat(timespec="milliseconds")


def row_of(sample: Sample, columns: Sequence[Column], machines: Sequence[Watched]) -> Row:
    """Return the row of a sample."""
    return [time_text(sample.at), *values_of(sample, columns), error_text(sample, machines)]


def cell_text(value: Value | None) -> str:
    """Return a value as a cell of a CSV file: bits as 0 and 1, one that was not read empty; always one line."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(int(value))
    text = show(value)
    return " ".join(text.split()) if isinstance(value, str) else text
