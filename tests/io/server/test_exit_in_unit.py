"""Units that raise SystemExit, CancelledError and the like: an error of the unit in a thread, the end of the program
in its main thread. A server that does end says so."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import threading
from typing import Any

import pytest

from barewire import AsyncModbusClient, AsyncModbusServer, ModbusClient, ModbusServer
from barewire.modbus import ModbusException, ReadHoldingRegisters, Server, Table
from barewire.tcp import TcpLine, encode
from tests.helpers import FailingUnit

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
