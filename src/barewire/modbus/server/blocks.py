"""The values of a table in memory: 16-bit registers, and bits, at the addresses that exist.

    address       0 ... 9   10 11 12   13 ... 99   100 101 102 103
    exists           no     yes           no        yes                   spans ((10, 13), (100, 104))

    registers[11] = 70000          EncodeError: holding register 11 = 70000: expected ...
    registers[13] = 1              EncodeError: holding register 13 does not exist: expected 10..12 or 100..103
    registers[10:12] = [1]         EncodeError: holding registers 10..11: 1 values for 2 holding registers
    registers.append(1)            EncodeError: holding registers: a block keeps its size ...

A block is an `array` or a `bytearray` up to its last address, with zeros in its holes. Values are checked when they are
assigned; reading checks that the addresses exist, where there are holes.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterable, Mapping, Sequence
from operator import index
from typing import Any, NoReturn, Self, SupportsIndex

from barewire.codecs.order import is_whole
from barewire.errors import EncodeError, shown

ADDRESSES = 0x10000
"""The number of addresses of each table [MB-APP 4.4]."""
_BITS = frozenset((0, 1))


class _Block:
    """What registers and bits have in common."""

    name = "value"
    """What one of them is called in errors."""
    expected = ""
    stored: Callable[..., Any]
    """Return a value or a slice, without a check."""
    store: Callable[..., None]
    """Set a value or a slice, without a check."""
    spans: tuple[tuple[int, int], ...] = ()
    """The addresses that exist, in order: the first one of each row, and the one after its last."""
    has_holes = False
    """Whether some addresses before the last one do not exist."""

    def has(self, address: int, quantity: int) -> bool:
        """Whether all these addresses exist."""
        end = address + quantity
        return any(first <= address and end <= after for first, after in self.spans)

    def _describe(self, name: str, spans: Iterable[tuple[int, int]]) -> None:
        self.name, self.spans = name, tuple(spans)
        self.has_holes = bool(self.spans) and (len(self.spans) > 1 or self.spans[0][0] > 0)

    def missing(self, place: SupportsIndex | slice) -> str:
        """Return the text of an error if not all these addresses exist, or an empty text."""
        length = len(self)  # type: ignore[arg-type]  # it is an array or a bytearray too
        expected = f"expected {_rows(self.spans, ' or ')}" if self.spans else f"the table has no {self.name}s"
        if not isinstance(place, slice):
            address = index(place)
            address += length if address < 0 else 0
            return "" if self.has(address, 1) else f"{self.name} {address} does not exist: {expected}"
        addresses = range(length)[place]
        if all(self.has(address, 1) for address in addresses):
            return ""
        return f"{self.name}s {addresses[0]}..{addresses[-1]} do not all exist: {expected}"

    def __getitem__(self, place: Any) -> Any:
        if self.has_holes and (missing := self.missing(place)):
            raise IndexError(missing)
        stored = self.stored(place)
        return list(stored) if isinstance(place, slice) else stored

    def __repr__(self) -> str:
        return f"<{self.name}s {_rows(self.spans, ', ')}>" if self.spans else f"<{self.name}s: none>"

    __str__ = __repr__  # a bytearray would print all its values

    def _keep_size(self, *_: object) -> NoReturn:
        """Raise EncodeError: every address of a table has one value."""
        how = "set values in place, such as block[0:3] = [1, 0, 1]"
        raise EncodeError(f"{self.name}s: a block keeps its size; {how}")

    def _keep_places(self, *_: object) -> NoReturn:
        """Raise EncodeError: a value that moves may get to an address that does not exist."""
        how = "set them, such as block[0:3] = [1, 0, 1]"
        raise EncodeError(f"{self.name}s: values keep their addresses; {how}")

    reverse = byteswap = _keep_places
    append = extend = insert = pop = remove = clear = _keep_size
    frombytes = fromfile = fromlist = fromunicode = _keep_size
    __iadd__ = __imul__ = __delitem__ = _keep_size


class RegisterBlock(_Block, array):  # type: ignore[type-arg]  # it takes [int] since Python 3.12
    """Registers, 0..65535 each."""

    expected = "whole numbers in 0..65535"
    stored = array.__getitem__
    store = array.__setitem__

    @classmethod
    def of(cls, name: str, size: int, rows: Any = None) -> Self:
        """Return a block of `rows`, see `_placed`; by default `size` zeros from address 0."""
        placed, spans = _placed(cls, name, size, rows)
        block = cls("H", bytes(2 * (spans[-1][1] if spans else 0)))
        block._describe(name, spans)
        for first, row in placed:
            block.store(slice(first, first + len(row)), array("H", row))
        return block

    @staticmethod
    def holds(value: Any) -> bool:
        """Whether the value can be a register."""
        return is_whole(value, 0, 0xFFFF)

    def fill(self, values: Any) -> None:
        """Set the values from the first address on; the others become 0. Raises EncodeError for several spans."""
        if (span := _only_span(self)) is not None:
            self.store(span, array("H", _filling(self, values, span)))

    def __setitem__(self, place: SupportsIndex | slice, value: Any) -> None:
        if self.has_holes and (missing := self.missing(place)):
            raise EncodeError(missing)
        if not isinstance(place, slice):
            _check(self, index(place), value)
        elif isinstance(value, array) and value.typecode == "H":  # it can only hold registers
            _check_length(self, place, value)
        else:
            value = array("H", _checked_row(self, place, value))
        self.store(place, value)

    def __copy__(self) -> Self:  # an array would copy itself as an array
        other = type(self)("H", self.tobytes())
        other._describe(self.name, self.spans)
        return other

    def __deepcopy__(self, memo: object) -> Self:
        return self.__copy__()


class BitBlock(_Block, bytearray):
    """Bits, one in each byte, 0 or 1."""

    expected = "True or False"
    stored = bytearray.__getitem__
    store = bytearray.__setitem__

    @classmethod
    def of(cls, name: str, size: int, rows: Any = None) -> Self:
        """Return a block of `rows`, see `_placed`; by default `size` zeros from address 0."""
        placed, spans = _placed(cls, name, size, rows)
        block = cls(spans[-1][1] if spans else 0)
        block._describe(name, spans)
        for first, row in placed:
            block.store(slice(first, first + len(row)), bytes(map(bool, row)))
        return block

    @staticmethod
    def holds(value: Any) -> bool:
        """Whether the value can be a bit: True, False, 1 or 0."""
        try:
            return value in _BITS and not isinstance(value, float)  # a bool of numpy is equal to one of them
        except TypeError:
            return False

    def fill(self, values: Any) -> None:
        """Set the values from the first address on; the others become 0. Raises EncodeError for several spans."""
        if (span := _only_span(self)) is not None:
            self.store(span, bytes(map(bool, _filling(self, values, span))))

    def __setitem__(self, place: SupportsIndex | slice, value: Any) -> None:
        if self.has_holes and (missing := self.missing(place)):
            raise EncodeError(missing)
        if not isinstance(place, slice):
            _check(self, index(place), value)
            value = bool(value)
        elif isinstance(value, bytes) and _BITS.issuperset(value):
            _check_length(self, place, value)
        else:
            value = bytes(map(bool, _checked_row(self, place, value)))
        self.store(place, value)


_AnyBlock = RegisterBlock | BitBlock


def _rows(spans: Sequence[tuple[int, int]], between: str) -> str:
    """Return the addresses of spans as text.

    >>> _rows([(7, 8), (100, 104)], " or ")
    '7 or 100..103'
    """
    return between.join(f"{first}" if after == first + 1 else f"{first}..{after - 1}" for first, after in spans)


def _placed(
    kind: type[_AnyBlock], name: str, size: int, rows: Any
) -> tuple[list[tuple[int, list[Any]]], list[tuple[int, int]]]:
    """Return rows of values by their first address, checked, and the spans that they fill; adjacent ones are one span.

    `rows` is a list of values from address 0 on, or a dict: first address -> list; None: `size` zeros, which no row
    has to set. Raises EncodeError.
    """
    if rows is None:
        return [], [(0, size)] if size else []
    if not isinstance(rows, Mapping):
        if not _is_list(kind, rows):
            text = "expected a list of values from address 0, such as [0] * 10, or a dict of address and list"
            raise EncodeError(f"{name}s = {shown(rows)}: {text}")
        rows = {0: rows}
    placed: list[tuple[int, list[Any]]] = []
    for first, values in rows.items():
        if not is_whole(first, 0, ADDRESSES - 1):
            raise EncodeError(f"{name}s from {shown(first)}: expected an address in 0..{ADDRESSES - 1}")
        if not _is_list(kind, values):
            text = f"expected a list of {kind.expected}, such as [0] * 10"
            raise EncodeError(f"{name}s from {index(first)} = {shown(values)}: {text}")
        row, address = list(values), index(first)
        after = address + len(row)
        if after > ADDRESSES:
            raise EncodeError(f"{name}s {address}..{after - 1}: expected addresses in 0..{ADDRESSES - 1}")
        for place, value in enumerate(row):
            if not kind.holds(value):
                raise EncodeError(f"{name} {address + place} = {shown(value)}: expected {_one_of(kind)}")
        if row:
            placed.append((address, row))
    placed.sort(key=lambda found: found[0])
    spans: list[tuple[int, int]] = []
    for first, row in placed:
        after = first + len(row)
        if not spans or first > spans[-1][1]:
            spans.append((first, after))
        elif first == spans[-1][1]:
            spans[-1] = spans[-1][0], after
        else:
            raise EncodeError(f"{name}s {first}..{min(after, spans[-1][1]) - 1} are given twice")
    return placed, spans


def _one_of(kind: type[_AnyBlock] | _AnyBlock) -> str:
    return kind.expected.replace("whole numbers", "a whole number")


def _is_list(kind: type[_AnyBlock] | _AnyBlock, values: object) -> bool:
    """Whether this can be a list of values. Bytes can be one of bits, and text never."""
    is_registers = kind is RegisterBlock or isinstance(kind, RegisterBlock)
    is_text = isinstance(values, str) or (is_registers and isinstance(values, bytes | bytearray))
    return isinstance(values, Iterable) and not is_text


def _check(block: _AnyBlock, place: int, value: Any) -> None:
    """Raise EncodeError unless this block can hold the value."""
    if not block.holds(value):
        address = place + len(block) if place < 0 else place
        raise EncodeError(f"{block.name} {address} = {shown(value)}: expected {_one_of(block)}")


def _checked_row(block: _AnyBlock, place: slice, values: Any) -> list[int]:
    """Return the values for a slice. Raises EncodeError, see `_check`."""
    if not _is_list(block, values):
        raise EncodeError(f"{_places(block, place)} = {shown(values)}: expected a list of {block.expected}")
    row = list(values)
    _check_length(block, place, row)
    for address, value in zip(range(len(block))[place], row, strict=True):
        _check(block, address, value)
    return row


def _only_span(block: _AnyBlock) -> slice | None:
    """Return the only span of a block as a slice, None if it has none. Raises EncodeError if it has several."""
    if len(block.spans) > 1:
        first, after = block.spans[0]
        how = f"set the values of each, such as block[{first}:{after}] = [{', '.join(['1'] * min(3, after - first))}]"
        raise EncodeError(f"{block.name}s {_rows(block.spans, ', ')}: several blocks; {how}")
    return slice(*block.spans[0]) if block.spans else None


def _filling(block: _AnyBlock, values: Any, span: slice) -> list[int]:
    """Return the values for the whole span, filled up with zeros. Raises EncodeError."""
    if not _is_list(block, values):
        raise EncodeError(f"{block.name}s = {shown(values)}: expected a list of {block.expected}")
    if isinstance(values, _AnyBlock):
        only = _only_span(values)
        row: list[Any] = [] if only is None else list(values.stored(only))
    else:
        row = list(values)
    size = span.stop - span.start
    if len(row) > size:
        raise EncodeError(f"{block.name}s: {len(row)} values for {size} {block.name}s")
    for place, value in enumerate(row):
        _check(block, span.start + place, value)
    return [*row, *[0] * (size - len(row))]


def _check_length(block: _AnyBlock, place: slice, values: Sequence[Any] | array[int]) -> None:
    room = len(range(len(block))[place])
    if len(values) != room:
        raise EncodeError(f"{_places(block, place)}: {len(values)} values for {room} {block.name}s")


def _places(block: _AnyBlock, place: slice) -> str:
    addresses = range(len(block))[place]
    return f"{block.name}s {addresses[0]}..{addresses[-1]}" if addresses else f"{block.name}s"
