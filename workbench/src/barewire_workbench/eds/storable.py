"""Which objects of an EDS or DCF are settings.

Storable is what 1010h of a device keeps: objects that can be read and written.   [CiA 301 7.5.2.13, CiA 306]

    left out                                   because
    1003h, 1010h, 1011h, 1F51h ...             writing them is a command         (as for a configuration by a DCF)
    ObjFlags bit 0, bit 1                      the file refuses writing, reading
    rww, and what an RPDO maps by default      process data: another node writes them while the machine works
    6040h, 6060h, targets of CiA 402;
      outputs of CiA 401                       the same, by the profile in 1000h
    domains                                    programs and files
    14xxh:04, 18xxh:04                         reserved

An object whose default contains $NODEID, such as a COB-ID, says how the device is reached.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import chain

from barewire.canopen.configuration.settings import COMMAND_OBJECTS
from barewire.canopen.eds import Eds, Formula
from barewire.canopen.eds.objects import REFUSES_READ, REFUSES_WRITE, every_item

Place = tuple[int, int]

_PROCESS: Mapping[int, tuple[range, ...]] = {
    401: (range(0x6200, 0x6350), range(0x6400, 0x6422)),
    402: (range(0x6040, 0x6041), range(0x6060, 0x6061), range(0x6071, 0x6072), range(0x607A, 0x607B),
          range(0x60B0, 0x60B3), range(0x60C1, 0x60C2), range(0x60FE, 0x6100)),
}  # fmt: skip
"""Objects that another node writes while the machine works, by the profile (low word of 1000h)."""
_RPDO_MAPPINGS = range(0x1600, 0x1800)
_PDO_PARAMETERS = (*range(0x1400, 0x1600), *range(0x1800, 0x1A00))
_RESERVED = 4


def storable(eds: Eds, node: int) -> set[Place]:
    """Return the objects of a file that are settings.

    >>> from barewire import load
    >>> from barewire_workbench.eds.export import export
    >>> places = storable(export(load("az3")), 1)
    >>> len(places), (0x6083, 0) in places, (0x6040, 0) in places
    (260, True, False)
    """
    objects = eds.dictionary(node)
    process = {
        (entry.default >> 16, entry.default >> 8 & 0xFF)
        for entry in objects
        if entry.index in _RPDO_MAPPINGS and entry.sub and isinstance(entry.default, int)
    }
    profile = int(objects.get(0x1000)) & 0xFFFF if (0x1000, 0) in objects else 0
    left_out = {*COMMAND_OBJECTS, *chain(*_PROCESS.get(profile, ()))}
    return {
        (described.index, item.sub)
        for described, item in every_item(eds.objects.values())
        if item.access in ("rw", "rwr")
        and item.type != "domain"
        and not item.flags & (REFUSES_WRITE | REFUSES_READ)
        and described.index not in left_out
        and (described.index, item.sub) not in process
        and not (described.index in _PDO_PARAMETERS and item.sub == _RESERVED)
    }


def formulas(eds: Eds) -> dict[Place, Formula]:
    """Return the objects whose default contains the node-ID, with it."""
    items = every_item(eds.objects.values())
    return {(described.index, item.sub): item.default for described, item in items if isinstance(item.default, Formula)}
