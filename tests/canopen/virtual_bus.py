"""A CAN bus in virtual time: devices as machines, one conversation at a time, frames lost on request."""

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
    """Lose no frame."""
    return False


def _due(device: Participant) -> float:
    return float("inf") if (due := device.deadline) is None else due


class VirtualBus:
    """Every frame reaches all others `wire` seconds later; each device answers after a latency of its own.

    `lose(number, frame)` decides for each frame whether it is lost. `log` holds all frames sent, with their times.
    """

    def __init__(self, *, wire: float = 0.00025, lose: Callable[[int, CanFrame], bool] = never) -> None:
        self.now = 0.0
        self.wire = wire
        self.lose = lose
        self.log: list[tuple[float, str]] = []
        self._devices: list[tuple[Participant, float]] = []
        self._under_way: list[tuple[float, int, int | None, CanFrame]] = []  # (when, order, receiver, frame)
        self._order = count()
        self._frames = 0

    def add(self, device: Participant, latency: float = 0.001, sent: list[CanFrame] | None = None) -> None:
        """Add a device; `sent` are the frames that it sends at once."""
        self._devices.append((device, latency))
        for frame in sent or []:
            self._send(frame, len(self._devices) - 1, self.now)

    def _send(self, frame: CanFrame, sender: int | None, now: float) -> None:
        self._frames += 1
        if self.lose(self._frames, frame):
            return
        self.log.append((now, str(frame)))
        for receiver in [None, *range(len(self._devices))]:
            if receiver != sender:
                heapq.heappush(self._under_way, (now + self.wire, next(self._order), receiver, frame))

    def inject(self, text: str, now: float) -> None:
        """Send a frame from outside the simulated devices."""
        self._send(CanFrame.parse(text), -1, now)

    def receive(self, until: float) -> CanFrame | None:
        """Let time pass until the conversation receives a frame, None at `until`."""
        dues = [_due(device) for device, _ in self._devices]
        while True:
            arrival = self._under_way[0][0] if self._under_way else float("inf")
            due = min(dues, default=float("inf"))
            if min(arrival, due) > max(until, self.now):
                self.now = max(self.now, until)
                return None
            receiver: int | None = None
            frame: CanFrame | None = None
            if due < arrival:
                receiver = dues.index(due)
            else:
                _, _, receiver, frame = heapq.heappop(self._under_way)
            self.now = max(self.now, min(due, arrival))
            if receiver is None:
                return frame
            device, latency = self._devices[receiver]
            for answer in device.feed(frame, self.now):
                self._send(answer, receiver, self.now + latency)
            dues[receiver] = _due(device)

    def run(self, conversation: Conversation[CanFrame, Result]) -> Result:
        """Run a conversation as the master on this bus."""
        try:
            step = next(conversation)
            while True:
                if not isinstance(step, Listen):
                    for frame in step.items:
                        self._send(frame, None, self.now)
                    heard: Heard[CanFrame] = Heard(None, self.now)
                else:
                    heard = Heard(self.receive(step.until), self.now)
                step = conversation.send(heard)
        except StopIteration as stop:
            result: Result = stop.value
            return result

    def pass_time(self, seconds: float) -> list[str]:
        """Let time pass and return the frames that the master receives."""
        until, received = self.now + seconds, []
        while (frame := self.receive(until)) is not None:
            received.append(str(frame))
        return received
