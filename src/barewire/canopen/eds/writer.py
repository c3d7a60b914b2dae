"""Writing: one key of an object, a whole object, a whole EDS from scratch, a DCF out of an EDS.

        compose(objects, file_info, device_info)      -> Document    nothing was there
        to_dcf(document, 5, {"heartbeat time": 500})  -> Document    what this very device is set to: ParameterValue
                                                                     keys, and [DeviceComissioning]
        set_key(document, 0x1017, 0, key, value)                     one line of what is there

Every line is read back before it is taken, so a name that would be cut at a semicolon is refused, not lost.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from barewire.canopen.cob_ids import check_node
from barewire.canopen.datatypes import BY_NAME
from barewire.canopen.eds.document import Document
from barewire.canopen.eds.lexer import EdsText, split_lines
from barewire.canopen.eds.model import EdsItem, EdsObject, every_item
from barewire.canopen.eds.section_names import BAUD_RATES, COMMISSIONING, DEVICE_INFO, FILE_INFO, LISTS, entry_number
from barewire.canopen.eds.value_syntax import Expression, Formula, write_value
from barewire.errors import EncodeError

MANDATORY = (0x1000, 0x1001, 0x1018)
"""The objects of [MandatoryObjects]."""

_VALUES = ("defaultvalue", "parametervalue", "lowlimit", "highlimit")
_PARTS = {"parametername": "Name", "parametervalue": "Value", "denotation": "Denotation"}


def set_key(document: Document, index: int, sub: int, key: str, value: str | Expression | None) -> None:
    """See `Document.set`."""
    described = document.objects.get(index)
    if described is None:
        raise EncodeError(f"there is no object {index:04X}h")
    _set(document, described, described.item(sub), key, value)


def _set(document: Document, described: EdsObject, item: EdsItem, key: str, value: str | Expression | None) -> None:
    if described.line == 0 and f"{described.index:04x}" not in document.sections:
        add_object(document, described)
    section, at_key = _place(document, described, item.sub, key)
    old = document.get(section, at_key) or ""
    text = value if value is None or isinstance(value, str) else _text(item, key, value, old)
    if at_key != key and text is not None and section.casefold() not in document.sections:
        document.put(section, "NrOfEntries", "0")
    document.put(section, at_key, text)
    if at_key != key and (found := document.sections.get(section.casefold())) is not None:
        document.put(section, "NrOfEntries", str(sum(entry_number(one) is not None for one in found.keys)))


def _place(document: Document, described: EdsObject, sub: int, key: str) -> tuple[str, str]:
    """Section and key where something about a sub-index stands."""
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
    """The list where an object belongs.

    >>> list_name(0x1018), list_name(0x2000), list_name(0x6040)
    ('MandatoryObjects', 'ManufacturerObjects', 'OptionalObjects')
    """
    if index in MANDATORY:
        return LISTS[0]
    return LISTS[2] if 0x2000 <= index < 0x6000 else LISTS[1]


def add_object(document: Document, described: EdsObject) -> None:
    """One more object: its sections at the end, its index at the end of its list."""
    if f"{described.index:04x}" in document.sections:
        raise EncodeError(f"{described.index:04X}h is there already")
    name = list_name(described.index)
    section = document.sections.get(name.casefold())
    numbers = [number for key in section.keys if (number := entry_number(key)) is not None] if section else []
    document.put(name, "SupportedObjects", str(len(numbers) + 1))
    document.put(name, str(max(numbers, default=0) + 1), f"0x{described.index:04X}")
    document.append(object_lines(described))


def object_lines(described: EdsObject) -> Iterator[str]:
    """The sections of an object, line by line."""
    yield from ("", f"[{described.index:04X}]")
    if not described.is_record:
        yield from _item_lines(described.items[0], described.object_type)
        return
    yield _pair("ParameterName", described.name)
    yield _pair("ObjectType", f"0x{described.object_type:X}")
    yield _pair("SubNumber", str(len(described.items)))
    for item in described.items:
        yield from ("", f"[{described.index:04X}sub{item.sub:X}]")
        yield from _item_lines(item, item.object_type)


def _item_lines(item: EdsItem, object_type: int) -> Iterator[str]:
    yield _pair("ParameterName", item.name)
    yield _pair("ObjectType", f"0x{object_type:X}")
    yield _pair("DataType", f"0x{item.code or BY_NAME[item.type].code:04X}")
    yield _pair("AccessType", item.access)
    for key, value in (("LowLimit", item.low), ("HighLimit", item.high), ("DefaultValue", item.default)):
        if value is not None:
            yield _pair(key, write_value(value, item.type))
    yield _pair("PDOMapping", str(int(item.pdo)))
    if item.flags:
        yield _pair("ObjFlags", str(item.flags))
    if item.value is not None:
        yield _pair("ParameterValue", write_value(item.value, item.type))
    if item.denotation:
        yield _pair("Denotation", item.denotation)


def _pair(key: str, value: str) -> str:
    """A line, if it says what it shall when it is read."""
    lines = split_lines(f"{key}={value}")
    if len(lines) != 1 or lines[0][1:6] != ("", key, "=", value, ""):
        raise EncodeError(f"{key}={value!r} would not be read back: no line ends, no ' ;', no blanks around it")
    return f"{key}={value}"


def compose(
    objects: Iterable[EdsObject],
    file_info: Mapping[str, str] | None = None,
    device_info: Mapping[str, str] | None = None,
    *,
    comments: Iterable[str] = (),
    dummies: Iterable[int] = (),
    end: str = "\r\n",
    encoding: str = "ascii",
) -> Document:
    """A new EDS. Keys of [FileInfo] and [DeviceInfo] that are not given are there without a value, or as 0.

    >>> heartbeat = EdsObject(0x1017, "Producer heartbeat time", 7, (EdsItem(0, "Producer heartbeat time", "u16"),))
    >>> document = compose([heartbeat], {"FileName": "small.eds"}, {"VendorName": "Nobody"})
    >>> document.diagnostics, document.dictionary().entry(0x1017).type
    ((), 'u16')
    """
    described = sorted(objects, key=lambda one: one.index)
    lines = ["[FileInfo]"]
    lines += [_pair(key, value) for key, value in (dict.fromkeys(FILE_INFO, "") | dict(file_info or {})).items()]
    lines += ["", "[DeviceInfo]"]
    info = {key: "" if key.endswith("Name") or key == "OrderCode" else "0" for key in DEVICE_INFO}
    lines += [_pair(key, value) for key, value in (info | dict(device_info or {})).items()]
    lines += ["", "[DummyUsage]", *(f"Dummy{code:04X}={int(code in set(dummies))}" for code in range(1, 8))]
    text = list(comments)
    lines += ["", "[Comments]", f"Lines={len(text)}"]
    lines += [_pair(f"Line{number}", line) for number, line in enumerate(text, 1)]
    for name in LISTS:
        listed = [one for one in described if list_name(one.index) == name]
        lines += ["", f"[{name}]", f"SupportedObjects={len(listed)}"]
        lines += [f"{number}=0x{one.index:04X}" for number, one in enumerate(listed, 1)]
        for one in listed:
            lines += object_lines(one)
    whole = "".join(line + end for line in lines)
    try:
        whole.encode(encoding)
    except UnicodeEncodeError as error:
        raise EncodeError(f"{error.object[error.start : error.end]!r} cannot be written in {encoding}") from None
    return Document(EdsText(b"", encoding, whole))


def to_dcf(
    document: Document,
    node_id: int,
    values: Mapping[tuple[int, int] | str, Expression] | None = None,
    *,
    name: str = "",
    bitrate: int | None = None,
) -> Document:
    """A device of this EDS as it is configured: a copy with [DeviceComissioning] and with values.

    Values are given by place or by name. EncodeError for one that the data type or the limits do not have.
    """
    check_node(node_id)
    made = document.copy()
    if bitrate is not None and f"BaudRate_{bitrate // 1000}" not in BAUD_RATES:
        raise EncodeError(f"{bitrate} bit/s: expected one of {', '.join(rate[9:] for rate in BAUD_RATES)} kbit/s")
    if (file_name := document.get("FileInfo", "FileName")) is not None:
        made.put("FileInfo", "LastEDS", file_name)
    told = {"NodeID": str(node_id), "NodeName": name, "Baudrate": str(bitrate // 1000) if bitrate else ""}
    for key in COMMISSIONING:
        if key == "Baudrate" and bitrate is None:
            continue  # nobody said it
        if told.get(key) or made.get("DeviceComissioning", key) is None:
            missing = "0" if key in ("NetNumber", "CANopenManager", "LSS_SerialNumber") else ""
            made.put("DeviceComissioning", key, told.get(key) or missing)
    items = {(described.index, item.sub): (described, item) for described, item in every_item(document)}
    dictionary = document.dictionary(node_id)
    for place, value in (values or {}).items():
        if isinstance(place, str):
            entry = dictionary.find(place)
            place = entry.index, entry.sub
        if place not in items:
            raise EncodeError(f"there is no object {place[0]:04X}h:{place[1]:02X}")
        described, item = items[place]
        _check_limits(item, place, value, node_id)
        _set(made, described, item, "ParameterValue", value)
    return made


def _check_limits(item: EdsItem, place: tuple[int, int], value: Expression, node: int) -> None:
    number = value.at(node) if isinstance(value, Formula) else value
    if isinstance(number, (str, bytes)):
        return
    low, high = (limit.at(node) if isinstance(limit, Formula) else limit for limit in item.limits)
    if (low is not None and number < low) or (high is not None and number > high):
        reach = f"{'' if low is None else low}..{'' if high is None else high}"
        raise EncodeError(f"{place[0]:04X}h:{place[1]:02X} {item.name} = {number}: expected {reach}")
