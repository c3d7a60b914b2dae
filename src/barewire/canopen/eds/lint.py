"""Lint: what an EDS must have and has not, and which of its places contradict each other.   [CiA 306, CiA 301]

        [DeviceInfo] NrOfTXPDO=4         but 1800h to 1802h only            pdo-count
        [1018sub1]   DefaultValue=0x51   but VendorNumber=0x52              identity
        [1A00sub1]   DefaultValue=0x60410020, but 6041h has 16 bits         pdo-mapping

A file can break all of these and still be read without doubt; `Document.diagnostics` has what is doubtful.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

from barewire.canopen.cob_ids import is_restricted
from barewire.canopen.datatypes import BY_NAME
from barewire.canopen.eds.diagnostics import Diagnostic, diagnostic
from barewire.canopen.eds.document import Document, Section
from barewire.canopen.eds.model import EdsItem, EdsObject, every_item
from barewire.canopen.eds.section_names import BAUD_RATES, COMMISSIONING, DEVICE_INFO, FILE_INFO, LISTS, entry_number
from barewire.canopen.eds.value_syntax import Formula, read_integer
from barewire.canopen.eds.writer import MANDATORY, list_name

LONGEST_LINE = 255
_FILE_INFO = [key for key in FILE_INFO if key != "EDSVersion"]  # without it the version is 3.0 [CiA 306 4.4]
_REQUIRED = {"FileInfo": _FILE_INFO, "DeviceInfo": DEVICE_INFO} | {name: ["SupportedObjects"] for name in LISTS}
_DATE = re.compile(r"(0[1-9]|1[0-2])-(0[1-9]|[12][0-9]|3[01])-[0-9]{4}")
_TIME = re.compile(r"(0[1-9]|1[0-2]):[0-5][0-9](AM|PM)")
_OF_ITEMS = ("DataType", "AccessType", "DefaultValue", "PDOMapping", "LowLimit", "HighLimit")
_VERSION = re.compile(r"[0-9]\.[0-9]")
_IDENTITY = ((1, "VendorNumber"), (2, "ProductNumber"), (3, "RevisionNumber"))
_PDOS = (("RPDO", "NrOfRXPDO", 0x1400, 0x1600), ("TPDO", "NrOfTXPDO", 0x1800, 0x1A00))


def lint(document: Document) -> tuple[Diagnostic, ...]:
    """Everything that can be said against a file: its diagnostics and what is missing or contradicts itself.

    >>> from barewire.canopen.eds.document import parse
    >>> print(lint(parse(b""))[0])
    0: missing-object: 1000h: an object that every device must have is missing
    """
    found = [*_keys(document), *_forms(document), *_lists(document), *_objects(document)]
    found += [*_info(document), *_commissioning(document), *_pdos(document)]
    return tuple(sorted({*found, *document.diagnostics}))


def _at(section: Section, key: str) -> int:
    """The line of a key, or of the section."""
    at = section.keys.get(key.casefold())
    return section.line if at is None else at + 1


def _line(document: Document, described: EdsObject, sub: int, key: str) -> int:
    own = document.sections.get(f"{described.index:04x}sub{sub:x}") or document.sections.get(f"{described.index:04x}")
    return _at(own, key) if own else 0


def _number(document: Document, section: str, key: str) -> int | None:
    return read_integer(document.get(section, key) or "").value


def _keys(document: Document) -> Iterator[Diagnostic]:
    """Sections and keys: those that must be there, and those that CiA 306 does not know."""
    for name, keys in _REQUIRED.items():
        section = document.sections.get(name.casefold())
        if section is None:
            yield diagnostic(0, "missing-section", f"[{name}]")
            continue
        for key in keys:
            if key.casefold() not in section.keys:
                yield diagnostic(section.line, "missing-key", f"[{name}] {key}")
    for section in document.sections.values():
        if section.name.kind == "unknown":
            yield diagnostic(section.line, "unknown-section", f"[{section.name.proper}]")
            continue
        if section.name.other_capitals(document.lines[section.line - 1].key):
            yield diagnostic(section.line, "capitals", f"[{document.lines[section.line - 1].key}]")
        for key, name_of in section.names.items():
            if name_of.capitals:
                text = document.lines[section.keys[key]].key
                yield diagnostic(_at(section, key), "capitals", f"[{section.name.proper}] {text}")
            if not name_of.known:
                yield diagnostic(_at(section, key), "unknown-key", f"[{section.name.proper}] {name_of.proper}")
    for index in MANDATORY:
        if index not in document.objects:
            yield diagnostic(0, "missing-object", f"{index:04X}h")
    for number, line in enumerate(document.lines, 1):
        if len(line.text) - len(line.end) > LONGEST_LINE:
            yield diagnostic(number, "long-line", line.shown)


def _forms(document: Document) -> Iterator[Diagnostic]:
    """Dates, times and versions of [FileInfo]."""
    section = document.sections.get("fileinfo")
    for key in ("FileVersion", "FileRevision", "EDSVersion") if section else ():
        text = document.get("FileInfo", key)
        number = read_integer(text or "").value
        fine = _VERSION.fullmatch(text or "") if key == "EDSVersion" else number is not None and 0 <= number <= 255
        if text and section is not None and not fine:
            yield diagnostic(_at(section, key), "version-form", f"{key}={text}")
    for word in ("Creation", "Modification") if section else ():
        for key, form, rule in ((f"{word}Date", _DATE, "date-form"), (f"{word}Time", _TIME, "time-form")):
            text = document.get("FileInfo", key)
            if text is not None and section is not None and not form.fullmatch(text):
                yield diagnostic(_at(section, key), rule, f"{key}={text}")


def _lists(document: Document) -> Iterator[Diagnostic]:
    """The lists of objects, and every other section that counts its entries."""
    for section in document.sections.values():
        name = section.name
        counter = {"list": "supportedobjects", "compact": "nrofentries"}.get(name.kind)
        if name.proper == "Comments":
            counter = "lines"
        if counter is None or name.part == "ObjectLinks":
            continue
        found = [entry_number(key.removeprefix("line")) for key in section.keys]
        numbers = [number for number in found if number is not None]
        count = _number(document, name.proper, counter)
        if count is not None and count != len(numbers):
            yield diagnostic(_at(section, counter), "list-count", f"[{name.proper}] {count} told, {len(numbers)} there")
        if name.kind == "list" and sorted(numbers) != list(range(1, len(numbers) + 1)):
            yield diagnostic(section.line, "list-gap", f"[{name.proper}]")
        for key in section.keys if name.kind == "list" else ():
            index = _number(document, name.proper, key) if entry_number(key) is not None else None
            if index is not None and 0x1000 <= index <= 0xFFFF and list_name(index) != name.proper:
                yield diagnostic(_at(section, key), "wrong-list", f"{index:04X}h in [{name.proper}]")


def _objects(document: Document) -> Iterator[Diagnostic]:
    """Objects one by one."""
    for described in document.objects.values():
        section = document.sections.get(f"{described.index:04x}")
        if section is None:
            continue
        if described.is_record and not described.compact:
            told = _number(document, section.name.proper, "SubNumber")
            there = sum(item.sub < 0xFF for item in described.items)  # FFh tells of the type, and is not counted
            if told != there:
                number = "no SubNumber" if told is None else f"SubNumber={told}"
                what = f"[{section.name.proper}] {number}, there are {there}"
                yield diagnostic(_at(section, "SubNumber"), "sub-number", what)
            yield from _sub0(document, described)
            for key in _OF_ITEMS:
                if document.get(section.name.proper, key):
                    yield diagnostic(_at(section, key), "key-not-here", f"[{section.name.proper}] {key}")
    for described, item in every_item(document):
        yield from _item(document, described, item)


def _sub0(document: Document, described: EdsObject) -> Iterator[Diagnostic]:
    first = described.items[0]
    if first.sub != 0:
        return
    what = f"[{described.index:04X}sub0]"
    if first.type != "u8":
        yield diagnostic(_line(document, described, 0, "DataType"), "sub0-type", f"{what} {first.type}")
    highest = max(item.sub for item in described.items if item.sub < 0xFF)
    # What counts errors, consumers or mapped objects is written, and need not reach the end.
    if first.access in ("ro", "const") and isinstance(first.default, int) and first.default != highest:
        line = _line(document, described, 0, "DefaultValue")
        yield diagnostic(line, "sub0-value", f"{what} {int(first.default)}, there are {highest}")


def _item(document: Document, described: EdsObject, item: EdsItem) -> Iterator[Diagnostic]:
    what = f"{described.index:04X}h:{item.sub:02X}"
    for key, value in (("DefaultValue", item.default), ("ParameterValue", item.value)):
        low, high = item.limits
        if not isinstance(value, (int, float)) or isinstance(low, Formula) or isinstance(high, Formula):
            continue
        if (low is not None and value < low) or (high is not None and value > high):
            yield diagnostic(_line(document, described, item.sub, key), "default-outside", f"{what} {key}={value}")
    if item.flags & ~3:
        yield diagnostic(_line(document, described, item.sub, "ObjFlags"), "flags", f"{what} {item.flags:X}h")


def _info(document: Document) -> Iterator[Diagnostic]:
    """[DeviceInfo] against the objects."""
    section = document.sections.get("deviceinfo")
    if section is None:
        return
    identity = document.objects.get(0x1018)
    defaults = {item.sub: item.default for item in identity.items} if identity else {}
    for sub, key in _IDENTITY:
        told, default = _number(document, "DeviceInfo", key), defaults.get(sub)
        # 0 is what stands where nobody knew the number.
        if told and default and told != default:
            yield diagnostic(_at(section, key), "identity", f"{key}={told}, 1018h:{sub:02X} is {default!r}")
    granularity = _number(document, "DeviceInfo", "Granularity")
    if granularity is not None and not 0 <= granularity <= 64:
        yield diagnostic(_at(section, "Granularity"), "granularity", str(granularity))
    for name, key, first, _ in _PDOS:
        told = _number(document, "DeviceInfo", key)
        there = sum(first <= index < first + 0x200 for index in document.objects)
        if told is not None and told != there:
            yield diagnostic(_at(section, key), "pdo-count", f"{key}={told}, there are {there} {name}s")


def _commissioning(document: Document) -> Iterator[Diagnostic]:
    section = document.sections.get("devicecomissioning")
    if section is None:
        return
    for key in COMMISSIONING[:3]:
        if key.casefold() not in section.keys:
            yield diagnostic(section.line, "missing-key", f"[{section.name.proper}] {key}")
    node, rate = (_number(document, "DeviceComissioning", key) for key in ("NodeID", "Baudrate"))
    if node is not None and not 1 <= node <= 127:
        yield diagnostic(_at(section, "NodeID"), "commissioning", f"NodeID={node}, expected 1 to 127")
    if rate is not None and (
        f"BaudRate_{rate}" not in BAUD_RATES or _number(document, "DeviceInfo", f"BaudRate_{rate}") == 0
    ):
        yield diagnostic(_at(section, "Baudrate"), "commissioning", f"Baudrate={rate} is none of the device's")


def _pdos(document: Document) -> Iterator[Diagnostic]:
    """The records of PDOs: in pairs, with identifiers that are free, mapping what is there."""
    objects = document.objects
    items = {(described.index, item.sub): item for described, item in every_item(document)}
    for name, _, communication, mapping in _PDOS:
        for number in range(0x200):
            pair = objects.get(communication + number), objects.get(mapping + number)
            there = [one for one in pair if one is not None]
            if len(there) == 1:
                yield diagnostic(there[0].line, "pdo-pair", f"{name}{number + 1} has {there[0].index:04X}h only")
            cob_id = items.get((communication + number, 1))
            word = cob_id.default if cob_id else None
            # Bit 31: switched off. Bit 29: an identifier of 29 bits, which has no reserved ones.
            if pair[0] and isinstance(word, int) and not word >> 29 & 5 and is_restricted(word & 0x7FF):
                line = _line(document, pair[0], 1, "DefaultValue")
                yield diagnostic(line, "cob-id", f"{name}{number + 1} has {word & 0x7FF:03X}h")
            if pair[1]:
                yield from _mapping(document, name, pair[1], items)


def _mapping(
    document: Document, name: str, record: EdsObject, items: dict[tuple[int, int], EdsItem]
) -> Iterator[Diagnostic]:
    bits = 0
    count = record.items[0].default if record.items else 0
    for item in _mapped(record.items, count if isinstance(count, int) else 0):
        word = item.default
        if not isinstance(word, int) or word == 0:
            continue
        index, sub, width = word >> 16, word >> 8 & 0xFF, word & 0xFF
        bits += width
        target = items.get((index, sub))
        why = ""
        if index < 8 and sub == 0:
            why = "" if name == "RPDO" and index in document.dummies else "no dummy of an RPDO in [DummyUsage]"
        elif target is None:
            why = "there is no such object"
        elif not target.pdo:
            why = "PDOMapping is 0"
        elif BY_NAME[target.type].bits not in (0, width):
            why = f"it has {BY_NAME[target.type].bits} bits"
        if why:
            line = _line(document, record, item.sub, "DefaultValue")
            yield diagnostic(line, "pdo-mapping", f"{record.index:04X}h:{item.sub:02X} {word:08X}h, {why}")
    if bits > 64:
        yield diagnostic(record.line, "pdo-bits", f"{record.index:04X}h maps {bits}")


def _mapped(items: Iterable[EdsItem], count: int) -> Iterator[EdsItem]:
    """The entries that are in force."""
    return (item for item in items if 1 <= item.sub <= count)
