"""The mapping of a PDO: which objects its data contains, packed bit by bit without identification.   [CiA 301, PDO]

        mapping entry    index 2 | sub 1 | bits 1     as one number: 6040 00 10h = 6040h:00, 16 bits

        RPDO1 of the AZ3     6040 00 10 | 60FF 00 20
        byte                 0   1      | 2   3   4   5
                             0F 00        A8 61 00 00          controlword 000Fh, velocity 25000

Bit k of the data is bit (k mod 8) of byte (k div 8), the low bit of each object first. So the data is one little-endian
number, and every object is a shift and a mask in it:

        5 : 4 bits, ABh : 8 bits, Ch : 4 bits    ->    CAB5h    ->    B5 CA

Unknown objects and dummies (0001h to 0007h) occupy their bits too, so the objects behind them keep their position.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from barewire.canopen.datatypes import BY_NAME, TimeCodec, object_codec, type_name
from barewire.codecs import Number, Value
from barewire.errors import DecodeError, EncodeError

ENTRIES_MAX = 64
BITS_MAX = 64
DUMMIES = range(0x0001, 0x0008)

# Objects of these types on whole bytes are packed by one struct call; all others by shifts and masks.
_STRUCT = {"u8": "B", "u16": "H", "u32": "I", "u64": "Q", "i8": "b", "i16": "h", "i32": "i", "i64": "q"}
_STRUCT |= {"f32": "f", "f64": "d"}


@dataclass(frozen=True, slots=True)
class MappedObject:
    """One object in a PDO. Without a type it is packed and unpacked as an unsigned number.

    >>> f"{MappedObject(0x6040, 0, 16, 'u16').word:08X}", MappedObject.of_word(0x60FF0020).name
    ('60400010', '60FFh:00')
    """

    index: int
    sub: int
    bits: int
    type: str | None = None
    given_name: str = ""

    def __post_init__(self) -> None:
        if self.type is not None:
            object.__setattr__(self, "type", type_name(self.type))

    @property
    def name(self) -> str:
        """The given name, or index and sub-index."""
        return self.given_name or f"{self.index:04X}h:{self.sub:02X}"

    @property
    def word(self) -> int:
        """The 32-bit mapping entry of 1600h or 1A00h."""
        return self.index << 16 | self.sub << 8 | self.bits

    @property
    def is_dummy(self) -> bool:
        """Whether the entry only fills bits (index 0001h to 0007h)."""
        return self.index in DUMMIES and self.sub == 0

    @classmethod
    def of_word(cls, word: int, type: str | None = None, name: str = "") -> MappedObject:
        """Return the object of a 32-bit mapping entry."""
        return cls(word >> 16 & 0xFFFF, word >> 8 & 0xFF, word & 0xFF, type, name)


class _Step(NamedTuple):
    name: str
    offset: int
    mask: int
    sign: int  # the value of the sign bit, 0 for an unsigned object
    codec: Number | TimeCodec | None  # for floats and times; all others are packed by shifts
    is_bool: bool
    length: int  # bytes of a string, 0 for a number


class PdoMapping:
    """The objects of a PDO in their order, with the steps to pack and unpack them.

    >>> controlword = MappedObject(0x6040, 0, 16, "u16", "controlword")
    >>> rpdo1 = PdoMapping([controlword, MappedObject(0x60FF, 0, 32, "i32", "velocity")])
    >>> rpdo1.pack({"controlword": 15, "velocity": -25000}).hex(" ").upper()
    '0F 00 58 9E FF FF'
    >>> rpdo1.unpack(bytes.fromhex("0F00 A8610000"))
    {'controlword': 15, 'velocity': 25000}

    Raises EncodeError for more than 64 entries or 64 bits, for a type that does not fit its bits, and for two
    objects of one name.
    """

    __slots__ = ("_names", "_steps", "_struct", "bits", "entries", "size")

    def __init__(self, entries: Iterable[MappedObject]) -> None:
        self.entries = tuple(entries)
        if len(self.entries) > ENTRIES_MAX:
            raise EncodeError(f"{len(self.entries)} objects: a PDO maps at most {ENTRIES_MAX}")
        self.bits = sum(entry.bits for entry in self.entries)
        if self.bits > BITS_MAX:
            raise EncodeError(f"{self.bits} bits: a PDO carries at most {BITS_MAX}")
        self.size = (self.bits + 7) // 8
        offset = 0
        steps: list[_Step] = []
        places: dict[str, tuple[int, int]] = {}
        for entry in self.entries:
            if not entry.is_dummy:
                if places.setdefault(entry.name, (entry.index, entry.sub)) != (entry.index, entry.sub):
                    raise EncodeError(f"two objects of this PDO are called {entry.name!r}")
                steps.append(_step(entry, offset))
            offset += entry.bits
        self._steps = tuple(steps)
        self._names = tuple(step.name for step in steps)
        self._struct = _struct_of(self.entries)

    def __repr__(self) -> str:
        return f"PdoMapping([{', '.join(f'{entry.word:08X}h' for entry in self.entries)}])"

    def pack(self, values: Mapping[str, Value]) -> bytes:
        """Return the data of a PDO from values by name; an object without a value is 0.

        Raise EncodeError for an unknown name, and for a value that does not fit.
        """
        if self._struct is not None:
            try:
                if len(values) == len(self._names):
                    return self._struct.pack(*[values[name] for name in self._names])
            except (KeyError, struct.error, OverflowError):
                pass  # a value is missing or does not fit: the loop below reports which
        stream = 0
        used = 0
        for step in self._steps:
            value = values.get(step.name)
            if value is not None:
                stream |= _to_bits(step, value) << step.offset
                used += 1
        if used < len(values):
            self._check_names(values)
        return stream.to_bytes(self.size, "little")

    def unpack(self, data: bytes, *, refused: list[str] | None = None) -> dict[str, Value]:
        """Return the values by name from the data of a PDO. Raise DecodeError if the data is not as long as mapped, and
        for a time of 24 hours or more. With a list as `refused`, such a time is left out, and its name is appended.
        """
        if len(data) < self.size:
            raise DecodeError("short", data, len(data), f"{self.size} bytes are mapped, got {len(data)}")
        if len(data) > self.size:
            raise DecodeError("long", data, self.size, f"{self.size} bytes are mapped, got {len(data)}")
        if self._struct is not None:
            return dict(zip(self._names, self._struct.unpack(data)))
        stream = int.from_bytes(data, "little")
        values = {}
        for step in self._steps:
            try:
                values[step.name] = _from_bits(step, stream >> step.offset & step.mask)
            except DecodeError:
                if refused is None:
                    raise
                refused.append(step.name)
        return values

    def _check_names(self, values: Mapping[str, Value]) -> None:
        names = {step.name for step in self._steps}
        for name in values:
            if name not in names:
                raise EncodeError(f"{name!r} is not in this PDO: it has {', '.join(sorted(names)) or 'nothing'}")


def _struct_of(entries: tuple[MappedObject, ...]) -> struct.Struct | None:
    """Return the whole mapping as one struct, None if an object is not of a type and width of `_STRUCT`."""
    codes = ""
    for entry in entries:
        code = _STRUCT.get(entry.type or f"u{entry.bits}")
        if entry.is_dummy and entry.bits % 8 == 0:
            codes += f"{entry.bits // 8}x"
        elif code is not None and struct.calcsize(f"<{code}") * 8 == entry.bits:
            codes += code
        else:
            return None
    return struct.Struct(f"<{codes}")


def _step(entry: MappedObject, offset: int) -> _Step:
    """Return the packing step of an object. Raise EncodeError if its type and its bits do not fit each other."""
    if not 1 <= entry.bits <= BITS_MAX:
        raise EncodeError(f"{entry.name} has {entry.bits} bits: expected 1..{BITS_MAX}")
    mask = (1 << entry.bits) - 1
    plain = _Step(entry.name, offset, mask, 0, None, False, 0)
    if entry.type is None:
        return plain
    codec = object_codec(entry.type)
    if entry.type == "bool":
        return plain._replace(is_bool=True)
    if isinstance(codec, TimeCodec):
        if entry.bits != 8 * codec.size:
            raise EncodeError(f"{entry.name} is a {entry.type} of {entry.bits} bits: expected {8 * codec.size}")
        return plain._replace(codec=codec)
    if not isinstance(codec, Number):
        if entry.bits % 8:
            raise EncodeError(f"{entry.name} is a {entry.type} of {entry.bits} bits: expected whole bytes")
        return plain._replace(length=entry.bits // 8)
    width = BY_NAME[entry.type].bits
    if codec.is_float and entry.bits != width:
        raise EncodeError(f"{entry.name} is a {entry.type} of {entry.bits} bits: expected {width}")
    if entry.bits > width:
        raise EncodeError(f"{entry.name} is a {entry.type} of {entry.bits} bits: expected at most {width}")
    if codec.is_float:
        return plain._replace(codec=codec)
    return plain._replace(sign=1 << entry.bits - 1 if entry.type[0] == "i" else 0)


def _to_bits(step: _Step, value: Value) -> int:
    if step.codec is not None:
        return int.from_bytes(step.codec.encode(value), "little")
    if step.length:
        data = value.encode("latin-1", "replace") if isinstance(value, str) else value
        if not isinstance(data, bytes) or len(data) > step.length:
            raise EncodeError(f"{step.name} = {value!r}: expected at most {step.length} bytes")
        return int.from_bytes(data, "little")
    if isinstance(value, (str, bytes)) or value != value // 1:
        raise EncodeError(f"{step.name} = {value!r}: expected a whole number")
    low, high = (-step.sign, step.sign - 1) if step.sign else (0, 1 if step.is_bool else step.mask)
    if not low <= value <= high:
        raise EncodeError(f"{step.name} = {value!r}: expected {low}..{high}")
    return int(value) & step.mask


def _from_bits(step: _Step, bits: int) -> Value:
    if step.codec is not None:
        return step.codec.decode(bits.to_bytes(step.codec.size, "little"))
    if step.length:
        return bits.to_bytes(step.length, "little")
    if step.is_bool:
        return bool(bits)
    return bits - (step.mask + 1) if bits & step.sign else bits
