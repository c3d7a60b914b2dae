"""RS-485: what sets the direction of the line, and the errors where that is not possible."""

from __future__ import annotations

import asyncio
import threading
from typing import Any

import pytest
import serial

from barewire import AsyncModbusClient, AsyncModbusServer, ModbusClient, ModbusServer
from barewire.errors import EncodeError, PortError
from barewire.io.ports.descriptor import SharedDescriptor
from barewire.io.ports.pty import PseudoTerminal
from barewire.modbus import Table, WriteSingleRegister
from tests.helpers import refused
from tests.interop.relay import relayed


class Turned(serial.Serial):
    """A serial port that logs its RTS, which a pseudo-terminal does not have."""

    log: list[Any]

    @property
    def rts(self) -> bool:
        return bool(self.log and self.log[-1])

    @rts.setter
    def rts(self, value: bool) -> None:
        self.log.append(value)

    def _update_rts_state(self) -> None:
        """A pseudo-terminal has no RTS."""

    def flush(self) -> None:
        self.log.append("flush")
        super().flush()


@pytest.fixture
def log(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    written: list[Any] = []
    monkeypatch.setattr(Turned, "log", written, raising=False)
    monkeypatch.setattr("barewire.io.ports.serial.serial.Serial", Turned)

    class Written(SharedDescriptor):
        def write(self, item: bytes, timeout: float) -> bool:
            written.append("write")
            return super().write(item, timeout)

    monkeypatch.setattr("barewire.io.ports.serial.SharedDescriptor", Written)
    return written


def test_rts_is_on_while_sending_and_off_after_the_last_bit(log: list[Any]) -> None:
    with ModbusServer("rtu://pty", units={1: Table()}) as host, ModbusClient(f"{host.url}?rs485=rts") as client:
        log.clear()
        assert client.read_holding_registers(0, 1) == (0,)
        assert log == [True, "write", "flush", False]


def test_rts_with_asyncio_even_if_the_task_is_cancelled(log: list[Any]) -> None:
    async def main(url: str) -> None:
        async with AsyncModbusClient(url) as client:
            log.clear()
            assert await client.read_holding_registers(0, 1) == (0,)
            assert log == [True, False]
            log.clear()
            task = asyncio.ensure_future(client.read_holding_registers(1, 1))
            while not log:
                await asyncio.sleep(0)
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
            await asyncio.sleep(0.1)
            assert log == [True, False]
            assert await client.read_holding_registers(2, 1) == (0,)

    with ModbusServer("rtu://pty", units={1: Table()}) as host:
        asyncio.run(main(f"{host.url}?rs485=rts&pace=1"))


# A function of the caller --------------------------------------------------------------------------------------------


def test_a_function_of_the_caller_sets_the_direction() -> None:
    turned: list[bool] = []
    with (
        ModbusServer("rtu://pty", units={1: Table()}) as host,
        ModbusClient(host.url, set_direction=turned.append) as client,
    ):
        assert turned == [False]
        assert client.read_holding_registers(0, 1) == (0,)
        assert turned == [False, True, False]
        client.broadcast(WriteSingleRegister(0, 1), turnaround=0.0)
        assert turned == [False, True, False, True, False]


def test_a_function_sets_the_direction_for_the_asyncio_client_and_server() -> None:
    directions: list[bool] = []
    answered: list[bool] = []

    async def main(ours: str, theirs: str) -> None:
        server = AsyncModbusServer(f"rtu://{theirs}?baudrate=115200", {1: Table()}, set_direction=answered.append)
        client = AsyncModbusClient(f"rtu://{ours}?baudrate=115200", set_direction=directions.append)
        async with server, client:
            for _ in range(3):
                assert await client.read_holding_registers(0, 1) == (0,)
        assert directions == [False, *[True, False] * 3]
        assert answered == [False, *[True, False] * 3]

    with relayed() as (ours, theirs):
        asyncio.run(main(ours, theirs))


def test_a_port_closed_while_sending_is_set_back_to_receiving() -> None:
    turned: list[bool] = []

    async def main(url: str) -> None:
        client = AsyncModbusClient(f"{url}?pace=1&baudrate=300", set_direction=turned.append)
        async with client:
            task = asyncio.ensure_future(client.read_holding_registers(1, 1))
            while turned != [False, True]:
                await asyncio.sleep(0)
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
        assert turned == [False, True, False]

    terminal = PseudoTerminal()
    asyncio.run(main(f"rtu://{terminal.path}"))
    terminal.close()


@pytest.mark.parametrize("fails_at", [1, 2, 3])
def test_a_direction_function_that_raises_is_a_port_error(fails_at: int) -> None:
    calls = 0

    def turn(sending: bool) -> None:
        nonlocal calls
        calls += 1
        if calls >= fails_at:  # from then on: an asyncio client that has its answer already opens the port again
            raise RuntimeError("no such pin")

    async def main(url: str) -> None:
        with refused(PortError, "the direction of the line could not be set: RuntimeError: no such pin"):
            async with AsyncModbusClient(url, set_direction=turn) as client:
                await client.read_holding_registers(0, 1)
                await client.read_holding_registers(0, 1)

    with ModbusServer("rtu://pty", units={1: Table()}) as host:
        with (
            refused(PortError, "the direction of the line could not be set: RuntimeError: no such pin"),
            ModbusClient(host.url, set_direction=turn) as client,
        ):
            client.read_holding_registers(0, 1)
        calls = 0
        asyncio.run(main(host.url))


@pytest.mark.parametrize("url", ["tcp://127.0.0.1:1", "rtu+tcp://127.0.0.1:1", "rtu:///dev/null?rs485=rts"])
def test_set_direction_is_refused_where_there_is_no_direction(url: str) -> None:
    with pytest.raises(EncodeError, match="set_direction"):
        ModbusClient(url, set_direction=lambda sending: None)
    with refused(EncodeError, "a new pseudo-terminal has no direction to set"):
        ModbusServer("rtu://pty", units={1: Table()}, set_direction=lambda sending: None)


@pytest.mark.parametrize("how", ["kernel", "rts"])
def test_a_port_without_rs485_modes_is_an_error_when_it_is_opened(how: str) -> None:
    terminal = PseudoTerminal()
    with refused(PortError, f"{terminal.path}: rs485={how} is not possible here"):
        ModbusClient(f"rtu://{terminal.path}?rs485={how}")
    terminal.close()


@pytest.mark.parametrize("echo", ["1", "auto"])
def test_an_echo_is_not_taken_for_an_answer(echo: str) -> None:
    """A two-wire adapter on a real pseudo-terminal: everything that is sent comes back first."""
    terminal, stop = PseudoTerminal(), threading.Event()

    def echo_and_answer() -> None:
        while not stop.is_set():
            request = terminal.receive(0.05)
            if request:
                terminal.send(request + bytes.fromhex("01 03 02 00 2A 39 9B"))

    thread = threading.Thread(target=echo_and_answer)
    thread.start()
    with ModbusClient(f"rtu://{terminal.path}?echo={echo}") as client:
        for _ in range(3):
            assert client.read_holding_registers(0, 1) == (42,)
    stop.set()
    thread.join(30)
    terminal.close()
