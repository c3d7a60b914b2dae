"""The object dictionary: everything a device lets others read and write, by index and sub-index.   [CiA 301]

        1000h-1FFFh   communication: who I am, heartbeat, SDO channels, PDOs
        2000h-5FFFh   the manufacturer's own
        6000h-9FFFh   the profile's: a drive has its controlword at 6040h:00

Each entry has a type, an access right, a default and perhaps limits; each refusal has its own abort code:

        0602 0000h  no such object              0601 0001h  read a write-only one      0607 0012h  too many bytes
        0609 0011h  no such sub-index           0601 0002h  write a read-only one      0607 0013h  too few bytes
        0609 0031h  too high                    0609 0032h  too low                    0609 0030h  no value of the type

Two doors lead in. `read` and `write` are the one for strangers (the SDO server): bytes, rights, limits. `get` and `set`
are the one for the device itself: values, and no rights, because a status word is read-only to everybody but its owner.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Literal, get_args

from barewire.canopen.datatypes import ObjectCodec, object_codec
from barewire.canopen.sdo.aborts import AbortCode, SdoAbort
from barewire.codecs import Value
from barewire.errors import DecodeError, EncodeError

ObjectAccess = Literal["ro", "wo", "rw", "const"]
ObjectRef = str | int | tuple[int, int]
"""Where a value is, for people: a name, an index, or an index and a sub-index."""


@dataclass(frozen=True, slots=True)
class Entry:
    """One object: what it is. Its value lives in the dictionary.

    `minimum` and `maximum` are limits of the value; of strings and domains, `maximum` is the longest length.
    `on_read` gives the value in place of the stored one. `on_write` sees a value that has passed every check, before it
    is stored, and may refuse it by raising SdoAbort. `object_name` is the name of the whole record or array that the
    entry belongs to; `mappable` says in which PDOs it may stand.
    """

    index: int
    sub: int
    name: str
    type: str
    access: ObjectAccess = "rw"
    default: Value = 0
    minimum: float | None = None
    maximum: float | None = None
    on_read: Callable[[], Value] | None = None
    on_write: Callable[[Value], None] | None = None
    object_name: str = ""
    mappable: tuple[Literal["RPDO", "TPDO"], ...] = ("RPDO", "TPDO")

    @property
    def codec(self) -> ObjectCodec:
        """What turns the value into bytes."""
        return object_codec(self.type)


class ObjectDictionary:
    """The entries of one device and their present values.

    An index with sub-indices has at sub-index 0 the highest of them; where nobody gives that entry, it is made.

    >>> objects = ObjectDictionary([Entry(0x206A, 1, "VREF SET POINT", "f32", "rw", 0.0)])
    >>> objects.write(0x206A, 1, bytes.fromhex("CDCC8C3F"))
    >>> round(objects.get(0x206A, 1), 6), objects.read(0x206A, 0)
    (1.1, b'\\x01')
    >>> objects["vref set point"] = 2.5
    >>> objects["VREF SET POINT"], objects[0x206A, 1]
    (2.5, 2.5)

    `changes` counts whatever may have changed a value, so who obeys objects need not look at them each time. Only what
    has an `on_read` changes without that; `computed` are the indices of such entries.
    """

    __slots__ = ("_entries", "_subs", "_values", "changes", "computed")

    def __init__(self, entries: Iterable[Entry] = ()) -> None:
        self._entries: dict[tuple[int, int], Entry] = {}
        self._values: dict[tuple[int, int], Value] = {}
        self._subs: dict[int, list[int]] = {}
        self.changes = 0
        self.computed: set[int] = set()
        for entry in entries:
            self.add(entry)
        for index, subs in self._subs.items():
            if subs[0] != 0:
                self.add(Entry(index, 0, "highest sub-index supported", "u8", "const", subs[-1]))

    def add(self, entry: Entry) -> None:
        """One more entry. EncodeError if there is one already, or if the default is no value of the type."""
        place = entry.index, entry.sub
        if not (0 <= entry.index <= 0xFFFF and 0 <= entry.sub <= 0xFF):
            raise EncodeError(f"{entry.name}: index {entry.index:X}h, sub-index {entry.sub:X}h do not exist")
        if place in self._entries:
            raise EncodeError(f"{entry.index:04X}h:{entry.sub:02X} is there twice: {entry.name}")
        if entry.access not in _ACCESSES:
            raise EncodeError(f"{entry.name}: access {entry.access!r}: expected one of {', '.join(_ACCESSES)}")
        default = self._default(entry)
        entry.codec.encode(default)
        self._entries[place] = entry
        self._values[place] = default
        self.changes += 1
        if entry.on_read is not None:
            self.computed.add(entry.index)
        subs = self._subs.setdefault(entry.index, [])
        subs.append(entry.sub)
        subs.sort()

    def replace(self, entry: Entry) -> None:
        """This entry in place of the one at its index and sub-index, or as a new one. Its value is its default."""
        if self._entries.pop((entry.index, entry.sub), None) is not None:
            self._subs[entry.index].remove(entry.sub)
        self.add(entry)

    def __iter__(self) -> Iterator[Entry]:
        """All entries in order of index and sub-index."""
        return (self._entries[place] for place in sorted(self._entries))

    def __contains__(self, place: object) -> bool:
        return place in self._entries

    def entry(self, index: int, sub: int = 0) -> Entry:
        """The entry, or SdoAbort: no such object, or no such sub-index of it."""
        found = self._entries.get((index, sub))
        if found is None:
            if not isinstance(index, int):
                raise EncodeError(f"index {index!r}: expected a number; by name it is objects[{index!r}]")
            raise SdoAbort(AbortCode.NO_SUB if index in self._subs else AbortCode.NO_OBJECT, index, sub)
        return found

    def find(self, name: str) -> Entry:
        """The entry of that name, whatever its case and blanks; "object.entry" where the entry's name is not enough.

        >>> objects = ObjectDictionary([Entry(0x1018, 1, "Vendor-ID", "u32", object_name="Identity")])
        >>> objects.find("identity.vendor-id").sub
        1

        EncodeError if there is none, or if several have it: the text tells their places.
        """
        wanted = _fold(name)
        found = [entry for entry in self if wanted in (_fold(entry.name), _fold(f"{entry.object_name}.{entry.name}"))]
        if len(found) == 1:
            return found[0]
        places = ", ".join(f"{entry.index:04X}h:{entry.sub:02X} {entry.object_name}".rstrip() for entry in found[:5])
        raise EncodeError(f"{name!r} is in several places: {places}" if found else f"no object is called {name!r}")

    def at(self, place: ObjectRef) -> Entry:
        """The entry of that name or number. EncodeError if there is none."""
        if isinstance(place, str):
            return self.find(place)
        index, sub = (place, 0) if isinstance(place, int) else place
        if (index, sub) not in self._entries:
            raise EncodeError(f"there is no object {index:04X}h:{sub:02X}")
        return self._entries[index, sub]

    def subs(self, index: int) -> tuple[int, ...]:
        """The sub-indices of an object, none if it does not exist."""
        return tuple(self._subs.get(index, ()))

    # The door for strangers: the ObjectStore that an SDO server asks.

    def size(self, index: int, sub: int) -> int | None:
        """How many bytes the object has, None if that varies."""
        return self.entry(index, sub).codec.size

    def read(self, index: int, sub: int) -> bytes:
        """The value as bytes, if it may be read."""
        entry = self.entry(index, sub)
        if entry.access == "wo":
            raise SdoAbort(AbortCode.WRITE_ONLY, index, sub)
        return entry.codec.encode(self.get(index, sub))

    def may_write(self, index: int, sub: int, size: int | None) -> None:
        """Refuse now what `write` would refuse whatever the bytes are."""
        entry = self.entry(index, sub)
        if entry.access in ("ro", "const"):
            raise SdoAbort(AbortCode.READ_ONLY, index, sub)
        if size is None:
            return
        least = entry.codec.size or 0
        most = least if entry.codec.size is not None else self._longest(entry)
        if size > most:
            raise SdoAbort(AbortCode.TOO_LONG, index, sub)
        if size < least:
            raise SdoAbort(AbortCode.TOO_SHORT, index, sub)

    @staticmethod
    def _longest(entry: Entry) -> float:
        """The most bytes that a value of no fixed length may have."""
        if entry.maximum is None:
            return math.inf
        return entry.maximum * (2 if entry.type == "unicode" else 1)

    def write(self, index: int, sub: int, data: bytes) -> None:
        """Take bytes as the new value, if it may be written and they are one."""
        entry = self.entry(index, sub)
        if entry.access in ("ro", "const"):
            raise SdoAbort(AbortCode.READ_ONLY, index, sub)
        try:
            value = entry.codec.decode(data)
        except DecodeError as error:
            lengths = {"long": AbortCode.TOO_LONG, "short": AbortCode.TOO_SHORT}
            raise SdoAbort(lengths.get(error.reason, AbortCode.INVALID_VALUE), index, sub) from None
        self._check_limits(entry, value)
        if entry.on_write is not None:
            entry.on_write(value)
        self._values[index, sub] = value
        self.changes += 1

    @staticmethod
    def _check_limits(entry: Entry, value: Value) -> None:
        code = None
        if isinstance(value, (str, bytes)):
            if entry.maximum is not None and len(value) > entry.maximum:
                code = AbortCode.TOO_LONG
        elif math.isnan(value) and (entry.minimum is not None or entry.maximum is not None):
            code = AbortCode.INVALID_VALUE
        elif entry.maximum is not None and value > entry.maximum:
            code = AbortCode.TOO_HIGH
        elif entry.minimum is not None and value < entry.minimum:
            code = AbortCode.TOO_LOW
        if code is not None:
            raise SdoAbort(code, entry.index, entry.sub)

    # The door for the device itself.

    def get(self, index: int, sub: int = 0) -> Value:
        """The present value, whatever the rights."""
        entry = self.entry(index, sub)
        return self._values[index, sub] if entry.on_read is None else entry.on_read()

    def set(self, index: int, sub: int, value: Value) -> None:
        """Another value, whatever the rights; EncodeError if it is none of the type. No hook is called."""
        self.entry(index, sub).codec.encode(value)
        self._values[index, sub] = value
        self.changes += 1

    def __getitem__(self, place: ObjectRef) -> Value:
        """`get`, by name too."""
        entry = self.at(place)
        return self.get(entry.index, entry.sub)

    def __setitem__(self, place: ObjectRef, value: Value) -> None:
        """`set`, by name too."""
        entry = self.at(place)
        self.set(entry.index, entry.sub, value)

    def hook(
        self,
        place: ObjectRef,
        *,
        on_read: Callable[[], Value] | None = None,
        on_write: Callable[[Value], None] | None = None,
    ) -> None:
        """Give an entry that is there its functions: one out of an EDS has none. Checks that it has come first."""
        entry = self.at(place)
        at, checks = (entry.index, entry.sub), entry.on_write

        def both(value: Value) -> None:
            for function in (checks, on_write):
                if function is not None:
                    function(value)

        self._entries[at] = replace(entry, on_read=on_read or entry.on_read, on_write=both)
        self.changes += 1
        if on_read is not None:
            self.computed.add(entry.index)

    def default(self, index: int, sub: int = 0) -> Value:
        """What the value is after a reset."""
        return self._default(self.entry(index, sub))

    def restore(self, first: int = 0x1000, last: int = 0x9FFF) -> None:
        """Defaults again for the indices `first` to `last`: what a reset does. No hook is called."""
        for place, entry in self._entries.items():
            if first <= place[0] <= last:
                self._values[place] = self._default(entry)
        self.changes += 1

    @staticmethod
    def _default(entry: Entry) -> Value:
        """0 stands for "nothing given", and of a string nothing is an empty one."""
        if entry.default == 0 and entry.codec.size is None:
            return "" if entry.type in ("string", "unicode") else b""
        return entry.default


_ACCESSES = get_args(ObjectAccess)


def _fold(name: str) -> str:
    return " ".join(name.casefold().split())
