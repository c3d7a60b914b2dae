"""The data types of the object dictionary: number, name, width and codec.   [CiA 301, data types]

        0001h BOOLEAN   bool   1 bit in a PDO, 1 byte in an SDO
        0003h INTEGER16 i16    16 bits, little-endian everywhere in CANopen
        0008h REAL32    f32    32 bits
        000Ch TIME_OF_DAY      48 bits, milliseconds and days

Types of variable size (strings, domains) have 0 bits here. Types of whole records (0020h to 0023h) have no codec.

The two time types are milliseconds and days:   [CiA 301, TIME_OF_DAY, TIME_DIFFERENCE]

        TIME_OF_DAY        ms since midnight, 28 bits | void, 4 bits | days since 1 January 1984, 16 bits
        TIME_DIFFERENCE    ms, 28 bits                | void, 4 bits | days, 16 bits

        2 January 1984, 00:00:01     E8 03 00 00 | 01 00         both little-endian, 48 bits in all

A value is an int, the total of milliseconds, so it can be compared and limited like any other number; `datetime` and
`timedelta` convert it. There are no time zones and no leap seconds: the value is the local time of a device.
"""

from __future__ import annotations

from datetime import datetime, timedelta
from typing import NamedTuple

from barewire.codecs import Number, Value, codec
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

    def __str__(self) -> str:
        return str(self.timedelta)

    def __repr__(self) -> str:
        return f"TimeDifference({self})"


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

    def __str__(self) -> str:
        return str(self.datetime)

    def __repr__(self) -> str:
        return f"TimeOfDay({self})"


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


class DataType(NamedTuple):
    """One row: number in the dictionary, name in the standard, name in barewire, bits in a PDO (0: varies)."""

    code: int
    standard: str
    name: str
    bits: int


DATA_TYPES: tuple[DataType, ...] = (
    DataType(0x01, "BOOLEAN", "bool", 1),
    DataType(0x02, "INTEGER8", "i8", 8),
    DataType(0x03, "INTEGER16", "i16", 16),
    DataType(0x04, "INTEGER32", "i32", 32),
    DataType(0x05, "UNSIGNED8", "u8", 8),
    DataType(0x06, "UNSIGNED16", "u16", 16),
    DataType(0x07, "UNSIGNED32", "u32", 32),
    DataType(0x08, "REAL32", "f32", 32),
    DataType(0x09, "VISIBLE_STRING", "string", 0),
    DataType(0x0A, "OCTET_STRING", "octets", 0),
    DataType(0x0B, "UNICODE_STRING", "unicode", 0),
    DataType(0x0C, "TIME_OF_DAY", "time_of_day", 48),
    DataType(0x0D, "TIME_DIFFERENCE", "time_difference", 48),
    DataType(0x0F, "DOMAIN", "domain", 0),
    DataType(0x10, "INTEGER24", "i24", 24),
    DataType(0x11, "REAL64", "f64", 64),
    DataType(0x12, "INTEGER40", "i40", 40),
    DataType(0x13, "INTEGER48", "i48", 48),
    DataType(0x14, "INTEGER56", "i56", 56),
    DataType(0x15, "INTEGER64", "i64", 64),
    DataType(0x16, "UNSIGNED24", "u24", 24),
    DataType(0x18, "UNSIGNED40", "u40", 40),
    DataType(0x19, "UNSIGNED48", "u48", 48),
    DataType(0x1A, "UNSIGNED56", "u56", 56),
    DataType(0x1B, "UNSIGNED64", "u64", 64),
)

BY_NAME = {row.name: row for row in DATA_TYPES}
BY_CODE = {row.code: row for row in DATA_TYPES}
_BY_STANDARD = {row.standard: row.name for row in DATA_TYPES}


class BooleanCodec:
    """BOOLEAN as one byte, 0 or 1."""

    name, size = "bool", 1

    def encode(self, value: Value) -> bytes:
        if value not in (0, 1):
            raise EncodeError(f"{value!r} is not a truth value: expected True, False, 1 or 0")
        return b"\1" if value else b"\0"

    def decode(self, data: bytes) -> bool:
        if len(data) != 1:
            raise DecodeError("long" if data else "short", data, min(len(data), 1), "a truth value is 1 byte")
        if data[0] > 1:
            raise DecodeError("value", data, 0, f"{data[0]:02X}h is not a truth value")
        return data == b"\1"


class BytesCodec:
    """VISIBLE_STRING, OCTET_STRING, DOMAIN: bytes of any length. A VISIBLE_STRING is text, in latin-1, in which the
    others encode text too."""

    size = None

    def __init__(self, name: str) -> None:
        self.name = name

    def encode(self, value: Value) -> bytes:
        if isinstance(value, str):
            try:
                return value.encode("latin-1")
            except UnicodeEncodeError:
                raise EncodeError(f"{value!r} has characters that are not in latin-1") from None
        if not isinstance(value, bytes):
            raise EncodeError(f"{value!r} is neither bytes nor text")
        return value

    def decode(self, data: bytes) -> Value:
        return data.decode("latin-1") if self.name == "string" else bytes(data)


class UnicodeCodec:
    """UNICODE_STRING: UTF-16, the low byte first. Lone surrogates are kept as they are."""

    name, size = "unicode", None

    def encode(self, value: Value) -> bytes:
        if not isinstance(value, str):
            raise EncodeError(f"{value!r} is not text")
        return value.encode("utf-16-le", "surrogatepass")

    def decode(self, data: bytes) -> str:
        if len(data) % 2:
            raise DecodeError("short", data, len(data), "half a character at the end")
        return bytes(data).decode("utf-16-le", "surrogatepass")


ObjectCodec = Number | BooleanCodec | BytesCodec | UnicodeCodec | TimeCodec

_SINGLE: dict[str, ObjectCodec] = {
    "bool": BooleanCodec(),
    "unicode": UnicodeCodec(),
    **{name: BytesCodec(name) for name in ("string", "octets", "domain")},
    **{name: TimeCodec(name) for name in ("time_of_day", "time_difference")},
}


def type_name(name: str) -> str:
    """Return the name in barewire of a type that may be given by its name in the standard; any other as it is.

    >>> type_name("VISIBLE_STRING"), type_name("u16")
    ('string', 'u16')
    """
    return _BY_STANDARD.get(name, name)


def object_codec(name: str) -> ObjectCodec:
    """Return the codec of a type name, little-endian as on the wire.

    >>> object_codec("f32").encode(1.1).hex(" ").upper()
    'CD CC 8C 3F'

    Raise EncodeError for a name that is not in the table.
    """
    name = type_name(name)
    if name in _SINGLE:
        return _SINGLE[name]
    if name not in BY_NAME:
        standard = ", ".join(f"{row.name} ({row.standard})" for row in DATA_TYPES)
        raise EncodeError(f"type {name!r}: expected one of {standard}")
    return codec(name, "DCBA")
