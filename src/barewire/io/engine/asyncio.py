"""The asyncio engine: carries out conversations on asyncio ports. See `blocking`."""

from __future__ import annotations

import asyncio
import contextlib
from typing import TYPE_CHECKING, TypeVar

from barewire.conversation import Conversation, Heard, Listen, Send
from barewire.errors import BarewireError
from barewire.io.engine.blocking import answer, frames_of_abort, hand_over, listening
from barewire.io.ports.base import raise_port_error

if TYPE_CHECKING:
    from barewire.io.ports.base import AsyncPort
    from barewire.modbus.client.bus import Bus
    from barewire.modbus.messages.base import Request, Response

Item = TypeVar("Item")
Result = TypeVar("Result")
R = TypeVar("R", bound="Response")


async def run(
    conversation: Conversation[Item, Result], port: AsyncPort[Item], heard: Heard[Item] | None = None
) -> Result:
    """Carry out a conversation and return its result. `heard` is the first input of one that already listens.

    Raises the errors of the conversation. If the task is cancelled or the port fails, the conversation is abandoned,
    and the abort frames that it sends are written.
    """
    clock = asyncio.get_running_loop().time
    try:
        step = next(conversation) if heard is None else conversation.send(heard)
        while True:
            item: Item | None = None
            try:
                if isinstance(step, Listen):
                    wait = step.until - clock()
                    item = await port.receive(wait if wait > 0.0 else 0.0)
                else:
                    if isinstance(step, Send):
                        port.write(step.item)
                    else:
                        hand_over(step.items, port.write, getattr(port, "write_all", None))
                    sent = port.sent()
                    if sent is not None:  # None: the bytes are on the wire already
                        await sent
            except OSError as error:
                raise_port_error(port, error)
            step = conversation.send(Heard(item, clock()))
    except StopIteration as stop:
        result: Result = stop.value
        return result
    except BaseException as error:
        abandon(conversation, port, error)
        raise


def abandon(conversation: Conversation[Item, Result], port: AsyncPort[Item], error: BaseException) -> None:
    """End a conversation that `error` interrupted, and write its abort frames, if the port still accepts them."""
    for item in frames_of_abort(conversation, error):
        with contextlib.suppress(BarewireError, OSError):
            port.write(item)


async def exchange(bus: Bus, unit: int, request: Request[R], timeout: float, port: AsyncPort[bytes]) -> R:
    """Do the same as `blocking.exchange` on an asyncio port, for lines with numbered responses.

    On other lines a request waits for a round of the loop, which reads what the port received before, and for `sent`.
    """
    clock = asyncio.get_running_loop().time
    now = clock()
    frame = bus.begin(unit, request, timeout, now) if timeout > 0.0 and bus.line.numbered else None
    if frame is None:
        return await run(bus.ask(unit, request, timeout=timeout, retries=0), port)
    try:
        port.write(frame)
        now = clock()
        data = await port.receive(timeout)
        arrived = clock()
        response = answer(bus, unit, request, data, arrived)
        if response is not None:
            return response
    except BaseException as error:
        abandon(listening(bus, unit, request, timeout, now), port, error)
        raise
    return await run(listening(bus, unit, request, timeout, now), port, Heard(data, arrived))
