"""The two forms of behaviour below `io`: a conversation sends first, a machine only reacts.

A **conversation** is a generator. It yields `Send(item)` to transmit and `Listen(until)` to receive, and is resumed
each time with one `Heard(item, now)`. It reads no clock: the time is passed in.

        conversation                                   interpreter
        ------------                                   -----------
        yield Send(frame)          ------------->      transmits the item
                                   <-------------      Heard(None, now)    transmitted (on a serial line: the last
                                                                           bit has left, as far as can be known)
        yield SendAll(frames)      ------------->      transmits the items, one after the other
                                   <-------------      Heard(None, now)    the last one is transmitted
        yield Listen(until=now+1)  ------------->      waits for an item, at most until that time
                                   <-------------      Heard(item, now)    an item arrived
                                   <-------------      Heard(None, now)    the time is over
        return result              ------------->      done

A **machine** has `feed(item, now) -> events` and a `deadline`. Feeding `None` means that only time has passed.

There are three interpreters: the blocking engine, the asyncio engine (both in `io.engine`), and `Wire` below, which
runs conversations in virtual time for tests. All three give these words the same meaning.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Sequence
from typing import Generic, NamedTuple, Protocol, TypeAlias, TypeVar

from barewire.errors import BarewireError, EncodeError

DEFAULT_TIMEOUT = 1.0
"""Seconds that a request waits for its response if the caller gives no time-out, on every bus."""

Item = TypeVar("Item")
Result = TypeVar("Result")
Event = TypeVar("Event")
ItemIn = TypeVar("ItemIn", contravariant=True)
EventOut = TypeVar("EventOut", covariant=True)


def check_request_timeout(timeout: float) -> None:
    """Raise EncodeError for a time-out below 0, or without an end: later requests may wait for a multiple of it."""
    if not 0 <= timeout < float("inf"):
        raise EncodeError(f"time-out {timeout} s: expected 0 or more seconds, and finite", "timeout")


class Send(NamedTuple, Generic[Item]):
    """Transmit `item`. The conversation is resumed with `Heard(None, now)` once it is transmitted."""

    item: Item

    @property
    def items(self) -> Sequence[Item]:
        """The item as a sequence, so that an interpreter treats `Send` and `SendAll` alike."""
        return (self.item,)


class SendAll(NamedTuple, Generic[Item]):
    """Transmit `items` one after the other. The conversation is resumed once, when the last one is transmitted.

    Used for bursts such as the segments of an SDO block. Nothing is received in between.
    """

    items: Sequence[Item]


class Listen(NamedTuple):
    """Wait for the next item, at most until `until` (seconds on the clock of `Heard.now`).

    If that time is past, an item that has already arrived is taken, and there is no waiting.
    """

    until: float


class Heard(NamedTuple, Generic[Item]):
    """The item that arrived, or None, and the time in seconds."""

    item: Item | None
    now: float


Conversation: TypeAlias = Generator[Send[Item] | SendAll[Item] | Listen, Heard[Item], Result]


class Machine(Protocol[ItemIn, EventOut]):
    """An object that reacts to items. If no item arrives before `deadline`, it must be fed `None` at that time."""

    @property
    def deadline(self) -> float | None: ...

    def feed(self, item: ItemIn | None, now: float) -> Iterable[EventOut]: ...


class Abandoned(BarewireError):
    """Thrown into a conversation that cannot go on: Ctrl-C, cancellation, an unplugged cable.

    The conversation may still send final frames, such as an SDO abort; it receives nothing more.
    """


def abort_frames(conversation: Conversation[Item, Result], why: str = "the conversation was abandoned") -> list[Item]:
    """Abandon a conversation and return the final frames that it still sends, such as an SDO abort.

    Errors that the conversation raises propagate, for example `WriteOutcomeUnknown`.
    """
    frames: list[Item] = []
    try:
        step = conversation.throw(Abandoned(why))
        while not isinstance(step, Listen):
            frames += step.items
            step = conversation.send(Heard(None, float("inf")))
    except (StopIteration, Abandoned):
        pass
    finally:
        conversation.close()
    return frames


class Wire(Generic[Item]):
    """The interpreter in virtual time: it runs one conversation after another and never sleeps.

    `peer(item, now)` is called for each transmitted item and returns its answers as (time, item) pairs. Answers that
    are still under way when a conversation ends or raises are received by the next one.
    """

    def __init__(
        self,
        peer: Callable[[Item, float], Iterable[tuple[float, Item]]],
        *,
        start: float = 0.0,
        sending_takes: Callable[[Item], float] = lambda item: 0.0,
    ) -> None:
        self.now = start
        self.coming: list[tuple[float, Item]] = []
        """Items under way, each with its time of arrival."""
        self.peer = peer
        self._sending_takes = sending_takes

    def play(self, conversation: Conversation[Item, Result]) -> Result:
        """Run a conversation, starting at `now`, and return its result. Errors that it raises propagate."""
        try:
            step = next(conversation)
            while True:
                item: Item | None = None
                if not isinstance(step, Listen):
                    for sent in step.items:
                        self.now += self._sending_takes(sent)
                        self.coming += self.peer(sent, self.now)
                        self.coming.sort(key=lambda pair: pair[0])
                elif self.coming and self.coming[0][0] <= max(step.until, self.now):
                    arrival, item = self.coming.pop(0)
                    self.now = max(self.now, arrival)
                else:
                    self.now = max(self.now, step.until)
                step = conversation.send(Heard(item, self.now))
        except StopIteration as stop:
            result: Result = stop.value
            return result


def play(
    conversation: Conversation[Item, Result],
    peer: Callable[[Item, float], Iterable[tuple[float, Item]]],
    *,
    start: float = 0.0,
    sending_takes: Callable[[Item], float] = lambda item: 0.0,
) -> tuple[Result, float]:
    """Run one conversation on a new `Wire`, and return its result and the time at the end."""
    wire = Wire(peer, start=start, sending_takes=sending_takes)
    return wire.play(conversation), wire.now
