"""The line of a public client: what its threads or tasks do on it, and what must be true of every question.

`clients` plays it.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterator, Sequence
from contextvars import ContextVar
from dataclasses import replace
from typing import Any, NamedTuple, TypeAlias

from barewire.errors import NoAnswer, PortError
from barewire.io.modbus.carriers import UnitKeywords
from barewire.modbus import ModbusException
from tests.model.choices import Choices
from tests.model.client_setups import OTHERS, OTHERS_SEND, TIMEOUT, Clients
from tests.model.one_line import Tally
from tests.model.units import READ, READ_IMAGE, Arrival, Fate, Question, UnitsOnLine
from tests.model.virtual_threads import FOREVER


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


LAST_QUESTIONS = (200, 201)
"""Two questions, a minute apart. The connection may be closed before the first, behind which a serial server may have
kept bytes: from the new connection on the windows of pending answers count again, and if the unit ignores probes, the
first question is not sent. The second one must be answered."""


class ClientLine(UnitsOnLine):
    """The units, and what every run of a client on their line must satisfy."""

    def __init__(self, choices: Choices, setup: Clients, tally: Tally) -> None:
        super().__init__(choices, setup.line)
        self.clients, self.tally = setup, tally
        self.options = choices.take(setup.options)
        self.arrived: set[int] = set()
        """The questions whose answers arrived."""
        self.got_right: set[int] = set()
        """The questions that got the right answer."""
        self.sent_at = 0.0
        self.is_transmitting = False
        """Whether what is executed belongs to the units, and not to the client."""
        self.of_units: dict[int, UnitKeywords] = self.options.get("units", {})
        """The options that units have for themselves."""
        self.longest_timeout = max(TIMEOUT, *(of_unit.get("timeout", 0.0) for of_unit in self.of_units.values()), 0.0)
        self._sent_to: dict[int, float] = {}
        """When a request to each unit was sent."""
        self.failures = 0
        """How often the connection failed."""
        self.is_over = False
        """Whether nothing fails any more."""
        self.fails_at = FOREVER
        self.allowed = 0.0
        """The time that all questions so far need at most, one after the other."""

    @property
    def window(self) -> float:
        """The time in which an answer comes: the option, or three times the longest time-out so far."""
        return float(self.options.get("late_window", 3 * self.longest_timeout))

    def transmit(self, data: bytes) -> None:
        """Send a request of the present thread or task."""
        ask = ASKING.get()
        self.number = ask.number
        if not self.is_probe(data):
            self.longest_timeout = max(self.longest_timeout, ask.call.get("timeout", TIMEOUT))
        unit, _, _ = self._decoded(data)
        if not self.setup.numbered:
            pause = self.now - self._sent_to.get(unit, -FOREVER)
            assert pause >= self.gap(unit) - 1e-9, f"{self.choices.script}: unit {unit} is asked after {pause} s"
        self.latest = self.now + self.duration(data) + self.window - 1e-6
        self.is_transmitting = True
        super().transmit(data)
        self.is_transmitting = False
        self.sent_at = self._sent_to[unit] = self.now

    def gap(self, unit: int) -> float:
        """Return the pause that the client must make between two requests to a unit."""
        return float(self.of_units.get(unit, {}).get("gap", self.options.get("gap", 0.0)))

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
        timeout = max(self.longest_timeout, *(call.get("timeout", TIMEOUT) for call in setup.calls), 0.0)
        gap = max(self.gap(unit) for unit in (1, 2))  # before a probe, and before the request
        longest = self.options.get("late_window", 3 * timeout) + 4 * timeout + 2 * gap + 0.2
        while left:
            stretch = take(setup.stretches)
            self.setup = {"trouble": setup.line, "dead": dead}.get(stretch, calm)
            count, same = 8, take(setup.line.questions)
            if stretch == "burst":
                count = take(range(17, 25))
                self.busy_until = self.now + take((0.5, 0.75))
            if take((False, False, False, True)):
                self.allowed += longest
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
                        pause = max(0.0, self.sent_at + self.window - take(range(-2, 40)) / 1000 - self.now)
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
                self.allowed += (1 + self.repeats(ask)) * longest
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
            self.got_right |= {ask.number} if own else set()
        if not own and not isinstance(
            outcome, NoAnswer | PortError | KeyboardInterrupt | Alarm | asyncio.CancelledError
        ):
            tally.wrong.append(f"question {ask.number} ({ask.question.name}) of {self.choices.script}: {outcome!r}")
        sent = self.sent.get(ask.number, 0)
        # A connection that fails in a repetition begins the repetitions again.
        most = 1 + self.repeats(ask) * (1 + self.failures)
        assert sent <= most, f"question {ask.number} of {self.choices.script}: sent {sent} times"

    def last_question(self, number: int) -> Ask:
        """Return one of LAST_QUESTIONS, at a time when nothing of the trouble is left."""
        self.setup = replace(self.setup, fates=(Fate.ARRIVES,), delays=(0.002,))
        self.fails_at, self.is_over = FOREVER, True
        self.coming.clear()
        return Ask(number, READ, {})

    def reconnect(self) -> None:
        """Open a connection after one that failed. PortError if that fails too."""
        if self.allowed and not self.is_over and self.choices.take((False, True)):
            raise PortError("the cable is not back")

    def jitter(self) -> float:
        """Return the random part of the next pause between two attempts to connect."""
        return self.choices.take((0.0, 0.5, 1.0))

    def connection_ended(self) -> None:
        """Drop what was under way to a socket; what a serial line still sends goes to the next one."""
        self.failures += 1
        if self.setup.framing == "tcp":
            self.coming.clear()
