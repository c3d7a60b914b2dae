"""The public clients, blocking with threads and asyncio with tasks, in virtual time: a run is some forty questions.

    threads  -->  ModbusClient       -->  |
                                          |  units on a line or connection (`units`)
    tasks    -->  AsyncModbusClient  -->  |

Nothing but the port and the clock is replaced (`virtual_threads`, `virtual_loop`), and the client gets a URL, a time-out
and, unless a setup has some, no options. A run consists of stretches:

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
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any, Literal, NamedTuple, TypeAlias
from unittest.mock import patch

import barewire
from barewire.errors import NoAnswer, PortError
from barewire.io.engine import blocking, fast_path
from barewire.io.modbus import async_connection, client as client_module, connection
from barewire.io.modbus.async_client import AsyncModbusClient
from barewire.io.modbus.client import ModbusClient
from barewire.modbus import ModbusException, ReadHoldingRegisters, Request
from barewire.rtu import encode
from tests.model.choices import Choices
from tests.model.one_line import Tally
from tests.model.units import (
    DIAGNOSE,
    ECHO,
    PLAIN,
    READ,
    READ_IMAGE,
    READ_INPUT,
    READ_OTHER_UNIT,
    SLOW_ECHO,
    WRITE,
    Adapter,
    Arrival,
    Fate,
    Framing,
    Question,
    Setup,
    UnitsOnLine,
)
from tests.model.virtual_loop import VirtualLoop, VirtualSelector
from tests.model.virtual_threads import FOREVER, VirtualThreads

PACKAGE = str(Path(barewire.__file__).parent)
TIMEOUT = 0.3
WINDOW = 3 * TIMEOUT
MILLISECONDS = tuple(step / 1000 for step in range(int(1000 * WINDOW)))
OTHERS_SEND = (False,) * 100 + (True,)
"""Whether a question has to wait for another master, which never makes a pause of t3.5 for longer than a time-out."""
OTHERS = tuple((0.0019 * step, encode(9, b"\x03\x02\xee\xee")) for step in range(300))
Stretch = Literal["trouble", "burst", "calm", "dead"]
World = Literal["blocking", "asyncio"]


class Carrier(NamedTuple):
    """A URL, and how answers travel."""

    url: str
    framing: Framing
    any_transaction: bool = False
    any_unit: bool = False
    adapters: tuple[Adapter, ...] = ()


CARRIERS = {
    "RTU": Carrier("rtu:///dev/virtual", "rtu"),
    "ASCII": Carrier("ascii:///dev/virtual", "ascii"),
    "RTU over TCP": Carrier("rtu+tcp://unit:4001", "rtu"),
    "TCP": Carrier("tcp://unit", "tcp"),
    "TCP, any_transaction": Carrier("tcp://unit?any_transaction=1", "tcp", any_transaction=True),
    "UDP": Carrier("udp://unit", "tcp"),
}
"""Those that are played with default options."""
OTHER_CARRIERS = {
    "RTU, echo": Carrier("rtu:///dev/virtual?echo=1", "rtu", adapters=(ECHO, SLOW_ECHO)),
    "RTU, echo to be detected": Carrier("rtu:///dev/virtual?echo=auto", "rtu", adapters=(SLOW_ECHO, PLAIN)),
    "RTU, strict": Carrier("rtu:///dev/virtual?patience=strict", "rtu"),
    "RTU, UART": Carrier("rtu:///dev/virtual?latency=uart", "rtu"),
    "RTU, 600 bit/s": Carrier("rtu:///dev/virtual?baudrate=600", "rtu"),
    "RTU, 115200 bit/s": Carrier("rtu:///dev/virtual?baudrate=115200", "rtu"),
    "ASCII over TCP": Carrier("ascii+tcp://unit:4001", "ascii"),
    "TCP, any_unit": Carrier("tcp://unit?any_unit=1", "tcp"),
    "TCP, any_transaction, any_unit": Carrier("tcp://unit?any_transaction=1&any_unit=1", "tcp", True, True),
}
"""Those whose options concern their frames."""
OPTIONS: tuple[dict[str, Any], ...] = (
    {},
    {"recovery": "wait"},
    {"late_window": 0.2},
    {"late_window": 0.9},
    {"late_window": 2.0},
    {"retries": 2},
    {"retries": 1, "recovery": "wait"},
    {"gap": 0.05},
    {"gaps": {1: 0.1}},
    {"dead_after": 2},
    {"reconnect_first": 0.01, "reconnect_longest": 0.02},
)
CALLS: tuple[dict[str, Any], ...] = (
    *({}, {}, {"timeout": 0.1}, {"timeout": 0.5}, {"retries": 1}, {"retries": 1, "repeat_writes": True}),
)


@dataclass(frozen=True)
class Clients:
    """The alphabet of a scenario. `line` has the choices of the line."""

    carrier: Carrier
    line: Setup
    length: int = 48
    worlds: tuple[World, ...] = ("blocking", "asyncio")
    workers: tuple[int, ...] = (1, 1, 3)
    """How many threads, or tasks, ask at the same time."""
    stretches: tuple[Stretch, ...] = ("trouble", "trouble", "trouble", "burst", "calm")
    give_up_after: Sequence[float | None] = (None, None, None, 0.0, 0.001, 0.02, 0.1, 0.31, 0.6)
    fail_after: tuple[float | None, ...] = (None,) * 60 + (0.05, 0.4)
    """When the connection fails, in seconds after a question began."""
    lines_until_error: Sequence[int | None] = (None,)
    """After how many executed lines of barewire an exception is raised in a question, as by a handler of a signal."""
    options: tuple[dict[str, Any], ...] = ({},)
    """Options of the client besides the URL and the time-out."""
    calls: tuple[dict[str, Any], ...] = ({},)
    """Arguments of `ask` besides the request and the unit."""
    in_flight: tuple[int, ...] = (1,)
    """For asyncio."""


FATES = (
    *[Fate.ARRIVES] * 8,
    *[Fate.LOST, Fate.IS_AN_EXCEPTION, Fate.DAMAGED, Fate.DOUBLED_AT_ONCE] * 2,
    *(Fate.IN_PIECES, Fate.FLOODED),
)
TROUBLE = Setup(
    questions=(READ, READ, READ_INPUT, READ_OTHER_UNIT, WRITE, READ_IMAGE, DIAGNOSE),
    fates=FATES,
    delays=(*[0.002] * 300, *MILLISECONDS),
    probing=("echoes", "declines", "declines", "ignores"),
    timeout=TIMEOUT,
    any_damage=True,
)


def default_options(name: str) -> Clients:
    """The alphabet of a carrier: everything that the assumptions allow, and no option."""
    carrier = (CARRIERS | OTHER_CARRIERS)[name]
    line = replace(
        TROUBLE, framing=carrier.framing, any_transaction=carrier.any_transaction, adapters=carrier.adapters
    )
    if carrier.any_unit:  # the assumption of this option
        line = replace(line, questions=tuple(question for question in line.questions if question.unit == 1))
    if line.framing == "tcp":  # TCP and UDP carry no damaged bytes, and a number tells late answers and copies apart
        fates = tuple(fate for fate in FATES if fate is not Fate.DAMAGED)
        line = replace(line, fates=fates)
    if line.numbered:
        line = replace(line, fates=(*line.fates, Fate.DOUBLED_LATER, Fate.AFTER_ANOTHER_NUMBER), probing=("ignores",))
        line = replace(line, delays=(*line.delays, 1.2, 2.0))
    return Clients(carrier, line)


def every_option(name: str) -> Clients:
    """The same with every option of a client and of its calls."""
    setup = default_options(name)
    in_flight = (1, 2, 16) if setup.line.numbered else (1,)
    stretches: tuple[Stretch, ...] = (*setup.stretches, "dead")
    return replace(setup, options=OPTIONS, calls=CALLS, in_flight=in_flight, stretches=stretches)


def errors_at_lines(name: str) -> Clients:
    """The same as with default options, and exceptions at any line of the package."""
    return replace(default_options(name), lines_until_error=(None,) * 600 + tuple(range(300)))


class Alarm(Exception):
    """What the handler of a signal raises in a program."""


class Pause(NamedTuple):
    """A worker does nothing for some seconds."""

    seconds: float


class Settle(NamedTuple):
    """A worker waits until no late answer can come."""


Step: TypeAlias = "Pause | Settle | Ask"


class Ask(NamedTuple):
    """A question of a worker, and the trouble with it."""

    number: int
    question: Question
    call: dict[str, Any]
    give_up_after: float | None = None
    fail_after: float | None = None
    lines_until_error: int | None = None
    error: type[BaseException] = KeyboardInterrupt


ASKING: ContextVar[Ask] = ContextVar("ASKING")
"""The question of the present thread or task."""


class ClientLine(UnitsOnLine):
    """The units, and what every run of a client on their line must satisfy."""

    def __init__(self, choices: Choices, setup: Clients, tally: Tally) -> None:
        super().__init__(choices, setup.line)
        self.clients, self.tally = setup, tally
        self.options = choices.take(setup.options)
        self.arrived: set[int] = set()
        """The questions whose answers arrived."""
        self.sent_at = 0.0
        self.failures = 0
        """How often the connection failed."""
        self.is_over = False
        """Whether nothing fails any more."""
        self.fails_at = FOREVER
        self.allowed = 0.0
        """The time that all questions so far need at most, one after the other."""

    def window(self, ask: Ask) -> float:
        """The time in which the answer to a question comes: the option, or three time-outs."""
        window = self.options.get("late_window")
        return float(3 * ask.call.get("timeout", TIMEOUT) if window is None else window)

    def transmit(self, data: bytes) -> None:
        """Send a request of the present thread or task."""
        ask = ASKING.get()
        self.number = ask.number
        self.latest = self.now + self.duration(data) + self.window(ask) - 1e-6
        super().transmit(data)
        self.sent_at = self.now

    def deliver(self) -> bytes:
        """Return the next bytes that arrive."""
        data = super().deliver()
        if self.last is not None and self.last.number is not None:
            self.arrived.add(self.last.number)
        return data

    def steps(self, numbers: Sequence[int]) -> Iterator[Step]:
        """Yield what a worker does, question by question."""
        take, setup, left = self.choices.take, self.clients, list(numbers)
        calm = replace(setup.line, fates=(Fate.ARRIVES,), delays=(0.002,))
        dead = replace(calm, fates=(Fate.LOST,))
        while left:
            stretch = take(setup.stretches)
            self.setup = {"trouble": setup.line, "dead": dead}.get(stretch, calm)
            count, same = 8, take(setup.line.questions)
            if stretch == "burst":
                count = take(range(17, 21))
                self.busy_until = self.now + take((0.5, 0.75))
            if take((False, False, False, True)):
                self.allowed += max(3 * TIMEOUT, self.options.get("late_window", 0.0))
                yield Settle()
            for number in left[:count]:
                question = take(setup.line.questions) if stretch == "trouble" else same
                ask = Ask(number, question, take(setup.calls))
                if stretch == "burst":
                    ask = ask._replace(give_up_after=0.02)
                if stretch == "dead":
                    self.allowed += 31.0
                    yield Pause(31.0)
                if stretch == "trouble":
                    pause = take((0.0, 0.0, 0.0, 0.05, 0.5, None))
                    if pause is None:  # until shortly before the window of the latest question ends
                        pause = max(0.0, self.sent_at + self.window(ask) - take(range(-2, 40)) / 1000 - self.now)
                    if setup.line.framing == "rtu" and take(OTHERS_SEND):
                        self.coming += [Arrival(self.now + pause + after, data, None) for after, data in OTHERS]
                        self.coming.sort()
                    self.allowed += pause
                    yield Pause(pause)
                    ask = ask._replace(
                        give_up_after=take(setup.give_up_after),
                        fail_after=take(setup.fail_after),
                        lines_until_error=take(setup.lines_until_error),
                        error=take((KeyboardInterrupt, Alarm)),
                    )
                self.allowed += (1 + self.repeats(ask)) * (
                    self.window(ask) + 4 * ask.call.get("timeout", TIMEOUT) + self.options.get("gap", 0.0) + 0.1
                )
                self.tally.questions += 1
                yield ask
            del left[:count]

    def repeats(self, ask: Ask) -> int:
        """How often a question may be repeated."""
        if ask.question.make(0).writes and not ask.call.get("repeat_writes", False):
            return 0
        return int(ask.call.get("retries", self.options.get("retries", 0)))

    def judge(self, ask: Ask, outcome: object) -> None:
        """Count the outcome of a question, a response or an error, and note it if it is wrong."""
        tally, own = self.tally, ask.number in self.arrived
        if isinstance(outcome, ModbusException):
            tally.exceptions += 1
        elif isinstance(outcome, NoAnswer | PortError):
            tally.no_answer += 1
        elif isinstance(outcome, KeyboardInterrupt | Alarm | asyncio.CancelledError):
            tally.cancelled += 1
        elif isinstance(outcome, BaseException):
            raise outcome
        else:
            registers = getattr(outcome, "registers", (ask.number,))
            own = own and (registers == (ask.number,) or ask.question is READ_IMAGE)
            tally.right += own
        if not own and not isinstance(outcome, NoAnswer | PortError | KeyboardInterrupt | Alarm | asyncio.CancelledError):
            tally.wrong.append(f"question {ask.number} ({ask.question.name}) of {self.choices.script}: {outcome!r}")
        sent = self.sent.get(ask.number, 0)
        # A connection that fails in a repetition begins the repetitions again.
        most = 1 + self.repeats(ask) * (1 + self.failures)
        assert sent <= most, f"question {ask.number} of {self.choices.script}: sent {sent} times"

    def last_question(self) -> Ask:
        """Return a question that must be answered, at a time when nothing of the trouble is left."""
        self.setup = replace(self.setup, fates=(Fate.ARRIVES,), delays=(0.002,))
        self.fails_at, self.is_over = FOREVER, True
        return Ask(200, READ, {})

    def reconnect(self) -> None:
        """Open a connection after one that failed. PortError if that fails too."""
        if self.allowed and not self.is_over and self.choices.take((False, True)):
            raise PortError("the cable is not back")

    def connection_ended(self) -> None:
        """Drop what was under way to a socket; what a serial line still sends goes to the next one."""
        self.failures += 1
        if self.setup.framing == "tcp":
            self.coming.clear()


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
        patch.object(connection, "threading", threads),
        patch.object(connection, "time", threads),
        patch.object(connection, "run", partial(blocking.run, clock=clock)),
        patch.object(connection, "exchange", partial(fast_path.exchange, clock=clock)),
        patch.object(client_module, "dialer", lambda _: partial(VirtualPort, line, threads)),
    ):
        client = ModbusClient(line.clients.carrier.url, timeout=TIMEOUT, **line.options)

        def ask(step: Ask) -> None:
            ASKING.set(step)
            outcome: object
            if step.give_up_after is not None:
                threads.interrupt_at(line.now + step.give_up_after, step.error)
            if step.fail_after is not None:
                line.fails_at = line.now + step.fail_after
            try:
                with error_at_line(step.lines_until_error, step.error, lambda: True):
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
        threads.sleep(60.0)
        ask(line.last_question())
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
        with error_at_line(step.lines_until_error, Alarm, lambda: asyncio.current_task() is me):
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
        client = AsyncModbusClient(line.clients.carrier.url, timeout=TIMEOUT, **options)
        async with client:
            await asyncio.gather(*(work(client, steps) for steps in shares))
            _check_bound(line)
            await asyncio.sleep(60.0)
            await ask(client, line.last_question())
        return client

    try:
        with patch.object(async_connection, "connect", connect):
            return loop.run_until_complete(play())
    finally:
        loop.close()


def _check_bound(line: ClientLine) -> None:
    assert line.now <= line.allowed, f"{line.choices.script}: {line.now:.3f} s instead of {line.allowed:.3f}"


def clients_scenario(setup: Clients, tally: Tally) -> Callable[[Choices], ClientLine]:
    """The scenario of one setup."""

    def play(choices: Choices) -> ClientLine:
        line = ClientLine(choices, setup, tally)
        world, workers = choices.take(setup.worlds), choices.take(setup.workers)
        numbers = range(1, setup.length + 1)
        shares = [line.steps(numbers[first::workers]) for first in range(workers)]
        right, wrong = tally.right, len(tally.wrong)
        client = (_play_threads if world == "blocking" else _play_tasks)(line, shares)
        assert tally.right > right or len(tally.wrong) > wrong, f"{choices.script}: the last question was not answered"
        counters = client.bus.counters
        assert setup.lines_until_error != (None,) or counters.asked == counters.answered + counters.lost, (
            choices.script,
            counters,
        )
        return line

    return play
