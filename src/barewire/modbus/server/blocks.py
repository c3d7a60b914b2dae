"""The values of a table in memory: 16-bit registers, and bits. Values are checked when they are assigned.

    table.holding_registers[5] = 70000       EncodeError: holding register 5 = 70000: expected ...
    table.coils[0:2] = [True]                EncodeError: coils 0..1: 1 values for 2 coils

Reading is that of `array` and `bytearray`, without a check. An assignment does not change the size of a block.

Used by: table.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Sequence
from operator import index
from typing import Any, Self, SupportsIndex

from barewire.errors import EncodeError, shown

_BITS = frozenset((0, 1))


class RegisterBlock(array):  # type: ignore[type-arg]  # it takes [int] since Python 3.12
    """Registers, 0..65535 each."""

    name = "register"
    """What one of them is called in errors."""
    expected = "whole numbers in 0..65535"

    @classmethod
    def filled(cls, name: str, size: int, values: Any = ()) -> Self:
        """Return a block that begins with `values`; the others are 0."""
        block = cls("H", bytes(2 * size))
        block.name = name
        row = _checked_row(block, None, values)
        array.__setitem__(block, slice(len(row)), array("H", row))
        return block

    @staticmethod
    def holds(value: Any) -> bool:
        """Whether the value can be a register."""
        return hasattr(value, "__index__") and 0 <= index(value) <= 0xFFFF

    def __setitem__(self, place: SupportsIndex | slice, value: Any) -> None:
        if not isinstance(place, slice):
            _check(self, index(place), value)
        elif isinstance(value, array) and value.typecode == "H":  # it can only hold registers
            _check_length(self, place, value)
        else:
            value = array("H", _checked_row(self, place, value))
        super().__setitem__(place, value)

    def __copy__(self) -> Self:  # an array would copy itself as an array
        return self.filled(self.name, len(self), self)

    def __deepcopy__(self, memo: object) -> Self:
        return self.filled(self.name, len(self), self)


class BitBlock(bytearray):
    """Bits, one in each byte, 0 or 1."""

    name = "bit"
    """What one of them is called in errors."""
    expected = "True or False"

    @classmethod
    def filled(cls, name: str, size: int, values: Any = ()) -> Self:
        """Return a block that begins with `values`; the others are 0."""
        block = cls(size)
        block.name = name
        row = _checked_row(block, None, values)
        bytearray.__setitem__(block, slice(len(row)), bytes(row))
        return block

    @staticmethod
    def holds(value: Any) -> bool:
        """Whether the value can be a bit: True, False, 1 or 0."""
        return hasattr(value, "__index__") and 0 <= index(value) <= 1

    def __setitem__(self, place: SupportsIndex | slice, value: Any) -> None:
        if not isinstance(place, slice):
            _check(self, index(place), value)
        elif isinstance(value, bytes) and _BITS.issuperset(value):
            _check_length(self, place, value)
        else:
            value = bytes(_checked_row(self, place, value))
        super().__setitem__(place, value)


def _check(block: RegisterBlock | BitBlock, place: int, value: Any) -> None:
    """Raise EncodeError unless this block can hold the value."""
    if not block.holds(value):
        expected = block.expected.replace("whole numbers", "a whole number")
        address = place + len(block) if place < 0 else place
        raise EncodeError(f"{block.name} {address} = {shown(value)}: expected {expected}")


def _checked_row(block: RegisterBlock | BitBlock, place: slice | None, values: Any) -> list[int]:
    """Return the values for a slice; None is the whole block, which may get fewer. Raises EncodeError, see `_check`."""
    is_text = isinstance(values, str) or (isinstance(block, RegisterBlock) and isinstance(values, bytes | bytearray))
    if is_text or not isinstance(values, Iterable):
        text = f"expected a list of {block.expected}"
        raise EncodeError(f"{_places(block, place)} = {shown(values)}: {text}")
    row = list(values)
    if place is not None or len(row) > len(block):
        _check_length(block, place, row)
    for address, value in zip(range(len(block))[slice(None) if place is None else place], row, strict=False):
        _check(block, address, value)
    return row


def _check_length(block: RegisterBlock | BitBlock, place: slice | None, values: Sequence[Any] | array[int]) -> None:
    room = len(range(len(block))[slice(None) if place is None else place])
    if len(values) != room:
        raise EncodeError(f"{_places(block, place)}: {len(values)} values for {room} {block.name}s")


def _places(block: RegisterBlock | BitBlock, place: slice | None) -> str:
    found = range(len(block))[slice(None) if place is None else place]
    if place is None or not found:
        return f"{block.name}s"
    return f"{block.name}s {found[0]}..{found[-1]}"
