"""The fast path has the results, errors, counters and times of `bus.ask`, for any input.

Both run in virtual time against the same faulty peer, request after request, and everything visible is compared after
each request; blocking and asyncio, on each kind of line.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

import pytest
from hypothesis import given, strategies as st

from barewire.errors import BarewireError, PortError
from barewire.io.engine import asyncio as aio, blocking as plain
from barewire.io.engine.blocking import run
from barewire.modbus import (
    Bus,
    Diagnostics,
    Line,
    ReadHoldingRegisters,
    ReportServerId,
    Request,
    Server,
    Table,
    UnitOptions,
    WriteSingleRegister,
)
from barewire.modbus.echo import EchoLine
from barewire.rtu import RtuLine, Timing, encode
from barewire.tcp import DatagramLine, TcpLine
from tests.helpers import modest

Script = list[tuple[float, bytes | BaseException]]
"""The items received after a request, each with the seconds since the item before it."""

REQUESTS: list[Request[Any]] = [
    *(ReadHoldingRegisters(3, 1), ReadHoldingRegisters(0, 125), ReadHoldingRegisters(250, 20)),
    *(WriteSingleRegister(3, 7), Diagnostics(0, b"\1\2"), Diagnostics(4), ReportServerId()),
]
KINDS_OF_INPUT = st.sampled_from(
    [
        "good",
        "cut",
        "stray",
        "other unit",
        "other pdu",
        "damaged",
        "header",
        "noise",
        "closed",
        "interrupt",
        "0",
        "twice",
    ]
)
TIMING = Timing.of(19200)
LINES: dict[str, Callable[[], Line]] = {
    "tcp": TcpLine,
    "udp": DatagramLine,
    "tcp without numbers": lambda: TcpLine(any_transaction=True),
    "rtu": lambda: RtuLine(TIMING),
    "rtu, strict": lambda: RtuLine(TIMING, patience=None),
    "rtu, with echo": lambda: EchoLine(RtuLine(TIMING), echoes=None),
    "rtu+tcp": lambda: RtuLine(Timing(0.0, 0.0, 0.0)),
}
OPTIONS = UnitOptions(), UnitOptions(dead_after=2), UnitOptions(gap=0.5)
PAUSE = st.sampled_from([0.0, 0.25, 0.5, 1.0])
REQUEST = st.tuples(st.sampled_from(REQUESTS), st.integers(1, 2), st.sampled_from([0.0, 1.0, 1.0, 1.0]))
SENDING = st.sampled_from(["out", "out", "out", "out", "out", "out", "fails", "is interrupted"])
SCRIPTS = st.lists(st.tuples(KINDS_OF_INPUT, PAUSE, st.integers(0, 300)), max_size=4)
STEP = st.tuples(REQUEST, SENDING, SCRIPTS | st.just([("good", 0.25, 0)]))


class FaultyPort:
    """A port in virtual time. `expect` sets the results of the next request."""

    def __init__(self, *, rtu: bool = False) -> None:
        self.now = 100.0
        self.sent_items: list[bytes] = []
        line = RtuLine(Timing(0.0, 0.0, 0.0), role="server") if rtu else TcpLine()
        self._rtu = rtu
        self._server = Server(line, {1: Table(size=256), 2: Table(size=256)}, serial=rtu)
        self._sending = "out"
        self._script: list[tuple[str, float, int]] = []
        self._incoming: Script = []

    def clock(self) -> float:
        return self.now

    def expect(self, sending: str, script: list[tuple[str, float, int]]) -> None:
        self._sending, self._script = sending, script

    def send(self, item: bytes) -> None:
        self.sent_items.append(item)
        sending, self._sending = self._sending, "out"
        if sending == "fails":
            raise PortError("the port failed")
        if sending == "is interrupted":
            raise KeyboardInterrupt
        replies = self._server.feed(item, self.now)
        good = replies[0].data if replies else b""
        for kind, pause, number in self._script:
            made = self._made_rtu(kind, good, number) if self._rtu else []
            self._incoming += [(pause, item) for item in made or self._made(kind, good, number)]
        self._script = []

    @staticmethod
    def _made_rtu(kind: str, good: bytes, number: int) -> list[bytes | BaseException]:
        """Return what is different on RTU: frames with a good CRC that are not the answer."""
        made = {
            "other unit": encode(9, good[1:-2] or b"\7"),
            "other pdu": encode(
                good[0] if good else 1, bytes([good[1] if good else 3, number % 9]) + good[3 : number % 9]
            ),
        }
        return [made[kind]] if kind in made else []

    @staticmethod
    def _made(kind: str, good: bytes, number: int) -> list[bytes | BaseException]:
        other: dict[str, list[bytes | BaseException]] = {
            "cut": [good[: number % (len(good) + 1)], good[number % (len(good) + 1) :]],
            "stray": [bytes([0xEE]) + good[1:]],
            "other unit": [good[:6] + b"\x09" + good[7:]],
            "damaged": [good[:7] + bytes([number % 256]) + good[8:]],
            "header": [good[:2] + bytes([number % 2]) + good[3:]],
            "noise": [bytes(number)],
            "closed": [PortError("the other side closed the connection")],
            "interrupt": [KeyboardInterrupt()],
            "0": [good + good[: number % 40]],
            "twice": [good + good],
        }
        return [item for item in other.get(kind, [good]) if item]

    def receive(self, timeout: float) -> bytes | None:
        if not self._incoming or self._incoming[0][0] > timeout:
            if self._incoming:
                self._incoming[0] = (self._incoming[0][0] - timeout, self._incoming[0][1])
            self.now += timeout
            return None
        pause, item = self._incoming.pop(0)
        self.now += pause
        if isinstance(item, BaseException):
            self._incoming.clear()
            raise item
        return item

    def close(self) -> None:
        """Do nothing: the port is only in memory."""


class AsyncFaultyPort:
    """The same for asyncio."""

    def __init__(self, port: FaultyPort) -> None:
        self.write, self._port = port.send, port

    def sent(self) -> Awaitable[float | None] | None:
        return None

    async def receive(self, timeout: float) -> bytes | None:
        return self._port.receive(timeout)


class VirtualLoop(asyncio.SelectorEventLoop):
    port: FaultyPort

    def time(self) -> float:
        return self.port.now


Ask = Callable[[Bus, int, Request[Any], float, FaultyPort], Any]


def with_bus_ask(bus: Bus, unit: int, request: Request[Any], timeout: float, port: FaultyPort) -> Any:
    return run(bus.ask(unit, request, timeout=timeout), port, port.clock)


def blocking(bus: Bus, unit: int, request: Request[Any], timeout: float, port: FaultyPort) -> Any:
    return plain.exchange(bus, unit, request, timeout, port, port.clock)


def with_await(bus: Bus, unit: int, request: Request[Any], timeout: float, port: FaultyPort) -> Any:
    loop = VirtualLoop()
    loop.port = port
    coming = aio.exchange(bus, unit, request, timeout, AsyncFaultyPort(port))
    try:
        return loop.run_until_complete(coming)
    finally:
        coming.close()
        loop.close()


def visible_state(ask: Ask, bus: Bus, port: FaultyPort, arguments: tuple[Request[Any], int, float]) -> tuple[Any, ...]:
    request, unit, timeout = arguments
    try:
        if not bus.line.numbered and (data := port.receive(0.0)) is not None:  # as `Connection.open` does
            bus.overhear(data, port.now)
        result = ask(bus, unit, request, timeout, port)
    except (BarewireError, KeyboardInterrupt) as error:
        result = type(error), str(error), type(error.__cause__), str(error.__cause__)
    line = bus.line
    seen = (
        line.held,
        line.quiet_at,
        str(line.broken),
        port.now,
        port.sent_items,
        repr(bus.counters),
        {unit: vars(state).copy() for unit, state in bus.state.units.items()},
        repr(bus.state.pending),
    )
    return result, *seen


BUS_OPTIONS: list[dict[str, Any]] = [*({"options": options} for options in OPTIONS), {"units": {2: OPTIONS[2]}}]
SETUPS = [
    pytest.param(
        *(kind, options, fast),
        id=f"{kind}-{options}-{fast.__name__}",
        marks=[pytest.mark.proof] * ((kind_at + options_at + fast_at) % 2),
    )
    for kind_at, kind in enumerate(LINES)
    for options_at, options in enumerate(BUS_OPTIONS)
    for fast_at, fast in enumerate((blocking, with_await))
]
"""`make test` has each line with each option once, blocking or asyncio in turn."""


@pytest.mark.parametrize(("kind", "options", "fast"), SETUPS)
@modest
@given(steps=st.lists(STEP, min_size=2, max_size=6))
def test_the_fast_path_has_the_results_and_effects_of_bus_ask(
    fast: Ask, options: dict[str, Any], kind: str, steps: Any
) -> None:
    new_line, rtu = LINES[kind], kind.startswith("rtu")
    slow_bus, fast_bus = Bus(new_line(), **options), Bus(new_line(), **options)
    slow_port, fast_port = FaultyPort(rtu=rtu), FaultyPort(rtu=rtu)
    for arguments, sending, script in steps:
        slow_port.expect(sending, script)
        fast_port.expect(sending, script)
        expected = visible_state(with_bus_ask, slow_bus, slow_port, arguments)
        assert visible_state(fast, fast_bus, fast_port, arguments) == expected
        if slow_bus.line.broken:
            slow_bus.line, fast_bus.line = new_line(), new_line()


@pytest.mark.parametrize(
    ("kind", "ask"), [("tcp", blocking), ("tcp", with_await), ("rtu", blocking), ("rtu+tcp", blocking)]
)
def test_a_regular_exchange_makes_no_conversation(kind: str, ask: Ask, monkeypatch: pytest.MonkeyPatch) -> None:
    """Otherwise the test above would compare `bus.ask` with itself."""
    bus, port = Bus(LINES[kind]()), FaultyPort(rtu=kind != "tcp")
    port.expect("out", [("good", 0.25, 0)])
    ask(bus, 1, REQUESTS[0], 1.0, port)  # to a unit without a state yet
    monkeypatch.setattr(Bus, "_exchange", None)
    for _ in range(2):
        port.now += 0.01
        port.expect("out", [("good", 0.25, 0)])
        assert ask(bus, 1, REQUESTS[1], 1.0, port).registers == (0,) * 125
    assert bus.counters.asked == bus.counters.answered == 3
