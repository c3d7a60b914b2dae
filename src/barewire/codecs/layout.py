"""Named fields in a row: a `Layout` describes the bytes of a message once, and packs and unpacks them.

pack       values -> bytes                         unpack   bytes -> values; too few or too many bytes are refused
fields     offset and value of each field, for `explain`
measure    the length of the message from its first bytes, for the RTU line

    Layout(">BHH", "function_code", "address", "quantity")

    offset   0               1        2        3        4
           | function_code | address         | quantity        |      size 5, always

    Layout(">BB", "function_code", "byte_count", tail="data", count="byte_count")

    offset   0               1            2 ...
           | function_code | byte_count | byte_count bytes of data |      size 2 + byte_count
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from operator import attrgetter
from typing import Any, Literal, NamedTuple

from barewire.errors import DecodeError, EncodeError


class Field(NamedTuple):
    """One field of a message with its offset and length in bytes. `explain` prints a line for each field."""

    offset: int
    length: int
    name: str
    value: object
    meaning: str = ""


class Layout:
    """A struct format with a name for each value, and optionally a tail of bytes behind it.

    `tail` names the bytes behind the fixed part, `count` the field that holds their number. A tail without a count
    takes all remaining bytes, so the first bytes do not determine the length.

    >>> Layout(">BHH", "function_code", "address", "quantity").pack(3, 107, 3).hex(" ")
    '03 00 6b 00 03'
    >>> Layout(">BB", "function_code", "byte_count", tail="data", count="byte_count").measure(b"\\x03\\x04")
    6
    """

    __slots__ = ("_byteorder", "_count_end", "_count_index", "_places", "_struct", "_values",
                 "count", "names", "size", "tail")  # fmt: skip

    def __init__(self, format: str, *names: str, tail: str | None = None, count: str | None = None) -> None:
        self._struct = struct.Struct(format)
        self.names = names
        self.tail = tail
        self.count = count
        self.size = self._struct.size
        # A field ends where the format up to its character ends: there is one format character for each field.
        self._byteorder: Literal["big", "little"] = "little" if format[0] == "<" else "big"
        ends = [struct.calcsize(format[: 2 + index]) for index in range(len(names))]
        self._places = tuple(zip([0, *ends], ends))
        self._values: Callable[[object], Any] = attrgetter(*names)
        self._count_index = names.index(count) if count is not None else 0
        self._count_end = ends[self._count_index] if count is not None else 0

    def __repr__(self) -> str:
        return f"<Layout {self._struct.format!r}: {', '.join(self.names)}>"

    def pack(self, *values: int, tail: bytes = b"") -> bytes:
        """Pack the fields and the tail. Raises EncodeError, which names the first value that does not fit its field."""
        try:
            return self._struct.pack(*values) + tail
        except struct.error:
            for name, value, (start, end) in zip(self.names, values, self._places):
                limit = (1 << 8 * (end - start)) - 1
                if not (isinstance(value, int) and 0 <= value <= limit):
                    raise EncodeError(f"{name} = {value!r}: expected a whole number in 0..{limit}") from None
            raise

    def pack_of(self, message: object) -> bytes:
        """Pack the attributes of `message` that have the names of the fields. There is no tail."""
        values = self._values(message)
        try:
            return self._struct.pack(*values)
        except (struct.error, TypeError):
            # attrgetter of one name gives the value itself, not a tuple; `pack` reports the value that does not fit.
            return self.pack(*values) if len(self.names) > 1 else self.pack(values)

    def unpack(self, data: bytes) -> tuple[Any, ...]:
        """Return the values of the fields, and behind them the tail if the layout has one.

        Raises DecodeError("short"), ("long") or ("length": the count field contradicts the number of bytes).
        """
        if len(data) < self.size:
            raise self._short(data)
        if self.tail is None:
            if len(data) > self.size:
                surplus = len(data) - self.size
                text = f"{surplus} byte{'s are' if surplus > 1 else ' is'} left over behind {self.names[-1]}"
                raise DecodeError("long", data, self.size, text)
            return self._struct.unpack(data)
        values = self._struct.unpack_from(data)
        if self.count is not None and values[self._count_index] != len(data) - self.size:
            count, following = values[self._count_index], len(data) - self.size
            text = f"{self.count} is {count}, but {following} bytes of {self.tail} follow"
            raise DecodeError("length", data, self._places[self._count_index][0], text)
        return (*values, data[self.size :])

    def _short(self, data: bytes) -> DecodeError:
        for name, (start, end) in zip(self.names, self._places):
            if end > len(data):
                missing = f"{name} needs bytes {start}..{end - 1}" if end - start > 1 else f"{name} is byte {start}"
                return DecodeError("short", data, len(data), f"{missing}, but there are only {len(data)}")
        raise AssertionError("not short")  # pragma: no cover - called with too few bytes only

    def measure(self, data: bytes) -> int | None:
        """Return how many bytes to wait for, as far as these first bytes determine it; None if they do not.

        The result grows once, when the count field has arrived. From then on it is the length of the message.
        """
        if self.tail is None:
            return self.size
        if self.count is None:
            return None
        if len(data) < self._count_end:
            return self.size
        start, end = self._places[self._count_index]
        return self.size + int.from_bytes(data[start:end], self._byteorder)

    def fields(self, data: bytes, at: int = 0) -> list[Field]:
        """Return the fields with their offsets and values, as far as the bytes go. Offsets count from `at`."""
        fields: list[Field] = []
        for name, (start, end) in zip(self.names, self._places):
            if end > len(data):
                return fields
            value = int.from_bytes(data[start:end], self._byteorder)
            fields.append(Field(at + start, end - start, name, value))
        if self.tail is not None and len(data) > self.size:
            tail = data[self.size :]
            fields.append(Field(at + self.size, len(tail), self.tail, tail.hex(" ").upper()))
        return fields


class BitPattern:
    """One byte described bit by bit, most significant first: 0 and 1 are fixed, a letter is a field, - is reserved.

        "010- nnes"    7 6 5 | 4 | 3 2 | 1 | 0
                       0 1 0   -   n n   e   s       the server's answer to an SDO upload [CiA 301]

    >>> initiate = BitPattern("010- nnes")
    >>> hex(initiate.encode(n=2, e=1, s=1))
    '0x4b'
    >>> initiate.matches(0x4B), initiate.decode(0x4B)
    (True, {'n': 2, 'e': 1, 's': 1})
    """

    __slots__ = ("_fields", "mask", "pattern", "value")

    def __init__(self, pattern: str) -> None:
        bits = pattern.replace(" ", "")
        if len(bits) != 8:
            raise EncodeError(f"bit pattern {pattern!r}: expected 8 places, found {len(bits)}")
        self.pattern = pattern
        self.mask = int("".join("1" if bit in "01" else "0" for bit in bits), 2)
        self.value = int("".join(bit if bit in "01" else "0" for bit in bits), 2)
        self._fields: dict[str, tuple[int, int]] = {}  # the lowest bit and the width
        for letter in dict.fromkeys(bit for bit in bits if bit not in "01-"):
            width = bits.count(letter)
            if letter * width not in bits:
                raise EncodeError(f"bit pattern {pattern!r}: the bits of {letter!r} do not lie together")
            self._fields[letter] = (7 - bits.rindex(letter), width)

    def __repr__(self) -> str:
        return f"BitPattern({self.pattern!r})"

    def matches(self, byte: int) -> bool:
        """Whether the fixed bits match. Reserved bits may have any value."""
        return byte & self.mask == self.value

    def decode(self, byte: int) -> dict[str, int]:
        """Return the fields by letter. Raises DecodeError("function") if the fixed bits do not match."""
        if not self.matches(byte):
            text = f"{byte:02X}h is not {self.pattern}"
            raise DecodeError("function", bytes([byte]), 0, text)
        return {letter: byte >> low & (1 << width) - 1 for letter, (low, width) in self._fields.items()}

    def encode(self, **fields: int) -> int:
        """Return the byte with these fields. Reserved bits and fields that are not given are 0."""
        byte = self.value
        for letter, field in fields.items():
            if letter not in self._fields:
                raise EncodeError(f"{self.pattern!r} has no field {letter!r}")
            low, width = self._fields[letter]
            if not 0 <= field < 1 << width:
                raise EncodeError(f"{letter} = {field}: expected 0..{(1 << width) - 1}")
            byte |= field << low
        return byte
