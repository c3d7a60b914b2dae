"""A client that was opened before `fork`: the child's copy is refused, the parent's stays usable."""

from __future__ import annotations

import asyncio
import os
import threading
import time
import warnings
from collections.abc import Callable
from typing import Any

import pytest

from barewire import AsyncCanopenClient, AsyncModbusClient, CanopenClient, ModbusClient, ModbusServer, Table
from barewire.canopen import CanFrame
from barewire.errors import NoAnswer, PortError
from tests.io.schemes import EVERY_SCHEME_WITHOUT_TLS, SERIAL

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="Windows has no fork")

UNITS = {1: Table(holding_registers=range(100))}
REFUSAL = "the client was opened before fork: open one in this process"


def in_child(work: Callable[[], object]) -> str:
    """What `work` returns or raises in a forked process."""
    ours, theirs = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # this process has threads
        process = os.fork()
    if not process:
        try:
            text = str(work())
        except BaseException as error:
            text = f"{type(error).__name__}: {error}"
        os.write(theirs, text.encode())
        os._exit(0)
    os.close(theirs)
    with os.fdopen(ours, encoding="utf-8") as pipe:
        text = pipe.read()
    os.waitpid(process, 0)
    return text


def use_and_close(client: Any) -> object:
    try:
        return client.read_holding_registers(50, 1)
    finally:
        client.close()


@EVERY_SCHEME_WITHOUT_TLS
def test_a_client_that_was_opened_before_fork(scheme: str) -> None:
    url = f"{scheme}://{'pty?pace=0' if scheme in SERIAL else '127.0.0.1:0'}"
    with ModbusServer(url, UNITS) as server, ModbusClient(server.url, timeout=30) as client:
        assert client.read_holding_registers(1, 1) == (1,)
        assert in_child(lambda: use_and_close(client)) == f"PortError: {REFUSAL}"
        assert in_child(client.open) == f"PortError: {REFUSAL}"
        assert client.read_holding_registers(2, 1) == (2,)


def test_a_client_opened_in_the_child_works_and_so_does_one_without_a_connection() -> None:
    with ModbusServer("tcp://127.0.0.1:0", UNITS) as server, ModbusClient(server.url, lazy=True) as lazy:

        def fresh() -> object:
            with ModbusClient(server.url, timeout=30) as client:
                return client.read_holding_registers(50, 1)

        assert in_child(fresh) == "(50,)"
        assert in_child(lambda: lazy.read_holding_registers(51, 1)) == "(51,)"
        assert lazy.read_holding_registers(1, 1) == (1,)


def test_a_fork_during_a_request_of_another_thread() -> None:
    """The child inherits locks that no thread of its own will ever release."""
    sent = threading.Event()
    with ModbusServer("tcp://127.0.0.1:0", UNITS, faults={"drop": 1.0}) as server:
        client = ModbusClient(server.url, timeout=2, watch=lambda direction, data: sent.set())

        def ask() -> None:
            with pytest.raises(NoAnswer):
                client.read_holding_registers(0, 1)

        thread = threading.Thread(target=ask)
        thread.start()
        assert sent.wait(30)
        began = time.monotonic()
        assert in_child(lambda: use_and_close(client)) == f"PortError: {REFUSAL}"
        assert time.monotonic() - began < 60
        thread.join()
        client.close()


@pytest.mark.parametrize("in_flight", [1, 4])
def test_an_asyncio_client(in_flight: int) -> None:
    async def main(url: str) -> None:
        async with AsyncModbusClient(url, timeout=30, in_flight=in_flight) as client:
            assert await client.read_holding_registers(1, 1) == (1,)

            async def use() -> object:
                try:
                    return await client.read_holding_registers(50, 1)
                finally:
                    await client.close()

            assert in_child(lambda: asyncio.run(use())) == f"PortError: {REFUSAL}"
            assert await client.read_holding_registers(2, 1) == (2,)

    with ModbusServer("tcp://127.0.0.1:0", UNITS) as server:
        asyncio.run(main(server.url))


class Port:
    """A CAN port that records what is done with it."""

    name = "recorded"

    def __init__(self) -> None:
        self.done: list[str] = []

    def send(self, item: CanFrame) -> None:
        self.done.append("send")

    def receive(self, timeout: float) -> CanFrame | None:
        time.sleep(0.001)
        return None

    def close(self) -> None:
        self.done.append("close")


def test_a_can_bus() -> None:
    port = Port()
    with CanopenClient(port) as client:

        def use() -> object:
            try:
                return client.node(5).sdo.upload(0x1000)
            except PortError as error:
                client.close()
                client.bus.close()
                return f"{error} {port.done}"

        assert in_child(use) == "recorded: the bus was opened before fork: open one in this process []"
        assert client.bus.failure is None


def test_a_stream_of_a_can_bus() -> None:
    """The child has no thread that reads the bus, and a lock of the stream may be held by one of the parent."""
    refusal = "recorded: the bus was opened before fork: open one in this process"
    with CanopenClient(Port()) as client, client.frames() as stream:

        def use() -> object:
            with pytest.raises(PortError) as caught:
                stream.get(3.0)
            with pytest.raises(PortError):
                next(iter(stream))
            stream.close()
            return caught.value

        with stream._subscriber._lock:
            assert in_child(use) == refusal
        client.bus.send(CanFrame(0x185))
        assert stream.get(0.0) == CanFrame(0x185)


def test_a_stream_of_an_asyncio_can_client() -> None:
    async def main() -> None:
        async with AsyncCanopenClient(Port()) as client:
            stream = client.frames()

            async def use() -> object:
                try:
                    return await stream.get(3.0)
                finally:
                    stream.close()

            assert in_child(lambda: asyncio.run(use())).startswith(
                "PortError: recorded: the bus was opened before fork"
            )
            assert await stream.get(0.0) is None

    asyncio.run(main())
