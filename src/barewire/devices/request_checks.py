"""What a caller asked for, checked as a whole before anything is sent: no call is refused when half of it is done.

    "status word"       find        -> Parameter, or UnknownName with the nearest names
    {"SPEED": 3000}     may I?      -> "STATUS WORD is read only", "CURRENT = 900: expected 0..300 A"

And what an error has to say afterwards: whose value it was, and what had been written before.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import TypeAlias

from barewire.codecs import Value, codec
from barewire.devices.device import Device
from barewire.devices.parameter import Parameter, show
from barewire.errors import BarewireError, EncodeError, NoAnswer

Name: TypeAlias = str | Parameter
# A Mapping is told its keys exactly, so each way of naming stands here by itself.
Values: TypeAlias = Mapping[str, Value] | Mapping[Parameter, Value] | Mapping[Name, Value]


def to_read(device: Device, names: Iterable[Name]) -> list[Parameter]:
    """The parameters, all of which may be read."""
    found = [device.find(name) if isinstance(name, str) else name for name in names]
    for parameter in found:
        if not parameter.readable:
            raise EncodeError(f"{parameter.name} is write only", parameter.name)
    return found


def to_write(device: Device, values: Values, force: bool) -> list[tuple[Parameter, Value]]:
    """The parameters with their values, all of which may be written, and in range."""
    found = []
    for name, value in values.items():
        parameter = device.find(name) if isinstance(name, str) else name
        if force:
            parameter = replace(parameter, minimum=None, maximum=None)
        elif not parameter.writable:
            raise EncodeError(f"{parameter.name} is read only", parameter.name)
        found.append((parameter, value))
        parameter.check(value)
    return found


def sendable(parameter: Parameter, value: Value) -> None:
    """Whether the value can travel at all: in range, on a step of the scale, of the type; EncodeError names it."""
    raw = parameter.to_raw(value)
    if parameter.type not in ("bool", "text"):
        with naming(parameter, value):
            codec(parameter.type).encode(raw)


@contextmanager
def naming(parameter: Parameter, value: Value) -> Iterator[None]:
    """A codec does not know whose value it refuses; the error must."""
    try:
        yield
    except EncodeError as error:
        if error.field is not None:
            raise
        raise EncodeError(f"{parameter.name} = {show(value)}: {error}", parameter.name) from None


@contextmanager
def reading(parameters: Iterable[Parameter]) -> Iterator[None]:
    """When one request of several fails, the error notes which parameters it was for."""
    try:
        yield
    except BarewireError as error:
        error.add_note(f"while reading {_some(parameter.name for parameter in parameters)}")
        raise


@contextmanager
def writing(parameters: Iterable[Parameter], done: Sequence[str]) -> Iterator[None]:
    """When one write of several fails, the error notes whose it was, and which have happened before it."""
    try:
        yield
    except BarewireError as error:
        error.add_note(f"while writing {_some(parameter.name for parameter in parameters)}")
        if done:
            error.add_note(f"written before that: {', '.join(done)}")
        raise


@contextmanager
def unanswered(parameters: Iterable[Parameter]) -> Iterator[None]:
    """Silence is right where the description says that nothing answers. A refusal is still one."""
    try:
        yield
    except NoAnswer:
        if all(parameter.answered for parameter in parameters):
            raise


def _some(names: Iterable[str]) -> str:
    """The first three names, and how many more there are."""
    known = list(names)
    return ", ".join(known[:3]) + (f" and {len(known) - 3} more" if known[3:] else "")
