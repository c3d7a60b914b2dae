"""Several requests under way on one TCP connection, as the asyncio client has them, in every order of events.

    lane 1, lane 2 ...   each with a bus of its own  -->  one connection  -->  a server that answers in any order

The choices of a step: ask the next question on a free lane, cancel the question of a busy one, let time pass until the
next answer arrives or the next question times out, or let so many requests pass that the transaction numbers wrap and
reach the one of a busy lane again. An answer is prompt, late, lost, doubled, or comes after one with another number or
from another unit.

What is checked, in every run:

    own answer      a question returns only on its own answer
    no repetition   a question is sent once, and `retries` times more only if it is a read
    bounded         a question ends one time-out after it was sent last
    counters        asked = answered + lost

The only assumption: an answer does not come after 65,535 further requests, unless its question is still open.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import suppress
from dataclasses import dataclass, field
from enum import Enum
from functools import partial
from typing import Any

from barewire.conversation import Abandoned, Heard, Listen
from barewire.errors import NoAnswer
from barewire.modbus import Bus, ReadHoldingRegisters, WriteSingleRegister
from barewire.tcp import FanOut, encode
from tests.model.choices import Choices

TIMEOUT = 0.3


class Fate(Enum):
    """What becomes of an answer."""

    PROMPT = "prompt"
    SLOW = "slow"
    LATE = "late"
    VERY_LATE = "very late"
    DOUBLED = "doubled"
    AFTER_ANOTHER_NUMBER = "after an answer with another number"
    AFTER_ANOTHER_UNIT = "after an answer of another unit"
    LOST = "lost"


ARRIVALS: dict[Fate, tuple[float, ...]] = {
    Fate.PROMPT: (0.01,),
    Fate.SLOW: (0.2,),
    Fate.LATE: (0.35,),
    Fate.VERY_LATE: (2.0,),
    Fate.DOUBLED: (0.01, 0.25),
    Fate.AFTER_ANOTHER_NUMBER: (0.01,),
    Fate.AFTER_ANOTHER_UNIT: (0.01,),
    Fate.LOST: (),
}
"""The times at which an answer arrives, in seconds after its request."""


@dataclass(frozen=True)
class LanesSetup:
    """The alphabet of a scenario."""

    lanes: int = 2
    questions: int = 3
    fates: tuple[Fate, ...] = (Fate.PROMPT, Fate.SLOW, Fate.LATE, Fate.LOST)
    may_cancel: bool = True
    waits: int = 1
    """How many of the choices of a step are to let time pass; more than one in random runs only."""
    may_wrap: bool = False
    writes: tuple[bool, ...] = (False,)
    retries: tuple[int, ...] = (0,)
    fan_out: Callable[[int], Any] = FanOut


MANY_LANES = LanesSetup(
    lanes=4, questions=20, fates=tuple(Fate), waits=8, may_wrap=True, writes=(False, False, True), retries=(0, 1)
)
"""The large alphabet, for random runs."""


@dataclass
class LanesTally:
    """What happened in all runs of a scenario."""

    questions: int = 0
    right: int = 0
    no_answer: int = 0
    cancelled: int = 0
    wrong: list[str] = field(default_factory=list)


class Lane:
    """The place of one request under way."""

    def __init__(self, bus: Bus) -> None:
        self.bus = bus
        self.box: list[bytes] = []
        self.number = 0
        self.is_write = False
        self.retries = 0
        self.transaction = -1
        self.sent = 0
        """How often the question was sent."""
        self.began = 0.0
        self.conversation: Generator[Any, Heard[bytes], Any] | None = None
        self.until = 0.0
        """The time at which the conversation continues without bytes."""


class Connection:
    """The lanes, the server behind them, and the time."""

    def __init__(self, choices: Choices, setup: LanesSetup, tally: LanesTally) -> None:
        self.choices, self.setup, self.tally = choices, setup, tally
        self.now = 0.0
        self.coming: list[tuple[float, bytes]] = []
        self.wrapped = False
        self.old: set[int] = set()
        """The numbers of open questions that were sent before the numbers wrapped."""
        self.fan = setup.fan_out(setup.lanes)
        self.fan._last = 0xFFFF - setup.questions // 2  # so that the numbers wrap within the run
        first = Bus(self.fan.lines[0])
        self.lanes = [Lane(first), *(Lane(first.sibling_bus(line)) for line in self.fan.lines[1:])]

    def ask(self, lane: Lane, number: int) -> None:
        """Send the next question on a free lane."""
        for data in lane.box:
            lane.bus.overhear(data, self.now)
        lane.box.clear()
        self.tally.questions += 1
        lane.number, lane.sent, lane.began = number, 0, self.now
        lane.is_write = self.choices.take(self.setup.writes)
        lane.retries = self.choices.take(self.setup.retries)
        request = WriteSingleRegister(7, number) if lane.is_write else ReadHoldingRegisters(7, 1)
        lane.conversation = lane.bus.ask(1, request, timeout=TIMEOUT, retries=lane.retries)
        self._continue(lane, None)

    def _continue(self, lane: Lane, data: bytes | None) -> None:
        """Resume the conversation of a lane; record its result if it ends."""
        assert lane.conversation is not None
        try:
            step = next(lane.conversation) if lane.until == 0.0 else lane.conversation.send(Heard(data, self.now))
            while not isinstance(step, Listen):
                self._transmit(step.item, lane)
                step = lane.conversation.send(Heard(None, self.now))
            lane.until = max(step.until, self.now)
        except StopIteration as stop:
            self._ended(lane)
            if (stop.value.value if lane.is_write else stop.value.registers[0]) == lane.number:
                self.tally.right += 1
            else:
                self.tally.wrong.append(f"question {lane.number} of {self.choices.script}: {stop.value}")
        except NoAnswer:
            self._ended(lane)
            self.tally.no_answer += 1

    def _ended(self, lane: Lane) -> None:
        lane.conversation, lane.until = None, 0.0
        self._give_up_number(lane)
        where = f"question {lane.number} of {self.choices.script}"
        assert lane.sent <= 1 + (0 if lane.is_write else lane.retries), f"{where}: sent {lane.sent} times"
        assert self.now <= lane.began + TIMEOUT * lane.sent + 1e-9, f"{where}: took {self.now - lane.began:.3f} s"

    def _transmit(self, data: bytes, lane: Lane) -> None:
        self._give_up_number(lane)
        lane.sent += 1
        transaction = lane.transaction = int.from_bytes(data[:2], "big")
        pdu = data[7:] if lane.is_write else bytes((3, 2, 0, lane.number))
        fate = self.choices.take(self.setup.fates)
        for delay in ARRIVALS[fate]:
            if fate is Fate.AFTER_ANOTHER_NUMBER:
                self.coming.append((self.now + delay, encode(1, bytes((3, 2, 0, 99)), transaction ^ 0x100)))
            if fate is Fate.AFTER_ANOTHER_UNIT:
                self.coming.append((self.now + delay, encode(2, bytes((3, 2, 0, 99)), transaction)))
            self.coming.append((self.now + delay, encode(1, pdu, transaction)))
        self.coming.sort(key=lambda pair: pair[0])

    def wrap(self, lane: Lane) -> None:
        """Let 65,535 requests pass: the number of this lane is the next one. Answers to ended questions are gone."""
        self.wrapped = True
        self.old = {other.transaction for other in self.lanes if other.conversation is not None}
        self.coming = [(at, data) for at, data in self.coming if int.from_bytes(data[:2], "big") in self.old]
        self.fan._last = lane.transaction - 1 & 0xFFFF

    def _give_up_number(self, lane: Lane) -> None:
        """Drop the answers with the number of this lane if 65,535 requests have passed since it was sent."""
        if lane.transaction in self.old:
            self.old.discard(lane.transaction)
            self.coming = [
                (at, data) for at, data in self.coming if int.from_bytes(data[:2], "big") != lane.transaction
            ]

    def cancel(self, lane: Lane) -> None:
        """Abandon the question of a lane, as a cancelled task does."""
        assert lane.conversation is not None
        with suppress(Abandoned, NoAnswer):  # a write: WriteOutcomeUnknown
            lane.conversation.throw(Abandoned("cancelled"))
        self._ended(lane)
        self.tally.cancelled += 1

    def wait(self) -> None:
        """Let time pass until the next answer arrives or the next question times out."""
        busy = [lane for lane in self.lanes if lane.conversation is not None]
        due = min((lane.until for lane in busy), default=float("inf"))
        if self.coming and self.coming[0][0] <= due:
            when, data = self.coming.pop(0)
            self.now = max(self.now, when)
            for place, frame in self.fan.feed(data):
                lane = self.lanes[place]
                if lane.conversation is None:
                    lane.box.append(frame)
                else:
                    self._continue(lane, frame)
        else:
            self.now = due
            self._continue(next(lane for lane in busy if lane.until == due), None)


def lanes_scenario(setup: LanesSetup, tally: LanesTally) -> Callable[[Choices], None]:
    """The scenario of one setup: every order of asking, cancelling and waiting."""

    def play(choices: Choices) -> None:
        connection = Connection(choices, setup, tally)
        asked = 0
        while True:
            busy = [lane for lane in connection.lanes if lane.conversation is not None]
            free = [lane for lane in connection.lanes if lane.conversation is None]
            actions: list[Callable[[], None]] = []
            if free and asked < setup.questions:
                actions += [partial(connection.ask, lane, asked) for lane in free]
            if busy:
                actions += [connection.wait] * setup.waits
            if busy and setup.may_cancel:
                actions += [partial(connection.cancel, lane) for lane in busy]
            if setup.may_wrap and free and busy and not connection.wrapped and asked < setup.questions:
                actions += [partial(connection.wrap, lane) for lane in busy]
            if not actions:
                counters = connection.lanes[0].bus.counters
                assert counters.asked == counters.answered + counters.lost, (choices.script, counters)
                return
            count = tally.questions
            choices.take(actions)()
            asked += tally.questions - count

    return play
