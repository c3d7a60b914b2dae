"""The fast path of SDO: expedited transfers on a bus, without running a conversation where nothing irregular happens.

        plain.begin()          -> the request      None                                      -> the whole conversation
        port.exchange(request) -> a frame          not sent: a frame waits to be read first  -> the whole conversation
        plain.answer_in(frame) -> the result       no frame, or any other; an error, Ctrl-C  -> the rest of it

Nearly every access of a master takes this path, in a third of the time: 10 us instead of 30, of which the system and
the other side take 4 (a pair of sockets). What frames mean is decided in `canopen.sdo.plain`. The frames come
through the port of a conversation that reads the bus itself, or through a `ChannelSubscriber` if others read it too.
"""

from __future__ import annotations

import threading
import time
from queue import Empty, SimpleQueue
from typing import Generic, Protocol, TypeVar

from barewire.canopen.channel_locks import ChannelLock
from barewire.canopen.frame import CanFrame
from barewire.canopen.sdo.channel import Channel
from barewire.canopen.sdo.plain import NOT_PLAIN, PlainExchange
from barewire.conversation import Conversation, Heard
from barewire.errors import PortError
from barewire.io.canopen.bus.direct_port import DirectPort
from barewire.io.canopen.bus.shared_bus import CanBus
from barewire.io.canopen.bus.subscriber import LONGEST_PULL, BusItem, FrameBus, Key, Subscriber
from barewire.io.canopen.methods.operations import BusOperation, sdo_keys, whole_transfer
from barewire.io.engine.blocking import abandon

T = TypeVar("T")

_CHANNELS_MAX = 256
"""Channels that are remembered. A bus has 127 nodes, but a program can make any number of further channels."""


class ChannelSubscriber(Subscriber):
    """The subscriber of one SDO channel for one thread at a time, which stays on the bus between exchanges."""

    def __init__(self, bus: FrameBus, keys: frozenset[Key]) -> None:
        self._frames: SimpleQueue[BusItem | None] = SimpleQueue()
        self.sent_at: float | None = None
        """When `exchange` sent the request; None: it did not."""
        super().__init__(bus, keys)

    def put(self, item: BusItem, at: float) -> None:
        """Add a frame, or count it as lost."""
        if self._frames.qsize() < self.room:
            self._frames.put(item)
        else:
            self.lost += 1

    def fail(self, why: str) -> None:
        """Let `receive` raise PortError(why) after the frames in the queue."""
        self._why = self._why or why
        self._frames.put(None)

    def fail_in_child(self, why: str) -> None:
        """The same in a forked process: a thread of the parent may hold the lock of the queue."""
        self._frames = SimpleQueue()
        self.fail(why)

    def exchange(self, request: CanFrame, timeout: float) -> CanFrame | None:
        """Send a request, and return the first frame after it, or None after `timeout` seconds. Raises PortError."""
        self.sent_at = None
        while not self._frames.empty() and self._why is None:
            self._frames.get()
        if self._why is not None:
            raise PortError(self._why)
        self.sent_at = time.monotonic()  # before it is sent: an exception may come between
        try:
            self.bus.send(request, self)
        except PortError:
            self.sent_at = None
            raise
        return self.receive(timeout)

    def receive(self, timeout: float) -> CanFrame | None:
        """Return the next frame, or None after `timeout` seconds. Raises PortError."""
        try:
            item = self._frames.get(timeout=min(timeout, LONGEST_PULL))
        except Empty:
            item = None
        if item is None and self._why is not None:
            raise PortError(self._why)
        return item  # type: ignore[return-value]  # without reports only frames


S = TypeVar("S", bound=Subscriber)


class KnownChannel(Generic[S]):
    """What the fast path remembers of a channel: its lock, the frames that it receives, and its subscriber."""

    __slots__ = ("direct", "keys", "lock", "subscriber")

    def __init__(self, channel: Channel) -> None:
        locks, self.keys = sdo_keys(channel)
        self.lock = ChannelLock(locks, None, _ignore)
        self.subscriber: S | None = None
        self.direct: DirectPort | None = None

    def close(self) -> None:
        """Take the subscriber off the bus."""
        if self.subscriber is not None:
            self.subscriber.close()


class RunOnPort(Protocol):
    """Runs a conversation on a channel; `heard` is the first input of one that already listens."""

    def __call__(
        self,
        channel: Channel,
        conversation: Conversation[CanFrame, T],
        port: DirectPort | Subscriber,
        heard: Heard[CanFrame] | None = None,
        /,
    ) -> T: ...


class CarryOut(Protocol):
    """Waits for the locks of an operation, and carries it out."""

    def __call__(self, operation: BusOperation[T], /) -> T: ...


class ChannelMemory(Generic[S]):
    """The channels that the fast path of one client knows."""

    def __init__(self) -> None:
        self._known: dict[Channel, KnownChannel[S]] = {}

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {len(self._known)} channels>"

    def _remember(self, channel: Channel) -> KnownChannel[S]:
        if len(self._known) >= _CHANNELS_MAX:
            for other, known in list(self._known.items()):
                if not known.lock.granted:
                    self._known.pop(other, None)
                    known.close()
        return self._known.setdefault(channel, KnownChannel(channel))

    def close(self) -> None:
        """Take all subscribers off the bus."""
        for known in list(self._known.values()):
            known.close()


class FastPath(ChannelMemory[ChannelSubscriber]):
    """The fast path of one blocking client. `carry_out` and `run` are for all that is not plain."""

    def __init__(self, carry_out: CarryOut, run: RunOnPort) -> None:
        super().__init__()
        self._carry_out = carry_out
        self._run = run

    def exchange(self, bus: CanBus, plain: PlainExchange[T]) -> T:
        """Carry out an exchange, or the transfer that it turns out to be."""
        known = self._known.get(plain.channel) or self._remember(plain.channel)
        lock, thread = known.lock, threading.get_ident()
        if bus.failure is not None or lock.granted:
            return self._carry_out(whole_transfer(plain))
        try:
            if bus.lock_if_free(lock, thread):
                return self._exchange(bus, known, plain)
        finally:
            try:
                if lock.granted and lock.owner == thread:
                    bus.release_lock(lock)
            finally:  # an exception may have come before it was released
                if lock.granted and lock.owner == thread:
                    bus.release_lock(lock)
        return self._carry_out(whole_transfer(plain))

    def _exchange(self, bus: CanBus, known: KnownChannel[ChannelSubscriber], plain: PlainExchange[T]) -> T:
        try:
            port = known.direct
            if port is None:
                port = known.direct = DirectPort(bus, bus.reading, known.keys)
            try:
                if bus.begin_direct(port, plain.timeout):
                    return self._exchange_on(port, plain)
            finally:
                try:
                    port.close()
                finally:  # an exception may have come before it was closed
                    port.close()
            return self._exchange_on(self._subscriber(bus, known), plain)
        finally:
            try:
                if plain.channel.busy:
                    plain.be_interrupted(time.monotonic())
            finally:
                if plain.channel.busy:
                    plain.be_interrupted(time.monotonic())

    def _exchange_on(self, port: DirectPort | ChannelSubscriber, plain: PlainExchange[T]) -> T:
        request = plain.begin()
        if request is None:
            return self._run(plain.channel, plain.whole(), port)
        try:
            frame = port.exchange(request, plain.timeout)
        except BaseException as error:
            self._abandon(port, plain, error)
            raise
        sent_at = port.sent_at
        if sent_at is None:
            plain.cancel()
            return self._run(plain.channel, plain.whole(), port)
        if frame is None:
            return self._run(plain.channel, plain.rest(sent_at), port)
        result = plain.answer_in(frame)
        if result is not NOT_PLAIN:
            return result
        rest = plain.rest(sent_at)
        next(rest)
        return self._run(plain.channel, rest, port, Heard(frame, time.monotonic()))

    @staticmethod
    def _abandon(port: DirectPort | ChannelSubscriber, plain: PlainExchange[T], error: BaseException) -> None:
        """End an exchange that `error` interrupted as its conversation does."""
        if port.sent_at is None:
            plain.cancel()
            return
        rest = plain.rest(port.sent_at)
        next(rest)
        abandon(rest, port, error)

    def _subscriber(self, bus: CanBus, known: KnownChannel[ChannelSubscriber]) -> ChannelSubscriber:
        subscriber = known.subscriber
        if subscriber is None or subscriber.has_failed:
            known.close()
            subscriber = known.subscriber = ChannelSubscriber(bus, known.keys)
        return subscriber


def _ignore() -> None:
    """Do nothing: nobody waits for a lock that is granted at once."""
