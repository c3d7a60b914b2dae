"""The engine: carries out a conversation on a port, waiting where the conversation listens."""

from __future__ import annotations

import time
from contextlib import suppress
from typing import Any, TypeVar

from barewire.conversation import Conversation, Heard, Listen, abort_frames
from barewire.errors import BarewireError, PortError
from barewire.io.ports.base import Port

Item = TypeVar("Item")
Result = TypeVar("Result")


def carry_out(conversation: Conversation[Item, Result], port: Port[Item]) -> Result:
    """Carry out a conversation on a port, and return its result.

    If the port fails, or the user interrupts, it is abandoned: it may send a last frame, such as an SDO abort, and
    raise a better error, such as WriteOutcomeUnknown.
    """
    try:
        step = next(conversation)
        while True:
            item: Item | None = None
            try:
                if isinstance(step, Listen):
                    item = port.receive(max(0.0, step.until - time.monotonic()))
                else:
                    for frame in step.items:
                        port.send(frame)
            except BaseException as error:
                _abandon(conversation, port, error)
                raise
            step = conversation.send(Heard(item, time.monotonic()))
    except StopIteration as end:
        result: Result = end.value
        return result


def _abandon(conversation: Conversation[Item, Any], port: Port[Item], error: BaseException) -> None:
    """End a conversation that cannot go on. Raise its error in place of that of the port, which says less."""
    try:
        for frame in abort_frames(conversation, str(error)):
            with suppress(BarewireError):  # a port that has failed takes no frame
                port.send(frame)
    except BarewireError as better:
        if isinstance(error, PortError):
            raise better from error
