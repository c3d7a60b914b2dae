"""SYNC: the beat that synchronous PDOs follow.   [CiA 301, SYNC]

        080h |              0 bytes, or
        080h | counter 1    1 byte, 1 up to the value of 1019h (2..240), then 1 again

A type 1 PDO is sent or takes effect at every SYNC, a type n PDO at every n-th. The AZ3 leaves the factory with type 0
and type 1 only: without somebody who sends SYNC, nothing moves.

        producer   t0 + T, t0 + 2T, t0 + 3T ...      an absolute beat: a late shell does not make it drift
        monitor    beat, wrong length, jump, lost    somebody who listens to the beat of another
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

from barewire.canopen.cob_ids import SYNC_KEY
from barewire.canopen.frame import CanFrame
from barewire.errors import DecodeError, EncodeError

COUNTER_MAX = 240
LOST_AFTER = 1.5
"""How many periods without a SYNC mean that its producer is gone."""


@dataclass(frozen=True, slots=True)
class SyncMessage:
    """One beat, with its number if the producer counts.

    >>> str(SyncMessage().encode()), str(SyncMessage(1).encode())
    ('080#', '080#01')
    """

    counter: int | None = None

    def encode(self, key: tuple[int, bool] = SYNC_KEY) -> CanFrame:
        """The frame, with COB-ID 080h if 1005h does not say another."""
        if self.counter is None:
            return CanFrame(key[0], b"", key[1])
        if not 1 <= self.counter <= COUNTER_MAX:
            raise EncodeError(f"SYNC counter {self.counter}: expected 1..{COUNTER_MAX}")
        return CanFrame(key[0], bytes([self.counter]), key[1])

    @classmethod
    def decode(cls, frame: CanFrame, key: tuple[int, bool] = SYNC_KEY) -> SyncMessage:
        """Raises DecodeError for another identifier, for more than one byte, for a counter of 0 or above 240."""
        if frame.key != key or frame.remote:
            raise DecodeError("mismatch", frame.data, 0, f"{frame} is no SYNC: that has COB-ID {key[0]:03X}h")
        return cls(sync_counter(frame.data))


def sync_counter(data: bytes) -> int | None:
    """The counter in the data of a SYNC, whatever its COB-ID; None if it counts nothing. Raises DecodeError."""
    if len(data) > 1:
        raise DecodeError("long", data, 1, "SYNC has a counter or nothing")
    if not data:
        return None
    if not 1 <= data[0] <= COUNTER_MAX:
        raise DecodeError("value", data, 0, f"SYNC counter {data[0]}: expected 1..{COUNTER_MAX}")
    return data[0]


class SyncProducer:
    """Beats every `period` seconds, and counts up to `overflow` (0: does not count). A machine.

    >>> producer = SyncProducer(0.01, overflow=2)
    >>> producer.start(0.0)
    >>> [str(producer.feed(None, now)[0]) for now in (0.01, 0.02, 0.03)]
    ['080#01', '080#02', '080#01']

    A beat that the shell was too late for is not made up for; `missed` counts them, `latest` is the longest delay.
    """

    __slots__ = ("_counter", "_next", "key", "latest", "missed", "overflow", "period")

    def __init__(self, period: float, *, overflow: int = 0, key: tuple[int, bool] = SYNC_KEY) -> None:
        if overflow == 1 or not 0 <= overflow <= COUNTER_MAX:
            raise EncodeError(f"SYNC counter overflow {overflow}: expected 0 or 2..{COUNTER_MAX}")
        if not period > 0:
            raise EncodeError(f"SYNC period {period} s: expected more than 0")
        self.period = period
        self.overflow = overflow
        self.key = key
        self.missed = 0
        self.latest = 0.0
        self._counter = 0
        self._next: float | None = None

    @property
    def deadline(self) -> float | None:
        """When the next SYNC is due."""
        return self._next

    def start(self, now: float) -> None:
        """The first SYNC goes out one period from now, with the counter 1."""
        self._counter = 0
        self._next = now + self.period

    def stop(self) -> None:
        """No further SYNC."""
        self._next = None

    def feed(self, item: None, now: float) -> list[CanFrame]:
        """What is due now."""
        if self._next is None or now < self._next:
            return []
        self.latest = max(self.latest, now - self._next)
        late = int((now - self._next) / self.period)
        self.missed += late
        self._next += (late + 1) * self.period
        if self._next <= now:  # rounding: a period that is tiny against the time
            self._next = now + self.period
        return [self.beat()]

    def beat(self) -> CanFrame:
        """One SYNC now, out of turn or by hand: the counter goes on."""
        if not self.overflow:
            return CanFrame(self.key[0], b"", self.key[1])
        self._counter = self._counter % self.overflow + 1
        return CanFrame(self.key[0], bytes([self._counter]), self.key[1])


SyncKind = Literal["beat", "jump", "wrong", "lost"]


class SyncEvent(NamedTuple):
    """`beat` a SYNC, `jump` one whose counter is not the next (some were lost, or the producer began again), `wrong`
    one of a length or with a counter that must not be, `lost` none for one and a half periods."""

    kind: SyncKind
    counter: int | None
    at: float
    since: float | None  # seconds since the beat before


class SyncMonitor:
    """Listens to somebody's SYNC. A machine.

    `overflow` is what 1019h says here: more than 0 wants a counter, 0 none, None takes what comes. `shortest` and
    `longest` are the intervals seen, so `longest - shortest` is the jitter.

    >>> monitor = SyncMonitor(0.015)
    >>> [monitor.feed(SyncMessage(number).encode(), number / 100)[0].kind for number in (1, 2, 4)]
    ['beat', 'beat', 'jump']
    """

    __slots__ = ("_last", "_lost", "_previous", "key", "longest", "overflow", "period", "shortest")

    def __init__(
        self, period: float | None = None, *, overflow: int | None = None, key: tuple[int, bool] = SYNC_KEY
    ) -> None:
        self.period = period
        self.overflow = overflow
        self.key = key
        self.shortest: float | None = None
        self.longest: float | None = None
        self._last: float | None = None
        self._previous: int | None = None
        self._lost = False

    @property
    def deadline(self) -> float | None:
        """When the beat will be missed."""
        if self.period is None or self._last is None or self._lost:
            return None
        return self._last + LOST_AFTER * self.period

    def feed(self, frame: CanFrame | None, now: float) -> list[SyncEvent]:
        """What the frame or the time tells about the beat."""
        events: list[SyncEvent] = []
        due = self.deadline
        since = None if self._last is None else now - self._last
        if due is not None and now >= due:
            self._lost = True
            events.append(SyncEvent("lost", self._previous, now, since))
        if frame is None or frame.key != self.key or frame.remote:
            return events
        try:
            counter = sync_counter(frame.data)
        except DecodeError:
            return [*events, SyncEvent("wrong", None, now, since)]
        if self.overflow is not None and (counter is None) == (self.overflow > 0):
            return [*events, SyncEvent("wrong", counter, now, since)]
        if since is not None and not self._lost:
            self.shortest = since if self.shortest is None else min(self.shortest, since)
            self.longest = since if self.longest is None else max(self.longest, since)
        kind: SyncKind = "beat" if self._follows(counter) else "jump"
        self._previous, self._last, self._lost = counter, now, False
        return [*events, SyncEvent(kind, counter, now, since)]

    def _follows(self, counter: int | None) -> bool:
        """Whether this counter comes behind the last one; where nobody told the overflow, 1 may always come."""
        if counter is None or self._previous is None:
            return True
        if self.overflow is None and counter == 1:
            return True
        return counter == (1 if self._previous == self.overflow else self._previous + 1)
