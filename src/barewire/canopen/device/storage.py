"""Store parameters, restore defaults: what a device comes back with after a reset.   [CiA 301, 1010h and 1011h]

        1010h:s  write 65766173h ("save": 73 61 76 65)     the present values are those of every reset from now on
        1011h:s  write 64616F6Ch ("load": 6C 6F 61 64)     the factory's are those of the next reset and all after it

        s   1  everything      2  communication, 1000h to 1FFFh      3  application, 6000h to 9FFFh
            4  and above       the manufacturer's, 2000h to 5FFFh

Anything else written there is refused with 0800 0020h, so that nobody stores by accident. Read, both say 1: "on
command". Objects that a device guards itself (with an `on_write` of its own) are left to it. The COB-ID of an SDO
channel that was given only for a while (bit 30 of 1200h to 12FFh) is not stored.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from barewire.canopen.cob_ids import CobEntry
from barewire.canopen.communication_objects import validate_writes
from barewire.canopen.object_dictionary import ObjectAddress, ObjectDictionary
from barewire.canopen.sdo.aborts import AbortCode, SdoAbort
from barewire.codecs import Value

STORE, RESTORE = 0x1010, 0x1011
SDO_CHANNELS = range(0x1200, 0x1300)
SAVE, LOAD = 0x6576_6173, 0x6461_6F6C
ON_COMMAND = 1
_AREAS = {1: (0x1000, 0x9FFF), 2: (0x1000, 0x1FFF), 3: (0x6000, 0x9FFF)}
_MANUFACTURER = (0x2000, 0x5FFF)


class StoredParameters:
    """What was stored of one dictionary. `values` may be kept in a file, and given back to another device.

    >>> from barewire.canopen.object_dictionary import Entry
    >>> objects = ObjectDictionary([Entry(0x2000, 0, "speed", "u16"), Entry(0x1010, 1, "store", "u32")])
    >>> stored = StoredParameters(objects)
    >>> objects.set(0x2000, 0, 7)
    >>> objects.write(0x1010, 1, b"save")
    >>> objects.set(0x2000, 0, 8)
    >>> stored.restore(0x2000, 0x9FFF)
    >>> objects.get(0x2000)
    7
    """

    __slots__ = ("objects", "values")

    def __init__(self, objects: ObjectDictionary) -> None:
        self.objects = objects
        self.values: dict[ObjectAddress, Value] = {}
        for index, signature, act in ((STORE, SAVE, self._save), (RESTORE, LOAD, self._load)):
            for sub in objects.subs(index):
                entry = objects.entry(index, sub)
                if sub and entry.type == "u32" and entry.on_write is None and entry.on_read is None:
                    objects.replace(replace(entry, on_read=lambda: ON_COMMAND))
                    validate_writes(objects, index, sub, partial(self._command, index, sub, signature, act))

    @staticmethod
    def _command(index: int, sub: int, signature: int, act: Callable[[int, int], None], word: int) -> None:
        if word != signature:
            raise SdoAbort(AbortCode.NOT_STORED, index, sub)
        act(*_AREAS.get(sub, _MANUFACTURER))

    def _save(self, first: int, last: int) -> None:
        for entry in self.objects:
            own = entry.on_read is not None or entry.index in (STORE, RESTORE)
            if first <= entry.index <= last and entry.access == "rw" and not own:
                place = entry.index, entry.sub
                value = self.objects.get(*place)
                if entry.index in SDO_CHANNELS and entry.type == "u32" and CobEntry.unpack(int(value)).bit30:
                    continue
                if value == self.objects.default(*place):
                    self.values.pop(place, None)
                else:
                    self.values[place] = value

    def _load(self, first: int, last: int) -> None:
        self.values = {place: value for place, value in self.values.items() if not first <= place[0] <= last}

    def restore(self, first: int, last: int) -> None:
        """A reset of these indices: the defaults, and over them what was stored."""
        self.objects.restore(first, last)
        self.put_back(first, last)

    def put_back(self, first: int = 0x1000, last: int = 0x9FFF) -> None:
        """What was stored of these indices, over what is there."""
        for (index, sub), value in self.values.items():
            if first <= index <= last:
                self.objects.set(index, sub, value)
