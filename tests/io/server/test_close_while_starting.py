"""An asyncio server that is closed, or whose task is cancelled, while it starts: nothing stays open."""

from __future__ import annotations

import asyncio
import socket
import threading
from collections.abc import Awaitable, Callable
from typing import Any

import pytest

import barewire
from barewire.errors import PortError
from barewire.modbus import Table

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
