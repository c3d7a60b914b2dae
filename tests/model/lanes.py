"""Several requests under way on one TCP connection, as the asyncio client has them, in every order of events.

    lane 1, lane 2 ...   each with a bus of its own  -->  one connection  -->  a server that answers in any order

The choices of a step: ask the next question on a free lane, cancel the question of a busy one, or let time pass until
the next answer arrives or the next question times out. An answer is prompt, late, lost, doubled, or has a transaction
number that was not sent. A question may return only on its own answer.
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
from barewire.modbus import Bus, ReadHoldingRegisters
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
    LOST = "lost"


ARRIVALS: dict[Fate, tuple[float, ...]] = {
    Fate.PROMPT: (0.01,),
    Fate.SLOW: (0.2,),
    Fate.LATE: (0.35,),
    Fate.VERY_LATE: (2.0,),
    Fate.DOUBLED: (0.01, 0.25),
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
    fan_out: Callable[[int], Any] = FanOut


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
        self.conversation: Generator[Any, Heard[bytes], Any] | None = None
        self.until = 0.0
        """The time at which the conversation continues without bytes."""


class Connection:
    """The lanes, the server behind them, and the time."""

    def __init__(self, choices: Choices, setup: LanesSetup, tally: LanesTally) -> None:
        self.choices, self.setup, self.tally = choices, setup, tally
        self.now = 0.0
        self.coming: list[tuple[float, bytes]] = []
        self.fan = setup.fan_out(setup.lanes)
        first = Bus(self.fan.lines[0])
        self.lanes = [Lane(first), *(Lane(first.sibling_bus(line)) for line in self.fan.lines[1:])]

    def ask(self, lane: Lane, number: int) -> None:
        """Send the next question on a free lane."""
        for data in lane.box:
            lane.bus.overhear(data, self.now)
        lane.box.clear()
        self.tally.questions += 1
        lane.number = number
        lane.conversation = lane.bus.ask(1, ReadHoldingRegisters(7, 1), timeout=TIMEOUT)
        self._continue(lane, None)

    def _continue(self, lane: Lane, data: bytes | None) -> None:
        """Resume the conversation of a lane; record its result if it ends."""
        assert lane.conversation is not None
        try:
            step = next(lane.conversation) if lane.until == 0.0 else lane.conversation.send(Heard(data, self.now))
            while not isinstance(step, Listen):
                self._transmit(step.item, lane.number)
                step = lane.conversation.send(Heard(None, self.now))
            lane.until = max(step.until, self.now)
        except StopIteration as stop:
            self._ended(lane)
            if stop.value.registers == (lane.number,):
                self.tally.right += 1
            else:
                self.tally.wrong.append(f"question {lane.number} of {self.choices.script}: {stop.value}")
        except NoAnswer:
            self._ended(lane)
            self.tally.no_answer += 1

    def _ended(self, lane: Lane) -> None:
        lane.conversation, lane.until = None, 0.0

    def _transmit(self, data: bytes, number: int) -> None:
        transaction = int.from_bytes(data[:2], "big")
        answer = encode(1, bytes((3, 2, 0, number)), transaction)
        for delay in ARRIVALS[self.choices.take(self.setup.fates)]:
            self.coming.append((self.now + delay, answer))
        self.coming.sort(key=lambda pair: pair[0])

    def cancel(self, lane: Lane) -> None:
        """Abandon the question of a lane, as a cancelled task does."""
        assert lane.conversation is not None
        with suppress(Abandoned):
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
                actions.append(connection.wait)
            if busy and setup.may_cancel:
                actions += [partial(connection.cancel, lane) for lane in busy]
            if not actions:
                return
            count = tally.questions
            choices.take(actions)()
            asked += tally.questions - count

    return play
