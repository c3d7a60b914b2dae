"""The blocking engine: carries a conversation out on a port, and a machine's turns on a port, waiting where it must.

`aio` is this file with await. Whatever is clever is in the conversations; here is only waiting.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from typing import Protocol, TypeVar

from barewire.conversation import Conversation, Heard, Listen, abort_frames
from barewire.errors import BarewireError, PortError

Item = TypeVar("Item")
Result = TypeVar("Result")

Clock = Callable[[], float]
_heard = tuple.__new__  # what Heard(...) does, without the function around it: this loop is all that a question costs


class Port(Protocol[Item]):
    """What a shell talks through. `send` returns when the item is out, as far as anybody can know."""

    def send(self, item: Item) -> None: ...

    def receive(self, timeout: float) -> Item | None:
        """What came within `timeout` seconds, or None."""

    def close(self) -> None: ...


def run(
    conversation: Conversation[Item, Result],
    port: Port[Item],
    clock: Clock = time.monotonic,
    heard: Heard[Item] | None = None,
) -> Result:
    """Carry a conversation out. Whatever it raises comes out. One that listens already is given `heard` first.

    If the port fails or the user interrupts, the conversation is abandoned first: it may say its last words.
    """
    try:
        step = next(conversation) if heard is None else conversation.send(heard)
        while True:
            item: Item | None = None
            if isinstance(step, Listen):
                wait = step.until - clock()
                item = port.receive(wait if wait > 0.0 else 0.0)
            else:
                for said in step.items:
                    port.send(said)
            step = conversation.send(_heard(Heard, (item, clock())))
    except StopIteration as stop:
        result: Result = stop.value
        return result
    except BaseException as gone:
        # A conversation that raised is over and has nothing to say; one that was cut off may have.
        break_off(conversation, port, gone)
        raise


def break_off(conversation: Conversation[Item, Result], port: Port[Item], gone: BaseException) -> None:
    """Cut a conversation off, and send what it still wants to say, if that can be done."""
    for item in farewell(conversation, gone):
        with contextlib.suppress(BarewireError):
            port.send(item)


def farewell(conversation: Conversation[Item, Result], gone: BaseException) -> list[Item]:
    """The last words of a conversation that was cut off by `gone`.

    Where the port failed and the conversation knows better what that means (a write whose outcome nobody knows), its
    error is raised instead.
    """
    try:
        return abort_frames(
            conversation, str(gone) if isinstance(gone, PortError) else "the conversation was abandoned"
        )
    except BarewireError as better:
        if isinstance(gone, PortError):
            raise better from gone
        return []
