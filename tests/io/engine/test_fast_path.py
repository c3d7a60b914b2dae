"""The fast path has the results, errors, counters and times of `bus.ask`, whatever comes.

Both run in virtual time against the same faulty peer, request after request, and everything visible is compared after
each. Blocking and asyncio.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

import pytest
from hypothesis import given, strategies as st

from barewire.errors import BarewireError, PortError
from barewire.io.engine import asyncio as aio, fast_path as plain
from barewire.io.engine.blocking import run
from barewire.modbus import Bus, Diagnostics, ReadHoldingRegisters, Request, Server, Table, WriteSingleRegister
from barewire.tcp import DatagramLine, TcpLine
from tests.helpers import modest

Script = list[tuple[float, bytes | BaseException]]
"""What comes after a request: so many seconds after what came before it."""

QUESTIONS: list[Request[Any]] = [
    *(ReadHoldingRegisters(3, 1), ReadHoldingRegisters(0, 125), ReadHoldingRegisters(250, 20)),
    *(WriteSingleRegister(3, 7), Diagnostics(0, b"\1\2"), Diagnostics(4)),
]
COMES = st.sampled_from(["good", "cut", "stray", "other unit", "damaged", "header", "noise", "gone", "interrupt", "0"])
PAUSE = st.sampled_from([0.0, 0.25, 0.5, 1.0])
ASKED = st.tuples(st.sampled_from(QUESTIONS), st.integers(1, 2), st.sampled_from([0.0, 1.0, 1.0, 1.0]))
SENDING = st.sampled_from(["out", "out", "out", "out", "out", "out", "fails", "is interrupted"])
SCRIPTS = st.lists(st.tuples(COMES, PAUSE, st.integers(0, 300)), max_size=4)
QUESTION = st.tuples(ASKED, SENDING, SCRIPTS | st.just([("good", 0.25, 0)]))


class Wrong:
    """A port in virtual time. `expect` sets what becomes of the next request."""

    def __init__(self) -> None:
        self.now = 100.0
        self.said: list[bytes] = []
        self._server = Server(TcpLine(), {1: Table(size=256), 2: Table(size=256)}, serial=False)
        self._sending = "out"
        self._script: list[tuple[str, float, int]] = []
        self._coming: Script = []

    def clock(self) -> float:
        return self.now

    def expect(self, sending: str, script: list[tuple[str, float, int]]) -> None:
        self._sending, self._script = sending, script

    def send(self, item: bytes) -> None:
        self.said.append(item)
        sending, self._sending = self._sending, "out"
        if sending == "fails":
            raise PortError("the port failed")
        if sending == "is interrupted":
            raise KeyboardInterrupt
        replies = self._server.feed(item, self.now)
        good = replies[0].data if replies else b""
        for what, pause, at in self._script:
            self._coming += [(pause, one) for one in self._made(what, good, at)]
        self._script = []

    @staticmethod
    def _made(what: str, good: bytes, at: int) -> list[bytes | BaseException]:
        other: dict[str, list[bytes | BaseException]] = {
            "cut": [good[: at % (len(good) + 1)], good[at % (len(good) + 1) :]],
            "stray": [bytes([0xEE]) + good[1:]],
            "other unit": [good[:6] + b"\x09" + good[7:]],
            "damaged": [good[:7] + bytes([at % 256]) + good[8:]],
            "header": [good[:2] + bytes([at % 2]) + good[3:]],
            "noise": [bytes(at)],
            "gone": [PortError("the other side closed the connection")],
            "interrupt": [KeyboardInterrupt()],
            "0": [good + good[: at % 40]],
        }
        return [one for one in other.get(what, [good]) if one]

    def receive(self, timeout: float) -> bytes | None:
        if not self._coming or self._coming[0][0] > timeout:
            if self._coming:
                self._coming[0] = (self._coming[0][0] - timeout, self._coming[0][1])
            self.now += timeout
            return None
        pause, what = self._coming.pop(0)
        self.now += pause
        if isinstance(what, BaseException):
            self._coming.clear()
            raise what
        return what

    def close(self) -> None:
        """Nothing to give back."""


class AsyncWrong:
    """The same for asyncio."""

    def __init__(self, port: Wrong) -> None:
        self.write, self._port = port.send, port

    def sent(self) -> Awaitable[float | None] | None:
        return None

    async def receive(self, timeout: float) -> bytes | None:
        return self._port.receive(timeout)


class VirtualLoop(asyncio.SelectorEventLoop):
    port: Wrong

    def time(self) -> float:
        return self.port.now


Ask = Callable[[Bus, int, Request[Any], float, Wrong], Any]


def through_bus(bus: Bus, unit: int, request: Request[Any], timeout: float, port: Wrong) -> Any:
    return run(bus.ask(unit, request, timeout=timeout), port, port.clock)


def blocking(bus: Bus, unit: int, request: Request[Any], timeout: float, port: Wrong) -> Any:
    return plain.exchange(bus, unit, request, timeout, port, port.clock)


def with_await(bus: Bus, unit: int, request: Request[Any], timeout: float, port: Wrong) -> Any:
    loop = VirtualLoop()
    loop.port = port
    coming = aio.exchange(bus, unit, request, timeout, AsyncWrong(port))
    try:
        return loop.run_until_complete(coming)
    finally:
        coming.close()
        loop.close()


def all_that_can_be_seen(ask: Ask, bus: Bus, port: Wrong, asked: tuple[Request[Any], int, float]) -> tuple[Any, ...]:
    request, unit, timeout = asked
    try:
        result = ask(bus, unit, request, timeout, port)
    except (BarewireError, KeyboardInterrupt) as error:
        result = type(error), str(error), type(error.__cause__), str(error.__cause__)
    line = bus.line
    told = (
        line.held,
        str(line.broken),
        port.now,
        port.said,
        repr(bus.counters),
        {unit: vars(state).copy() for unit, state in bus.state.units.items()},
        repr(bus.state.pending),
    )
    return result, *told


@pytest.mark.parametrize("fast", [blocking, with_await])
@pytest.mark.parametrize("options", [{}, {"dead_after": 2}, {"gap": 0.5}, {"gaps": {2: 0.5}}], ids=str)
@pytest.mark.parametrize("kind", [TcpLine, DatagramLine])
@modest
@given(talk=st.lists(QUESTION, min_size=2, max_size=6))
def test_the_fast_path_has_the_results_and_effects_of_bus_ask(
    fast: Ask, options: dict[str, Any], kind: type[TcpLine], talk: Any
) -> None:
    slow_bus, fast_bus = Bus(kind(), **options), Bus(kind(), **options)
    slow_port, fast_port = Wrong(), Wrong()
    for asked, sending, script in talk:
        slow_port.expect(sending, script)
        fast_port.expect(sending, script)
        slow = all_that_can_be_seen(through_bus, slow_bus, slow_port, asked)
        assert all_that_can_be_seen(fast, fast_bus, fast_port, asked) == slow
        if slow_bus.line.broken:
            slow_bus.line, fast_bus.line = kind(), kind()


def test_a_regular_exchange_makes_no_conversation(monkeypatch: pytest.MonkeyPatch) -> None:
    """Otherwise the test above would compare `bus.ask` with itself."""
    bus, port = Bus(TcpLine()), Wrong()
    port.expect("out", [("good", 0.25, 0)])
    blocking(bus, 1, QUESTIONS[0], 1.0, port)  # of a unit of which nothing is known yet
    monkeypatch.setattr(Bus, "_exchange", None)
    for ask in (blocking, with_await):
        port.expect("out", [("good", 0.25, 0)])
        assert ask(bus, 1, QUESTIONS[1], 1.0, port).registers == (0,) * 125
    assert bus.counters.asked == bus.counters.answered == 3
