"""The blocking engine: carries out a conversation on a port, waiting where the conversation listens.

    Send, SendAll -> port.send          Listen(until) -> port.receive          Heard(item, now) -> the conversation

`engine.asyncio` does the same with await, and `conversation.Wire` in virtual time, for tests. `fast_path` carries out
one request and one response without a conversation.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, TypeVar

from barewire.conversation import Conversation, Heard, Listen, Send, abort_frames
from barewire.errors import BarewireError, PortError
from barewire.io.ports.base import raise_port_error

if TYPE_CHECKING:
    from barewire.io.ports.base import Port

Item = TypeVar("Item")
Result = TypeVar("Result")

Clock = Callable[[], float]


def run(
    conversation: Conversation[Item, Result],
    port: Port[Item],
    clock: Clock = time.monotonic,
    heard: Heard[Item] | None = None,
) -> Result:
    """Carry out a conversation and return its result. `heard` is the first input of one that already listens.

    If the port fails or the user interrupts, the conversation is abandoned, and its final frames (an SDO abort) are
    sent.
    """
    try:
        step = next(conversation) if heard is None else conversation.send(heard)
        while True:
            item: Item | None = None
            try:
                if isinstance(step, Listen):
                    wait = step.until - clock()
                    item = port.receive(wait if wait > 0.0 else 0.0)
                elif isinstance(step, Send):
                    port.send(step.item)
                else:
                    hand_over(step.items, port.send, getattr(port, "send_all", None))
            except OSError as error:
                raise_port_error(port, error)
            step = conversation.send(Heard(item, clock()))
    except StopIteration as stop:
        result: Result = stop.value
        return result
    except BaseException as error:
        # A conversation that raised the error itself is over; one that was interrupted may still send frames.
        abandon(conversation, port, error)
        raise


def hand_over(
    items: Sequence[Item], one: Callable[[Item], object], many: Callable[[Sequence[Item]], object] | None
) -> None:
    """Pass items on in their order, all at once if the port has a way for many of them (`many`)."""
    if many is not None:
        many(items)
        return
    for item in items:
        one(item)


def abandon(conversation: Conversation[Item, Result], port: Port[Item], error: BaseException) -> None:
    """End a conversation that `error` interrupted, and send its abort frames, if the port still accepts them."""
    for item in frames_of_abort(conversation, error):
        with contextlib.suppress(BarewireError, OSError):
            port.send(item)


def frames_of_abort(conversation: Conversation[Item, Result], error: BaseException) -> list[Item]:
    """Return the frames that a conversation sends when `error` interrupts it.

    If the port failed and the conversation raises a more exact error (a write whose outcome is unknown), that error is
    raised instead.
    """
    why = str(error) if isinstance(error, PortError) else "the conversation was abandoned"
    try:
        return abort_frames(conversation, why)
    except BarewireError as better:
        if isinstance(error, PortError):
            raise better from error
        return []
