"""Change a document: one key of an object, or a whole object.

        set_key(document, described, item, "DefaultValue", 1000)       one line
        add_object(document, described)                                its sections, and a line of its list

Every line is parsed again before it is accepted, so a name that would end at a semicolon is refused, not truncated.
"""

from __future__ import annotations

from collections.abc import Iterator

from barewire.canopen.datatypes import BY_NAME
from barewire.canopen.eds.document import Document
from barewire.canopen.eds.lexer import split_lines
from barewire.canopen.eds.model import EdsItem, EdsObject
from barewire.canopen.eds.section_names import LISTS, entry_number
from barewire.canopen.eds.value_syntax import Expression, write_value
from barewire.errors import EncodeError

MANDATORY = (0x1000, 0x1001, 0x1018)
"""The objects of [MandatoryObjects]."""

_VALUES = ("defaultvalue", "parametervalue", "lowlimit", "highlimit")
_PARTS = {"parametername": "Name", "parametervalue": "Value", "denotation": "Denotation"}


def set_key(document: Document, described: EdsObject, item: EdsItem, key: str, value: str | Expression | None) -> None:
    """Write a key of one sub-index; see `Eds.set`."""
    if described.line == 0 and f"{described.index:04x}" not in document.sections:
        add_object(document, described)
    section, at_key = _place(document, described, item.sub, key)
    old = document.get(section, at_key) or ""
    text = value if value is None or isinstance(value, str) else _text(item, key, value, old)
    if at_key != key and text is not None and section.casefold() not in document.sections:
        document.put(section, "NrOfEntries", "0")
    document.put(section, at_key, text)
    if at_key != key and (found := document.sections.get(section.casefold())) is not None:
        document.put(section, "NrOfEntries", str(sum(entry_number(name) is not None for name in found.keys)))


def _place(document: Document, described: EdsObject, sub: int, key: str) -> tuple[str, str]:
    """Return the section and key that describe a sub-index."""
    own = f"{described.index:04X}sub{sub:X}"
    if own.casefold() in document.sections:
        return own, key
    if not described.compact:
        return f"{described.index:04X}", key
    part = _PARTS.get(key.casefold())
    if part is None or sub == 0:
        raise EncodeError(f"{described.index:04X}h:{sub:02X} is made by CompactSubObj and has no {key} of its own")
    return f"{described.index:04X}{part}", str(sub)


def _text(item: EdsItem, key: str, value: Expression, old: str) -> str:
    if key.casefold() in _VALUES:
        return write_value(value, item.type, old)
    if not isinstance(value, int):
        raise EncodeError(f"{key} = {value!r}: expected text or a whole number")
    return str(int(value))


def list_name(index: int) -> str:
    """Return the list that an object belongs to.

    >>> list_name(0x1018), list_name(0x2000), list_name(0x6040)
    ('MandatoryObjects', 'ManufacturerObjects', 'OptionalObjects')
    """
    if index in MANDATORY:
        return LISTS[0]
    return LISTS[2] if 0x2000 <= index < 0x6000 else LISTS[1]


def add_object(document: Document, described: EdsObject) -> None:
    """Add an object: its sections at the end of the file, its index at the end of its list.

    Raise EncodeError if the object exists.
    """
    if f"{described.index:04x}" in document.sections:
        raise EncodeError(f"{described.index:04X}h exists already")
    name = list_name(described.index)
    section = document.sections.get(name.casefold())
    numbers = [number for key in section.keys if (number := entry_number(key)) is not None] if section else []
    document.put(name, "SupportedObjects", str(len(numbers) + 1))
    document.put(name, str(max(numbers, default=0) + 1), f"0x{described.index:04X}")
    document.append(object_lines(described))


def object_lines(described: EdsObject) -> Iterator[str]:
    """Yield the sections of an object, line by line."""
    yield from ("", f"[{described.index:04X}]")
    if not described.is_record:
        yield from _item_lines(described.items[0], described.object_type)
        return
    yield pair_line("ParameterName", described.name)
    yield pair_line("ObjectType", f"0x{described.object_type:X}")
    yield pair_line("SubNumber", str(len(described.items)))
    for item in described.items:
        yield from ("", f"[{described.index:04X}sub{item.sub:X}]")
        yield from _item_lines(item, item.object_type)


def _item_lines(item: EdsItem, object_type: int) -> Iterator[str]:
    yield pair_line("ParameterName", item.name)
    yield pair_line("ObjectType", f"0x{object_type:X}")
    yield pair_line("DataType", f"0x{item.code or BY_NAME[item.type].code:04X}")
    yield pair_line("AccessType", item.access)
    for key, value in (("LowLimit", item.low), ("HighLimit", item.high), ("DefaultValue", item.default)):
        if value is not None:
            yield pair_line(key, write_value(value, item.type))
    yield pair_line("PDOMapping", str(int(item.pdo)))
    if item.flags:
        yield pair_line("ObjFlags", str(item.flags))
    if item.value is not None:
        yield pair_line("ParameterValue", write_value(item.value, item.type))
    if item.denotation:
        yield pair_line("Denotation", item.denotation)


def pair_line(key: str, value: str) -> str:
    """Return a line `key=value`. Raise EncodeError if it would not be read back unchanged."""
    lines = split_lines(f"{key}={value}")
    if len(lines) != 1 or lines[0][1:6] != ("", key, "=", value, ""):
        raise EncodeError(f"{key}={value!r} would not be read back unchanged: it has a line end, ' ;' or outer blanks")
    return f"{key}={value}"
