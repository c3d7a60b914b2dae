"""What a DCF says about one device: the values to write, the values that identify the device, the date.

    [1017] ParameterValue=500                    a setting: 1017h:00 Producer heartbeat time = 500
    [1018sub1] DefaultValue=0x360                identity: the device must have this vendor-ID
    [FileInfo] ModificationDate=06-28-2026       the date that 1020h of the device gets

Only a ParameterValue is a setting: an object without one may have any value. The number of mapped objects is one too if
an entry of the mapping is, because entries change only while the number is 0. Left out are objects that are read-only,
objects whose write is a command (`COMMAND_OBJECTS`), mapping entries beyond the number of mapped objects, and those
that the file excludes by ObjFlags.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import NamedTuple

from barewire.canopen.cob_ids import check_node
from barewire.canopen.datatypes import DAY, TimeOfDay
from barewire.canopen.eds.eds_file import Eds
from barewire.canopen.eds.objects import REFUSES_READ, REFUSES_WRITE, EdsItem, every_item
from barewire.canopen.object_dictionary import Entry, ObjectAddress, ObjectDictionary
from barewire.canopen.pdo.config import PDOS_MAX, PdoConfig, PdoDirection
from barewire.canopen.pdo.mapping import BITS_MAX, ENTRIES_MAX
from barewire.canopen.pdo.multiplexed import MPDO_COUNTS
from barewire.codecs import Value
from barewire.errors import EncodeError, shown

DEVICE_TYPE, IDENTITY, DATE = 0x1000, 0x1018, 0x1020
COMMAND_OBJECTS = {0x1003, 0x1010, 0x1011, 0x1023, 0x1024, 0x1025, 0x1026, 0x1F50, 0x1F51}
"""Objects whose write is a command or deletes something: error history, store, restore, OS commands, programs."""

_PDO_TYPES = {1: "u32", 2: "u8", 3: "u16", 5: "u16", 6: "u8"}
_VARIABLE_TYPES = dict.fromkeys((DEVICE_TYPE, 0x1005, 0x1006, 0x1012, 0x1014), "u32") | {0x1019: "u8"}
_RECORD_TYPES = dict.fromkeys((0x1016, IDENTITY, DATE), "u32")
_SDO_TYPES = {1: "u32", 2: "u32", 3: "u8"}
_PDO_RECORDS: tuple[tuple[int, PdoDirection], ...] = (
    (0x1400, "RPDO"),
    (0x1600, "RPDO"),
    (0x1800, "TPDO"),
    (0x1A00, "TPDO"),
)
_RESERVED = 4  # sub-index of a communication record
_DAY_TEXT = re.compile(r"(\d\d?)-(\d\d?)-(\d{4})")
_CLOCK_TEXT = re.compile(r"(\d\d?):(\d\d)\s*([AP]M)?", re.IGNORECASE)


class Setting(NamedTuple):
    """An object of a device, and the value that it is to have."""

    entry: Entry
    value: Value

    @property
    def place(self) -> tuple[int, int]:
        """(index, sub-index)."""
        return self.entry.index, self.entry.sub

    @property
    def data(self) -> bytes:
        """The bytes of the value in an SDO, little-endian."""
        return self.entry.codec.encode(self.value)

    def __repr__(self) -> str:
        return f"<Setting {object_text(self.entry)} = {value_text(self.entry, self.value)}>"


class Difference(NamedTuple):
    """An object whose value is not the configured one.

    present     its value in the device; bytes if it is not of the type; None if it cannot be read
    wanted      the configured value
    reason      why there is no present value: the object is write-only, or does not exist
    """

    entry: Entry
    present: Value | None
    wanted: Value
    reason: str = ""

    @property
    def data(self) -> bytes:
        """The bytes of the configured value in an SDO, little-endian."""
        return self.entry.codec.encode(self.wanted)

    def __str__(self) -> str:
        present = self.reason if self.present is None else value_text(self.entry, self.present)
        return f"{object_text(self.entry)}: device {present}, configuration {value_text(self.entry, self.wanted)}"

    def __repr__(self) -> str:
        return f"<Difference {self}>"


@dataclass(frozen=True, slots=True)
class DeviceConfiguration:
    """The configuration of one device, from a DCF by `device_configuration`.

    node        the node-ID for which the formulas were computed
    settings    the values to write, in the order of the objects
    identity    values of 1000h and 1018h that the device must have
    date        1020h:01 and :02, configuration date and time; empty if the DCF has no date or no such object
    left_out    a sentence for each value of the file that is not written

    Raises EncodeError for a value that does not fit its type, for a mapping of more than 64 bits, and for an object
    that a configuration interprets (1005h, 1016h, PDO records ...) if it is not of the type that CiA 301 gives it.
    """

    node: int
    settings: tuple[Setting, ...]
    identity: tuple[Setting, ...] = ()
    date: tuple[Setting, ...] = ()
    left_out: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for setting in (*self.settings, *self.identity, *self.date):
            _check(setting)
        _check_mappings({setting.place: setting for setting in self.settings})

    def __repr__(self) -> str:
        return f"<DeviceConfiguration of node {self.node}: {len(self.settings)} settings>"


_UNREADABLE = ("bad-number", "bad-formula", "out-of-range")
"""The rules of an EDS by which a value is ignored."""


def device_configuration(dcf: Eds, node: int | None = None) -> DeviceConfiguration:
    """Return the configuration that a DCF describes, for its node-ID or another one.

    >>> from barewire.canopen import eds
    >>> lines = "[1017]", "ParameterName=Heartbeat", "DataType=6", "AccessType=rw", "ParameterValue=500"
    >>> device_configuration(eds.parse("\\n".join(lines).encode()), 5).settings
    (<Setting 1017h:00 Heartbeat = 500>,)

    Raise EncodeError if the file has no ParameterValue, which is an EDS, or one that cannot be read, or no node-ID and
    none is given, and for values that a `DeviceConfiguration` cannot have.
    """
    items = {(described.index, item.sub): item for described, item in every_item(dcf.objects.values())}
    check_readable(dcf)
    if not any(item.value is not None for item in items.values()):
        raise EncodeError("the file has no ParameterValue: expected a DCF, such as eds.to_dcf makes of an EDS", "dcf")
    number = dcf.node_id if node is None else node
    if number is None:
        finding = next((f" ({finding})" for finding in dcf.diagnostics if "NodeID" in finding.text), "")
        raise EncodeError(f"the DCF has no node-ID: expected NodeID in [DeviceComissioning], or a node{finding}", "dcf")
    check_node(number)
    objects = dcf.dictionary(number)
    left_out: list[str] = []
    settings = tuple(_settings(objects, items, left_out))
    identity = tuple(_identity(dcf, objects, items))
    return DeviceConfiguration(number, settings, identity, _date(dcf, objects, items), tuple(left_out))


def check_readable(dcf: Eds) -> None:
    """Raise EncodeError if a ParameterValue cannot be read."""
    unreadable = [
        str(finding) for finding in dcf.diagnostics if "ParameterValue" in finding.text and finding.rule in _UNREADABLE
    ]
    if unreadable:
        more = f"; and {len(unreadable) - 1} more" if len(unreadable) > 1 else ""
        raise EncodeError(f"line {unreadable[0]}{more}", "dcf")


def _settings(
    objects: ObjectDictionary, items: dict[tuple[int, int], EdsItem], left_out: list[str]
) -> Iterator[Setting]:
    counted: set[int] = set()  # mappings whose number is a setting because an entry is one
    for place, item in sorted(items.items()):
        entry = objects.entry(*place)
        if item.value is None or entry.access in ("ro", "const") or entry.index in (DEVICE_TYPE, IDENTITY, DATE):
            continue
        pdo = pdo_of(entry.index)
        reason = _why_left_out(entry, item, pdo)
        if reason:
            left_out.append(f"{object_text(entry)}: {reason}")
            continue
        if pdo is not None and entry.index == pdo.communication and entry.sub == _RESERVED:
            continue
        if pdo is not None and entry.index == pdo.map and entry.sub:
            count = objects.get(pdo.map, 0) if (pdo.map, 0) in objects else 0
            if not isinstance(count, int) or not entry.sub <= count <= ENTRIES_MAX:
                continue
            if pdo.map not in counted and _is_default(objects.entry(pdo.map, 0), items.get((pdo.map, 0))):
                counted.add(pdo.map)
                yield Setting(objects.entry(pdo.map, 0), count)
        yield Setting(entry, objects.get(*place))


def _is_default(entry: Entry, item: EdsItem | None) -> bool:
    """Return whether a writable object has its default."""
    return item is not None and item.value is None and entry.access not in ("ro", "const")


def _why_left_out(entry: Entry, item: EdsItem, pdo: PdoConfig | None) -> str:
    if entry.index in COMMAND_OBJECTS:
        return "writing it is a command"
    if item.flags & (REFUSES_WRITE | REFUSES_READ):
        return f"ObjFlags={item.flags} excludes it"
    if pdo is not None and entry.index == pdo.communication and entry.sub not in (*_PDO_TYPES, _RESERVED):
        return "a PDO has no such parameter"
    return ""


def _type_of(entry: Entry) -> str | None:
    """Return the type that an object has by CiA 301, if a configuration interprets its value; otherwise None."""
    pdo = pdo_of(entry.index)
    if pdo is not None:
        return _PDO_TYPES.get(entry.sub) if entry.index == pdo.communication else "u32" if entry.sub else "u8"
    if 0x1200 <= entry.index < 0x1300:
        return _SDO_TYPES.get(entry.sub)
    return (_RECORD_TYPES if entry.sub else _VARIABLE_TYPES).get(entry.index)


def _check(setting: Setting) -> None:
    """Raise EncodeError for a value that does not fit its type, or the type that its object has by CiA 301."""
    entry, value, expected = setting.entry, setting.value, _type_of(setting.entry)
    if expected is not None:
        kind, bits = entry.type[0], int(expected[1:])
        if kind not in "ui" or entry.type[1:] != expected[1:]:
            raise EncodeError(f"{object_text(entry)} is {entry.type}: expected {expected}; its value is {shown(value)}")
        if not isinstance(value, int) or not 0 <= value < 1 << bits:
            raise EncodeError(f"{object_text(entry)} = {shown(value)}: expected 0..{(1 << bits) - 1:X}h")
    try:
        entry.codec.encode(value)
    except EncodeError as error:
        raise EncodeError(f"{object_text(entry)}: {error}") from None


def _check_mappings(settings: Mapping[ObjectAddress, Setting]) -> None:
    """Raise EncodeError for a number of mapped objects that does not exist, and for more than 64 bits."""
    for (index, sub), setting in settings.items():
        pdo, count = pdo_of(index), setting.value
        if pdo is None or index != pdo.map or sub or not isinstance(count, int) or count in MPDO_COUNTS:
            continue
        if count > ENTRIES_MAX:
            raise EncodeError(f"{object_text(setting.entry)} = {count}: expected 0..{ENTRIES_MAX}, FEh or FFh")
        check_bits(pdo, [int(settings[index, sub].value) for sub in range(1, count + 1) if (index, sub) in settings])


def check_bits(pdo: PdoConfig, words: Iterable[int]) -> None:
    """Raise EncodeError if the objects of these mapping entries have more than 64 bits together."""
    bits = sum(word & 0xFF for word in words)
    if bits > BITS_MAX:
        raise EncodeError(f"{pdo.direction}{pdo.number}: {pdo.map:04X}h maps {bits} bits: expected at most {BITS_MAX}")


def pdo_of(index: int) -> PdoConfig | None:
    """Return a PDO without mapping, to which a record belongs; None for an index that is not that of a PDO record.

    >>> pdo_of(0x1A01)
    PdoConfig('TPDO', 2, (), type=255)
    """
    for first, direction in _PDO_RECORDS:
        if first <= index < first + PDOS_MAX:
            return PdoConfig(direction, index - first + 1, ())
    return None


def _identity(dcf: Eds, objects: ObjectDictionary, items: dict[tuple[int, int], EdsItem]) -> Iterator[Setting]:
    """Yield what the device must be."""
    # A default of 0 says nothing. A default revision or serial number is that of the device from which the EDS was
    # made: only a ParameterValue is that of this device.
    for place in ((DEVICE_TYPE, 0), *((IDENTITY, sub) for sub in range(1, 5))):
        item = items.get(place)
        if item is None or (item.value is None and place[1] > 2):
            continue
        value = objects.get(*place)
        if value:
            yield Setting(objects.entry(*place), value)
    serial = dcf.get("DeviceComissioning", "LSS_SerialNumber") or ""
    if (IDENTITY, 4) in items and items[IDENTITY, 4].value is None:
        try:
            number = int(serial, 0)
        except ValueError:
            return
        if number:
            yield Setting(objects.entry(IDENTITY, 4), number)


def _date(dcf: Eds, objects: ObjectDictionary, items: dict[tuple[int, int], EdsItem]) -> tuple[Setting, ...]:
    """Return the values of 1020h: its own ParameterValue, or when the file was modified, or when it was made."""
    if (DATE, 1) not in items or (DATE, 2) not in items:
        return ()
    stated = [items[DATE, sub].value is not None for sub in (1, 2)]
    if all(stated):
        return tuple(Setting(objects.entry(DATE, sub), objects.get(DATE, sub)) for sub in (1, 2))
    for word in ("Modification", "Creation"):
        moment = _moment(dcf.get("FileInfo", f"{word}Date") or "", dcf.get("FileInfo", f"{word}Time") or "")
        if moment is not None:
            days, milliseconds = divmod(int(TimeOfDay.of(moment)), DAY)
            return Setting(objects.entry(DATE, 1), days), Setting(objects.entry(DATE, 2), milliseconds)
    return ()


def _moment(date: str, time: str) -> datetime | None:
    """Return the date `mm-dd-yyyy` and the time `hh:mm` with AM or PM; None if the date is not readable."""
    day, clock = _DAY_TEXT.search(date), _CLOCK_TEXT.search(time)
    if day is None:
        return None
    hour, minute = (int(clock[1]), int(clock[2])) if clock else (0, 0)
    if clock and clock[3]:  # 12 AM is 0 h, 12 PM is 12 h
        hour = hour % 12 + (12 if clock[3].upper() == "PM" else 0)
    try:
        moment = datetime(int(day[3]), int(day[1]), int(day[2]), hour, minute)
    except ValueError:
        return None
    return moment if moment.year >= 1984 else None  # CANopen counts the days from 1984-01-01


def object_text(entry: Entry) -> str:
    """Return the address and the name of an object: `1018h:01 Identity.Vendor-ID`."""
    name = f"{entry.object_name}.{entry.name}" if entry.object_name else entry.name
    return f"{entry.index:04X}h:{entry.sub:02X} {name}"


def value_text(entry: Entry, value: Value) -> str:
    """Return a value as text; COB-IDs, mapping entries and the identity in hexadecimal, text in quotes."""
    in_words = entry.type == "u32" and entry.index < 0x2000 and entry.index not in (0x1006, 0x1007, DATE)
    if in_words and isinstance(value, int):
        return f"{value:08X}h"
    return value.hex(" ").upper() if isinstance(value, bytes) else repr(value)
