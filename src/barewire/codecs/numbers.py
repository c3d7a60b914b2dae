"""Codecs of integers and floats: a codec encodes a value as bytes and decodes the bytes.

    u8 u16 u24 u32 u40 u48 u56 u64     0 .. 2^n - 1
    i8 i16 i24 i32 i40 i48 i56 i64     -2^(n-1) .. 2^(n-1) - 1, two's complement
    f32 f64                            IEEE 754 binary32, binary64

    1.1  --codec("f32", "DCBA")-->  CD CC 8C 3F        the number of the AZ3's CANopen guide

`codec(type, order)` returns the codec; there is one object for each type and order.
"""

from __future__ import annotations

import math
import struct
from typing import Protocol, TypeAlias

from barewire.codecs.order import ORDERS, Order, reorder
from barewire.errors import DecodeError, EncodeError, Reason, shown

Value: TypeAlias = int | float | bool | str | bytes

_STRUCT = {"u8": "B", "u16": "H", "u32": "I", "u64": "Q", "i8": "b", "i16": "h", "i32": "i", "i64": "q"}
_STRUCT |= {"f32": "f", "f64": "d"}
_FLOAT_BITS = {"f32": 32, "f64": 64}
_FLOAT_MAX = {"f32": 3.4028234663852886e38, "f64": 1.7976931348623157e308}
_FLOAT_TOO_LARGE = {
    "f32": 3.4028235677973366e38,
    "f64": math.inf,
}  # from here on a number rounds to more than the largest float
_INTEGER_BITS = {f"{sign}{bits}": bits for sign in "ui" for bits in range(8, 65, 8)}


class Codec(Protocol):
    """Encodes one value as `size` bytes and decodes them."""

    @property
    def name(self) -> str: ...

    @property
    def size(self) -> int: ...

    def encode(self, value: Value) -> bytes: ...

    def decode(self, data: bytes) -> Value: ...


class Number:
    """One integer or float type in one byte order.

    >>> Number("u32", "CDAB").encode(100_000).hex(" ")
    '86 a0 00 01'
    >>> Number("i16").decode(bytes.fromhex("FFFE"))
    -2

    `minimum` and `maximum` are the limits of the type. `encode` raises EncodeError for a value that is not a number,
    is not whole although the type is an integer, or lies outside the limits. `decode` raises DecodeError for a wrong
    number of bytes.
    """

    __slots__ = ("_struct", "bits", "is_float", "maximum", "minimum", "name", "order", "size")

    def __init__(self, name: str, order: Order = "ABCD") -> None:
        if order not in ORDERS:
            raise EncodeError(f"byte order {order!r}: expected one of {', '.join(ORDERS)}")
        self.name = name
        self.order: Order = order
        self.is_float = name in _FLOAT_BITS
        self.bits = _FLOAT_BITS[name] if self.is_float else _integer_bits(name)
        self.size = self.bits // 8
        # Raises now, not at the first value, for an order that does not exist, such as u24 in CDAB.
        reorder(bytes(self.size), order)
        self.minimum: int | float
        self.maximum: int | float
        if self.is_float:
            self.minimum, self.maximum = -_FLOAT_MAX[name], _FLOAT_MAX[name]
        elif name[0] == "i":
            self.minimum, self.maximum = -(1 << self.bits - 1), (1 << self.bits - 1) - 1
        else:
            self.minimum, self.maximum = 0, (1 << self.bits) - 1
        # For orders ABCD and DCBA one struct call is enough; mixed orders and odd widths are reordered byte by byte.
        endian = {"ABCD": ">", "DCBA": "<"}.get(order)
        plain = endian is not None and name in _STRUCT
        self._struct = struct.Struct(f"{endian}{_STRUCT[name]}") if plain else None

    def __repr__(self) -> str:
        return f"Number({self.name!r}, {self.order!r})"

    def check(self, value: Value) -> int | float:
        """Return the value as int or float. Raises EncodeError, with the limits, for a value outside the type."""
        if not isinstance(value, (int, float)) or (value != value // 1 and not self.is_float):
            wanted = "a number" if self.is_float else "a whole number"
            raise EncodeError(f"{shown(value)} is not {wanted} for {self.name}")
        if self.is_float:
            # Infinities and NaN are values of IEEE 754; a number that rounds beyond the largest float is refused.
            try:
                number = float(value)
                if abs(number) < _FLOAT_TOO_LARGE[self.name] or not math.isfinite(number):
                    return number
            except OverflowError:  # an int that no float can hold
                pass
            raise EncodeError(f"{shown(value)} does not fit {self.name}: at most ±{self.maximum:g}")
        whole = int(value)
        if not self.minimum <= whole <= self.maximum:
            raise EncodeError(f"{shown(value)} does not fit {self.name}: expected {self.minimum}..{self.maximum}")
        return whole

    def encode(self, value: Value) -> bytes:
        """Encode a value as `size` bytes."""
        number = self.check(value)
        if self._struct is not None:
            return self._struct.pack(number)
        if isinstance(number, float):
            return reorder(struct.pack(f">{_STRUCT[self.name]}", number), self.order)
        return reorder(number.to_bytes(self.size, "big", signed=self.name[0] == "i"), self.order)

    def decode(self, data: bytes) -> int | float:
        """Decode `size` bytes."""
        if len(data) != self.size:
            reason: Reason = "short" if len(data) < self.size else "long"
            text = f"{self.name} takes {self.size} bytes, got {len(data)}"
            raise DecodeError(reason, data, min(len(data), self.size), text)
        if self._struct is not None:
            number: int | float = self._struct.unpack(data)[0]
            return number
        straight = reorder(data, self.order)
        if self.is_float:
            number = struct.unpack(f">{_STRUCT[self.name]}", straight)[0]
            return number
        return int.from_bytes(straight, "big", signed=self.name[0] == "i")


def _integer_bits(name: str) -> int:
    """Return the number of bits: 24 for 'u24'. Raises EncodeError for a name that is not a number type."""
    if name in _INTEGER_BITS:
        return _INTEGER_BITS[name]
    raise EncodeError(f"type {name!r}: expected u8..u64, i8..i64 (in steps of 8 bits), f32 or f64")


_made: dict[tuple[str, str], Number] = {}


def codec(name: str, order: Order = "ABCD") -> Number:
    """Return the codec of a number type in a byte order.

    >>> codec("f32", "DCBA").encode(1.1).hex(" ").upper()
    'CD CC 8C 3F'
    """
    number = _made.get((name, order))
    if number is None:
        # Bounded: Number accepts 18 names and 4 orders.
        number = _made[name, order] = Number(name, order)
    return number
