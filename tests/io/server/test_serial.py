"""Servers on a serial line, in a thread and with asyncio: one request after the other."""

from __future__ import annotations

import asyncio
import os
import select
import threading
import time
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from barewire import AsyncModbusServer, ModbusServer
from barewire.errors import PortError
from barewire.io.ports.async_links import SerialLink
from barewire.io.ports.serial import SerialPort
from barewire.modbus import (
    Delayed,
    ReadHoldingRegisters,
    ReadHoldingRegistersResponse,
    Response,
    Table,
    WriteSingleRegister,
)
from barewire.rtu import encode
from tests.helpers import PATIENCE

SERVERS = pytest.mark.parametrize("kind", ["thread", "asyncio"])


class Sensor:
    """A unit that returns the address as the value. Its response for address 1 is delayed."""

    delays = True

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds
        self.received = threading.Event()
        self.times: list[float] = []

    def handle(self, request: Any, now: float) -> Response | Delayed:
        assert isinstance(request, ReadHoldingRegisters)
        response = ReadHoldingRegistersResponse((request.address,))
        self.times.append(now)
        self.received.set()
        return Delayed(response, self.seconds) if request.address == 1 else response


def request(address: int) -> bytes:
    return encode(1, ReadHoldingRegisters(address, 1).encode())


def response(address: int) -> bytes:
    return encode(1, ReadHoldingRegistersResponse((address,)).encode())


@contextmanager
def line_with_server(kind: str, unit: Any, **options: Any) -> Iterator[int]:
    """Serve the unit on a pseudo-terminal; yield the descriptor of its other side."""
    ours, theirs = os.openpty()
    url = f"rtu://{os.ttyname(theirs)}?baudrate=115200"
    try:
        if kind == "thread":
            with ModbusServer(url, {1: unit}, **options):
                yield ours
            return
        serving, end = threading.Event(), threading.Event()

        async def serve() -> None:
            async with AsyncModbusServer(url, {1: unit}, **options):
                serving.set()
                await asyncio.to_thread(end.wait)

        thread = threading.Thread(target=asyncio.run, args=(serve(),))
        thread.start()
        try:
            assert serving.wait(30)
            yield ours
        finally:
            end.set()
            thread.join(30)
    finally:
        os.close(ours)
        os.close(theirs)


def received(line: int, size: int) -> bytes:
    data = b""
    while len(data) < size and select.select([line], [], [], 30)[0]:
        data += os.read(line, 4096)
    return data


@SERVERS
def test_a_request_during_a_delayed_response_is_carried_out_after_it(kind: str) -> None:
    """Until then it waits in the buffer of the port."""
    unit = Sensor(0.3)
    with line_with_server(kind, unit) as line:
        os.write(line, request(1))
        assert unit.received.wait(30)
        os.write(line, request(2))
        expected = response(1) + response(2)
        assert received(line, len(expected)) == expected
    first, second = unit.times
    assert second - first > 0.29


@SERVERS
def test_a_request_during_a_late_response_is_answered_after_it(kind: str) -> None:
    unit = Sensor(0.0)
    with line_with_server(kind, unit, faults="late=0.3@nth=1") as line:
        os.write(line, request(3))
        assert unit.received.wait(30)
        os.write(line, request(2))
        expected = response(3) + response(2)
        assert received(line, len(expected)) == expected


WRITE = encode(1, WriteSingleRegister(5, 1).encode())


@SERVERS
def test_a_write_is_carried_out_again_although_sending_its_response_ended_late(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As on a busy machine: the next request, a silence behind the response, is received before the server goes on."""
    monkeypatch.setattr(SerialPort, "send", _ends_late(SerialPort.send))
    monkeypatch.setattr(SerialLink, "sent", _ends_late_in_loop(SerialLink.sent))
    table = Table(10)
    with line_with_server(kind, table) as line:
        for _ in range(5):
            os.write(line, WRITE)
            assert received(line, len(WRITE)) == WRITE
            time.sleep(0.0025)  # t3.5 is 1.75 ms


def _ends_late(send: Callable[[SerialPort, bytes], None]) -> Callable[[SerialPort, bytes], None]:
    def slow(port: SerialPort, item: bytes) -> None:
        send(port, item)
        time.sleep(0.05)

    return slow


def _ends_late_in_loop(sent: Callable[[SerialLink], Awaitable[None]]) -> Callable[[SerialLink], Awaitable[None]]:
    async def slow(link: SerialLink) -> None:
        await sent(link)
        await asyncio.sleep(0.05)

    return slow


@SERVERS
@pytest.mark.parametrize("echo", ["1", "auto"])
def test_a_server_on_an_adapter_that_echoes_late_executes_a_write_once(
    kind: str, echo: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("barewire.modbus.server.server._ECHO_WITHIN", PATIENCE)
    writes: list[object] = []
    with line_with_server(kind, Table(10, on_write=lambda *change: writes.append(change)), echo=echo) as line:
        os.write(line, WRITE)
        assert received(line, len(WRITE)) == WRITE
        time.sleep(0.005)
        os.write(line, WRITE)
        other = encode(1, ReadHoldingRegisters(5, 1).encode())
        os.write(line, other)
        answer = encode(1, ReadHoldingRegistersResponse((1,)).encode())
        assert received(line, len(answer)) == answer
    assert len(writes) == 1


@pytest.mark.parametrize("name", ["tty-nowhere", "serial/by-id/usb-nowhere", "../dev/tty-nowhere"])
def test_a_port_that_does_not_exist_is_no_pseudo_terminal_in_dev(name: str) -> None:
    """A service that starts before its adapter would serve nobody, and hide it."""
    with pytest.raises(PortError, match=r"nowhere: there is no such port; .* outside /dev, .* rtu://pty"):
        ModbusServer(f"rtu:///dev/{name}", {1: Table(10)})
    assert not os.path.lexists(f"/dev/{name}")
