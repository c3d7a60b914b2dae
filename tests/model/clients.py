"""The public clients, blocking with threads and asyncio with tasks, in virtual time: a run is some forty questions.

    threads  -->  ModbusClient       -->  |
                                          |  units on a line or connection (`units`)
    tasks    -->  AsyncModbusClient  -->  |
    clients  -->  Backend of a gateway -> |

Nothing but the port, the clock and the random part of the pauses between attempts to connect (`jitter`) is replaced
(`virtual_threads`, `virtual_loop`), and the client gets a URL, a time-out and, unless a setup has some, no options. A
run consists of stretches:

    trouble    answers are late by any time in the window, lost, damaged, doubled, exceptions; questions are given up at
               any time (a cancelled task, an exception in a thread), or begin just before the window of an earlier one
               ends; the connection fails
    burst      more questions than any bound are given up at once, while the units are busy
    dead       no unit answers for minutes
    calm       the units answer at once, so that an answer which is one too late stays so

What is checked, in every run:

    own answer      a question returns, or raises ModbusException, only if its own answer arrived, with its own value
    no repetition   a request is sent once, and `retries` times more if it may be repeated
    bounded         the run ends within the time that its questions need one after the other; no thread waits for ever
    usable          when the window is over, a question is answered
    counters        asked = answered + lost
"""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any
from unittest.mock import patch

import barewire
from barewire.conversation import Heard
from barewire.errors import NoAnswer, PortError
from barewire.gateway.backend import BackendOptions, ModbusBackend
from barewire.gateway.dispatch import BUSY, NO_PATH, NO_RESPONSE, Exchange, Query, UnitConfig
from barewire.io.endpoint import Endpoint
from barewire.io.engine import blocking
from barewire.io.engine.callbacks import CallbackBox
from barewire.io.modbus import async_client, client as client_module
from barewire.io.modbus.async_client import AsyncModbusClient, Lane
from barewire.io.modbus.carriers import of_units, unit_options
from barewire.io.modbus.client import ModbusClient
from barewire.modbus import Caller, ModbusException, RawRequest
from tests.model.choices import Choices
from tests.model.client_line import ASKING, LAST_QUESTIONS, Alarm, Ask, ClientLine, Pause, Settle, Step
from tests.model.client_setups import TIMEOUT, Clients, World
from tests.model.one_line import Tally
from tests.model.virtual_loop import VirtualLoop, VirtualSelector
from tests.model.virtual_threads import FOREVER, VirtualThreads

PACKAGE = str(Path(barewire.__file__).parent)


@contextmanager
def error_at_line(count: int | None, error: type[BaseException], is_own: Callable[[], bool]) -> Iterator[None]:
    """Raise an error at the executed line of barewire with this number, if `is_own` says that it counts."""
    if count is None:
        yield
        return
    left = [count]

    def trace(frame: FrameType, event: str, _: object) -> Any:
        if not frame.f_code.co_filename.startswith(PACKAGE) or not is_own():
            return None
        if event == "line":
            left[0] -= 1
            if left[0] < 0:
                raise error("at a line")
        return trace

    sys.settrace(trace)
    try:
        yield
    finally:
        sys.settrace(None)


class VirtualPort:
    """The port of a blocking client."""

    def __init__(self, line: ClientLine, threads: VirtualThreads) -> None:
        line.reconnect()
        self._line, self._threads = line, threads

    def send(self, item: bytes) -> None:
        """Send a request."""
        self._fail_when_due()
        self._line.transmit(item)

    def receive(self, timeout: float) -> bytes | None:
        """Return the next bytes, or None after the time-out."""
        line = self._line
        if timeout > 0.0 and not (line.coming and line.coming[0].at <= line.now):
            self._threads.wait(min(line.now + timeout, line.fails_at), for_bytes=True)
        self._fail_when_due()
        return line.deliver() if line.coming and line.coming[0].at <= line.now else None

    def _fail_when_due(self) -> None:
        if self._line.now >= self._line.fails_at:
            self._line.fails_at = FOREVER
            raise PortError("the cable was pulled out")

    def close(self) -> None:
        """Close the port."""
        self._line.connection_ended()


def _play_threads(line: ClientLine, shares: list[Iterator[Step]]) -> ModbusClient:
    threads = VirtualThreads(line)
    clock = threads.monotonic
    with (
        patch.object(client_module, "threading", threads),
        patch.object(client_module, "time", threads),
        patch.object(client_module, "run", partial(blocking.run, clock=clock)),
        patch.object(client_module, "exchange", partial(blocking.exchange, clock=clock)),
        patch.object(client_module, "dialer", lambda _: partial(VirtualPort, line, threads)),
    ):
        client = ModbusClient(line.clients.carrier.url, timeout=TIMEOUT, jitter=line.jitter, **line.options)

        def ask(step: Ask) -> None:
            ASKING.set(step)
            outcome: object
            if step.give_up_after is not None:
                threads.interrupt_at(line.now + step.give_up_after, step.error)
            if step.fail_after is not None:
                line.fails_at = line.now + step.fail_after
            try:
                with error_at_line(step.lines_until_error, step.error, lambda: not line.is_transmitting):
                    outcome = client.ask(step.question.make(step.number), unit=step.question.unit, **step.call)
            except BaseException as error:
                outcome = error
            threads.interrupt_at(FOREVER, None)
            line.judge(step, outcome)

        def work(steps: Iterator[Step]) -> None:
            for step in steps:
                if isinstance(step, Pause):
                    threads.sleep(step.seconds)
                elif isinstance(step, Settle):
                    with suppress(PortError):
                        client.settle()
                else:
                    ask(step)

        threads.run([partial(work, steps) for steps in shares])
        _check_bound(line)
        for number in LAST_QUESTIONS:
            threads.sleep(60.0)
            ask(line.last_question(number))
        client.close()
    return client


class VirtualLink:
    """The connection of an asyncio client: see `AsyncLink`."""

    def __init__(self, line: ClientLine) -> None:
        self._line = line

    def write(self, item: bytes) -> None:
        """Send bytes, which may be several requests on TCP."""
        while self._line.setup.framing == "tcp" and item:
            end = 6 + int.from_bytes(item[4:6], "big")
            self._line.transmit(item[:end])
            item = item[end:]
        if item:
            self._line.transmit(item)

    write_together = write

    def sent(self) -> None:
        """Return None: everything is on the wire."""

    def close(self) -> None:
        """Close the connection."""
        self._line.connection_ended()


def _play_tasks(line: ClientLine, shares: list[Iterator[Step]]) -> AsyncModbusClient:
    selector = VirtualSelector(line)
    loop = VirtualLoop(selector)
    end: list[Callable[[str], None]] = []

    async def connect(endpoint: object, receive: Callable[[bytes], object], lose: Callable[[str], None]) -> VirtualLink:
        line.reconnect()
        selector.received = lambda data: loop.call_soon(receive, data)
        end[:] = [lose]
        return VirtualLink(line)

    async def ask_now(client: AsyncModbusClient, step: Ask) -> object:
        ASKING.set(step)
        me = asyncio.current_task()

        def is_own() -> bool:
            return asyncio.current_task() is me and not line.is_transmitting

        with error_at_line(step.lines_until_error, Alarm, is_own):
            return await client.ask(step.question.make(step.number), unit=step.question.unit, **step.call)

    async def ask(client: AsyncModbusClient, step: Ask) -> None:
        task = asyncio.ensure_future(ask_now(client, step))
        if step.give_up_after is not None:
            loop.call_later(step.give_up_after, task.cancel)
        if step.fail_after is not None:
            loop.call_later(step.fail_after, lambda: end[0]("the cable was pulled out"))
        await asyncio.wait([task])
        outcome: object = asyncio.CancelledError() if task.cancelled() else task.exception() or task.result()
        line.judge(step, outcome)

    async def work(client: AsyncModbusClient, steps: Iterator[Step]) -> None:
        for step in steps:
            if isinstance(step, Pause):
                await asyncio.sleep(step.seconds)
            elif isinstance(step, Settle):
                with suppress(PortError):
                    await client.settle()
            else:
                await ask(client, step)

    async def play() -> AsyncModbusClient:
        options = dict(line.options)
        if (in_flight := line.choices.take(line.clients.in_flight)) > 1:
            options["in_flight"] = in_flight
        client = AsyncModbusClient(line.clients.carrier.url, timeout=TIMEOUT, jitter=line.jitter, **options)
        async with client:
            await asyncio.gather(*(work(client, steps) for steps in shares))
            _check_bound(line)
            for number in LAST_QUESTIONS:
                await asyncio.sleep(60.0)
                await ask(client, line.last_question(number))
        return client

    try:
        with patch.object(async_client, "connect", connect):
            return loop.run_until_complete(play())
    finally:
        loop.close()


class AskingBox(CallbackBox):
    """The mailbox of a lane. Several lanes have exchanges under way, and each may write in any round of the loop."""

    question: Ask
    backend: AskingBackend

    def _resume(self, heard: Heard[bytes] | None) -> None:
        self.backend.asking = self.question
        super()._resume(heard)


class AskingBackend(ModbusBackend):
    """A backend that notes which question it sends, or answers: that of the first query of the exchange."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.connection.new_box = self._new_box  # type: ignore[method-assign]

    def _new_box(self, lane: Lane) -> AskingBox:
        box = AskingBox(self.endpoint.place, lane.bus)
        box.backend = self
        return box

    def _send(self, lane: Lane, exchange: Exchange) -> None:
        self.asking = self.questions[exchange.queries[0]]
        assert isinstance(lane.box, AskingBox)
        lane.box.question = self.asking
        super()._send(lane, exchange)

    def _ended(self, lane: Lane, response: bytes | int | None, *, is_silence: bool = True) -> None:
        self.asking = self.questions[self.under_way[lane].queries[0]]
        super()._ended(lane, response, is_silence=is_silence)

    questions: dict[Query, Ask]
    asking: Ask


def _play_gateway(line: ClientLine, shares: list[Iterator[Step]]) -> AskingBackend:
    """Ask through a backend of the gateway, which has no task for a request. Each share is a client of the gateway."""
    selector = VirtualSelector(line)
    loop = VirtualLoop(selector)
    end: list[Callable[[str], None]] = []
    backend: AskingBackend

    async def connect(endpoint: object, receive: Callable[[bytes], object], lose: Callable[[str], None]) -> VirtualLink:
        line.reconnect()
        selector.received = lambda data: loop.call_soon(receive, data)
        end[:] = [lose]
        return AskingLink(line)

    class AskingLink(VirtualLink):
        def write(self, item: bytes) -> None:
            ASKING.set(backend.asking)
            super().write(item)

        write_together = write

    async def ask(client: Caller, step: Ask) -> None:
        request = step.question.make(step.number)
        answer: asyncio.Future[bytes] = loop.create_future()
        asked = step

        def respond(pdu: bytes | None) -> None:
            nonlocal asked
            if pdu is not None and not answer.done():
                answer.set_result(pdu)
                if pdu[0] < 0x80 or pdu[1] not in _OF_GATEWAY:
                    asked = backend.asking  # an identical read of another client, if this one has joined it

        query = Query(client, step.question.unit, RawRequest(request.encode()), respond)
        backend.questions[query] = step
        backend.submit(query)
        if step.fail_after is not None:
            loop.call_later(step.fail_after, lambda: end and end[0]("the cable was pulled out"))
        outcome: object
        try:
            outcome = request.read_response(await asyncio.wait_for(answer, step.give_up_after))
        except TimeoutError:
            client.is_gone = True
            outcome = asyncio.CancelledError()
        except ModbusException as declined:
            outcome = NoAnswer("of the gateway") if declined.code in _OF_GATEWAY else declined
        line.judge(asked, outcome)

    async def work(steps: Iterator[Step]) -> None:
        client = Caller()
        for step in steps:
            if isinstance(step, Pause):
                await asyncio.sleep(step.seconds)
            elif isinstance(step, Ask):
                client = Caller() if client.is_gone else client
                await ask(client, step)

    async def play() -> AskingBackend:
        nonlocal backend
        endpoint = Endpoint.parse(
            line.clients.carrier.url, {"timeout": TIMEOUT, **line.options, "units": None} | of_units(line.of_units)
        )
        in_flight = line.choices.take(line.clients.in_flight)
        backend = AskingBackend(
            "line",
            endpoint,
            BackendOptions(in_flight=in_flight),
            {unit: UnitConfig(unit_options(endpoint, unit)) for unit in line.of_units},
            UnitConfig(unit_options(endpoint)),
            patience=1000.0,
            jitter=line.jitter,
        )
        backend.questions = {}
        await asyncio.gather(*(work(steps) for steps in shares))
        _check_bound(line)
        for number in LAST_QUESTIONS:
            await asyncio.sleep(60.0)
            await ask(Caller(), line.last_question(number))
        await backend.close()
        return backend

    try:
        with patch.object(async_client, "connect", connect):
            return loop.run_until_complete(play())
    finally:
        loop.close()


_OF_GATEWAY = (NO_PATH, NO_RESPONSE, BUSY)
"""The exceptions that are not those of a unit."""
_PLAYS: dict[World, Callable[[ClientLine, list[Iterator[Step]]], ModbusClient | AsyncModbusClient | AskingBackend]] = {
    **{"blocking": _play_threads, "asyncio": _play_tasks, "gateway": _play_gateway},
}


def _check_bound(line: ClientLine) -> None:
    assert line.now <= line.allowed, f"{line.choices.script}: {line.now:.3f} s instead of {line.allowed:.3f}"


def clients_scenario(setup: Clients, tally: Tally) -> Callable[[Choices], ClientLine]:
    """The scenario of one setup."""

    def play(choices: Choices) -> ClientLine:
        line = ClientLine(choices, setup, tally)
        world, workers = choices.take(setup.worlds), choices.take(setup.workers)
        numbers = range(1, setup.length + 1)
        shares = [line.steps(numbers[first::workers]) for first in range(workers)]
        wrong = len(tally.wrong)
        client = _PLAYS[world](line, shares)
        is_answered = LAST_QUESTIONS[-1] in line.got_right or len(tally.wrong) > wrong
        assert is_answered, f"{choices.script}: the last question was not answered"
        counters = client.bus.counters
        assert setup.lines_until_error != (None,) or counters.asked == counters.answered + counters.lost, (
            choices.script,
            counters,
        )
        return line

    return play
