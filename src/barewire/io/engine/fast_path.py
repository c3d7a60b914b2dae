"""The fast path: one request and one response over a blocking port, without running a conversation.

    bus.begin(unit, ...)      -->  the frame     None: the request cannot be sent at once                 -> bus.ask
    port.send(frame)
    port.receive(timeout)     -->  the bytes
    line.answer_in(bytes)     -->  the PDU       None: these bytes are not exactly the answer              }
    request.read_response(PDU)                   raises: an exception, or an answer that does not fit      } -> bus.rest

On TCP nearly every exchange takes this path, in about two thirds of the time (8.8 instead of 12.4 us, without the
network), and on RTU every one whose answer arrives in one piece. It cannot change results: in every irregular case (no
bytes, too few, too many, other bytes, a port that failed, an interrupt by the user) the conversation of `bus.ask`
continues at the point where it listens, with all bytes received so far. tests/io/engine/test_fast_path.py compares
results, errors and counters of both.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, TypeVar

from barewire.conversation import Heard
from barewire.errors import BarewireError
from barewire.io.engine.blocking import abandon, run

if TYPE_CHECKING:
    from barewire.conversation import Conversation
    from barewire.io.engine.blocking import Clock
    from barewire.io.ports.base import Port
    from barewire.modbus.client.bus import Bus
    from barewire.modbus.messages.base import Request, Response

R = TypeVar("R", bound="Response")


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
