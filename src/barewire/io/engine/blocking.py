"""The blocking engine: carries out a conversation on a port, waiting where the conversation listens.

    Send, SendAll -> port.send          Listen(until) -> port.receive          Heard(item, now) -> the conversation

`engine.asyncio` does the same with await, and `conversation.Wire` in virtual time, for tests.

`exchange` is the fast path: one Modbus request and its response, without running a conversation.

    bus.begin(unit, ...)      -->  the frame     None: the request cannot be sent at once                 -> bus.ask
    port.send(frame)
    port.receive(timeout)     -->  the bytes
    line.answer_in(bytes)     -->  the PDU       None: these bytes are not exactly the answer              }
    request.read_response(PDU)                   raises: an exception, or an answer that does not fit      } -> bus.rest

On TCP nearly every exchange takes this path, in about two thirds of the time (8.8 instead of 12.4 us, without the
network), and on RTU every one whose answer arrives in one piece, in half the time. It cannot change results: in every
irregular case (no bytes, too few, too many, other bytes, a port that failed, an interrupt by the user) the conversation
of `bus.ask` continues at the point where it listens, with all bytes received so far. tests/io/engine/test_fast_path.py
compares results, errors and counters of both.
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
    from barewire.modbus.client.bus import Bus
    from barewire.modbus.messages.base import Request, Response

Item = TypeVar("Item")
Result = TypeVar("Result")
R = TypeVar("R", bound="Response")

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


# The fast path -------------------------------------------------------------------------------------------------------


def exchange(
    bus: Bus, unit: int, request: Request[R], timeout: float, port: Port[bytes], clock: Clock = time.monotonic
) -> R:
    """Do the same as `run(bus.ask(unit, request, timeout=timeout, retries=0), port)`, faster.

    What the port had received before was passed to `bus.overhear`.
    """
    now = clock()
    frame = bus.begin(unit, request, timeout, now) if timeout > 0.0 else None
    if frame is None:
        return run(bus.ask(unit, request, timeout=timeout, retries=0), port, clock)
    try:
        port.send(frame)
        now = clock()
        if not bus.line.numbered:
            bus.sent(now)
        data = port.receive(timeout)
        arrived = clock()
        response = answer(bus, unit, request, data, arrived)
        if response is not None:
            return response
    except BaseException as error:
        abandon(listening(bus, unit, request, timeout, now), port, error)
        raise
    return run(listening(bus, unit, request, timeout, now), port, clock, Heard(data, arrived))


def listening(bus: Bus, unit: int, request: Request[R], timeout: float, sent_at: float) -> Conversation[bytes, R]:
    """Return the conversation of a request that was already sent, advanced to the point where it listens."""
    rest = bus.rest(unit, request, timeout, sent_at)
    next(rest)
    return rest


def answer(bus: Bus, unit: int, request: Request[R], data: bytes | None, now: float) -> R | None:
    """Return the response if the bytes are exactly one; otherwise None, with the state of the bus unchanged."""
    line = bus.line
    answer_in = getattr(line, "answer_in", None)  # lines of ASCII and of adapters with an echo have none
    pdu = None if data is None or answer_in is None else answer_in(data, now)
    if pdu is None or not (line.numbered or _is_counted(request, pdu)):
        return None
    try:
        response = request.read_response(pdu)
    except BarewireError:
        return None
    bus.answered(unit, now)
    return response


def _is_counted(request: Request[R], pdu: bytes) -> bool:
    """Whether a response has a count, and this length. The end of one without a count is a silence."""
    try:
        return request.response.measure(pdu) == len(pdu)
    except Exception:  # the `measure` of a user's class may fail on other bytes than its own
        return False
