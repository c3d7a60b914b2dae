"""Checks of the functions that an application gives to a Modbus unit or to an entry of an object dictionary."""

from __future__ import annotations

from functools import partial
from typing import Any

from barewire.errors import EncodeError, shown

_GENERATOR, _COROUTINE, _ASYNC_GENERATOR = 0x20, 0x80, 0x200
"""Flags of code objects (those of `inspect`, which loads slowly)."""


def deferred(function: Any) -> str:
    """Return what a call returns instead of running the function, or "" for a function that runs when it is called.

    >>> deferred(lambda: (yield)), deferred(print)
    ('a generator', '')
    """
    while isinstance(function, partial):
        function = function.func
    method = getattr(type(function), "__call__", None)  # noqa: B004 - of an object that can be called
    code = getattr(function, "__code__", None) or getattr(method, "__code__", None)
    flags = getattr(code, "co_flags", 0)
    return "a coroutine" if flags & _COROUTINE else "a generator" if flags & (_GENERATOR | _ASYNC_GENERATOR) else ""


def check_callbacks(owner: str, **functions: object) -> None:
    """Raise EncodeError unless each of these is None or a function that runs when it is called."""
    for name, function in functions.items():
        if function is not None:
            check_function(f"{owner}: {name}", function, name)


def check_function(name: str, function: object, field: str) -> None:
    """Raise EncodeError unless this is a function that runs when it is called. `field` is that of the error."""
    if not callable(function):
        raise EncodeError(f"{name} = {shown(function)}: expected a function", field)
    if kind := deferred(function):
        raise EncodeError(f"{name} = {shown(function)}: a call returns {kind} and runs nothing; expected def", field)
