"""A CAN bus in virtual time for SDO tests: conversations and machines on it, and faults.

Every frame reaches all participants but its sender, one after the other, 0.1 ms each. Frames that reach a client while
it is not listening wait for it, as in the buffer of a port. A fault function may change each frame:

    fault(number, frame) -> [(delay, frame), ...]         nothing: it is lost; two of them: doubled; ...

`number` counts the frames on the bus, from 0.
"""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Callable
from typing import Any, Protocol

from barewire.canopen import AbortCode, CanFrame, Entry, ObjectDictionary, SdoAbort, SdoServer
from barewire.canopen.sdo.plain import NOT_PLAIN, PlainExchange
from barewire.canopen.sdo.server import awaits_end, is_initiate
from barewire.conversation import Conversation, Heard, Listen, Send, SendAll

FRAME_TIME = 0.0001
EVENTS_MAX = 200_000
NAME = "CANopenDemoPIC32"

Fault = Callable[[int, CanFrame], list[tuple[float, CanFrame]]]


class Node(Protocol):
    @property
    def deadline(self) -> float | None: ...

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]: ...


class Client:
    """A client: one conversation after the other, and the frames that wait for it."""

    def __init__(self) -> None:
        self.inbox: deque[CanFrame] = deque()
        self.conversation: Conversation[CanFrame, Any] | None = None
        self.step: Send[CanFrame] | SendAll[CanFrame] | Listen | None = None
        self.at = 0.0  # when the frame being sent is transmitted
        self.result: Any = None


class Bus:
    """The bus, with the machines on it."""

    def __init__(self, *nodes: Node, fault: Fault | None = None) -> None:
        self.nodes = nodes
        self.fault = fault
        self.now = 0.0
        self.free_at = 0.0
        self.log: list[str] = []
        self.sent = 0
        self._order = 0
        self._coming: list[tuple[float, int, object, CanFrame]] = []
        self._clients: list[Client] = [Client()]

    def run(self, conversation: Conversation[CanFrame, Any]) -> Any:
        """Run one conversation."""
        self.run_all(conversation)
        return self._clients[0].result

    def run_all(self, *conversations: Conversation[CanFrame, Any]) -> list[Any]:
        """Run conversations at the same time, each on its own client."""
        while len(self._clients) < len(conversations):
            self._clients.append(Client())
        for client, conversation in zip(self._clients, conversations):
            client.conversation, client.step = conversation, next(conversation)
            self._begin(client)
        for _ in range(EVENTS_MAX):
            busy = [client for client in self._clients if client.conversation is not None]
            if not busy:
                return [client.result for client in self._clients[: len(conversations)]]
            self._next_event(busy)
        raise AssertionError(f"not finished after {EVENTS_MAX} events")

    def rest(self, seconds: float) -> None:
        """Let time pass: frames arrive, deadlines expire."""
        until = self.now + seconds
        while self._event(until):
            pass
        self.now = until

    def _begin(self, client: Client) -> None:
        """Put the frames of the client's step on the bus."""
        if client.step is not None and not isinstance(client.step, Listen):
            for frame in client.step.items:
                client.at = self._put(frame, client, self.now)

    def _next_event(self, busy: list[Client]) -> None:
        """Process the next event: a client continues, a frame arrives, or a deadline expires."""
        for client in busy:
            if isinstance(client.step, Listen) and client.inbox:
                return self._resume(client, client.inbox.popleft())
        wakes = [client.step.until if isinstance(client.step, Listen) else client.at for client in busy]
        first = min(range(len(busy)), key=lambda number: wakes[number])
        if not self._event(max(self.now, wakes[first])):
            self.now = max(self.now, wakes[first])
            self._resume(busy[first], None)
        return None

    def _resume(self, client: Client, frame: CanFrame | None) -> None:
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
        """Process the next arrival or deadline until then, arrivals first. Return whether there was one."""
        dues = [(node.deadline, node) for node in self.nodes if node.deadline is not None]
        due, node = min(dues, key=lambda pair: pair[0], default=(None, None))
        arrival = self._coming[0][0] if self._coming else None
        if arrival is not None and arrival <= until and (due is None or arrival <= max(due, self.now)):
            _, _, sender, frame = heapq.heappop(self._coming)
            self.now = max(self.now, arrival)
            for receiver in self.nodes:
                if receiver is not sender:
                    self._send(receiver, receiver.feed(frame, self.now))
            for client in self._clients:
                if client is not sender:
                    client.inbox.append(frame)
            return True
        if node is not None and due is not None and due <= until:
            self.now = max(self.now, due)
            self._send(node, node.feed(None, self.now))
            return True
        return False

    def _send(self, node: Node, frames: list[CanFrame]) -> None:
        for frame in frames:
            self._put(frame, node, self.now)

    def _put(self, frame: CanFrame, sender: object, now: float) -> float:
        """Put a frame on the bus. Return when its transmission ends."""
        self.free_at = out = max(self.free_at, now) + FRAME_TIME
        self.log.append(f"{'C' if isinstance(sender, Client) else 'S'} {frame.data.hex(' ').upper()}")
        arriving = [(0.0, frame)] if self.fault is None else self.fault(self.sent, frame)
        self.sent += 1
        for delay, arrived in arriving:
            self._order += 1
            # A frame made by the fault function has no sender, so all participants receive it.
            by = sender if arrived is frame else None
            heapq.heappush(self._coming, (out + delay, self._order, by, arrived))
        return out


def plainly(plain: PlainExchange[Any]) -> Conversation[CanFrame, Any]:
    """Return a conversation that does what the client of a bus does with a plain exchange (`io.canopen.client`)."""
    request = plain.begin()
    if request is None:
        return (yield from plain.whole())
    try:
        heard: Heard[CanFrame] = yield Listen(float("-inf"))
    except BaseException:
        plain.cancel()
        raise
    sent_at, channel = heard.now, plain.channel  # before it is sent: an exception may come between
    if heard.item is not None:  # a bus only looks whether a frame waits: the node monitor has not counted it yet
        counted = channel._mark
        plain.cancel()
        whole = plain.whole()
        next(whole)
        channel._mark = counted
        return (yield from _going_on(whole, heard))
    try:
        yield Send(request)
        heard = yield Listen(sent_at + plain.timeout)
        while heard.item is not None and heard.item.id not in (channel.request_id, channel.response_id):
            heard = yield Listen(sent_at + plain.timeout)
    except BaseException as error:
        rest = plain.rest(sent_at)
        next(rest)
        return (yield from _steps(rest, rest.throw(error)))
    if heard.item is not None:
        result = plain.answer_in(heard.item)
        if result is not NOT_PLAIN:
            return result
    rest = plain.rest(sent_at)
    next(rest)
    return (yield from _going_on(rest, heard))


def _going_on(conversation: Conversation[CanFrame, Any], heard: Heard[CanFrame]) -> Conversation[CanFrame, Any]:
    """Continue a conversation that listens, and has heard this."""
    try:
        step = conversation.send(heard)
    except StopIteration as stop:
        return stop.value
    return (yield from _steps(conversation, step))


def _steps(conversation: Conversation[CanFrame, Any], step: Any) -> Conversation[CanFrame, Any]:
    try:
        while True:
            try:
                heard = yield step
            except BaseException as error:
                step = conversation.throw(error)
            else:
                step = conversation.send(heard)
    except StopIteration as stop:
        return stop.value


class RefusingServer(SdoServer):
    """A server that refuses a request during a transfer and ends that, as Lely and CANopenNode do; ours begins anew."""

    def _receive(self, data: bytes, now: float) -> list[bytes]:
        transfer = self._transfer
        if transfer is None or data[0] >> 5 not in (1, 2, 5, 6) or not is_initiate(data) or awaits_end(transfer):
            return super()._receive(data, now)
        return self._continue(transfer, data, now)


class Store:
    """An object store of any bytes, for servers under test."""

    def __init__(self) -> None:
        self.objects = {(0x2100, 0): b"", (0x2101, 0): b"other"}
        self.writes = 0

    def size(self, index: int, sub: int) -> int | None:
        """Return None: the size is always unknown."""
        self.read(index, sub)
        return None

    def read(self, index: int, sub: int) -> bytes:
        """Return the value."""
        if (index, sub) not in self.objects:
            raise SdoAbort(AbortCode.NO_OBJECT, index, sub)
        return self.objects[index, sub]

    def may_write(self, index: int, sub: int, size: int | None) -> None:
        """Accept every existing object."""
        self.read(index, sub)

    def write(self, index: int, sub: int, data: bytes) -> None:
        """Replace the value."""
        self.read(index, sub)
        self.objects[index, sub] = data
        self.writes += 1


def objects() -> ObjectDictionary:
    """Return the objects of the device under test."""
    return ObjectDictionary(
        [
            Entry(0x1000, 0, "device type", "u32", "ro", 0x000F0191),
            Entry(0x1008, 0, "device name", "string", "const", NAME),
            Entry(0x1017, 0, "heartbeat time", "u16", "rw", 1000),
            Entry(0x2100, 0, "anything", "domain", "rw", b"", maximum=100),
        ]
    )
