"""The registry, and custom function codes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import pytest

from barewire.codecs import Layout
from barewire.errors import DecodeError, EncodeError
from barewire.modbus import Adu, Request, Response, decode_request, decode_response, messages, register
from barewire.modbus.messages import registry as functions
from barewire.modbus.messages.registry import (
    known_requests,
    measure_request,
    measure_response,
    request_class,
    unregister,
)
from barewire.rtu import RtuLine, Timing, encode
from tests.helpers import refused, unhex


@dataclass(frozen=True, slots=True)
class BlinkResponse(Response):
    """The number of blinks so far."""

    times: int

    name: ClassVar[str] = "Blink"
    function_code: ClassVar[int] = 0x41
    layout: ClassVar[Layout] = Layout(">BH", "function_code", "times")


@dataclass(frozen=True, slots=True)
class Blink(Request[BlinkResponse]):
    """Blink `times` times."""

    times: int

    name: ClassVar[str] = "Blink"
    function_code: ClassVar[int] = 0x41
    layout: ClassVar[Layout] = Layout(">BH", "function_code", "times")
    response: ClassVar[type[Response]] = BlinkResponse


@pytest.fixture(autouse=True)
def _restored_registry(monkeypatch: pytest.MonkeyPatch) -> None:
    """Restore the registry after each test."""
    for table in (functions._functions, functions._encapsulated):
        monkeypatch.setattr(table, "classes", dict(table.classes))
        monkeypatch.setattr(table, "names", dict(table.names))


def test_the_tables_of_the_functions_have_every_request() -> None:
    every = [getattr(messages, name) for name in messages.NAMES]
    requests = {item for item in every if isinstance(item, type) and issubclass(item, Request)}
    requests.remove(messages.RawRequest)  # of any function: its code is in its bytes
    listed = {*messages.FUNCTIONS.items(), *((0x2B00 | number, name) for number, name in messages.MEI_TYPES.items())}
    assert listed == {
        (item.function_code if item.mei_type is None else 0x2B00 | item.mei_type, item.__name__) for item in requests
    }
    assert set(known_requests()) == requests


def test_a_function_that_was_never_used_can_be_removed() -> None:
    unregister(messages.MaskWriteRegister)
    assert request_class(b"\x16") is None
    assert messages.MaskWriteRegister not in known_requests()


def test_a_registered_function_is_decoded_and_measured() -> None:
    assert register(Blink) is Blink
    assert Blink in known_requests()
    assert decode_request(unhex("41 0003")) == Blink(3)
    assert decode_response(unhex("41 0003")) == BlinkResponse(3)
    assert Blink(3).read_response(unhex("41 0003")) == BlinkResponse(3)
    assert measure_request(b"\x41") == measure_response(b"\x41") == 3
    line = RtuLine(Timing.of(19200), role="server")
    assert line.feed(encode(1, unhex("41 0003")), 1.0) == [Adu(1, unhex("41 0003"))]


def test_the_echoed_fields_of_an_own_message_are_checked() -> None:
    with refused(DecodeError, "times 4 where 3 was asked (Blink)"):
        Blink(3).read_response(unhex("41 0004"))


@pytest.mark.parametrize("code", [0x00, 0x80, 0xC1, -1])
def test_a_function_code_is_1_to_127(code: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Blink, "function_code", code)
    with refused(EncodeError, "expected 01h..7Fh"):
        register(Blink)


def test_an_mei_type_belongs_to_2b_and_2b_needs_one(monkeypatch: pytest.MonkeyPatch) -> None:
    with refused(EncodeError, "an MEI type belongs to function 2Bh, and only to that one"):
        register(Blink, mei_type=0x0D)
    monkeypatch.setattr(Blink, "function_code", 0x2B)
    with refused(EncodeError, "an MEI type belongs to function 2Bh, and only to that one"):
        register(Blink)


def test_a_registered_code_can_be_replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Blink, "function_code", 0x07)
    register(Blink)
    assert decode_request(unhex("07 0003")) == Blink(3)


@pytest.mark.parametrize("candidate", [int, BlinkResponse, Blink(3), Request])
def test_only_a_request_can_be_registered(candidate: Any) -> None:
    with refused(EncodeError, "register needs a request class, with a function_code, a layout and a response"):
        register(candidate)


@pytest.mark.parametrize("wrong", [ZeroDivisionError("division"), IndexError("index"), "3", 2.5, -1])
def test_a_measure_that_raises_leaves_the_length_unknown(wrong: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """A user's `measure` is called with the first bytes of any frame, also of damaged ones. The line must continue."""

    def measure(pdu: bytes) -> Any:
        if isinstance(wrong, Exception):
            raise wrong
        return wrong

    monkeypatch.setattr(Blink, "measure", staticmethod(measure), raising=False)
    register(Blink)
    assert measure_request(unhex("41 0003")) is None
    line = RtuLine(Timing.of(19200), role="server")
    line.feed(encode(1, unhex("41 0003")), 1.0)
    assert line.feed(None, 2.0) in ([], [Adu(1, unhex("41 0003"))])
    assert line.held == b""
