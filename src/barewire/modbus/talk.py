"""The turn of talk of a client: ask one unit one thing, and take nothing for the answer that is not one.

    client                                       unit
    ------                                       ----
    wait until the line may be spoken on
    request    ------------------------------->
               <-------------------------------  response, or exception response      -> value, or ModbusException
               <-------------------------------  anything else                        -> heard, told, never taken
               .............. time-out .........                                      -> NoAnswer, with what was heard

An answer that fits no part of the question, from another unit, or damaged, does not end the waiting: the standard keeps
the timer running [MB-SERIAL 2.4.1], for the right answer may still come.
"""

from __future__ import annotations

from typing import TypeVar

from barewire.conversation import Conversation, Listen, Send
from barewire.errors import DecodeError, EncodeError, NoAnswer
from barewire.modbus.adu import BROADCAST, Adu
from barewire.modbus.line import Event, Line
from barewire.modbus.message import Request, Response

R = TypeVar("R", bound=Response)


def ask(line: Line, unit: int, request: Request[R], *, timeout: float = 1.0) -> Conversation[bytes, R]:
    """Ask `unit` and return its response. `timeout` counts from the moment the request is out, in seconds.

    Raises ModbusException when the unit declines, NoAnswer when it is silent. A serial broadcast (unit 0) has no
    answer: that is `tell`.
    """
    yield from hush(line, timeout)
    heard = yield Send(line.request(unit, request.encode()))
    line.sent(heard.now)
    until = heard.now + timeout
    passed_over: list[str] = []
    while heard.now < until:
        wake = until if line.deadline is None else min(until, line.deadline)
        heard = yield Listen(wake)
        for event in line.feed(heard.item, heard.now):
            if isinstance(event, Adu) and line.answers(event):
                try:
                    return request.read_response(event.pdu)
                except DecodeError as error:
                    _note(passed_over, str(error))
            else:
                _note(passed_over, describe(event))
    if line.held:
        _note(passed_over, f"{len(line.held)} bytes without an end")
    else_heard = f"; heard instead: {'; '.join(passed_over)}" if passed_over else ""
    raise NoAnswer(f"unit {unit} did not answer {request.name} within {timeout:g} s{else_heard}")


def tell(line: Line, request: Request[R], *, turnaround: float = 0.1) -> Conversation[bytes, None]:
    """Broadcast to every unit on a serial line. Nobody answers; `turnaround` is their time to act [MB-SERIAL 2.4.1].

    Raises EncodeError for a request that only reads: nobody would see the answer.
    """
    if request.name.startswith(("Read", "Report")):
        raise EncodeError(f"{request.name} as a broadcast: nobody answers those, so only writing makes sense", "unit")
    yield from hush(line, turnaround + 1.0)
    heard = yield Send(line.request(BROADCAST, request.encode()))
    line.sent(heard.now)
    until = heard.now + turnaround
    while heard.now < until:
        heard = yield Listen(until)
        line.feed(heard.item, heard.now)


def hush(line: Line, patience: float) -> Conversation[bytes, None]:
    """Hear the line out until it may be spoken on: what comes before we spoke answers nothing of ours.

    Raises NoAnswer if somebody else never stops talking.
    """
    heard = yield Listen(float("-inf"))
    give_up = heard.now + patience
    while True:
        line.feed(heard.item, heard.now)
        quiet = max(line.quiet_at, line.deadline or line.quiet_at) if line.held else line.quiet_at
        if heard.item is None and heard.now >= quiet:
            return
        if heard.now >= give_up:
            raise NoAnswer(f"the line is never silent: somebody else has been talking for {patience:g} s")
        heard = yield Listen(max(quiet, heard.now))


def describe(event: Event) -> str:
    """One event in words, for the text of an error."""
    if isinstance(event, Adu):
        return f"a frame from unit {event.unit}, function {event.pdu[0]:02X}"
    shown = event.data[:16].hex(" ").upper() + (" ..." if len(event.data) > 16 else "")
    return f"{len(event.data)} bytes {shown}: {event.text or event.reason}"


def _note(passed_over: list[str], text: str) -> None:
    """Keep the first few: an error is one line, and a babbling line must not fill the memory."""
    if len(passed_over) < 3:
        passed_over.append(text)
    elif len(passed_over) == 3:
        passed_over.append("...")
