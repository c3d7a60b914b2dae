"""How servers end: closed or cancelled while they start, closed while they cannot end, by a unit that exits."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
import threading
from collections.abc import Awaitable, Callable
from typing import Any

import pytest

import barewire
from barewire import AsyncModbusClient, AsyncModbusServer, ModbusClient, ModbusServer
from barewire.errors import PortError
from barewire.io.server import base
from barewire.modbus import ModbusException, ReadHoldingRegisters, Server, Table
from barewire.tcp import TcpLine, encode
from tests.helpers import FailingUnit

STEPS = range(8)
"""Rounds of the loop after which the start is interrupted: before it begins, at each of its waits, and after it."""

Interrupt = Callable[[Any, "asyncio.Task[None]"], Awaitable[None]]


async def close(server: Any, start: asyncio.Task[None]) -> None:
    await server.close()


async def cancel(server: Any, start: asyncio.Task[None]) -> None:
    start.cancel()
    await asyncio.wait([start])
    if not start.cancelled():  # it had started before
        await server.close()


async def interrupted(server: Any, interrupt: Interrupt, steps: int) -> BaseException | None:
    """Start a server, interrupt it after so many rounds of the loop, and return the error of the start."""
    start = asyncio.create_task(server.start())
    for _ in range(steps):
        await asyncio.sleep(0)
    await interrupt(server, start)
    error: BaseException | None = (await asyncio.gather(start, return_exceptions=True))[0]
    assert isinstance(error, (PortError, asyncio.CancelledError, type(None))), repr(error)
    assert start.done()
    await asyncio.sleep(0)  # asyncio closes the socket of a transport in the next round
    return error


@pytest.mark.parametrize("interrupt", [close, cancel])
@pytest.mark.parametrize("steps", STEPS)
@pytest.mark.parametrize(
    ("scheme", "kind"), [("tcp", socket.SOCK_STREAM), ("rtu+tcp", socket.SOCK_STREAM), ("udp", socket.SOCK_DGRAM)]
)
def test_a_modbus_server_leaves_no_socket_open(scheme: str, kind: int, interrupt: Interrupt, steps: int) -> None:
    with socket.socket(socket.AF_INET, kind) as listener:
        listener.bind(("127.0.0.1", 0))
        server = barewire.AsyncModbusServer(f"{scheme}://127.0.0.1:0", {1: Table()}, listener=listener)
        error = asyncio.run(interrupted(server, interrupt, steps))
        if not steps:  # closed before the start: it never had the socket
            assert isinstance(error, (PortError, asyncio.CancelledError))
        else:
            assert listener.fileno() == -1
            assert error is None or "closed" in str(error) or isinstance(error, asyncio.CancelledError)


@pytest.mark.parametrize("interrupt", [close, cancel])
@pytest.mark.parametrize("steps", [0, 1, 2, 3])
def test_a_canopen_server_leaves_no_bus_open(interrupt: Interrupt, steps: int) -> None:
    name = f"closed-{interrupt.__name__}-{steps}"
    server = barewire.AsyncCanopenServer(f"can://virtual/{name}?node=5", device="az3")

    async def main() -> None:
        await interrupted(server, interrupt, steps)
        while any(name in thread.name for thread in threading.enumerate()):  # the reader of the bus ends
            await asyncio.sleep(0.01)

    asyncio.run(asyncio.wait_for(main(), 30))


def test_the_text_of_a_start_that_was_closed() -> None:
    """On UDP: a start on TCP waits for nothing."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", 0))
        server = barewire.AsyncModbusServer("udp://127.0.0.1:0", {1: Table()}, listener=listener)
        error = asyncio.run(interrupted(server, close, 1))
    assert str(error) == f"{server.url}: closed while it started"


# Closed while it cannot end: it ends later ----------------------------------------------------------------------------


class VirtualTime:
    """A clock, and an event that is not set and a thread that does not end within any time-out."""

    now = 100.0

    def monotonic(self) -> float:
        return self.now

    def wait(self, timeout: float) -> bool:
        self.now += timeout
        return False

    def join(self, timeout: float) -> None:
        self.now += timeout


def test_close_waits_five_seconds_in_all(monkeypatch: pytest.MonkeyPatch) -> None:
    server = ModbusServer("tcp://127.0.0.1:0", {1: Table(1)})
    server.start()
    virtual = VirtualTime()
    with monkeypatch.context() as patched:
        patched.setattr(base, "time", virtual)
        patched.setattr(server, "_released", virtual)
        patched.setattr(server, "_thread", virtual)
        server.close()
    assert virtual.now == 105.0
    assert server._released.wait(30)


# Units that exit: an error of the unit in a thread, the end of the program in its main one ----------------------------

URLS = ["tcp://127.0.0.1:0", "udp://127.0.0.1:0", "rtu+tcp://127.0.0.1:0", "rtu://pty?pace=0"]
ENDS: list[BaseException] = [SystemExit(1), KeyboardInterrupt(), GeneratorExit(), asyncio.CancelledError("stop")]


class Fragile(Table):
    """A table that raises `error` when register 1 is read."""

    def __init__(self, error: BaseException) -> None:
        super().__init__(5)
        self.error = error

    def handle(self, request: Any, now: float) -> Any:
        if request == ReadHoldingRegisters(1, 1):
            raise self.error
        return super().handle(request, now)


@pytest.mark.parametrize("url", URLS)
@pytest.mark.parametrize("error", ENDS, ids=repr)
def test_in_a_thread_it_is_exception_04_and_the_server_stays(
    url: str, error: BaseException, caplog: pytest.LogCaptureFixture
) -> None:
    with ModbusServer(url, {1: Fragile(error)}) as server, ModbusClient(server.url, timeout=30) as client:
        with pytest.raises(ModbusException, match="exception 04"):
            client.read_holding_registers(1, 1)
        assert client.read_holding_registers(2, 1) == (0,)
        assert server.failure is None
        assert server.statistics.failures == [f"{type(error).__name__}: {error}"]
    (record,) = caplog.records
    assert "its code failed, exception 04" in record.getMessage()
    assert record.exc_info is not None
    assert record.exc_info[1] is error


@pytest.mark.parametrize("url", URLS[:3])
@pytest.mark.parametrize("error", ENDS[2:], ids=repr)
def test_in_an_asyncio_server_a_cancellation_by_a_unit_is_exception_04_and_one_of_the_task_is_not(
    url: str, error: BaseException, caplog: pytest.LogCaptureFixture
) -> None:
    async def run() -> None:
        opened = asyncio.get_running_loop().create_future()

        async def serve() -> None:
            async with AsyncModbusServer(url, {1: Fragile(error)}) as server:
                opened.set_result(server)
                await asyncio.Event().wait()

        task = asyncio.create_task(serve())
        server = await opened
        async with AsyncModbusClient(server.url, timeout=30) as client:
            with pytest.raises(ModbusException, match="exception 04"):
                await client.read_holding_registers(1, 1)
            assert await client.read_holding_registers(2, 1) == (0,)
            assert not task.done()
            assert server.statistics.failures == [f"{type(error).__name__}: {error}"]
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task

    asyncio.run(run())
    assert len([record for record in caplog.records if record.levelno == logging.ERROR]) == 1


@pytest.mark.parametrize("error", ENDS[:2], ids=repr)
def test_in_the_main_thread_it_ends_the_program(error: BaseException) -> None:
    server = ModbusServer(URLS[0], {1: Fragile(error)})

    def ask() -> None:
        with contextlib.suppress(OSError), ModbusClient(server.url, timeout=30) as client:
            client.read_holding_registers(1, 1)

    asking = threading.Thread(target=ask)
    asking.start()
    with pytest.raises(type(error)):
        server.run(threading.Event())
    asking.join(30)
    assert server.statistics.failures == []


def test_a_server_machine_without_on_failure_raises_it() -> None:
    server = Server(TcpLine(), {1: FailingUnit(SystemExit(1))}, serial=False)
    with pytest.raises(SystemExit):
        server.feed(encode(1, bytes.fromhex("03 0000 0001"), 1), 1.0)


def test_a_look_up_of_units_that_exits_ends_one_connection(caplog: pytest.LogCaptureFixture) -> None:
    class Units(dict[int, Any]):
        def get(self, key: int, default: Any = None) -> Any:
            if key == 9:
                raise SystemExit(3)
            return super().get(key, default)

    with ModbusServer(URLS[0], Units({1: Table(5)})) as server, ModbusClient(server.url, timeout=30) as client:
        with pytest.raises(OSError, match="closed"):
            client.at(unit=9).read_holding_registers(0, 1)
        assert client.read_holding_registers(0, 1) == (0,)
        assert server.connections.closed[-1].endswith("SystemExit: 3")


@pytest.mark.parametrize("error", [SystemExit(3), ValueError("wrong")], ids=repr)
def test_a_server_that_ends_says_so(
    error: BaseException, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(threading, "excepthook", lambda _: None)
    ended = threading.Event()
    server = ModbusServer(URLS[0], {1: Table(5)})

    def serve(stop: threading.Event) -> None:
        raise error

    monkeypatch.setattr(server, "_serve", serve)
    server.on_end = ended.set
    server.start()
    assert ended.wait(30)
    assert server.failure is error
    (record,) = caplog.records
    assert f"ended: its code failed: {type(error).__name__}: {error}" in record.getMessage()
    server.close()
