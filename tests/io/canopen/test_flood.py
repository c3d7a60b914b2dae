"""Transfers on a bus full of other frames, some of which resemble responses."""

from __future__ import annotations

import asyncio
import itertools
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from barewire import CanopenClient
from barewire.canopen import CanFrame, ErrorFrame, FdFrame
from barewire.io.canopen.async_client import AsyncCanopenClient
from barewire.io.canopen.bus.shared_bus import CanBus
from barewire.io.canopen.bus.subscriber import FramesLost
from tests.helpers import PATIENCE
from tests.io.canopen.memory_bus import MemoryPort, device

ANSWER = bytes.fromhex("4300100092010200")
OTHERS = (
    CanFrame(0x585, ANSWER, extended=True),
    CanFrame(0x605, bytes.fromhex("8000100000000008"), extended=True),
    CanFrame(0x585, b"", remote=True, requested=8),
    CanFrame(0x605, b"", remote=True, requested=8),
    CanFrame(0x586, ANSWER),
    CanFrame(0x18FF1234, bytes(8), extended=True),
    CanFrame(0x000, b"\x02\x07"),
    CanFrame(0x705, b"\x05"),
    FdFrame(0x585, bytes(64)),
    ErrorFrame(0x4, bytes(8)),
)
LATE = CanFrame(0x585, bytes.fromhex("4300300078563412"))  # the response for an object that is never requested


@contextmanager
def flood(port: MemoryPort, *more: CanFrame) -> Iterator[None]:
    """Another node sends, as fast as the reader receives. The block begins when 30 of its frames were received."""
    over, flooded = threading.Event(), threading.Event()

    def send() -> None:
        for number, item in enumerate(itertools.cycle(OTHERS + more)):
            if over.is_set():
                return
            if number == 50:
                flooded.set()
            port.deliver(item)
            while len(port._incoming) > 20 and not over.is_set():
                over.wait(0.0005)

    thread = threading.Thread(target=send)
    thread.start()
    try:
        assert flooded.wait(PATIENCE)
        yield
    finally:
        over.set()
        thread.join()


def test_transfers_on_a_full_bus_give_the_right_values() -> None:
    port, value = MemoryPort(), bytes(number % 253 for number in range(3000))
    node = device()
    with CanBus(port) as bus, CanopenClient(bus, node=5, timeout=30.0) as client, client.host(node):
        slow = client.frames()
        with flood(port, LATE):
            give_up = time.monotonic() + PATIENCE
            # Again, if the thread that floods had no turn during all transfers.
            while client.channel().total.late == 0 and time.monotonic() < give_up:
                for number in range(1, 100):
                    assert client.node().sdo.upload(0x3000 + number) == (number * 7919).to_bytes(4, "little")
        with flood(port):
            for block in (False, True):
                client.node().sdo.download(0x2100, 0, value, block=block)
                assert client.node().sdo.upload(0x2100, block=block) == value
        assert client.channel().total.garbled == 0
        assert client.channel().total.late > 0
        assert slow.lost > 0
        assert any(isinstance(slow.get(0.0), FramesLost) for _ in range(2000))
        assert node.sdo.counters.aborts_sent == 0


def test_transfers_of_tasks_on_a_full_bus_give_the_right_values() -> None:
    async def main(bus: CanBus, port: MemoryPort) -> None:
        async with AsyncCanopenClient(bus, node=5, timeout=30.0) as client:
            with client.host(device()):
                await asyncio.sleep(0)
                with flood(port, LATE):
                    sdo = client.node().sdo
                    values = await asyncio.gather(*(sdo.upload(0x3000 + number) for number in range(1, 50)))
        assert values == [(number * 7919).to_bytes(4, "little") for number in range(1, 50)]

    port = MemoryPort()
    with CanBus(port) as bus:
        asyncio.run(main(bus, port))
