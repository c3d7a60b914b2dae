"""The plain exchange: one question goes out, what comes is its answer, and no conversation is needed for that.

    bus.begin(unit, request)  -->  the frame     None: something has to be done before -> bus.ask, as ever
    port.send(frame)
    port.receive(timeout)     -->  the bytes
    line.answer_in(bytes)     -->  the PDU       None: these bytes are not just the answer
    request.read_response(PDU)                   raises: an exception, or an answer that does not fit      } -> bus.rest

On TCP this is nearly every exchange, and it takes half the time. In every other case - nothing came, too little, too
much, something else, the port failed, the user interrupted - all that was heard is given to the conversation, which
goes on as if it had asked. So there is nothing here to be right or wrong about: results, errors and counters are those
of `bus.ask`, whatever comes in whatever pieces; tests/io/engine/test_fast_path.py compares the two.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, TypeVar

from barewire.conversation import Heard
from barewire.errors import BarewireError
from barewire.io.engine.blocking import break_off, run
from barewire.tcp import TcpLine

if TYPE_CHECKING:
    from barewire.conversation import Conversation
    from barewire.io.engine.blocking import Clock, Port
    from barewire.modbus.client.bus import Bus
    from barewire.modbus.messages.base import Request, Response
R = TypeVar("R", bound="Response")


def exchange(
    bus: Bus, unit: int, request: Request[R], timeout: float, port: Port[bytes], clock: Clock = time.monotonic
) -> R:
    """`run(bus.ask(unit, request, timeout=timeout), port)`, without a conversation where none is needed."""
    frame = bus.begin(unit, request) if timeout > 0.0 else None
    if frame is None:
        return run(bus.ask(unit, request, timeout=timeout), port, clock)
    now = 0.0  # not out yet
    try:
        port.send(frame)
        now = clock()
        data = port.receive(timeout)
        response = answer(bus, unit, request, data, now)
        if response is not None:
            return response
        heard = Heard(data, clock())
    except BaseException as gone:
        break_off(listening(bus, unit, request, timeout, now), port, gone)
        raise
    return run(listening(bus, unit, request, timeout, now), port, clock, heard)


def listening(bus: Bus, unit: int, request: Request[R], timeout: float, sent_at: float) -> Conversation[bytes, R]:
    """The conversation of a question that is out, at the point where it listens."""
    rest = bus.rest(unit, request, timeout, sent_at)
    next(rest)
    return rest


def answer(bus: Bus, unit: int, request: Request[R], data: bytes | None, now: float) -> R | None:
    """The response, if what came is it and nothing else. None leaves everything as it was."""
    line = bus.line
    pdu = line.answer_in(data) if data is not None and isinstance(line, TcpLine) else None
    if pdu is None:
        return None
    try:
        response = request.read_response(pdu)
    except BarewireError:
        return None
    bus.answered(unit, now)
    return response
