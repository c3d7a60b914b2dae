"""The object dictionary: all values of a device that can be read and written, by index and sub-index.   [CiA 301]

        1000h-1FFFh   communication: identity, heartbeat, SDO channels, PDOs
        2000h-5FFFh   manufacturer-specific
        6000h-9FFFh   device profile: a drive has its controlword at 6040h:00

Each entry has a type, an access right, a default and optional limits. Each kind of refusal has its own abort code:

        0602 0000h  no such object              0601 0001h  read a write-only one      0607 0012h  too many bytes
        0609 0011h  no such sub-index           0601 0002h  write a read-only one      0607 0013h  too few bytes
        0609 0031h  too high                    0609 0032h  too low                    0609 0030h  no value of the type

There are two interfaces. `read` and `write` are for the SDO server: bytes, with access rights and limits. `get` and
`set` are for the device's own code: values, without access rights, because the device writes its own status word.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Literal, NoReturn, get_args

from barewire._callbacks import check_function
from barewire.canopen.abort_codes import AbortCode, SdoAbort
from barewire.canopen.datatypes import ObjectCodec, object_codec, type_name
from barewire.codecs import Value
from barewire.errors import BarewireError, DecodeError, EncodeError, shown

ObjectAccess = Literal["ro", "wo", "rw", "const"]
ObjectAddress = tuple[int, int]
"""(index, sub-index)."""
ObjectRef = str | int | ObjectAddress
"""How a caller names an object: by name, by index, or by index and sub-index."""

_FIRST_APPLICATION = 0x2000
"""The first index after the communication objects."""


@dataclass(frozen=True, slots=True)
class Entry:
    """The description of one object. Its value is in the dictionary.

    index, sub         the address
    name               the name of the entry
    type               the name of a data type of `datatypes`; that of the standard (UNSIGNED16) becomes ours (u16)
    access             "ro", "wo", "rw" or "const"
    default            the value after a reset
    minimum, maximum   limits of the value; for strings and domains `maximum` is the greatest length
    on_read            returns the value, in place of the stored one
    on_write           called with a value that has passed all checks, before it is stored; raises SdoAbort to refuse
    object_name        the name of the record or array that the entry belongs to
    mappable           the kinds of PDO into which the entry may be mapped; if it is not given, both for objects from
                       2000h on, none for communication objects

    Raises EncodeError for an `on_read` or `on_write` that is not a function, or that is an `async def` or a generator:
    a call would not run it.
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
    mappable: tuple[Literal["RPDO", "TPDO"], ...] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "type", type_name(self.type))
        self._check_hooks(self.on_read, self.on_write)

    def _check_hooks(self, on_read: object, on_write: object) -> None:
        for field, function in (("on_read", on_read), ("on_write", on_write)):
            if function is not None:
                check_function(f"{self.index:04X}h:{self.sub:02X} {field}", function, field)

    def is_mappable(self, direction: Literal["RPDO", "TPDO"]) -> bool:
        """Return whether the entry may be mapped into a PDO of this kind."""
        return self.index >= _FIRST_APPLICATION if self.mappable is None else direction in self.mappable

    def __repr__(self) -> str:
        return f"<Entry {self.index:04X}h:{self.sub:02X} {self.name}: {self.access} {self.type}>"

    @property
    def codec(self) -> ObjectCodec:
        """The codec between value and bytes."""
        return object_codec(self.type)


class ObjectDictionary:
    """The entries of one device and their present values.

    Sub-index 0 of a record holds its highest sub-index; if that entry is not given, it is added.

    >>> objects = ObjectDictionary([Entry(0x206A, 1, "VREF SET POINT", "f32", "rw", 0.0)])
    >>> objects.write(0x206A, 1, bytes.fromhex("CDCC8C3F"))
    >>> round(objects.get(0x206A, 1), 6), objects.read(0x206A, 0)
    (1.1, b'\\x01')
    >>> objects["vref set point"] = 2.5
    >>> objects["VREF SET POINT"], objects[0x206A, 1]
    (2.5, 2.5)

    `changes` counts everything that may have changed a stored value, so that a machine that follows objects reads them
    only after a change. Entries with `on_read` change without being counted; `computed` holds their indices.

    An error that `on_read` or `on_write` raises reaches the caller. With `on_failure`, which a device on a bus sets,
    on_failure("2001h:00", error) is called for errors other than those of barewire, and for a value of `on_read` that
    does not fit its type, and the access is refused with 0800 0000h.
    """

    __slots__ = ("_entries", "_subs", "_values", "changes", "computed", "on_failure")

    def __init__(self, entries: Iterable[Entry] = ()) -> None:
        self._entries: dict[tuple[int, int], Entry] = {}
        self._values: dict[tuple[int, int], Value] = {}
        self._subs: dict[int, list[int]] = {}
        self.changes = 0
        self.computed: set[int] = set()
        self.on_failure: Callable[[str, Exception], None] | None = None
        for entry in entries:
            self.add(entry)
        for index, subs in self._subs.items():
            if subs[0] != 0:
                self.add(Entry(index, 0, "highest sub-index supported", "u8", "const", subs[-1], mappable=()))

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {len(self._entries)} entries>"

    def add(self, entry: Entry) -> None:
        """Add an entry. Raise EncodeError if its address is in use already, or if its default does not fit its type."""
        address = entry.index, entry.sub
        if not (0 <= entry.index <= 0xFFFF and 0 <= entry.sub <= 0xFF):
            raise EncodeError(
                f"{entry.name}: index {entry.index:X}h, sub-index {entry.sub:X}h: expected 0..FFFFh and 0..FFh"
            )
        if address in self._entries:
            raise EncodeError(f"{entry.index:04X}h:{entry.sub:02X} is defined twice: {entry.name}")
        if entry.access not in _ACCESSES:
            raise EncodeError(f"{entry.name}: access {entry.access!r}: expected one of {', '.join(_ACCESSES)}")
        default = self._default(entry)
        entry.codec.encode(default)
        self._entries[address] = entry
        self._values[address] = default
        self.changes += 1
        if entry.on_read is not None:
            self.computed.add(entry.index)
        subs = self._subs.setdefault(entry.index, [])
        subs.append(entry.sub)
        subs.sort()

    def replace(self, entry: Entry) -> None:
        """Replace the entry at this index and sub-index, or add it. Its value is its default."""
        if self._entries.pop((entry.index, entry.sub), None) is not None:
            self._subs[entry.index].remove(entry.sub)
        self.add(entry)

    def __iter__(self) -> Iterator[Entry]:
        """Iterate over all entries, in order of index and sub-index."""
        return (self._entries[address] for address in sorted(self._entries))

    def __contains__(self, address: object) -> bool:
        return address in self._entries

    def entry(self, index: int, sub: int = 0) -> Entry:
        """Return the entry at an address. Raise SdoAbort if the object or its sub-index does not exist."""
        entry = self._entries.get((index, sub))
        if entry is None:
            if not isinstance(index, int):
                raise EncodeError(f"index {index!r}: expected a number; by name it is objects[{index!r}]")
            raise SdoAbort(AbortCode.NO_SUB if index in self._subs else AbortCode.NO_OBJECT, index, sub)
        return entry

    def find(self, name: str) -> Entry:
        """Return the entry of a name, ignoring case and extra blanks; "object.entry" if the entry's name is ambiguous.

        >>> objects = ObjectDictionary([Entry(0x1018, 1, "Vendor-ID", "u32", object_name="Identity")])
        >>> objects.find("identity.vendor-id").sub
        1

        Raise EncodeError if no entry has the name, with similar names, or if several have it, with their addresses.
        """
        folded = _fold(name)
        entries = [entry for entry in self if folded in (_fold(entry.name), _fold(f"{entry.object_name}.{entry.name}"))]
        if len(entries) == 1:
            return entries[0]
        if not entries:
            raise EncodeError(f"no object is called {name!r}{self._suggestion(folded)}")
        places = ", ".join(f"{entry.index:04X}h:{entry.sub:02X} {entry.object_name}".rstrip() for entry in entries[:5])
        raise EncodeError(f"{name!r} is in several places: {places}")

    def _suggestion(self, folded: str) -> str:
        """Return '; did you mean ...?' with up to three names of entries that are similar, or contain this one."""
        from difflib import get_close_matches  # only errors need it

        names = {_fold(entry.name): entry.name for entry in self}
        similar = get_close_matches(folded, names, n=3, cutoff=0.6)
        similar += [name for name in names if folded and folded in name and name not in similar][: 3 - len(similar)]
        return f"; did you mean {' or '.join(repr(names[name]) for name in similar)}?" if similar else ""

    def at(self, ref: ObjectRef) -> Entry:
        """Return the entry of a name or an address. Raise EncodeError if there is none."""
        if isinstance(ref, str):
            return self.find(ref)
        match ref:
            case int(index):
                sub = 0
            case (int(index), int(sub)):
                pass
            case _:
                raise EncodeError(f"{shown(ref)}: expected the name of an object, its index, or (index, sub-index)")
        if (index, sub) not in self._entries:
            raise EncodeError(f"there is no object {index:04X}h:{sub:02X}")
        return self._entries[index, sub]

    def subs(self, index: int) -> tuple[int, ...]:
        """Return the sub-indices of an object in ascending order; empty if it does not exist."""
        return tuple(self._subs.get(index, ()))

    # The interface of the SDO server (`ObjectStore`).

    def size(self, index: int, sub: int) -> int | None:
        """Return the size of an object in bytes, None if it varies."""
        return self.entry(index, sub).codec.size

    def read(self, index: int, sub: int) -> bytes:
        """Return the value as bytes. Raise SdoAbort if it is write-only or does not exist."""
        entry = self.entry(index, sub)
        if entry.access == "wo":
            raise SdoAbort(AbortCode.WRITE_ONLY, index, sub)
        value = self.get(index, sub)
        try:
            return entry.codec.encode(value)
        except EncodeError as error:
            if entry.on_read is None or self.on_failure is None:
                raise
            self._refuse(entry, error, self.on_failure)

    def may_write(self, index: int, sub: int, size: int | None) -> None:
        """Raise the SdoAbort that `write` would raise for any value of this size (None: not known yet)."""
        entry = self.entry(index, sub)
        if entry.access in ("ro", "const"):
            raise SdoAbort(AbortCode.READ_ONLY, index, sub)
        if size is None:
            return
        shortest = longest = float(entry.codec.size or 0)
        if entry.codec.size is None:  # of variable length: the maximum counts characters, of 2 bytes in unicode
            characters = math.inf if entry.maximum is None else entry.maximum
            longest = characters * (2 if entry.type == "unicode" else 1)
        if size > longest:
            raise SdoAbort(AbortCode.TOO_LONG, index, sub)
        if size < shortest:
            raise SdoAbort(AbortCode.TOO_SHORT, index, sub)

    def write(self, index: int, sub: int, data: bytes) -> None:
        """Decode, check and store a new value. Raise SdoAbort if it is refused."""
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
            try:
                entry.on_write(value)
            except Exception as error:
                self._raise_refusal(entry, error)
        self._values[index, sub] = value
        self.changes += 1

    @staticmethod
    def _check_limits(entry: Entry, value: Value) -> None:
        code = None
        if isinstance(value, (str, bytes)):
            if entry.maximum is not None and len(value) > entry.maximum:
                code = AbortCode.TOO_LONG
        elif math.isnan(value) and (entry.minimum is not None or entry.maximum is not None):
            # Comparisons with NaN are false, so it would pass any limits.
            code = AbortCode.INVALID_VALUE
        elif entry.maximum is not None and value > entry.maximum:
            code = AbortCode.TOO_HIGH
        elif entry.minimum is not None and value < entry.minimum:
            code = AbortCode.TOO_LOW
        if code is not None:
            raise SdoAbort(code, entry.index, entry.sub)

    # The interface of the device's own code.

    def get(self, index: int, sub: int = 0) -> Value:
        """Return the present value, without regard to access rights."""
        entry = self.entry(index, sub)
        if entry.on_read is None:
            return self._values[index, sub]
        try:
            return entry.on_read()
        except Exception as error:
            self._raise_refusal(entry, error)

    def _raise_refusal(self, entry: Entry, error: Exception) -> NoReturn:
        """Raise what a hook raised. An error that is not a refusal is reported, and raised as one."""
        if isinstance(error, BarewireError) or self.on_failure is None:
            raise error
        self._refuse(entry, error, self.on_failure)

    @staticmethod
    def _refuse(entry: Entry, error: Exception, on_failure: Callable[[str, Exception], None]) -> NoReturn:
        on_failure(f"{entry.index:04X}h:{entry.sub:02X}", error)
        raise SdoAbort(AbortCode.GENERAL, entry.index, entry.sub) from error

    def set(self, index: int, sub: int, value: Value) -> None:
        """Store a value without regard to access rights and limits; no `on_write` is called.

        Raise EncodeError if it does not fit the type.
        """
        self.entry(index, sub).codec.encode(value)
        self._values[index, sub] = value
        self.changes += 1

    def __getitem__(self, ref: ObjectRef) -> Value:
        """Return the present value of an entry, by name or address."""
        entry = self.at(ref)
        return self.get(entry.index, entry.sub)

    def __setitem__(self, ref: ObjectRef, value: Value) -> None:
        """Store a value, by name or address."""
        entry = self.at(ref)
        self.set(entry.index, entry.sub, value)

    def hook(
        self,
        ref: ObjectRef,
        *,
        on_read: Callable[[], Value] | None = None,
        on_write: Callable[[Value], None] | None = None,
    ) -> None:
        """Attach functions to an existing entry, for example to one from an EDS.

        An `on_write` that the entry already has is called before the new one. Raise EncodeError for a function that
        `Entry` refuses.
        """
        entry = self.at(ref)
        entry._check_hooks(on_read, on_write)
        own_hook = entry.on_write

        def both(value: Value) -> None:
            for function in (own_hook, on_write):
                if function is not None:
                    function(value)

        self._entries[entry.index, entry.sub] = replace(entry, on_read=on_read or entry.on_read, on_write=both)
        self.changes += 1
        if on_read is not None:
            self.computed.add(entry.index)

    def default(self, index: int, sub: int = 0) -> Value:
        """Return the value after a reset."""
        return self._default(self.entry(index, sub))

    def restore(self, first: int = 0x1000, last: int = 0xFFFF) -> None:
        """Reset the objects of the indices `first` to `last` to their defaults; no `on_write` is called."""
        for address, entry in self._entries.items():
            if first <= address[0] <= last:
                self._values[address] = self._default(entry)
        self.changes += 1

    @staticmethod
    def _default(entry: Entry) -> Value:
        # 0 stands for "not given", which is an empty value for a string or domain.
        if entry.default == 0 and entry.codec.size is None:
            return "" if entry.type in ("string", "unicode") else b""
        return entry.default


_ACCESSES = get_args(ObjectAccess)


def _fold(name: str) -> str:
    return " ".join(name.casefold().split())
