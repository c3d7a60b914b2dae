"""RS-485: who turns the line, and what is said where it cannot be turned."""

from __future__ import annotations

import asyncio
import threading
from typing import Any

import pytest
import serial

from barewire.errors import PortError
from barewire.modbus import Table
from barewire.shells import open_async, open_host, open_modbus
from barewire.shells.pseudo_terminal import PseudoTerminal
from tests.helpers import refused


class Turned(serial.Serial):
    """A serial port that writes down what is done with its RTS: a pseudo-terminal has none."""

    log: list[Any]

    @property
    def rts(self) -> bool:
        return bool(self.log and self.log[-1])

    @rts.setter
    def rts(self, value: bool) -> None:
        self.log.append(value)

    def _update_rts_state(self) -> None:
        """Not here."""

    def write(self, data: Any) -> int | None:
        self.log.append("write")
        return super().write(data)

    def flush(self) -> None:
        self.log.append("flush")
        super().flush()


@pytest.fixture
def log(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    written: list[Any] = []
    monkeypatch.setattr(Turned, "log", written, raising=False)
    monkeypatch.setattr("barewire.shells.serial_port.serial.Serial", Turned)
    return written


def test_rts_is_on_while_we_send_and_off_when_the_last_bit_is_out(log: list[Any]) -> None:
    with open_host("rtu://pty", units={1: Table()}) as host, open_modbus(f"{host.url}?rs485=rts") as client:
        log.clear()
        assert client.read_holding_registers(0, 1) == (0,)
        assert log == [True, "write", "flush", False]


def test_the_same_under_asyncio_even_when_the_task_is_cancelled(log: list[Any]) -> None:
    async def talk(url: str) -> None:
        async with await open_async(url) as client:
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

    with open_host("rtu://pty", units={1: Table()}) as host:
        asyncio.run(talk(f"{host.url}?rs485=rts&pace=1"))


@pytest.mark.parametrize("how", ["kernel", "rts"])
def test_where_the_line_cannot_be_turned_it_is_said_when_it_is_opened(how: str) -> None:
    terminal = PseudoTerminal()
    with refused(PortError, f"{terminal.path}: rs485={how} is not possible here"):
        open_modbus(f"rtu://{terminal.path}?rs485={how}")
    terminal.close()


def test_a_line_that_echoes() -> None:
    """A two-wire adapter on a real pseudo-terminal: everything that is sent comes back first."""
    terminal, stop = PseudoTerminal(), threading.Event()

    def echo_and_answer() -> None:
        while not stop.is_set():
            request = terminal.receive(0.05)
            if request:
                terminal.send(request + bytes.fromhex("01 03 02 00 2A 39 9B"))

    thread = threading.Thread(target=echo_and_answer)
    thread.start()
    with open_modbus(f"rtu://{terminal.path}?echo=1") as client:
        for _ in range(3):
            assert client.read_holding_registers(0, 1) == (42,)
    stop.set()
    thread.join(5)
    terminal.close()
