"""Delayed: a unit says when its response is sent."""

from __future__ import annotations

from typing import Any

import pytest

from barewire.modbus import (
    Delayed,
    ModbusException,
    ReadHoldingRegisters,
    ReadHoldingRegistersResponse,
    Response,
    Server,
    Unit,
)
from barewire.modbus.framing import Line
from barewire.rtu import RtuLine, Timing, encode as rtu_frame
from barewire.tcp import TcpLine, decode as tcp_decode, encode as tcp_frame

ASKED = ReadHoldingRegisters(0, 1).encode()


class SlowUnit:
    """A unit with the given responses, one after the other."""

    def __init__(self, *responses: Response | Delayed | None) -> None:
        self.responses = list(responses)

    def handle(self, request: Any, now: float) -> Response | Delayed | None:
        return self.responses.pop(0)


def served(unit: Unit, line: Line | None = None) -> Server:
    return Server(line or TcpLine(), {1: unit}, serial=line is not None)


PLAIN = ReadHoldingRegistersResponse((7,))


def test_a_delayed_response_on_tcp_has_its_time_and_the_next_one_has_none() -> None:
    server = served(SlowUnit(Delayed(PLAIN, 0.25), PLAIN))
    (first,) = server.feed(tcp_frame(1, ASKED, 1), 10.0)
    (second,) = server.feed(tcp_frame(1, ASKED, 2), 10.0)
    assert (first.at, second.at) == (10.25, 0.0)
    assert tcp_decode(first.data)[1] == PLAIN.encode()


def test_an_exception_may_be_delayed() -> None:
    server = served(SlowUnit(Delayed(ModbusException(6), 0.5)))
    (reply,) = server.feed(tcp_frame(1, ASKED, 1), 10.0)
    assert (reply.at, tcp_decode(reply.data)[1]) == (10.5, b"\x83\x06")


@pytest.mark.parametrize(("seconds", "at"), [(0.5, 10.5), (0.0, None)])
def test_on_a_serial_line_it_is_sent_after_the_delay_and_the_silence(seconds: float, at: float | None) -> None:
    line = RtuLine(Timing.of(19200), role="server")
    (reply,) = served(SlowUnit(Delayed(PLAIN, seconds)), line).feed(rtu_frame(1, ASKED), 10.0)
    assert reply.at == (line.quiet_at if at is None else at)
    assert reply.request == ASKED
