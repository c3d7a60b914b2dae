"""TIME: the time of day as a broadcast message, its producer and consumer.   [CiA 301, TIME; TIME_OF_DAY]

        100h | milliseconds since midnight, 28 bits + 4 reserved | days since 1 January 1984, 16 bits |      6 bytes

        95 2C B3 02 4D 39        29 February 2024, 12:34:56.789

The standard defines no time zone; barewire uses UTC. The 16 bits of days end in June 2163. In 1012h, bit 31 means that
a device *consumes* TIME, bit 30 that it *produces* it.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from typing import NamedTuple

from barewire.canopen.cob_ids import TIME_KEY
from barewire.canopen.cyclic import check_period
from barewire.canopen.datatypes import TimeCodec, TimeOfDay
from barewire.canopen.frame import CanFrame
from barewire.errors import DecodeError, EncodeError, shown

EPOCH_UNIX = int(datetime(1984, 1, 1, tzinfo=UTC).timestamp())
"""1 January 1984 in seconds since 1 January 1970."""

_CODEC = TimeCodec("time_of_day")


@dataclass(frozen=True, slots=True)
class TimeStamp:
    """One TIME message: a moment in milliseconds since 1 January 1984.

    >>> stamp = TimeStamp.of_unix(1709210096.789)
    >>> str(stamp.encode()), stamp.unix
    ('100#952CB3024D39', 1709210096.789)
    """

    moment: TimeOfDay

    @classmethod
    def of_unix(cls, seconds: float) -> TimeStamp:
        """Convert seconds since 1 January 1970, rounded to milliseconds. Raise EncodeError for a day out of range."""
        try:
            moment = TimeOfDay(round((seconds - EPOCH_UNIX) * 1000))
        except (TypeError, ValueError, OverflowError):
            raise EncodeError(f"{shown(seconds)} s is not a time of day: expected a finite number of seconds") from None
        _CODEC.encode(moment)
        return cls(moment)

    @property
    def unix(self) -> float:
        """Seconds since 1 January 1970."""
        return EPOCH_UNIX + int(self.moment) / 1000

    def encode(self, key: tuple[int, bool] = TIME_KEY) -> CanFrame:
        """Return the frame; the default COB-ID is 100h. Raise EncodeError for a day out of range."""
        return CanFrame(key[0], _CODEC.encode(self.moment), key[1])

    @classmethod
    def decode(cls, frame: CanFrame, key: tuple[int, bool] = TIME_KEY) -> TimeStamp:
        """Decode a frame. Raise DecodeError for another identifier or length, and for a time of 24 hours or more."""
        if frame.key != key or frame.remote:
            raise DecodeError(
                "mismatch", frame.data, 0, f"{frame} is not a TIME message: expected COB-ID {key[0]:03X}h"
            )
        return cls(TimeOfDay(_CODEC.decode(frame.data)))


class TimeProducer:
    """A machine that sends TIME every `period` seconds. `unix_at_zero` is the Unix time at which `now` was 0.

    >>> producer = TimeProducer(60.0, unix_at_zero=EPOCH_UNIX)
    >>> [str(frame) for frame in producer.feed(None, 0.0)], producer.deadline
    (['100#000000000000'], 60.0)
    """

    __slots__ = ("_next", "key", "period", "unix_at_zero")

    def __init__(self, period: float, unix_at_zero: float, *, key: tuple[int, bool] = TIME_KEY) -> None:
        self.period = check_period("TIME period", period)
        self.unix_at_zero = unix_at_zero
        self.key = key
        self._next: float | None = None

    @property
    def deadline(self) -> float | None:
        """When the next TIME is due; None before the first `feed`, which sends one."""
        return self._next

    def feed(self, item: None, now: float) -> list[CanFrame]:
        """Return the TIME message, if it is due."""
        if self._next is not None and now < self._next:
            return []
        self._next = now + self.period
        return [TimeStamp.of_unix(self.unix_at_zero + now).encode(self.key)]


class TimeReceived(NamedTuple):
    """A received TIME message, and the Unix time at which `now` was 0 according to it."""

    stamp: TimeStamp
    at: float
    unix_at_zero: float


class TimeConsumer:
    """A machine that follows the TIME messages of another node. `unreadable` counts those that cannot be decoded.

    >>> consumer = TimeConsumer()
    >>> received = consumer.feed(TimeStamp.of_unix(EPOCH_UNIX + 1.5).encode(), 10.0)
    >>> consumer.unix(12.0) == EPOCH_UNIX + 1.5 + 2.0
    True
    """

    __slots__ = ("key", "last", "unreadable")
    deadline = None  # nothing is timed

    def __init__(self, key: tuple[int, bool] = TIME_KEY) -> None:
        self.key = key
        self.last: TimeReceived | None = None
        self.unreadable = 0

    def unix(self, now: float) -> float | None:
        """Return the Unix time now, None before the first TIME message."""
        return None if self.last is None else self.last.unix_at_zero + now

    def feed(self, frame: CanFrame | None, now: float) -> list[TimeReceived]:
        """Return the time stamp of the frame, if it is a TIME message."""
        if frame is None or frame.key != self.key or frame.remote:
            return []
        try:
            stamp = TimeStamp.decode(frame, self.key)
        except DecodeError:
            self.unreadable += 1
            return []
        self.last = TimeReceived(stamp, now, stamp.unix - now)
        return [self.last]
