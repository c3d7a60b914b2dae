"""Interrupted exchanges: by the user, by an unplugged line, by Force Listen Only Mode."""

from __future__ import annotations

import asyncio
import contextlib
import threading
import time
from pathlib import Path

import pytest

from barewire import AsyncModbusClient, ModbusClient, ModbusServer
from barewire.errors import NoAnswer, PortError
from barewire.io.ports.pty import PseudoTerminal
from barewire.modbus import Diagnostics, Unanswered
from tests.helpers import until
from tests.io.peers import full
from tests.io.schemes import SERIAL


@pytest.mark.parametrize("wire", ["tcp", "rtu", "ascii"])
def test_an_interrupt_at_every_step_of_a_blocking_exchange(wire: str) -> None:
    """As by Ctrl-C: before the request is sent, when its answer begins, in the middle of the answer."""
    left = 0

    def watch(direction: str, item: bytes) -> None:
        nonlocal left
        left -= 1
        if left == 0:
            raise KeyboardInterrupt

    where = "tcp://127.0.0.1:0" if wire == "tcp" else f"{wire}://pty?baudrate=115200"
    with ModbusServer(where, units=full()) as host, ModbusClient(host.url, watch=watch, late_window=30) as client:
        for step in range(1, 5):
            left = step
            with contextlib.suppress(KeyboardInterrupt):
                assert client.read_holding_registers(100 + step, 1) == (100 + step,)
            left = 0
            assert client.read_holding_registers(step, 1) == (step,)


@pytest.mark.parametrize("answered", [0, 3])
@pytest.mark.parametrize("wire", SERIAL)
def test_a_line_that_is_unplugged_in_the_middle_of_an_exchange(wire: str, answered: int, tmp_path: Path) -> None:
    """After the request or part of the answer: an error at once, and the next request works."""
    place = f"{tmp_path}/line"
    url = f"{wire}://{place}?timeout=5"

    def pull(terminal: PseudoTerminal) -> None:
        while not terminal.receive(30.0):
            pass
        terminal.send(b":010"[:answered] if wire == "ascii" else b"\x01\x03\x02"[:answered])
        time.sleep(0.05)
        terminal.close()

    def unplugged() -> threading.Thread:
        thread = threading.Thread(target=pull, args=(PseudoTerminal(place),))
        thread.start()
        return thread

    async def main() -> None:
        thread = unplugged()
        async with AsyncModbusClient(url, recovery="wait", late_window=0.1) as client:
            with pytest.raises(PortError):
                await client.read_holding_registers(8, 1)
            await asyncio.to_thread(thread.join, 5)
            with ModbusServer(f"{wire}://{place}", units=full()):
                assert await client.read_holding_registers(9, 1) == (9,)

    thread = unplugged()
    with ModbusClient(url, recovery="wait", late_window=0.1) as client:
        with pytest.raises(PortError):
            client.read_holding_registers(7, 1)
        thread.join(30)
        with ModbusServer(f"{wire}://{place}", units=full()):
            assert client.read_holding_registers(9, 1) == (9,)
    asyncio.run(main())


# Listen only mode -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("wire", ["rtu://pty?baudrate=115200", "ascii://pty?baudrate=115200", "rtu+tcp://127.0.0.1:0"])
def test_force_listen_only_and_restart_with_both_clients(wire: str) -> None:
    """Each request waits until the server has had the one before: a server that is late drops a request behind which
    the next has come."""

    async def main(url: str) -> None:
        async with AsyncModbusClient(url) as client:
            assert await client.diagnostics(0x04) == b""
            until(lambda: host.statistics.requests == 4)
            assert await client.ask(Diagnostics(0x01)) == Unanswered(0x01)
            until(lambda: host.statistics.requests == 5)
            assert await client.at(timeout=30.0).read_holding_registers(8, 1) == (8,)

    with ModbusServer(wire, units=full()) as host:
        url = f"{host.url}{'&' if '?' in host.url else '?'}timeout=0.1&late_window=0.1"
        with ModbusClient(url) as client:
            assert client.diagnostics(0x04) == b""
            until(lambda: host.statistics.requests == 1)
            assert client.ask(Diagnostics(0x01)) == Unanswered(0x01)
            until(lambda: host.statistics.requests == 2)
            assert client.at(timeout=30.0).read_holding_registers(7, 1) == (7,)
        asyncio.run(main(url))


def test_counters_of_a_unit_are_shared_by_all_connections_to_its_line() -> None:
    """All connections to a serial server share one line, and so its listen only mode."""
    with ModbusServer("rtu+tcp://127.0.0.1:0", units=full()) as host, ModbusClient(host.url) as first:
        assert first.read_holding_registers(7, 1) == (7,)
        with ModbusClient(f"{host.url}?late_window=0") as second:
            briefly = second.at(timeout=0.2)
            assert second.diagnostics(0x0B) == b"\0\2"
            assert briefly.diagnostics(0x04) == b""
            with pytest.raises(NoAnswer):
                first.at(timeout=0.2).read_holding_registers(7, 1)
            assert briefly.ask(Diagnostics(0x01)) == Unanswered(0x01)
        assert first.diagnostics(0x0B) == b"\0\1"
