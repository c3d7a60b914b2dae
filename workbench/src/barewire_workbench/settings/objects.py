"""The settings of a CANopen device that has an EDS or DCF instead of a description.

Storable is what 1010h of a device keeps: objects that can be read and written.   [CiA 301 7.5.2.13, CiA 306]

    left out                                   because
    1003h, 1010h, 1011h, 1F51h ...             writing them is a command         (as for a configuration by a DCF)
    ObjFlags bit 0, bit 1                      the file refuses writing, reading
    rww, and what an RPDO maps by default      process data: another node writes them while the machine works
    6040h, 6060h, targets of CiA 402;
      outputs of CiA 401                       the same, by the profile in 1000h
    domains                                    programs and files

An object whose default contains $NODEID, such as the COB-IDs, is one that says how the device is reached.

A name is that of the file behind the address: "1017h:00 Producer heartbeat time".
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from barewire.canopen.configuration.settings import COMMAND_OBJECTS, device_configuration, object_text
from barewire.canopen.eds import Eds, Formula, to_dcf
from barewire.canopen.eds.objects import every_item
from barewire.canopen.eds.value_syntax import Expression
from barewire.canopen.object_dictionary import Entry
from barewire.codecs import Value
from barewire.errors import EncodeError, shown
from barewire_workbench.settings.saved import SavedSettings, SavedValue

_PROCESS: Mapping[int, tuple[range, ...]] = {
    401: (range(0x6200, 0x6350), range(0x6400, 0x6422)),
    402: (range(0x6040, 0x6041), range(0x6060, 0x6061), range(0x6071, 0x6072), range(0x607A, 0x607B),
          range(0x60B0, 0x60B3), range(0x60C1, 0x60C2), range(0x60FE, 0x6100)),
}  # fmt: skip
"""Objects that another node writes while the machine works, by the profile (low word of 1000h)."""
_RPDO_MAPPINGS = range(0x1600, 0x1800)
_PDO_RECORDS = (*range(0x1400, 0x1600), *range(0x1800, 0x1A00))
_RESERVED = 4
_MAPPINGS = (*_RPDO_MAPPINGS, *range(0x1A00, 0x1C00))
_PLACE = re.compile(r"([0-9A-F]{4})h:([0-9A-F]{2}) ")


def storable(eds: Eds, node: int) -> list[Entry]:
    """Return the objects of a file that are settings, in the order of their addresses.

    >>> from barewire import load
    >>> from barewire_workbench.eds.export import export
    >>> entries = storable(export(load("az3")), 1)
    >>> [object_text(entry) for entry in entries[:1]], any(entry.index == 0x6040 for entry in entries)
    (['1016h:01 CONSUMER HEART BEAT.CONSUMER HEART BEAT 1'], False)
    """
    objects = eds.dictionary(node)
    process = set()
    for entry in objects:
        if entry.index in _RPDO_MAPPINGS and entry.sub and isinstance(entry.default, int):
            process.add((entry.default >> 16, entry.default >> 8 & 0xFF))
    profile = int(objects.get(0x1000)) & 0xFFFF if (0x1000, 0) in objects else 0
    ranges = _PROCESS.get(profile, ())
    return [
        objects.entry(described.index, item.sub)
        for described, item in every_item(sorted(eds.objects.values(), key=lambda described: described.index))
        if item.access in ("rw", "rwr")
        and item.type != "domain"
        and not item.flags & 3
        and described.index not in COMMAND_OBJECTS
        and not (described.index in _PDO_RECORDS and item.sub == _RESERVED)
        and (described.index, item.sub) not in process
        and not any(described.index in range_ for range_ in ranges)
    ]


def is_beyond_mapping(entry: Entry, counts: Mapping[int, Value]) -> bool:
    """Return whether an entry of a PDO mapping is behind the number of mapped objects, so that it says nothing.
    `counts` has that number by the index of the mapping."""
    count = counts.get(entry.index)
    return entry.index in _MAPPINGS and entry.sub > 0 and isinstance(count, int) and entry.sub > count


def in_commissioning(eds: Eds) -> set[tuple[int, int]]:
    """Return the (index, sub-index) of objects whose default contains the node-ID."""
    return set(_formulas(eds))


def _formulas(eds: Eds) -> dict[tuple[int, int], Formula]:
    items = every_item(eds.objects.values())
    return {(described.index, item.sub): item.default for described, item in items if isinstance(item.default, Formula)}


def saved_dcf(dcf: Eds, name: str) -> SavedSettings:
    """Return the settings that a DCF has. Raises EncodeError if it has none, or no node-ID."""
    configuration = device_configuration(dcf)
    saved = SavedSettings(name, name, _title(dcf))
    at_node = in_commissioning(dcf)
    for setting in configuration.settings:
        values = saved.communication if setting.place in at_node else saved.settings
        values[object_text(setting.entry)] = saved_value(setting.value)
    return saved


def saved_value(value: Value) -> SavedValue:
    """Return a value as it is in a file: bytes are text in hexadecimal."""
    return SavedValue(value.hex(" ").upper() if isinstance(value, bytes) else value)


def dcf_of(saved: SavedSettings, eds: Eds, node: int, *, communication: bool = True) -> Eds:
    """Return the DCF of one node with these settings: its EDS with a ParameterValue for each.

    A COB-ID that is the default for this node remains a formula, so that the DCF suits another node too. Raises
    EncodeError for a setting that the EDS does not have.
    """
    values: dict[tuple[int, int] | str, Expression] = {}
    objects = eds.dictionary(node)
    formulas = _formulas(eds)
    wanted = saved.settings | (saved.communication if communication else {})
    for name, setting in wanted.items():
        match = _PLACE.match(name)
        if match is None:
            raise EncodeError(f"{shown(name)}: expected an address such as 1017h:00 before the name")
        entry = objects.at((int(match[1], 16), int(match[2], 16)))
        value = setting.value
        if isinstance(value, str) and entry.type not in ("string", "unicode"):
            value = bytes.fromhex(value)
        formula = formulas.get((entry.index, entry.sub))
        values[entry.index, entry.sub] = formula if formula is not None and formula.at(node) == value else value
    return to_dcf(eds, node, values, name=saved.title)


def _title(eds: Eds) -> str:
    texts = (eds.get("DeviceInfo", key) or "" for key in ("VendorName", "ProductName"))
    return " ".join(text for text in texts if text)
