"""The two time types of the object dictionary: milliseconds and days.   [CiA 301, TIME_OF_DAY, TIME_DIFFERENCE]

        TIME_OF_DAY        ms since midnight, 28 bits | void, 4 bits | days since 1 January 1984, 16 bits
        TIME_DIFFERENCE    ms, 28 bits                | void, 4 bits | days, 16 bits

        2 January 1984, 00:00:01     E8 03 00 00 | 01 00         both little-endian, 48 bits in all

A value is an int, the total of milliseconds, so it can be compared and limited like any other number; `datetime` and
`timedelta` convert it. There are no time zones and no leap seconds: the value is the local time of a device.
"""

from __future__ import annotations

from datetime import datetime, timedelta

from barewire.codecs import Value
from barewire.errors import DecodeError, EncodeError

EPOCH = datetime(1984, 1, 1)
DAY = 24 * 60 * 60 * 1000
"""Milliseconds of a day."""

_MS = (1 << 28) - 1
_MILLISECOND = timedelta(milliseconds=1)


class TimeDifference(int):
    """A span of time: an int of milliseconds.

    >>> TimeDifference(90_000), TimeDifference.of(timedelta(days=2)) == 2 * DAY
    (TimeDifference(0:01:30), True)
    """

    __slots__ = ()

    @classmethod
    def of(cls, span: timedelta) -> TimeDifference:
        """Convert a timedelta, rounded down to milliseconds."""
        return cls(span // _MILLISECOND)

    @property
    def timedelta(self) -> timedelta:
        """The value as a timedelta."""
        return int(self) * _MILLISECOND

    def __repr__(self) -> str:
        return f"TimeDifference({self.timedelta})"


class TimeOfDay(int):
    """A date with its time: an int of milliseconds since 1 January 1984.

    >>> TimeOfDay(DAY + 1000)
    TimeOfDay(1984-01-02 00:00:01)
    >>> TimeOfDay.of(datetime(2026, 1, 1)).datetime.year
    2026
    """

    __slots__ = ()

    @classmethod
    def of(cls, moment: datetime) -> TimeOfDay:
        """Convert a datetime; its time zone is ignored."""
        return cls((moment.replace(tzinfo=None) - EPOCH) // _MILLISECOND)

    @property
    def datetime(self) -> datetime:
        """The value as a datetime without a time zone."""
        return EPOCH + int(self) * _MILLISECOND

    def __repr__(self) -> str:
        return f"TimeOfDay({self.datetime})"


class TimeCodec:
    """The codec of both types: encodes milliseconds, a datetime or a timedelta; decodes TimeOfDay or TimeDifference.

    >>> TimeCodec("time_of_day").encode(datetime(1984, 1, 2, 0, 0, 1)).hex(" ").upper()
    'E8 03 00 00 01 00'
    >>> TimeCodec("time_difference").decode(bytes.fromhex("E80300000100"))
    TimeDifference(1 day, 0:00:01)
    """

    size = 6
    minimum, maximum = 0, DAY << 16
    """Limits in milliseconds; the maximum is excluded."""

    def __init__(self, name: str) -> None:
        self.name = name

    def encode(self, value: Value | datetime | timedelta) -> bytes:
        """Return six bytes. Raise EncodeError for another type, and outside of 0..65535 days."""
        if isinstance(value, datetime) and self.name == "time_of_day":
            value = TimeOfDay.of(value)
        elif isinstance(value, timedelta) and self.name == "time_difference":
            value = TimeDifference.of(value)
        if not isinstance(value, int):
            raise EncodeError(f"{value!r} is not a {self.name}: expected milliseconds, a datetime or a timedelta")
        if not self.minimum <= value < self.maximum:
            raise EncodeError(f"{int(value)} ms do not fit {self.name}: expected less than 65536 days")
        days, milliseconds = divmod(int(value), DAY)
        return milliseconds.to_bytes(4, "little") + days.to_bytes(2, "little")

    def decode(self, data: bytes) -> TimeOfDay | TimeDifference:
        """Decode six bytes; the four void bits are ignored. Raise DecodeError("value") for 24 hours or more."""
        if len(data) != self.size:
            short = len(data) < self.size
            text = f"{self.name} takes {self.size} bytes, got {len(data)}"
            raise DecodeError("short" if short else "long", data, min(len(data), self.size), text)
        milliseconds = int.from_bytes(data[:4], "little") & _MS
        if milliseconds >= DAY:
            raise DecodeError("value", data, 0, f"{milliseconds} ms are more than a day")
        total = int.from_bytes(data[4:], "little") * DAY + milliseconds
        return TimeOfDay(total) if self.name == "time_of_day" else TimeDifference(total)
