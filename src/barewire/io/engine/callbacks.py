"""The callback engine: carries out conversations on asyncio connections without a task, for gateways.

    start(conversation, done) ->  Send: write          ->  resumed at once, or when the bytes are on the wire
                                  Listen: timer is set ->  resumed with received bytes, or None at that time
                                  return, raise        ->  done(result, error)

A task that waits costs two rounds of the event loop and a future for each exchange; here the bytes of a response resume
the conversation in the call that received them. The conversations are those of the other engines.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, Any

from barewire.conversation import Conversation, Heard, Listen, Send
from barewire.errors import BarewireError, PortError
from barewire.io.engine.asyncio import abandon
from barewire.io.engine.blocking import answer, hand_over, listening
from barewire.io.ports.async_links import Mailbox

if TYPE_CHECKING:
    from barewire.modbus.client.bus import Bus
    from barewire.modbus.messages.base import Request

Done = Callable[[Any, BaseException | None], None]
"""Called with the result of a conversation, or with the error that ended it."""


class CallbackBox(Mailbox):
    """A mailbox that carries out one conversation at a time, of the bus of its lane."""

    def __init__(self, name: str, bus: Bus) -> None:
        super().__init__(name)
        self._bus = bus
        self._conversation: Conversation[bytes, Any] | None = None
        self._done: Done | None = None
        self._asked: tuple[int, Request[Any], float, float] | None = None  # of the fast path, with the time of sending
        self._listens_until: float | None = None
        self._alarm: asyncio.TimerHandle | None = None

    @property
    def is_busy(self) -> bool:
        """Whether an exchange is under way."""
        return self._done is not None

    def ask(self, unit: int, request: Request[Any], timeout: float, done: Done) -> None:
        """Ask a unit, as `bus.ask` does, and call `done`. A usual exchange on TCP runs no conversation."""
        if self.chunks and not self._overhear():
            done(None, PortError(f"{self.name}: {self.lost or self._bus.line.broken}"))
            return
        now = self.loop.time()
        frame = self._bus.begin(unit, request, timeout, now) if timeout > 0.0 and self._bus.line.numbered else None
        if frame is None:
            self.start(self._bus.ask(unit, request, timeout=timeout, retries=0), done)
            return
        self._done = done
        self._asked = (unit, request, timeout, now)
        try:
            self.write(frame)
        except BaseException as error:
            self._abandon(error)
            return
        self._listens_until = now + timeout
        self._set_alarm(now + timeout)

    def start(self, conversation: Conversation[bytes, Any], done: Done) -> None:
        """Carry out a conversation and call `done`. Raises RuntimeError if another one is under way."""
        if self._done is not None:
            raise RuntimeError("a lane carries out one conversation at a time")
        self._done, self._conversation = done, conversation
        self._resume(None)

    def put(self, data: bytes) -> None:
        """Resume the conversation that listens with received bytes; keep them if none does."""
        if self._listens_until is None or self.chunks:
            super().put(data)
            if self._done is None and not self._overhear():
                self.fail(str(self._bus.line.broken or self.lost))
            return
        self._listens_until = None
        if self._asked is None:
            self._resume(Heard(data, self.loop.time()))
            return
        unit, request, _, _ = self._asked
        now = self.loop.time()
        response = answer(self._bus, unit, request, data, now)
        if response is not None:
            self._end(response, None)
            return
        self._leave_fast_path()
        self._resume(Heard(data, now))

    def fail(self, why: str) -> None:
        """End the conversation: the connection has ended."""
        super().fail(why)
        if self._alarm is not None:
            self._alarm.cancel()
            self._alarm = None
        if self._done is not None:
            self._abandon(PortError(f"{self.name}: {self.lost}"))

    def _leave_fast_path(self) -> None:
        """Go on with the conversation that listens, if the exchange was begun without one."""
        if self._asked is not None:
            self._conversation = listening(self._bus, *self._asked)
            self._asked = None

    def _overhear(self) -> bool:
        """Let the bus take bytes that came unasked. Returns whether the connection can still be used."""
        while self.chunks and (data := self.take()) is not None:
            self._bus.overhear(data, self.loop.time())
        return self._bus.line.broken is None and self.lost is None

    def _resume(self, heard: Heard[bytes] | None) -> None:
        """Carry the conversation on until it waits or ends."""
        conversation = self._conversation
        assert conversation is not None, "only a conversation that was started is resumed"
        try:
            while True:
                step = next(conversation) if heard is None else conversation.send(heard)
                if isinstance(step, Listen):
                    if self.chunks:
                        heard = Heard(self.take(), self.loop.time())
                        continue
                    return self._listen(step.until)
                if isinstance(step, Send):
                    self.write(step.item)
                else:
                    hand_over(step.items, self.write, None)
                sent = self.sent()
                if sent is not None:
                    self.loop.create_task(self._wait_until_sent(sent))
                    return None
                heard = Heard(None, self.loop.time())
        except StopIteration as stop:
            return self._end(stop.value, None)
        except PortError as error:
            return self._abandon(error)
        except BaseException as error:
            return self._end(None, error)

    async def _wait_until_sent(self, sent: Awaitable[float | None]) -> None:
        try:
            await sent
        except BarewireError as error:
            self._abandon(error)
        else:
            if self._done is not None:
                self._resume(Heard(None, self.loop.time()))

    def _listen(self, until: float) -> None:
        self._listens_until = until
        if until <= self.loop.time():
            # The first round lets the loop read its ports, in the second the conversation is resumed.
            self.loop.call_soon(self.loop.call_soon, self._ring, until)
        else:
            self._set_alarm(until)

    def _set_alarm(self, until: float) -> None:
        # An alarm that rings earlier stays, and is set again when it rings: most responses come long before it, and a
        # thousand alarms a second need not be set and cancelled.
        if self._alarm is not None:
            if self._alarm.when() <= until:
                return
            self._alarm.cancel()
        self._alarm = self.loop.call_at(until, self._ring_at)

    def _ring_at(self) -> None:
        self._alarm = None
        until = self._listens_until
        if until is not None:
            if self.loop.time() >= until:
                self._ring(until)
            else:
                self._set_alarm(until)

    def _ring(self, until: float) -> None:
        """Resume the conversation that listens until then: nothing has arrived."""
        if self._listens_until != until:
            return
        self._listens_until = None
        self._leave_fast_path()
        self._resume(Heard(None, self.loop.time()))

    def _abandon(self, error: BaseException) -> None:
        """End the conversation because of an error outside it; its abort frames are written."""
        self._leave_fast_path()
        if self._conversation is not None:
            try:
                abandon(self._conversation, self, error)
            except BarewireError as ended:
                error = ended
        self._end(None, error)

    def _end(self, result: Any, error: BaseException | None) -> None:
        self._listens_until = self._conversation = self._asked = None
        done, self._done = self._done, None
        if done is not None:
            done(result, error)
