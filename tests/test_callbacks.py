"""Functions of the application: those that a call does not run are refused."""

from __future__ import annotations

from functools import partial
from types import SimpleNamespace
from typing import Any

import pytest

from barewire.canopen import (
    BootSlave,
    Entry,
    LocalNode,
    LssAddress,
    LssSlave,
    NetworkList,
    NodeGroup,
    ObjectDictionary,
)
from barewire.errors import EncodeError
from barewire.io.canopen.nmt import NetworkNmtMethods
from barewire.modbus import Functions, Table
from tests.helpers import refused


async def coroutine(*_: Any) -> None:
    raise AssertionError


async def async_generator(*_: Any) -> Any:
    yield


def generator(*_: Any) -> Any:
    yield


class Callback:
    async def __call__(self, *_: Any) -> None:
        raise AssertionError

    async def method(self, *_: Any) -> None:
        raise AssertionError


@pytest.mark.parametrize("name", ["on_write", "on_read"])
@pytest.mark.parametrize(
    ("function", "text"),
    [
        (coroutine, "a coroutine"),
        (Callback().method, "a coroutine"),
        (Callback(), "a coroutine"),
        (partial(partial(coroutine, 1), 2), "a coroutine"),
        (generator, "a generator"),
        (partial(generator), "a generator"),
        (async_generator, "a generator"),
    ],
)
def test_a_function_that_a_call_does_not_run_is_refused(name: str, function: Any, text: str) -> None:
    said = f"a call returns {text} and runs nothing; expected def"
    table = Table(5)
    with refused(EncodeError, said):
        Table(5, **{name: function})
    with refused(EncodeError, said):
        setattr(table, name, function)
    assert getattr(table, name) is None
    with refused(EncodeError, said):
        Functions(read_coils=function)


def test_a_partial_and_an_object_with_call_are_functions() -> None:
    class Recorder:
        def __call__(self, *given: Any) -> None:
            """Record nothing."""

    for function in (Recorder(), partial(Recorder(), 1), partial(print, 1)):
        Table(5, on_write=function)


@pytest.mark.parametrize("function", [coroutine, generator])
def test_callbacks_of_a_canopen_device_and_of_a_boot_are_functions_too(function: Any) -> None:
    objects = ObjectDictionary([Entry(0x1000, 0, "type", "u32")])
    said = "and runs nothing; expected def"
    with refused(EncodeError, said):
        LocalNode(5, objects, on_reset=function)
    with refused(EncodeError, said):
        LocalNode(5, objects, on_failure=function)
    with refused(EncodeError, said):
        LocalNode(5, objects).on_failure = function
    with refused(EncodeError, said):
        NodeGroup([LocalNode(5, objects)], on_failure=function)
    with refused(EncodeError, said):
        LssSlave(LssAddress(1, 2, 3, 4), store=function)
    with refused(EncodeError, said):
        LssSlave(LssAddress(1, 2, 3, 4), on_bit_timing=function)
    network = NetworkList([BootSlave(5)])
    runner: Any = SimpleNamespace(is_open=True, timeout=1.0, carry_out=print, start_task=print)
    methods = NetworkNmtMethods(runner)
    for name in ("on_event", "progress"):
        with refused(EncodeError, f"boot: {name} = "):
            methods.boot(network, **{name: function})
    with refused(EncodeError, "start_manager: callback = "):
        methods.start_manager(network, function)
