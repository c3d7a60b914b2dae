"""A CAN bus in virtual time for SDO tests: conversations and machines on it, and weather.

Every frame reaches everybody but who said it, one after the other, a tenth of a millisecond each. What reaches a client
while it is not listening waits for it, as in the buffer of a real port. The weather may do anything to a frame:

    weather(number, frame) -> [(delay, frame), ...]         nothing: it is lost; two of them: doubled; ...

`number` counts what the client and the server of the first transfer say, from 0.
"""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Callable
from typing import Any, Protocol

from barewire.canopen import AbortCode, CanFrame, SdoAbort
from barewire.conversation import Conversation, Heard, Listen, Send, SendAll

FRAME_TIME = 0.0001
EVENTS_MAX = 200_000

Weather = Callable[[int, CanFrame], list[tuple[float, CanFrame]]]


class Node(Protocol):
    @property
    def deadline(self) -> float | None: ...

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]: ...


class Client:
    """One conversation after the other, and what waits to be heard."""

    def __init__(self) -> None:
        self.inbox: deque[CanFrame] = deque()
        self.conversation: Conversation[CanFrame, Any] | None = None
        self.step: Send[CanFrame] | SendAll[CanFrame] | Listen | None = None
        self.at = 0.0  # a frame that is being said is out then
        self.result: Any = None


class Bus:
    """The bus, with the machines that live on it."""

    def __init__(self, *nodes: Node, weather: Weather | None = None) -> None:
        self.nodes = nodes
        self.weather = weather
        self.now = 0.0
        self.free_at = 0.0
        self.log: list[str] = []
        self.said = 0
        self._order = 0
        self._coming: list[tuple[float, int, object, CanFrame]] = []
        self._clients: list[Client] = [Client()]

    def run(self, conversation: Conversation[CanFrame, Any]) -> Any:
        """Carry one conversation out."""
        self.run_all(conversation)
        return self._clients[0].result

    def run_all(self, *conversations: Conversation[CanFrame, Any]) -> list[Any]:
        """Carry conversations out at the same time, each as a client of its own."""
        while len(self._clients) < len(conversations):
            self._clients.append(Client())
        for client, conversation in zip(self._clients, conversations):
            client.conversation, client.step = conversation, next(conversation)
            self._begin(client)
        for _ in range(EVENTS_MAX):
            busy = [client for client in self._clients if client.conversation is not None]
            if not busy:
                return [client.result for client in self._clients[: len(conversations)]]
            self._turn(busy)
        raise AssertionError("this does not come to an end")

    def rest(self, seconds: float) -> None:
        """Let time pass: whatever is on its way arrives, whoever wants to give up does."""
        until = self.now + seconds
        while self._event(until):
            pass
        self.now = until

    def _begin(self, client: Client) -> None:
        """Put on the wire what the client says."""
        if client.step is not None and not isinstance(client.step, Listen):
            for frame in client.step.items:
                client.at = self._put(frame, client, self.now)

    def _turn(self, busy: list[Client]) -> None:
        """Whatever happens next: a client goes on, a frame arrives, a machine's time has come."""
        for client in busy:
            if isinstance(client.step, Listen) and client.inbox:
                return self._go_on(client, client.inbox.popleft())
        wakes = [client.step.until if isinstance(client.step, Listen) else client.at for client in busy]
        first = min(range(len(busy)), key=lambda place: wakes[place])
        if not self._event(max(self.now, wakes[first])):
            self.now = max(self.now, wakes[first])
            self._go_on(busy[first], None)
        return None

    def _go_on(self, client: Client, frame: CanFrame | None) -> None:
        assert client.conversation is not None
        try:
            client.step = client.conversation.send(Heard(frame, self.now))
        except StopIteration as stop:
            client.conversation, client.result = None, stop.value
        except Exception:
            client.conversation = None
            raise
        else:
            self._begin(client)

    def _event(self, until: float) -> bool:
        """The next arrival or deadline up to then, arrivals first."""
        dues = [(node.deadline, node) for node in self.nodes if node.deadline is not None]
        due, node = min(dues, key=lambda pair: pair[0], default=(None, None))
        arrival = self._coming[0][0] if self._coming else None
        if arrival is not None and arrival <= until and (due is None or arrival <= max(due, self.now)):
            _, _, speaker, frame = heapq.heappop(self._coming)
            self.now = max(self.now, arrival)
            for hearer in self.nodes:
                if hearer is not speaker:
                    self._say(hearer, hearer.feed(frame, self.now))
            for client in self._clients:
                if client is not speaker:
                    client.inbox.append(frame)
            return True
        if node is not None and due is not None and due <= until:
            self.now = max(self.now, due)
            self._say(node, node.feed(None, self.now))
            return True
        return False

    def _say(self, node: Node, frames: list[CanFrame]) -> None:
        for frame in frames:
            self._put(frame, node, self.now)

    def _put(self, frame: CanFrame, speaker: object, now: float) -> float:
        """Returns when the frame is out."""
        self.free_at = out = max(self.free_at, now) + FRAME_TIME
        self.log.append(f"{'C' if isinstance(speaker, Client) else 'S'} {frame.data.hex(' ').upper()}")
        arriving = [(0.0, frame)] if self.weather is None else self.weather(self.said, frame)
        self.said += 1
        for delay, arrived in arriving:
            self._order += 1
            # What the weather put there itself comes from nobody, so everybody hears it.
            by = speaker if arrived is frame else None
            heapq.heappush(self._coming, (out + delay, self._order, by, arrived))
        return out


class Store:
    """Objects of any bytes, for servers under test."""

    def __init__(self) -> None:
        self.objects = {(0x2100, 0): b"", (0x2101, 0): b"other"}
        self.writes = 0

    def size(self, index: int, sub: int) -> int | None:
        """Nobody knows."""
        self.read(index, sub)
        return None

    def read(self, index: int, sub: int) -> bytes:
        """The value."""
        if (index, sub) not in self.objects:
            raise SdoAbort(AbortCode.NO_OBJECT, index, sub)
        return self.objects[index, sub]

    def may_write(self, index: int, sub: int, size: int | None) -> None:
        """Whatever is there."""
        self.read(index, sub)

    def write(self, index: int, sub: int, data: bytes) -> None:
        """Another value."""
        self.read(index, sub)
        self.objects[index, sub] = data
        self.writes += 1
