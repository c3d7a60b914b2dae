"""Servers on a serial line, in a thread and with asyncio: one request after the other."""

from __future__ import annotations

import asyncio
import os
import select
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from barewire import AsyncModbusServer, ModbusServer
from barewire.modbus import Delayed, ReadHoldingRegisters, ReadHoldingRegistersResponse, Response
from barewire.rtu import encode

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
