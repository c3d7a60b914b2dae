"""Checks of a request by name before anything is sent, and the notes that its errors carry afterwards.

    "status word"       find        -> Parameter, or UnknownName with the nearest names
    {"SPEED": 3000}     checked     -> "STATUS WORD is read only", "CURRENT = 900: expected 0..300 A"

All of a call is checked first, so no call is refused after a part of it was written.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import TypeAlias

from barewire.codecs import Value
from barewire.devices.device import Device
from barewire.devices.parameter import Parameter, show
from barewire.errors import BarewireError, EncodeError, NoAnswer, shown, suggest

_SWITCHED = {"on": True, "true": True, "off": False, "false": False}


def value_of_name(parameter: Parameter, name: str) -> Value:
    """Return the value with this name, in upper or lower case; on or off for a bit. Raises EncodeError with the names.

    >>> value_of_name(Parameter("Mode", "i8", values={1: "position", 3: "velocity"}), "Velocity")
    3
    """
    value = _named_value(parameter, name.strip())
    if value is None:
        raise _unknown(parameter, name)
    return value


def _named_value(parameter: Parameter, name: str) -> Value | None:
    for number, title in parameter.values.items():
        if name.casefold() == title.casefold():
            return number
    return _SWITCHED.get(name.lower()) if parameter.type == "bool" else None


def _unknown(parameter: Parameter, text: str) -> EncodeError:
    expected = "on or off" if parameter.type == "bool" else "a number"
    if parameter.values:
        expected += f", or one of: {', '.join(parameter.values.values())}{suggest(text, parameter.values.values())}"
    return EncodeError(f"{parameter.name} = {shown(text)}: expected {expected}", parameter.name)


NameOrParameter: TypeAlias = str | Parameter
# Mapping is invariant in its keys, so each kind of key is listed by itself.
ValuesByName: TypeAlias = Mapping[str, Value] | Mapping[Parameter, Value] | Mapping[NameOrParameter, Value]


def to_read(device: Device, names: Iterable[NameOrParameter]) -> list[Parameter]:
    """Return the parameters of these names. Raises UnknownName, or EncodeError if one cannot be read."""
    parameters = [device.find(name) if isinstance(name, str) else name for name in names]
    for parameter in parameters:
        if not parameter.readable:
            raise EncodeError(f"{parameter.name} is write only", parameter.name)
    return parameters


def to_write(device: Device, values: ValuesByName, force: bool) -> list[tuple[Parameter, Value]]:
    """Return the parameters with their values. With `force` neither access nor range is checked.

    A text for a parameter that is not a text is the name of one of its values, or on or off for a bit.

    Raises UnknownName, or EncodeError if a parameter cannot be written or its value is out of range.
    """
    pairs = []
    for name, value in values.items():
        parameter = device.find(name) if isinstance(name, str) else name
        if force:  # for a manual that is wrong
            parameter = replace(parameter, minimum=None, maximum=None)
        elif not parameter.writable:
            raise EncodeError(f"{parameter.name} is read only", parameter.name)
        if isinstance(value, str) and parameter.type != "text":
            value = value_of_name(parameter, value)
        parameter.check(value)
        pairs.append((parameter, value))
    return pairs


@contextmanager
def naming(parameter: Parameter, value: Value) -> Iterator[None]:
    """Add the name of the parameter to an EncodeError of a codec, which lacks it."""
    try:
        yield
    except EncodeError as error:
        if error.field is not None:
            raise
        raise EncodeError(f"{parameter.name} = {show(value)}: {error}", parameter.name) from None


def reading_note(parameters: Iterable[Parameter]) -> str:
    """Return the note for the error of a request that reads these parameters: one request of several has failed."""
    return f"while reading {_names(parameters)}"


@contextmanager
def writing(parameters: Iterable[Parameter], done: Sequence[str]) -> Iterator[None]:
    """Add notes to an error of one write of several: which parameters it was for, and which were written before."""
    try:
        yield
    except BarewireError as error:
        error.add_context(f"while writing {_names(parameters)}")
        if done:
            error.add_note(f"written before that: {', '.join(done)}")
        raise


@contextmanager
def may_not_answer(parameters: Iterable[Parameter]) -> Iterator[None]:
    """Accept a missing answer where the description has `answered = false`. A refusal is still an error."""
    try:
        yield
    except NoAnswer:
        if all(parameter.answered for parameter in parameters):
            raise


def _names(parameters: Iterable[Parameter]) -> str:
    """Return the first three names, and the number of others."""
    names = [parameter.name for parameter in parameters]
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if names[3:] else "")
