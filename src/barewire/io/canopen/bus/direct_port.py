"""A port for one conversation that reads a shared bus itself.

A conversation that is alone on a bus needs no queue and no reader thread: `DirectPort` reads the bus itself.

        conversation  ->  DirectPort  ->  port of the bus               one thread: none is woken
        a second listener comes: the reader thread of the bus starts, and reads when this port does not
        conversation  ->  DirectPort  ->  Subscriber  <-  reader        from here as every other subscriber

It delivers the frames that it reads to all subscribers, and becomes a subscriber at its next call: no frame is lost,
and none is delivered twice. Frames that others send or the reader reads until then wait in its `inbox`.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Sequence

from barewire.canopen.frame import CanFrame
from barewire.errors import BarewireError, PortError
from barewire.io.canopen.bus.subscriber import SUBSCRIBER_ROOM, FrameBus, Key, Subscriber, send_each

_SLICE = 0.05
"""Seconds of one read, after which it is checked whether the bus was closed, or a second listener came."""
_BACKLOG = 1.0
"""Seconds that reading the waiting frames of others may take at most: a busy bus is never silent."""


class DirectPort:
    """A port for one conversation or plain exchange at a time. `CanBus.direct` makes it; `close` lets others read."""

    __slots__ = ("_bus", "_has_sent", "_keys", "_patience", "_reading", "_subscriber", "inbox", "sent_at", "thread")

    node = False

    def __init__(self, bus: FrameBus, reading: threading.Lock, keys: frozenset[Key] | None) -> None:
        """`reading`: held by the thread that reads the bus; by this port only inside `receive`, since the functions of
        the caller may take long between two calls."""
        self.inbox: deque[CanFrame] = deque(maxlen=SUBSCRIBER_ROOM)
        self._bus = bus
        self._reading = reading
        self._keys = keys
        self.begin(0.0)

    def begin(self, patience: float) -> None:
        """Begin a conversation in this thread. `patience`: seconds to wait for a bus that failed before anything was
        sent, and is opened again."""
        self.thread = threading.get_ident()
        self._patience = patience
        self._has_sent = False
        self.sent_at: float | None = None
        """When `exchange` sent the request."""
        self._subscriber: Subscriber | None = None
        if self.inbox:
            self.inbox.clear()

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {self._bus.name}>"

    def receives(self, frame: CanFrame) -> bool:
        """Return whether the conversation receives this frame."""
        return self._keys is None or (frame.id, frame.extended) in self._keys

    def send(self, item: CanFrame) -> None:
        """Send a frame. Raises PortError."""
        self._has_sent = True
        self._bus.send(item, self._subscriber or self)

    def send_all(self, items: Sequence[CanFrame]) -> None:
        """Send frames one after the other. Raises PortError."""
        self._has_sent = True
        send_each(self._bus, items, self._subscriber or self)

    def exchange(self, request: CanFrame, timeout: float) -> CanFrame | None:
        """Send a request, unless a frame waits to be read; return the first frame of this conversation after it.

        Nothing was sent if `sent_at` is None. Return None too if no frame came soon: others may want to read, or close
        the bus, so a conversation goes on from here. Raise PortError.
        """
        bus, keys, clock = self._bus, self._keys, time.monotonic
        if bus.has_frames is None or keys is None or not self._reading.acquire(False):
            return None
        try:
            if bus.has_frames() or self.inbox:
                return None
            self.sent_at = sent_at = clock()  # before it is sent: an exception may come between
            if not bus.try_send(request, self):
                self.sent_at = None
                return None
            self._has_sent = True
            wait = timeout if timeout < _SLICE else _SLICE
            until = sent_at + wait
            while wait > 0.0:
                item = bus.read_now(wait)
                if item is None:
                    return None
                if bus.take(item):
                    frame: CanFrame = item  # type: ignore[assignment]  # `take` is False for a report
                    if (frame.id, frame.extended) in keys:
                        return frame
                wait = until - clock()
            return None
        except PortError as error:
            if self._has_sent:
                bus.fail_directly(str(error))
            else:
                self.sent_at = None
            raise
        finally:
            self._reading.release()

    def receive(self, timeout: float) -> CanFrame | None:
        """Return the next frame of this conversation, or None after `timeout` seconds. Raises PortError."""
        if self._subscriber is not None:
            return self._next_of(self._subscriber, timeout)
        bus, clock = self._bus, time.monotonic
        if timeout <= 0.0 and self._is_quiet():
            return None
        until = clock() + timeout
        give_up = until + _BACKLOG
        why = None
        # If the lock is held, the reader thread was started for another listener: this becomes a subscriber, too.
        if self._reading.acquire(blocking=False):
            try:
                while not bus.has_reader:
                    if self.inbox:
                        return self.inbox.popleft()
                    if bus.failure is not None:
                        raise PortError(bus.failure)
                    try:
                        item = bus.read_now(_SLICE if timeout > _SLICE else timeout)
                    except PortError as error:
                        why = str(error)
                        bus.fail_directly(why)
                        break
                    if item is not None and bus.take(item):
                        frame: CanFrame = item  # type: ignore[assignment]  # `take` is False for a report
                        if self.receives(frame):
                            return frame
                    timeout = until - clock()
                    if timeout <= 0.0:
                        if item is None or give_up <= clock():
                            return None
                        timeout = 0.0
            finally:
                self._reading.release()
        remaining = max(0.0, until - clock())
        return self._next_of(self._hand_over(), remaining) if why is None else self._survive(why, remaining)

    def _is_quiet(self) -> bool:
        """Return whether a read, which costs more than this question, would be in vain."""
        bus = self._bus
        idle = bus.has_frames is not None and not (self.inbox or bus.has_reader or bus.has_frames())
        return idle and bus.failure is None

    def _next_of(self, subscriber: Subscriber, timeout: float) -> CanFrame | None:
        return self.inbox.popleft() if self.inbox else subscriber.receive(timeout)

    def _hand_over(self) -> Subscriber:
        """Become a subscriber: from now on only the reader reads."""
        self._subscriber = subscriber = self._bus.subscribe_instead(self._keys)
        return subscriber

    def _survive(self, why: str, timeout: float) -> CanFrame | None:
        """If nothing was sent yet, wait for the reader to open the port that failed again, and go on."""
        bus = self._bus
        if self._has_sent:
            raise PortError(why)
        bus.wait_until_open(self._patience)
        self._subscriber = Subscriber(bus, self._keys)
        return self._subscriber.receive(timeout)

    def note_losses(self, error: BarewireError) -> None:
        """Add a note about dropped frames to the error of a conversation."""
        if self._subscriber is not None:
            self._subscriber.note_losses(error)

    def __enter__(self) -> DirectPort:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the use of the bus."""
        if self._subscriber is not None:
            self._subscriber.close()
        else:
            self._bus.end_direct(self)
