"""An SDO transfer that the caller ends, by cancelling its task or in its progress function."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from barewire import CanopenClient
from barewire.canopen import CanFrame
from barewire.io.canopen.async_client import AsyncCanopenClient
from barewire.io.canopen.bus.shared_bus import CanBus
from tests.io.canopen.memory_bus import MemoryPort, device, memory_bus


@pytest.mark.parametrize("block", [False, True])
@pytest.mark.parametrize("downloads", [False, True])
def test_cancelled_at_every_await_and_the_next_transfer_works(block: bool, downloads: bool) -> None:
    """A task is cancelled at its first step, at its second ... until one comes to its end before that.

    Only after a block upload the next transfer waits for a time-out; otherwise the test would take minutes.
    """
    value = bytes(place % 256 for place in range(60))

    async def main(bus: CanBus) -> int:
        client = AsyncCanopenClient(bus, node=5, timeout=0.1 if block and not downloads else 60.0)
        node = device()
        client.host(node)
        await asyncio.sleep(0)
        for steps in range(10_000):
            await client.node().sdo.download(0x2100, 0, value)
            task: asyncio.Task[Any] = asyncio.create_task(
                client.node().sdo.download(0x2100, 0, value[::-1], block=block)
                if downloads
                else client.node().sdo.upload(0x2100, block=block)
            )
            for _ in range(steps):
                await asyncio.sleep(0)
            ended = task.done()
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
            assert await client.node().sdo.upload(0x2100) in ((value, value[::-1]) if downloads else (value,))
            assert await client.node().sdo.upload(0x6041) == bytes.fromhex("3706")
            if ended:
                return steps
        raise AssertionError("it did not end")

    with memory_bus() as bus:
        assert asyncio.run(main(bus)) >= 5


@pytest.mark.parametrize("block", [False, True])
def test_a_transfer_ended_by_its_progress_function_leaves_the_channel_usable(block: bool) -> None:
    with memory_bus() as bus, CanopenClient(bus, node=5, timeout=30.0) as client, client.host(device()):
        client.node().sdo.download(0x2100, 0, bytes(2000))
        for moment in range(3):
            left = moment

            def stop(done: int, size: int | None) -> None:
                nonlocal left
                left -= 1
                if left < 0:
                    raise KeyboardInterrupt

            with pytest.raises(KeyboardInterrupt):
                client.node().sdo.upload(0x2100, block=block, progress=stop, timeout=0.5)
            assert client.node().sdo.upload(0x2100, block=block) == bytes(2000)


class Cramped(MemoryPort):
    """A controller with room for so many frames."""

    def __init__(self, room: int) -> None:
        super().__init__()
        self.room = room

    def try_send(self, item: CanFrame) -> bool:
        if self.room <= 0:
            return False
        self.room -= 1
        self.send(item)
        return True


def test_a_task_cancelled_within_a_burst_sends_its_abort_when_there_is_room() -> None:
    """The controller takes five frames of a burst of sixteen. The abort follows after the rest of them."""

    async def main(bus: CanBus, port: Cramped) -> list[CanFrame]:
        client = AsyncCanopenClient(bus, node=5, timeout=30.0)
        task: asyncio.Task[Any] = asyncio.create_task(client.node().sdo.download(0x2100, 0, bytes(2000), block=True))
        while not port.sent:
            await asyncio.sleep(0.001)
        port.deliver(CanFrame.parse("585#A40021007F000000"))
        while port.room:
            await asyncio.sleep(0.001)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        assert len(port.sent) == 6
        port.room = 100
        async with asyncio.timeout(10):
            while port.room > 100 - 12:
                await asyncio.sleep(0.001)
        return list(port.sent)

    port = Cramped(6)
    with CanBus(port) as bus:
        sent_texts = [str(frame) for frame in asyncio.run(main(bus, port))]
    assert [text[:6] for text in sent_texts[1:17]] == [f"605#{number:02X}" for number in range(1, 17)]
    assert sent_texts[17:] == ["605#8000210000000008"]
