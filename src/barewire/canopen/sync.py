"""SYNC: the periodic message that triggers synchronous PDOs, with its producer and a monitor.   [CiA 301, SYNC]

        080h |              0 bytes, or
        080h | counter 1    1 byte, 1 up to the value of 1019h (2..240), then 1 again

A type 1 PDO is sent or takes effect at every SYNC, a type n PDO at every n-th. A device whose PDOs are all synchronous
(the AZ3 as it leaves the factory) exchanges no process data until a node produces SYNC.

        producer   t0 + T, t0 + 2T, t0 + 3T ...      times are absolute, so a late call does not shift the later ones
        monitor    sync, wrong, jump, lost           checks the SYNC that another node produces
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

from barewire.canopen.cob_ids import SYNC_KEY
from barewire.canopen.cyclic import check_period, next_due
from barewire.canopen.frame import CanFrame
from barewire.errors import DecodeError, EncodeError, shown

COUNTER_MAX = 240
_LOST_AFTER = 1.5
"""Periods without a SYNC after which it counts as lost."""


@dataclass(frozen=True, slots=True)
class SyncMessage:
    """One SYNC message, with its counter if the producer counts.

    >>> str(SyncMessage().encode()), str(SyncMessage(1).encode())
    ('080#', '080#01')
    """

    counter: int | None = None

    def encode(self, key: tuple[int, bool] = SYNC_KEY) -> CanFrame:
        """Return the frame; the default COB-ID is 080h. Raise EncodeError for a counter outside 1..240."""
        if self.counter is None:
            return CanFrame(key[0], b"", key[1])
        if not isinstance(self.counter, int) or not 1 <= self.counter <= COUNTER_MAX:
            raise EncodeError(f"SYNC counter {shown(self.counter)}: expected 1..{COUNTER_MAX}", "counter")
        return CanFrame(key[0], bytes([self.counter]), key[1])

    @classmethod
    def decode(cls, frame: CanFrame, key: tuple[int, bool] = SYNC_KEY) -> SyncMessage:
        """Decode a frame. Raise DecodeError for another identifier, more than one byte, or a counter outside 1..240."""
        if frame.key != key or frame.remote:
            raise DecodeError("mismatch", frame.data, 0, f"{frame} is not a SYNC: expected COB-ID {key[0]:03X}h")
        return cls(sync_counter(frame.data))


def sync_counter(data: bytes) -> int | None:
    """Return the counter in the data of a SYNC, None if it has none. Raise DecodeError."""
    if len(data) > 1:
        raise DecodeError("long", data, 1, "a SYNC has no data, or a counter of 1 byte")
    if not data:
        return None
    if not 1 <= data[0] <= COUNTER_MAX:
        raise DecodeError("value", data, 0, f"SYNC counter {data[0]}: expected 1..{COUNTER_MAX}")
    return data[0]


class SyncProducer:
    """A machine that sends SYNC every `period` seconds, with a counter from 1 to `overflow` (0: without counter).

    >>> producer = SyncProducer(0.01, overflow=2)
    >>> producer.start(0.0)
    >>> [str(producer.feed(None, now)[0]) for now in (0.01, 0.02, 0.03)]
    ['080#01', '080#02', '080#01']

    A SYNC that was due while `feed` was not called is not sent later, but counted in `missed`; `latest` is the longest
    delay in seconds.
    """

    __slots__ = ("_counter", "_next", "key", "latest", "missed", "overflow", "period")

    def __init__(self, period: float, *, overflow: int = 0, key: tuple[int, bool] = SYNC_KEY) -> None:
        if not isinstance(overflow, int) or overflow == 1 or not 0 <= overflow <= COUNTER_MAX:
            raise EncodeError(f"SYNC counter overflow {shown(overflow)}: expected 0 or 2..{COUNTER_MAX}", "overflow")
        self.period = check_period("SYNC period", period)
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

    @property
    def frames(self) -> tuple[CanFrame, ...]:
        """All different frames, in the order in which they are sent."""
        identifier, extended = self.key
        if not self.overflow:
            return (CanFrame(identifier, b"", extended),)
        return tuple(CanFrame(identifier, bytes([count]), extended) for count in range(1, self.overflow + 1))

    def start(self, now: float) -> None:
        """Send the first SYNC one period from now, with the counter 1."""
        self._counter = 0
        self._next = now + self.period

    def stop(self) -> None:
        """Send no further SYNC."""
        self._next = None

    def feed(self, item: None, now: float) -> list[CanFrame]:
        """Return the SYNC, if one is due."""
        if self._next is None or now < self._next:
            return []
        self.latest = max(self.latest, now - self._next)
        self._next, missed = next_due(self._next, self.period, now)
        self.missed += missed
        return [self.next_frame()]

    def next_frame(self) -> CanFrame:
        """Return the next SYNC, independent of the period, and advance the counter."""
        if not self.overflow:
            return CanFrame(self.key[0], b"", self.key[1])
        self._counter = self._counter % self.overflow + 1
        return CanFrame(self.key[0], bytes([self._counter]), self.key[1])


SyncKind = Literal["sync", "jump", "wrong", "lost"]


class SyncEvent(NamedTuple):
    """An event of the monitor.

    sync    a SYNC
    jump    a SYNC whose counter is not the next one: some were lost, or the producer restarted
    wrong   a SYNC with an invalid length or counter
    lost    no SYNC for one and a half periods
    """

    kind: SyncKind
    counter: int | None
    at: float
    since: float | None  # seconds since the previous SYNC


class SyncMonitor:
    """A machine that checks the SYNC of another node.

    `overflow` is the expected value of 1019h: above 0 a counter is required, 0 forbids it, None accepts both.
    `shortest` and `longest` are the intervals measured in seconds, so `longest - shortest` is the jitter.

    >>> monitor = SyncMonitor(0.015)
    >>> [monitor.feed(SyncMessage(number).encode(), number / 100)[0].kind for number in (1, 2, 4)]
    ['sync', 'sync', 'jump']
    """

    __slots__ = ("_lost", "_previous", "_received_at", "key", "longest", "overflow", "period", "shortest")

    def __init__(
        self, period: float | None = None, *, overflow: int | None = None, key: tuple[int, bool] = SYNC_KEY
    ) -> None:
        self.period = None if period is None else check_period("SYNC period", period)
        self.overflow = overflow
        self.key = key
        self.shortest: float | None = None
        self.longest: float | None = None
        self._received_at: float | None = None
        self._previous: int | None = None
        self._lost = False

    @property
    def deadline(self) -> float | None:
        """When SYNC counts as lost unless one arrives before."""
        if self.period is None or self._received_at is None or self._lost:
            return None
        return self._received_at + _LOST_AFTER * self.period

    def feed(self, frame: CanFrame | None, now: float) -> list[SyncEvent]:
        """Return the events of a frame, or of time passing."""
        events: list[SyncEvent] = []
        due = self.deadline
        since = None if self._received_at is None else now - self._received_at
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
        kind: SyncKind = "sync" if self._follows(counter) else "jump"
        self._previous, self._received_at, self._lost = counter, now, False
        return [*events, SyncEvent(kind, counter, now, since)]

    def _follows(self, counter: int | None) -> bool:
        if counter is None or self._previous is None:
            return True
        if self.overflow is None and counter == 1:  # 1 may follow every counter
            return True
        return counter == (1 if self._previous == self.overflow else self._previous + 1)
