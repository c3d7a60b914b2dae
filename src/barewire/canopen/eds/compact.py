"""Compact storage: sub-indices and PDO records that an EDS implies without a section for each.   [CiA 306]

        [1003]                          1003h:00   NrOfObjects        UNSIGNED8, 8
        ParameterName=Error             1003h:01   first              as the object says, with its name and a number,
        ObjectType=8                    1003h:02   Error2             or the name that is told
        DataType=7                      ...
        CompactSubObj=8                 1003h:08   Error8
        [1003Name] NrOfEntries=1  1=first          [1003Value] ParameterValue  [1003Denotation] Denotation

        [DeviceInfo]
        CompactPDO=0x13    bit k: communication records have sub-index k+1; here 1, 2 and 5
        NrOfRXPDO=4        that many RPDOs: those that have no section are made, with 64 entries of mapping

A sub-index that has a section of its own is read from there.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

from barewire.canopen.eds.model import RECORD, VAR, EdsItem, EdsObject
from barewire.canopen.eds.section_names import entry_number
from barewire.canopen.eds.value_syntax import Expression, Formula

if TYPE_CHECKING:
    from barewire.canopen.eds.document import Section
    from barewire.canopen.eds.reader import Reader

PDOS = 512
_NOT_USED = 0x8000_0000
_KINDS = (("RPDO", "nrofrxpdo", 0x1400, 0x200), ("TPDO", "nroftxpdo", 0x1800, 0x180))
_COMMUNICATION = (
    ("COB-ID", "u32", 0x07),
    ("Transmission type", "u8", 0x05),
    ("Inhibit time", "u16", 0x06),
    ("Compatibility entry", "u8", 0x05),
    ("Event timer", "u16", 0x06),
    ("SYNC start value", "u8", 0x05),
)


def compact_items(reader: Reader, section: Section, highest: int) -> Iterator[EdsItem]:
    """The sub-indices that CompactSubObj makes: all alike but for name, value and denotation."""
    like = reader.item(1, section)
    names = _told(reader, section, "name", highest)
    values = _told(reader, section, "value", highest)
    denotations = _told(reader, section, "denotation", highest)
    yield EdsItem(0, "NrOfObjects", "u8", "ro", highest, code=0x05)
    for sub in range(1, highest + 1):
        key = str(sub)
        value: Expression | None = like.value
        if key in values and (found := reader.document.sections.get(f"{section.name.key}value")):
            value = reader.value(found, key, like.type)
        name = names.get(key) or f"{like.name}{sub}"
        yield replace(like, object_type=VAR, sub=sub, name=name, value=value, denotation=denotations.get(key, ""))


def _told(reader: Reader, section: Section, part: str, highest: int) -> dict[str, str]:
    """What [hhhhName], [hhhhValue] or [hhhhDenotation] tells, by sub-index."""
    found = reader.document.sections.get(f"{section.name.key}{part}")
    if found is None:
        return {}
    reader.number(found, "nrofentries")
    told = {}
    for key in found.keys:
        sub = entry_number(key)
        if sub is not None and not 1 <= sub <= highest:
            reader.say(found, key, "compact-entry")
        elif sub is not None:
            told[key] = reader.text(found, key)
    return told


def implied_pdos(reader: Reader, objects: dict[int, EdsObject]) -> Iterator[EdsObject]:
    """The records of PDOs that CompactPDO implies: of each PDO up to the number told, what has no section."""
    info = reader.document.sections.get("deviceinfo")
    mask = reader.number(info, "compactpdo") & 0x3F
    for name, key, first, cob_id in _KINDS:
        wanted = min(max(reader.number(info, key), 0), PDOS)
        if not mask:
            continue
        told = [number for number in range(PDOS) if first + number in objects or first + 0x200 + number in objects]
        free = [number for number in range(PDOS) if number not in told][: max(wanted - len(told), 0)]
        for number in sorted([*told, *free]):
            if first + number not in objects:
                default = Formula(cob_id + 0x100 * number) if number < 4 else _NOT_USED
                yield communication(first + number, name, mask, default)
            if first + 0x200 + number not in objects:
                yield mapping(first + 0x200 + number, name)


def communication(index: int, name: str, mask: int, cob_id: Expression) -> EdsObject:
    """The communication record with the sub-indices whose bit is set in the mask."""
    items = [EdsItem(0, "Highest sub-index supported", "u8", "const", mask.bit_length(), code=0x05)]
    for bit, (what, type, code) in enumerate(_COMMUNICATION):
        if mask >> bit & 1:
            items.append(EdsItem(bit + 1, what, type, "rw", cob_id if bit == 0 else None, code=code))
    return EdsObject(index, f"{name} communication parameter", RECORD, tuple(items))


def mapping(index: int, name: str, entries: int = 64) -> EdsObject:
    """The mapping record with room for `entries`."""
    items = [EdsItem(0, "Number of mapped objects", "u8", "rw", 0, code=0x05)]
    items += [EdsItem(sub, f"Application object {sub}", "u32", "rw", 0, code=0x07) for sub in range(1, entries + 1)]
    return EdsObject(index, f"{name} mapping parameter", RECORD, tuple(items))
