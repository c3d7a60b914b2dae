"""Store parameters 1010h, restore defaults 1011h: the values of a device after a reset.   [CiA 301]

        1010h:s  write 65766173h ("save": 73 61 76 65)     store the present values for all later resets
        1011h:s  write 64616F6Ch ("load": 6C 6F 61 64)     the next reset restores the defaults

        s   1  all             2  communication, 1000h to 1FFFh      3  application, 6000h to 9FFFh
            4  and above       manufacturer-specific, 2000h to 5FFFh

Any other value is refused with 0800 0020h, so that nothing is stored by accident. Both objects read as 1, which means
"stores on command". A 1010h or 1011h with an `on_read` or `on_write` of its own is left to the application. The COB-ID
of a temporary SDO channel (bit 30 in 1200h to 12FFh) is not stored.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from barewire.canopen.abort_codes import AbortCode, SdoAbort
from barewire.canopen.cob_ids import CobEntry
from barewire.canopen.communication_objects import validate_writes
from barewire.canopen.object_dictionary import ObjectAddress, ObjectDictionary
from barewire.codecs import Value

_STORE, _RESTORE = 0x1010, 0x1011
_SDO_CHANNELS = range(0x1200, 0x1300)
_SAVE, _LOAD = (int.from_bytes(word, "little") for word in (b"save", b"load"))
_ON_COMMAND = 1
_AREAS = {1: (0x1000, 0xFFFF), 2: (0x1000, 0x1FFF), 3: (0x6000, 0x9FFF)}
_MANUFACTURER = (0x2000, 0x5FFF)


class StoredParameters:
    """The stored values of one dictionary. `values` may be saved to a file and given to another device.

    >>> from barewire.canopen.object_dictionary import Entry
    >>> objects = ObjectDictionary([Entry(0x2000, 0, "speed", "u16"), Entry(0x1010, 1, "store", "u32")])
    >>> stored = StoredParameters(objects)
    >>> objects.set(0x2000, 0, 7)
    >>> objects.write(0x1010, 1, b"save")
    >>> objects.set(0x2000, 0, 8)
    >>> stored.restore(0x2000, 0xFFFF)
    >>> objects.get(0x2000)
    7
    """

    __slots__ = ("objects", "values")

    def __init__(self, objects: ObjectDictionary) -> None:
        self.objects = objects
        self.values: dict[ObjectAddress, Value] = {}
        for index, signature, command in ((_STORE, _SAVE, self._save), (_RESTORE, _LOAD, self._load)):
            for sub in objects.subs(index):
                entry = objects.entry(index, sub)
                if sub and entry.type == "u32" and entry.on_write is None and entry.on_read is None:
                    objects.replace(replace(entry, on_read=lambda: _ON_COMMAND))
                    validate_writes(objects, index, sub, partial(self._carry_out, index, sub, signature, command))

    @staticmethod
    def _carry_out(index: int, sub: int, signature: int, command: Callable[[int, int], None], word: int) -> None:
        if word != signature:
            raise SdoAbort(AbortCode.NOT_STORED, index, sub)
        command(*_AREAS.get(sub, _MANUFACTURER))

    def _save(self, first: int, last: int) -> None:
        for entry in self.objects:
            if not first <= entry.index <= last or entry.access != "rw":
                continue
            if entry.on_read is not None or entry.index in (_STORE, _RESTORE):
                continue  # the application computes it, or it is a command: there is no value to store
            address = entry.index, entry.sub
            value = self.objects.get(*address)
            # A channel that a master assigned for a time (bit 30) ends with the reset.   [CiA 301, 1200h]
            if entry.index in _SDO_CHANNELS and entry.type == "u32" and CobEntry.unpack(int(value)).bit30:
                continue
            # A default is not stored: after the reset it is there anyway, and a default COB-ID follows a new node-ID.
            if value == self.objects.default(*address):
                self.values.pop(address, None)
            else:
                self.values[address] = value

    def _load(self, first: int, last: int) -> None:
        # The objects keep their present values until the reset.   [CiA 301, 1011h]
        self.values = {address: value for address, value in self.values.items() if not first <= address[0] <= last}

    def restore(self, first: int, last: int) -> None:
        """Reset the objects of these indices to their stored values, or to their defaults."""
        self.objects.restore(first, last)
        self.apply(first, last)

    def apply(self, first: int = 0x1000, last: int = 0xFFFF) -> None:
        """Set the objects of these indices to their stored values."""
        for (index, sub), value in self.values.items():
            if first <= index <= last:
                self.objects.set(index, sub, value)
