"""The asyncio CANopen client: the same words as the blocking one, on the same buses.

    async with await open_canopen_async("can://socketcan/can0?node=5") as client:
        await client.upload(0x6041)
        await asyncio.gather(*(client.at(node=node).upload(0x1000) for node in range(1, 6)))

On one SDO channel one transfer at a time, in the order in which they were asked for; different nodes at the same time.
A task that is cancelled abandons its transfer: the device is told, and what it still answers is nobody's answer.
"""

from __future__ import annotations

import asyncio
from types import TracebackType
from typing import Any, Self, TypeVar
from weakref import WeakSet

from barewire.canopen import CanFrame
from barewire.conversation import Conversation
from barewire.errors import BarewireError, EncodeError
from barewire.io.canopen.async_bus import AsyncStream, AsyncSubscriber, turn, wait_open
from barewire.io.canopen.async_node_runner import AsyncRunning
from barewire.io.canopen.client import manners, open_bus
from barewire.io.canopen.event_stream import Listener
from barewire.io.canopen.methods import MasterVerbs
from barewire.io.canopen.node_runner import Speaker
from barewire.io.canopen.operations import Talk
from barewire.io.canopen.pdo_lss_methods import LssVerbs, PdoVerbs
from barewire.io.canopen.subscriber import Key
from barewire.io.engine.asyncio import run
from barewire.io.ports.trace import Watch

T = TypeVar("T")
E = TypeVar("E")


class AsyncCanopenClient(MasterVerbs, PdoVerbs, LssVerbs):
    """A client of the nodes on a bus. `node` and `timeout` (seconds) hold where a call does not say otherwise.

    `bus` is a bus that is shared, or a port that becomes this client's own.
    """

    _mine: WeakSet[AsyncRunning | AsyncStream[Any]]

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None
    ) -> None:
        await self.aclose()

    def close(self) -> None:
        """End what this client began: its streams, what it has running, and the bus, unless that is shared."""
        self._end()
        if self.owns_bus:
            self.bus.close()

    async def aclose(self) -> None:
        """The same, without keeping the loop waiting for the reader."""
        self._end()
        if self.owns_bus:
            await asyncio.to_thread(self.bus.close)

    def _end(self) -> None:
        for one in list(self._mine):
            one.close()

    async def run(self, conversation: Conversation[CanFrame, T]) -> T:
        """Carry any conversation out. Nobody knows whom it would disturb, so it has the bus alone."""
        return await self.carry_out(Talk(conversation, None, None))

    async def carry_out(self, talk: Talk[T]) -> T:
        """What every verb does: wait for its turn, then talk. A bus that is being opened anew is given our time-out."""
        await wait_open(self.bus, self.timeout)
        async with turn(self.bus, talk.claims):
            with AsyncSubscriber(self.bus, talk.hears) as tap:
                try:
                    return await run(talk.conversation, tap)
                except BarewireError as error:
                    tap.tell(error)
                    raise

    def watch(self, machine: Listener[E], hears: frozenset[Key] | None = None) -> AsyncStream[E]:
        """The events of any machine that listens; `hears` are the identifiers that it needs, None for all."""
        stream = AsyncStream(self.bus, machine, hears)
        self._mine.add(stream)
        return stream

    def keep_going(self, machine: Speaker, hears: frozenset[Key] | None = None) -> AsyncRunning:
        """Let any machine speak on the bus until it is stopped."""
        running = AsyncRunning(self.bus, machine, hears)
        self._mine.add(running)
        return running


async def open_canopen_async(url: str, *, dialect: str = "standard", watch: Watch | None = None) -> AsyncCanopenClient:
    """The client for a can:// URL, as `open_canopen`. `watch` is called in the thread that reads."""
    options = manners(url)
    bus = await asyncio.to_thread(open_bus, url, watch=watch)
    try:
        client = AsyncCanopenClient(bus, dialect=dialect, **options)
    except EncodeError:
        bus.close()
        raise
    client.owns_bus = True
    return client
