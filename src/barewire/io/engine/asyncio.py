"""The asyncio engine: `blocking` with await, and the ports that it runs on.

A port's `write` only hands over, so it can be called while going down; `sent` waits until the bytes are out. What
comes is put in a mailbox, so nothing is lost when the task that waited for it was cancelled: the next one hears it.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections import deque
from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, Protocol, TypeVar, cast

from barewire.conversation import Conversation, Heard, Listen
from barewire.errors import BarewireError, PortError
from barewire.io.engine.blocking import farewell
from barewire.io.engine.fast_path import answer, listening
from barewire.io.ports.tcp import CHUNK, attend, reason
from barewire.io.ports.tls import tls_reason
from barewire.modbus.client.bus import Bus

if TYPE_CHECKING:
    from barewire.modbus.messages.base import Request, Response

Item = TypeVar("Item")
Result = TypeVar("Result")
R = TypeVar("R", bound="Response")


class AsyncPort(Protocol[Item]):
    """What the asyncio engine talks through."""

    def write(self, item: Item) -> None: ...

    def sent(self) -> Awaitable[float | None] | None:
        """Wait until what was written is out. None if it is at once."""

    async def receive(self, timeout: float) -> Item | None: ...


async def run(
    conversation: Conversation[Item, Result], port: AsyncPort[Item], heard: Heard[Item] | None = None
) -> Result:
    """Carry a conversation out; one that listens already is given `heard`. Cancelled, it may say its last words."""
    clock = asyncio.get_running_loop().time
    try:
        step = next(conversation) if heard is None else conversation.send(heard)
        while True:
            item: Item | None = None
            if isinstance(step, Listen):
                wait = step.until - clock()
                item = await port.receive(wait if wait > 0.0 else 0.0)
            else:
                for said in step.items:
                    port.write(said)
                leaving = port.sent()
                if leaving is not None:
                    await leaving
            step = conversation.send(_heard(Heard, (item, clock())))
    except StopIteration as stop:
        result: Result = stop.value
        return result
    except BaseException as gone:
        break_off(conversation, port, gone)
        raise


def break_off(conversation: Conversation[Item, Result], port: AsyncPort[Item], gone: BaseException) -> None:
    """Cut a conversation off, and send what it still wants to say, if that can be done."""
    for item in farewell(conversation, gone):
        with contextlib.suppress(BarewireError):
            port.write(item)


async def exchange(bus: Bus, unit: int, request: Request[R], timeout: float, port: AsyncPort[bytes]) -> R:
    """The exchange of `io.engine.fast_path`, with await. Where answers are numbered, what is written is out."""
    frame = bus.begin(unit, request) if timeout > 0.0 else None
    if frame is None:
        return await run(bus.ask(unit, request, timeout=timeout), port)
    clock = asyncio.get_running_loop().time
    now = 0.0  # not out yet
    try:
        port.write(frame)
        now = clock()
        data = await port.receive(timeout)
        response = answer(bus, unit, request, data, now)
        if response is not None:
            return response
        heard = Heard(data, clock())
    except BaseException as gone:
        break_off(listening(bus, unit, request, timeout, now), port, gone)
        raise
    return await run(listening(bus, unit, request, timeout, now), port, heard)


_heard = tuple.__new__  # what Heard(...) does, without the function around it
MAILBOX = 0x10000
"""Bytes that may lie in a mailbox: 250 of the longest frames."""


class Mailbox:
    """What came and nobody has taken yet. `write` is where the bytes of whoever has this mailbox go."""

    def __init__(self, name: str, write: Callable[[bytes], None]) -> None:
        self.name = name
        self.lost: str | None = None
        """Why nothing will come any more."""
        self._write = write
        self.chunks: deque[bytes] = deque()
        """What lies here."""
        self._waiting = 0
        self._waiter: asyncio.Future[bytes | None] | None = None
        self._until = 0.0  # when the waiter gives up
        self._timer: asyncio.TimerHandle | None = None
        self._loop = asyncio.get_running_loop()

    def put(self, data: bytes) -> None:
        """Bytes came. Whoever sends more than anybody takes is hung up on: the memory is not theirs."""
        waiter = self._waiter
        if waiter is not None and not self.chunks and not waiter.done():
            waiter.set_result(data)  # from hand to hand
            return
        if self.lost is not None:
            return
        self._waiting += len(data)
        if self._waiting > MAILBOX:
            self.chunks.clear()
            self.fail(f"more than {MAILBOX} bytes came that nobody asked for")
            return
        self.chunks.append(data)
        self._wake()

    def fail(self, why: str) -> None:
        """The connection is gone: whoever waits is told, after what came before."""
        self.lost = self.lost or why
        self._wake()
        self._disarm()

    def _wake(self) -> None:
        if self._waiter is not None and not self._waiter.done():
            self._waiter.set_result(None)

    def _arm(self, until: float) -> None:
        """Somebody waits, until then at most. A timer that rings too early is set anew when it rings: it need not be
        taken down and put up again for each of a thousand questions that are answered in time."""
        self._until = until
        if self._timer is None or self._timer.when() > until:
            self._disarm()
            self._timer = self._loop.call_at(until, self._ring)

    def _disarm(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _ring(self) -> None:
        self._timer = None
        if self._waiter is None:
            return
        if self._loop.time() >= self._until:
            self._wake()
        else:
            self._arm(self._until)

    def write(self, item: bytes) -> None:
        """Hand the bytes over; PortError if the connection is gone."""
        if self.lost is not None:
            raise PortError(f"{self.name}: {self.lost}")
        self._write(item)

    def sent(self) -> Awaitable[float | None] | None:
        """The system has them."""
        return None

    def take(self) -> bytes | None:
        """What is here already; PortError if nothing is and nothing will come."""
        if self.chunks:
            taken = self.chunks.popleft()
            self._waiting -= len(taken)
            return taken
        if self.lost is not None:
            raise PortError(f"{self.name}: {self.lost}")
        return None

    async def receive(self, timeout: float) -> bytes | None:
        """What came within `timeout` seconds, or None; PortError if the connection is gone."""
        for _ in range(2 if timeout <= 0 and not self.chunks else 0):
            await asyncio.sleep(0)  # the first lets the loop look at its ports, the second hand over what came there
        if self.chunks or self.lost is not None or timeout <= 0:
            return self.take()
        waiter = self._waiter = self._loop.create_future()
        self._arm(self._loop.time() + timeout)
        try:
            data = await waiter
        except asyncio.CancelledError:
            if waiter.done() and not waiter.cancelled() and (given := waiter.result()) is not None:
                self.chunks.appendleft(given)  # it came, and who waited for it was cancelled: the next one hears it
                self._waiting += len(given)
            raise
        finally:
            self._waiter = None
        return self.take() if data is None else data


class AsyncLink(Protocol):
    """An open connection: who gets what comes is told by `receive`, that it is gone by `lose`."""

    def write(self, item: bytes) -> None: ...

    def close(self) -> None: ...


class Connected(asyncio.BufferedProtocol):
    """A TCP or TLS connection. `receive` is given what comes, `lose` why nothing comes any more.

    It reads into a buffer of its own: asyncio would make one of 256 KiB for each answer of thirty bytes.
    """

    receive: Callable[[bytes], None]

    def __init__(self, lose: Callable[[str], None]) -> None:
        self._lose = lose
        self._transport: asyncio.Transport | None = None
        self._together: list[bytes] = []
        self._buffer = memoryview(bytearray(CHUNK))

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """asyncio: the connection stands."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        raw = transport.get_extra_info("socket")
        if raw is not None:
            attend(raw)

    def get_buffer(self, sizehint: int) -> memoryview:
        """asyncio: where to put what comes."""
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        """asyncio: bytes came."""
        self.receive(self._buffer[:nbytes].tobytes())

    def connection_lost(self, exc: Exception | None) -> None:
        """asyncio: the connection is gone."""
        self._lose(tls_reason(exc) if isinstance(exc, OSError) else "the other side closed the connection")

    def write(self, item: bytes) -> None:
        """Hand the bytes over."""
        if self._transport is not None:
            self._transport.write(item)

    def write_together(self, item: bytes) -> None:
        """Hand the bytes over with all else that is written in this round of the loop: sixteen questions are one send,
        and arrive as one read."""
        if not self._together:
            asyncio.get_running_loop().call_soon(self._flush)
        self._together.append(item)

    def _flush(self) -> None:
        self.write(b"".join(self._together))
        self._together.clear()

    def close(self) -> None:
        """Hang up, at once: nobody waits for what is still to be sent."""
        if self._transport is not None:
            self._transport.abort()


class Datagrams(asyncio.DatagramProtocol):
    """UDP to one server. `receive` is given what comes, `lose` why nothing comes any more."""

    receive: Callable[[bytes], None]

    def __init__(self, lose: Callable[[str], None]) -> None:
        self._lose = lose
        self._transport: asyncio.DatagramTransport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """asyncio: the socket stands."""
        # Not every loop's transport is an instance of the class it fulfils.
        self._transport = cast(asyncio.DatagramTransport, transport)

    def datagram_received(self, data: bytes, addr: object) -> None:
        """asyncio: a datagram came."""
        self.receive(data)

    def error_received(self, exc: Exception) -> None:
        """asyncio: the other machine says that nobody is there."""
        self._lose(reason(exc))

    def write(self, item: bytes) -> None:
        """One datagram."""
        if self._transport is not None:
            self._transport.sendto(item)

    def close(self) -> None:
        """Give the port back."""
        if self._transport is not None:
            self._transport.abort()
