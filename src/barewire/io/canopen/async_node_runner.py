"""Machines that speak by themselves on a bus, each in a task: `can_run` with await."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Iterable
from types import TracebackType
from typing import Self

from barewire.canopen.frame import CanFrame
from barewire.errors import PortError
from barewire.io.canopen.async_bus import AsyncSubscriber
from barewire.io.canopen.node_runner import LOOK, Action, NodeDriver, Speaker, begin
from barewire.io.canopen.shared_bus import CanBus
from barewire.io.canopen.subscriber import Key


class AsyncRunning:
    """A machine at work in a task, until it is stopped or the bus is gone for good.

    `do` does something with it and says at once what comes of it. `refused` counts what the bus did not take.
    """

    def __init__(self, bus: CanBus, machine: Speaker, keys: Iterable[Key] | None) -> None:
        self.machine = machine
        self.refused = 0
        self._tap = AsyncSubscriber(bus, keys, node=True, reports=True)
        self._task = asyncio.create_task(self._live())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.stop()

    async def _live(self) -> None:
        machine, ears, clock = self.machine, NodeDriver(self.machine), time.monotonic
        with self._tap:
            said = begin(machine, clock())
            while True:
                for frame in said:
                    await self._say(frame)
                deadline = machine.deadline
                try:
                    arrived = await self._tap.pull_async(LOOK if deadline is None else min(LOOK, deadline - clock()))
                except PortError:
                    return
                said = ears.hear(None if arrived is None else arrived.item, clock())
                await asyncio.sleep(0)

    async def _say(self, frame: CanFrame) -> None:
        try:
            self._tap.write(frame)
            await self._tap.sent()
        except PortError:
            self.refused += 1

    async def do(self, action: Action) -> None:
        """`action(now)`; the frames that it returns are said, and what is due then."""
        now = time.monotonic()
        for frame in [*(action(now) or ()), *self.machine.feed(None, now)]:
            await self._say(frame)

    def stop(self) -> None:
        """No further frame."""
        self._tap.hush()
        self._tap.close()
        self._task.cancel()

    close = stop
