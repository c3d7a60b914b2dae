"""A CAN bus in virtual time: devices as machines, one conversation at a time, frames lost on purpose."""

from __future__ import annotations

import heapq
from collections.abc import Callable
from itertools import count
from typing import Protocol, TypeVar

from barewire.canopen import CanFrame
from barewire.conversation import Conversation, Heard, Listen

Result = TypeVar("Result")


class Participant(Protocol):
    @property
    def deadline(self) -> float | None: ...

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]: ...


def never(number: int, frame: CanFrame) -> bool:
    """Nothing is lost."""
    return False


class VirtualBus:
    """Every frame reaches all others `wire` seconds later; a device needs its own time to answer.

    `lose(number, frame)` is asked for every frame in turn. `log` holds every frame that was said, with its time.
    """

    def __init__(self, *, wire: float = 0.00025, lose: Callable[[int, CanFrame], bool] = never) -> None:
        self.now = 0.0
        self.wire = wire
        self.lose = lose
        self.log: list[tuple[float, str]] = []
        self._devices: list[tuple[Participant, float]] = []
        self._coming: list[tuple[float, int, int | None, CanFrame]] = []  # (when, order, who hears, frame)
        self._order = count()
        self._frames = 0

    def add(self, device: Participant, latency: float = 0.001, said: list[CanFrame] | None = None) -> None:
        """One more device; `said` is what it says as it comes."""
        self._devices.append((device, latency))
        for frame in said or []:
            self._say(frame, len(self._devices) - 1, self.now)

    def _say(self, frame: CanFrame, speaker: int | None, at: float) -> None:
        self._frames += 1
        if self.lose(self._frames, frame):
            return
        self.log.append((at, str(frame)))
        for hearer in [None, *range(len(self._devices))]:
            if hearer != speaker:
                heapq.heappush(self._coming, (at + self.wire, next(self._order), hearer, frame))

    def _next_due(self) -> tuple[float, int] | None:
        dues = [(due, place) for place, (device, _) in enumerate(self._devices) if (due := device.deadline) is not None]
        return min(dues, default=None)

    def inject(self, text: str, at: float) -> None:
        """A frame of somebody who is not simulated."""
        self._say(CanFrame.parse(text), -1, at)

    def hear(self, until: float) -> CanFrame | None:
        """Let time pass until the conversation hears something."""
        while True:
            coming = self._coming[0][0] if self._coming else float("inf")
            due = self._next_due()
            if min(coming, due[0] if due else float("inf")) > max(until, self.now):
                self.now = max(self.now, until)
                return None
            if due is not None and due[0] < coming:
                self.now = max(self.now, due[0])
                self._feed(due[1], None)
                continue
            when, _, hearer, frame = heapq.heappop(self._coming)
            self.now = max(self.now, when)
            if hearer is None:
                return frame
            self._feed(hearer, frame)

    def _feed(self, place: int, frame: CanFrame | None) -> None:
        device, latency = self._devices[place]
        for answer in device.feed(frame, self.now):
            self._say(answer, place, self.now + latency)

    def run(self, conversation: Conversation[CanFrame, Result]) -> Result:
        """Carry out a conversation as the master on this bus."""
        try:
            step = next(conversation)
            while True:
                if not isinstance(step, Listen):
                    for frame in step.items:
                        self._say(frame, None, self.now)
                    heard: Heard[CanFrame] = Heard(None, self.now)
                else:
                    heard = Heard(self.hear(step.until), self.now)
                step = conversation.send(heard)
        except StopIteration as stop:
            result: Result = stop.value
            return result

    def pass_time(self, seconds: float) -> list[str]:
        """What the master hears meanwhile."""
        until, heard = self.now + seconds, []
        while (frame := self.hear(until)) is not None:
            heard.append(str(frame))
        return heard
