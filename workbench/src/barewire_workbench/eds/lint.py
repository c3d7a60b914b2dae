"""Lint: mandatory parts that an EDS lacks, and parts that contradict each other.   [CiA 306, CiA 301]

        [DeviceInfo] NrOfTXPDO=4         but 1800h to 1802h only            pdo-count
        [1018sub1]   DefaultValue=0x51   but VendorNumber=0x52              identity
        [1A00sub1]   DefaultValue=0x60410020, but 6041h has 16 bits         pdo-mapping

Such a file can still be read without doubt; `Eds.diagnostics` reports what is doubtful.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from barewire.canopen.cob_ids import is_restricted
from barewire.canopen.datatypes import BY_NAME
from barewire.canopen.eds.diagnostics import Diagnostic, diagnostic
from barewire.canopen.eds.document import (
    BAUD_RATES,
    COMMISSIONING,
    DEVICE_INFO,
    FILE_INFO,
    LISTS,
    entry_number,
)
from barewire.canopen.eds.eds_file import MANDATORY, Eds, list_name
from barewire.canopen.eds.objects import REFUSES_READ, REFUSES_WRITE, EdsItem, EdsObject, every_item
from barewire.canopen.eds.value_syntax import Formula, read_integer

_LONGEST_LINE = 255
_FILE_INFO = [key for key in FILE_INFO if key != "EDSVersion"]  # without it the version is 3.0 [CiA 306 4.4]
_REQUIRED = {"FileInfo": _FILE_INFO, "DeviceInfo": DEVICE_INFO} | {name: ["SupportedObjects"] for name in LISTS}
REQUIRED_SECTIONS = frozenset(name.casefold() for name in _REQUIRED)
_DATE = re.compile(r"(0[1-9]|1[0-2])-(0[1-9]|[12][0-9]|3[01])-[0-9]{4}")
_TIME = re.compile(r"(0[1-9]|1[0-2]):[0-5][0-9](AM|PM)")
_ITEM_KEYS = ("DataType", "AccessType", "DefaultValue", "PDOMapping", "LowLimit", "HighLimit")
_VERSION = re.compile(r"[0-9]\.[0-9]")
_IDENTITY = ((1, "VendorNumber"), (2, "ProductNumber"), (3, "RevisionNumber"))
_PDOS = (("RPDO", "NrOfRXPDO", 0x1400, 0x1600), ("TPDO", "NrOfTXPDO", 0x1800, 0x1A00))


def lint(eds: Eds) -> tuple[Diagnostic, ...]:
    """Return all findings: the diagnostics of the file, missing parts and contradictions.

    >>> from barewire.canopen.eds.eds_file import parse
    >>> print(lint(parse(b""))[0])
    0: missing-object: 1000h: an object that every device must have is missing
    """
    checks = (_keys, _forms, _lists, _objects, _info, _commissioning, _pdos)
    return tuple(sorted({*eds.diagnostics, *(finding for check in checks for finding in check(eds))}))


def _line(eds: Eds, described: EdsObject, sub: int, key: str) -> int:
    own = eds.sections.get(f"{described.index:04x}sub{sub:x}") or eds.sections.get(f"{described.index:04x}")
    return own.line_of(key) if own else 0


def _number(eds: Eds, section: str, key: str) -> int | None:
    return read_integer(eds.get(section, key) or "").value


def _keys(eds: Eds) -> Iterator[Diagnostic]:
    """Check for missing sections and keys, and for names that CiA 306 does not define."""
    for name, keys in _REQUIRED.items():
        section = eds.sections.get(name.casefold())
        if section is None:
            yield diagnostic(0, "missing-section", f"[{name}]")
            continue
        for key in keys:
            if key.casefold() not in section.keys:
                yield diagnostic(section.line, "missing-key", f"[{name}] {key}")
    for section in eds.sections.values():
        if section.name.kind == "unknown":
            yield diagnostic(section.line, "unknown-section", f"[{section.name.proper}]")
            continue
        if section.name.other_capitals(eds.lines[section.line - 1].key):
            yield diagnostic(section.line, "capitals", f"[{eds.lines[section.line - 1].key}]")
        for key, name_of in section.names.items():
            if name_of.capitals:
                text = eds.lines[section.keys[key]].key
                yield diagnostic(section.line_of(key), "capitals", f"[{section.name.proper}] {text}")
            if not name_of.known:
                yield diagnostic(section.line_of(key), "unknown-key", f"[{section.name.proper}] {name_of.proper}")
    for index in MANDATORY:
        if index not in eds.objects:
            yield diagnostic(0, "missing-object", f"{index:04X}h")
    for number, line in enumerate(eds.lines, 1):
        if len(line.text) - len(line.end) > _LONGEST_LINE:
            yield diagnostic(number, "long-line", line.shown)


def _forms(eds: Eds) -> Iterator[Diagnostic]:
    """Check dates, times and versions of [FileInfo]."""
    section = eds.sections.get("fileinfo")
    for key in ("FileVersion", "FileRevision", "EDSVersion") if section else ():
        text = eds.get("FileInfo", key)
        number = read_integer(text or "").value
        valid = _VERSION.fullmatch(text or "") if key == "EDSVersion" else number is not None and 0 <= number <= 255
        if text and section is not None and not valid:
            yield diagnostic(section.line_of(key), "version-form", f"{key}={text}")
    for word in ("Creation", "Modification") if section else ():
        for key, form, rule in ((f"{word}Date", _DATE, "date-form"), (f"{word}Time", _TIME, "time-form")):
            text = eds.get("FileInfo", key)
            if text is not None and section is not None and not form.fullmatch(text):
                yield diagnostic(section.line_of(key), rule, f"{key}={text}")


def _lists(eds: Eds) -> Iterator[Diagnostic]:
    """Check the lists of objects, and other sections that count their entries."""
    for section in eds.sections.values():
        name = section.name
        counter = {"list": "supportedobjects", "compact": "nrofentries"}.get(name.kind)
        if name.proper == "Comments":
            counter = "lines"
        if counter is None or name.part == "ObjectLinks":
            continue
        numbers = [number for key in section.keys if (number := entry_number(key.removeprefix("line"))) is not None]
        count = _number(eds, name.proper, counter)
        if count is not None and count != len(numbers):
            text = f"[{name.proper}] {count} stated, {len(numbers)} there"
            yield diagnostic(section.line_of(counter), "list-count", text)
        if name.kind == "list" and sorted(numbers) != list(range(1, len(numbers) + 1)):
            yield diagnostic(section.line, "list-gap", f"[{name.proper}]")
        for key in section.keys if name.kind == "list" else ():
            index = _number(eds, name.proper, key) if entry_number(key) is not None else None
            if index is not None and 0x1000 <= index <= 0xFFFF and list_name(index) != name.proper:
                yield diagnostic(section.line_of(key), "wrong-list", f"{index:04X}h in [{name.proper}]")


def _objects(eds: Eds) -> Iterator[Diagnostic]:
    """Check the objects one by one."""
    for described in eds.objects.values():
        section = eds.sections.get(f"{described.index:04x}")
        if section is None:
            continue
        if described.is_record and not described.compact:
            stated = _number(eds, section.name.proper, "SubNumber")
            present = sum(item.sub < 0xFF for item in described.items)  # FFh describes the type, and is not counted
            if stated != present:
                number = "no SubNumber" if stated is None else f"SubNumber={stated}"
                text = f"[{section.name.proper}] {number}, there are {present}"
                yield diagnostic(section.line_of("SubNumber"), "sub-number", text)
            yield from _sub0(eds, described)
            for key in _ITEM_KEYS:
                if eds.get(section.name.proper, key):
                    yield diagnostic(section.line_of(key), "key-not-here", f"[{section.name.proper}] {key}")
    for described, item in every_item(eds.objects.values()):
        yield from _item(eds, described, item)


def _sub0(eds: Eds, described: EdsObject) -> Iterator[Diagnostic]:
    sub0 = described.items[0]
    if sub0.sub != 0:
        return
    section = f"[{described.index:04X}sub0]"
    if sub0.type != "u8":
        yield diagnostic(_line(eds, described, 0, "DataType"), "sub0-type", f"{section} {sub0.type}")
    highest = max(item.sub for item in described.items if item.sub < 0xFF)
    # A writable sub-index 0 (of errors, consumers, mapped objects) need not be the highest sub-index.
    if sub0.access in ("ro", "const") and isinstance(sub0.default, int) and sub0.default != highest:
        line = _line(eds, described, 0, "DefaultValue")
        yield diagnostic(line, "sub0-value", f"{section} {int(sub0.default)}, there are {highest}")


def _item(eds: Eds, described: EdsObject, item: EdsItem) -> Iterator[Diagnostic]:
    address = f"{described.index:04X}h:{item.sub:02X}"
    for key, value in (("DefaultValue", item.default), ("ParameterValue", item.value)):
        low, high = item.limits
        if not isinstance(value, (int, float)) or isinstance(low, Formula) or isinstance(high, Formula):
            continue
        if (low is not None and value < low) or (high is not None and value > high):
            yield diagnostic(_line(eds, described, item.sub, key), "default-outside", f"{address} {key}={value}")
    if item.flags & ~(REFUSES_WRITE | REFUSES_READ):
        yield diagnostic(_line(eds, described, item.sub, "ObjFlags"), "flags", f"{address} {item.flags:X}h")


def _info(eds: Eds) -> Iterator[Diagnostic]:
    """Check for contradictions between [DeviceInfo] and the objects."""
    section = eds.sections.get("deviceinfo")
    if section is None:
        return
    identity = eds.objects.get(0x1018)
    defaults = {item.sub: item.default for item in identity.items} if identity else {}
    for sub, key in _IDENTITY:
        stated, default = _number(eds, "DeviceInfo", key), defaults.get(sub)
        # 0 is written where the number was unknown.
        if stated and default and stated != default:
            yield diagnostic(section.line_of(key), "identity", f"{key}={stated}, 1018h:{sub:02X} is {default!r}")
    granularity = _number(eds, "DeviceInfo", "Granularity")
    if granularity is not None and not 0 <= granularity <= 64:
        yield diagnostic(section.line_of("Granularity"), "granularity", str(granularity))
    for name, key, first, _ in _PDOS:
        stated = _number(eds, "DeviceInfo", key)
        present = sum(first <= index < first + 0x200 for index in eds.objects)
        if stated is not None and stated != present:
            yield diagnostic(section.line_of(key), "pdo-count", f"{key}={stated}, there are {present} {name}s")


def _commissioning(eds: Eds) -> Iterator[Diagnostic]:
    section = eds.sections.get("devicecomissioning")
    if section is None:
        return
    for key in COMMISSIONING[:3]:
        if key.casefold() not in section.keys:
            yield diagnostic(section.line, "missing-key", f"[{section.name.proper}] {key}")
    node, rate = (_number(eds, "DeviceComissioning", key) for key in ("NodeID", "Baudrate"))
    if node is not None and not 1 <= node <= 127:
        yield diagnostic(section.line_of("NodeID"), "commissioning", f"NodeID={node}, expected 1 to 127")
    if rate is not None and (
        f"BaudRate_{rate}" not in BAUD_RATES or _number(eds, "DeviceInfo", f"BaudRate_{rate}") == 0
    ):
        text = f"Baudrate={rate} is not supported by the device"
        yield diagnostic(section.line_of("Baudrate"), "commissioning", text)


def _pdos(eds: Eds) -> Iterator[Diagnostic]:
    """Check PDO records: complete pairs, unrestricted identifiers, mappings of existing objects."""
    objects = eds.objects
    items = {(described.index, item.sub): item for described, item in every_item(eds.objects.values())}
    for name, _, communication, mapping in _PDOS:
        for number in range(0x200):
            pair = objects.get(communication + number), objects.get(mapping + number)
            present = [record for record in pair if record is not None]
            if len(present) == 1:
                yield diagnostic(present[0].line, "pdo-pair", f"{name}{number + 1} has {present[0].index:04X}h only")
            cob_id = items.get((communication + number, 1))
            word = cob_id.default if cob_id else None
            # Bit 31: not in use. Bit 29: an identifier of 29 bits, of which none are restricted.
            if pair[0] and isinstance(word, int) and not word >> 29 & 5 and is_restricted(word & 0x7FF):
                line = _line(eds, pair[0], 1, "DefaultValue")
                yield diagnostic(line, "cob-id", f"{name}{number + 1} has {word & 0x7FF:03X}h")
            if pair[1]:
                yield from _mapping(eds, name, pair[1], items)


def _mapping(eds: Eds, name: str, record: EdsObject, items: dict[tuple[int, int], EdsItem]) -> Iterator[Diagnostic]:
    bits = 0
    count = record.items[0].default if record.items else 0
    for item in record.items:
        word = item.default
        is_mapped = isinstance(count, int) and 1 <= item.sub <= count
        if not is_mapped or not isinstance(word, int) or word == 0:
            continue
        index, sub, width = word >> 16, word >> 8 & 0xFF, word & 0xFF
        bits += width
        target = items.get((index, sub))
        reason = ""
        if index < 8 and sub == 0:
            reason = "" if name == "RPDO" and index in eds.dummies else "no dummy of an RPDO in [DummyUsage]"
        elif target is None:
            reason = "there is no such object"
        elif not target.pdo:
            reason = "PDOMapping is 0"
        elif BY_NAME[target.type].bits not in (0, width):
            reason = f"it has {BY_NAME[target.type].bits} bits"
        if reason:
            line = _line(eds, record, item.sub, "DefaultValue")
            yield diagnostic(line, "pdo-mapping", f"{record.index:04X}h:{item.sub:02X} {word:08X}h, {reason}")
    if bits > 64:
        yield diagnostic(record.line, "pdo-bits", f"{record.index:04X}h maps {bits}")
