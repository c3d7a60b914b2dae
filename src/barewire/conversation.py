"""The two forms of behaviour: a conversation speaks first, a machine only listens.

A **conversation** is a generator. It yields `Send(item)` when it wants something on the wire and `Listen(until)`
when it wants to hear; each time it is given back one `Heard(item, now)`. It never looks at a clock: time is
what it is told.

        conversation                                   whoever runs it
        ------------                                   ---------------
        yield Send(frame)          ------------->      puts it on the wire
                                   <-------------      Heard(None, now)    it is out (for a serial line: the last
                                                                           bit has left, as far as anyone can know)
        yield SendAll(frames)      ------------->      puts them on the wire, one after the other
                                   <-------------      Heard(None, now)    the last one is out
        yield Listen(until=now+1)  ------------->      waits for something, at most until then
                                   <-------------      Heard(item, now)    this came
                                   <-------------      Heard(None, now)    the time is up
        return result              ------------->      done

A **machine** has `feed(item, now) -> events` and a `deadline`. Feeding `None` is how time passes.

Three interpreters exist and no more: the blocking shell, the asyncio shell, and a test that plays a script in
virtual time (`Wire` below, and `play`). All three mean the same by every word here.

I know: turns and times.  I never know: bytes, frames, sockets, clocks.  Everybody may import me.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Sequence
from typing import Generic, NamedTuple, Protocol, TypeAlias, TypeVar

from barewire.errors import BarewireError

DEFAULT_TIMEOUT = 1.0
"""Seconds that a request waits for its response where the caller gives no time-out, on every bus."""

Item = TypeVar("Item")
Result = TypeVar("Result")
Event = TypeVar("Event")
ItemIn = TypeVar("ItemIn", contravariant=True)
EventOut = TypeVar("EventOut", covariant=True)


class Send(NamedTuple, Generic[Item]):
    """Put `item` on the wire. Answered with `Heard(None, now)` once it is out."""

    item: Item

    @property
    def items(self) -> Sequence[Item]:
        """As `SendAll` has them: whoever carries a conversation out need not tell the two apart."""
        return (self.item,)


class SendAll(NamedTuple, Generic[Item]):
    """Put `items` on the wire, one after the other. Answered once, with `Heard(None, now)` when the last one is out.

    For what is said in one breath, as the segments of an SDO block are: nothing is listened for in between.
    """

    items: Sequence[Item]


class Listen(NamedTuple):
    """Wait for whatever comes, at most until `until` (seconds on the clock of `Heard.now`).

    A time that is already past means: take what is there, do not wait.
    """

    until: float


class Heard(NamedTuple, Generic[Item]):
    """What came, or None, and what time it is."""

    item: Item | None
    now: float


Conversation: TypeAlias = Generator[Send[Item] | SendAll[Item] | Listen, Heard[Item], Result]


class Machine(Protocol[ItemIn, EventOut]):
    """What only listens. `deadline` is the time at which it wants to be fed `None` if nothing came before."""

    @property
    def deadline(self) -> float | None: ...

    def feed(self, item: ItemIn | None, now: float) -> Iterable[EventOut]: ...


class Abandoned(BarewireError):
    """Thrown into a conversation by a shell that has to go: Ctrl-C, cancellation, an unplugged cable.

    The conversation may still send (an SDO abort is a last word); it is never listened for again.
    """


def last_words(conversation: Conversation[Item, Result], why: str = "the conversation was abandoned") -> list[Item]:
    """Tell a conversation that it is abandoned and collect what it still wants to say.

    What it raises comes out, if it has something to tell: that nobody knows what became of a write.
    """
    said: list[Item] = []
    try:
        step = conversation.throw(Abandoned(why))
        while not isinstance(step, Listen):
            said += step.items
            step = conversation.send(Heard(None, float("inf")))
    except (StopIteration, Abandoned):
        pass
    finally:
        conversation.close()
    return said


class Wire(Generic[Item]):
    """The third interpreter: virtual time, on which one conversation is played after the other.

    `peer(item, now)` is called for everything sent and returns what it answers as (time, item) pairs; nothing sleeps,
    so a night on the bus is a test of a millisecond. What is still under way when a conversation ends, or raises, is
    heard by the next one.
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
        """What is under way, and when it is there."""
        self.peer = peer
        self._sending_takes = sending_takes

    def play(self, conversation: Conversation[Item, Result]) -> Result:
        """Carry a conversation out, from `now` on. Whatever it raises comes out."""
        try:
            step = next(conversation)
            while True:
                item: Item | None = None
                if not isinstance(step, Listen):
                    for said in step.items:
                        self.now += self._sending_takes(said)
                        self.coming += self.peer(said, self.now)
                        self.coming.sort(key=lambda pair: pair[0])
                elif self.coming and self.coming[0][0] <= max(step.until, self.now):
                    when, item = self.coming.pop(0)
                    self.now = max(self.now, when)
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
    """One conversation on a `Wire` of its own. Returns the result and the time at the end."""
    wire = Wire(peer, start=start, sending_takes=sending_takes)
    return wire.play(conversation), wire.now
