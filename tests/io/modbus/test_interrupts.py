"""An exception at any line of an exchange: no wrong value follows, no lock stays, and the counters add up.

A signal handler, Ctrl-C and a lack of memory raise anywhere. Here an exception is raised before each line of barewire
that a read executes, one after the other (`tests.interrupts`), in virtual time. Then the client is used on, against a
unit that answers everything late and in order; from another thread, which would hang if the lock were kept. `make
test` raises at every sixteenth line, `make proof` at each.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import suppress
from types import SimpleNamespace
from typing import Any, NamedTuple

import pytest

from barewire import AsyncModbusClient, ModbusClient
from barewire.ascii import AsciiLine
from barewire.errors import NoAnswer
from barewire.io.engine import blocking
from barewire.io.modbus import async_client, client as client_module
from barewire.modbus import Line
from barewire.rtu import RtuLine
from barewire.tcp import TcpLine
from tests.helpers import part_or_whole
from tests.interrupts import check_lines, in_a_thread, interrupt
from tests.modbus.client.slow import TIMING, InTime
from tests.model.virtual_loop import VirtualLoop, VirtualSelector

# An exception raised while a generator is freed is only reported.
pytestmark = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")

TIMEOUT, WINDOW = 0.3, 0.9
RTU: Callable[[], Line] = lambda: RtuLine(TIMING, role="server", units=(1, 2))  # noqa: E731
CARRIERS: dict[str, tuple[str, Callable[[], Line]]] = {
    "rtu": ("rtu:///dev/virtual?baudrate=19200", RTU),
    "ascii": ("ascii:///dev/virtual?baudrate=19200", AsciiLine),
    "tcp": ("tcp://unit:502", TcpLine),
    "tcp, any_transaction": ("tcp://unit:502?any_transaction=1", TcpLine),
}
BEFORE: dict[str, tuple[float | None, ...]] = {
    "nothing is pending": (0.01,),
    "an answer is pending": (0.01, None),
    "one is pending, the line is free": (0.01, 0.35),
}
"""The delays of the answers to the reads before the interrupted one."""
LATE = (0.35, 0.35, 0.1, 0.5, 0.35, 0.35, 0.8)
"""The delays of all answers after those. One that is prompt is behind others that are late."""


class Coming(NamedTuple):
    at: float
    data: bytes


class BoundedSelector(VirtualSelector):
    """The selector of a loop that must not wait for ever."""

    def select(self, timeout: float | None = None) -> list[Any]:
        assert timeout is not None or self.line.coming, "every task waits for ever"
        return super().select(timeout)


class VirtualUnit:
    """A unit on a line in virtual time. It is the port of a blocking client, and the link of an asyncio client."""

    def __init__(self, line: Line, delays: tuple[float | None, ...]) -> None:
        self.now = 100.0
        self.coming: list[Coming] = []
        self._line = line
        self._unit = InTime([*delays, *LATE], line, function_08="declined")

    def send(self, item: bytes) -> None:
        self.coming += [Coming(*answer) for answer in self._unit(item, self.now)]
        self.coming.sort()

    write = write_together = send

    def sent(self) -> None:
        """Return None: everything is on the wire."""

    def receive(self, timeout: float) -> bytes | None:
        until = self.now + timeout
        if self.coming and self.coming[0].at <= until:
            return self.deliver()
        self.now = until
        return None

    def deliver(self) -> bytes:
        """Return the next bytes that arrive, at the time when they arrive."""
        self.now = max(self.now, self.coming[0].at)
        return self.coming.pop(0).data

    def pause(self, seconds: float) -> None:
        self.now += seconds

    def close(self) -> None:
        """Lose what is under way on a connection of TCP. A serial line delivers it when it is opened again."""
        if isinstance(self._line, TcpLine):
            self.coming.clear()


def read_register(client: ModbusClient, address: int) -> None:
    """Read a register, which holds its own address."""
    with suppress(NoAnswer):
        assert client.read_holding_registers(address, 1) == (address,)


def check_counters(client: ModbusClient | AsyncModbusClient) -> None:
    counters = client.bus.counters
    assert counters.asked == counters.answered + counters.lost, counters


def blocking_run(
    patch: pytest.MonkeyPatch, carrier: str, before: str, retries: int, at: int | None, error: type[BaseException]
) -> int:
    """Play one run, with an exception before the line with the number `at`. Return how many lines there were."""
    url, server_line = CARRIERS[carrier]
    unit = VirtualUnit(server_line(), BEFORE[before])
    patch.setattr(blocking.run, "__defaults__", (lambda: unit.now, None))
    patch.setattr(blocking.exchange, "__defaults__", (lambda: unit.now,))
    patch.setattr(client_module, "time", SimpleNamespace(monotonic=lambda: unit.now, sleep=unit.pause))
    patch.setattr(client_module, "dialer", lambda endpoint: lambda: unit)
    client = ModbusClient(url, timeout=TIMEOUT, unit=1, retries=retries)
    for address, _ in enumerate(BEFORE[before]):
        read_register(client, address)
    lines = 0

    def interrupted() -> None:
        nonlocal lines
        lines = interrupt(lambda: read_register(client, 10), at, error=error)

    with suppress(error):
        interrupted()

    def use_on() -> None:
        for address in range(20, 24):
            read_register(client, address)
        unit.pause(2 * WINDOW + TIMEOUT)
        unit._unit.delays = iter(())  # prompt again
        assert client.read_holding_registers(30, 1) == (30,)

    in_a_thread(use_on, 60, "the line")
    check_counters(client)
    read_register(client, 31)  # this thread does not have the line either
    client.close()
    return lines


async def aread(client: AsyncModbusClient, address: int) -> None:
    """Read a register, which holds its own address."""
    with suppress(NoAnswer):
        assert await client.read_holding_registers(address, 1) == (address,)


def asyncio_run(
    patch: pytest.MonkeyPatch, carrier: str, before: str, retries: int, at: int | None, error: type[BaseException]
) -> int:
    """The same with an asyncio client: an exception leaves the task, or the event loop, which then runs on."""
    url, server_line = CARRIERS[carrier]
    unit = VirtualUnit(server_line(), BEFORE[before])
    selector = BoundedSelector(unit)  # type: ignore[arg-type]
    loop = VirtualLoop(selector)
    loop.set_exception_handler(lambda loop, context: None)  # of callbacks: the loop goes on without their bytes

    async def connect(endpoint: object, receive: Callable[[bytes], object], lose: object) -> VirtualUnit:
        selector.received = lambda data: loop.call_soon(receive, data)
        return unit

    patch.setattr(async_client, "connect", connect)
    client = AsyncModbusClient(url, timeout=TIMEOUT, unit=1, retries=retries)

    async def prepare() -> None:
        for address, _ in enumerate(BEFORE[before]):
            await aread(client, address)

    async def use_on() -> None:
        for task in asyncio.all_tasks() - {asyncio.current_task()}:
            task.cancel()
            with suppress(asyncio.CancelledError, error):
                await task
        for address in range(20, 24):
            await aread(client, address)
        await asyncio.sleep(2 * WINDOW + TIMEOUT)
        unit._unit.delays = iter(())
        assert await asyncio.wait_for(client.read_holding_registers(30, 1), 60) == (30,)
        await client.close()

    lines = 0
    try:
        loop.run_until_complete(prepare())
        with suppress(error):
            lines = interrupt(lambda: loop.run_until_complete(aread(client, 10)), at, error=error)
        loop.run_until_complete(use_on())
    finally:
        loop.close()
    check_counters(client)
    return lines


RUNS = {"blocking": blocking_run, "asyncio": asyncio_run}


# An event loop reports an Exception of a callback and goes on, but Ctrl-C leaves it.
@pytest.mark.parametrize(
    ("world", "error"), [("blocking", KeyboardInterrupt), ("blocking", MemoryError), ("asyncio", KeyboardInterrupt)]
)
@pytest.mark.parametrize("before", BEFORE)
@pytest.mark.parametrize("carrier", CARRIERS)
@pytest.mark.parametrize("step", part_or_whole(48, 1))
def test_an_exception_at_any_line(
    world: str, carrier: str, before: str, error: type[BaseException], step: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(at: int | None) -> int:
        return RUNS[world](monkeypatch, carrier, before, 0, at, error)

    run(None)  # imports what is loaded when it is needed
    check_lines(run, range(run(None)), step, f"{world} {carrier} {before} {error}")
