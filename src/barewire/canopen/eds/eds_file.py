"""`Eds`: an EDS or DCF, its text and the objects that it describes.

bytes --parse--> Eds --.objects-------> EdsObject, EdsItem
                  |  --.dictionary(5)-> ObjectDictionary of node 5
bytes <--encode---'  <-.set, .put       one line is changed

compose(objects, file_info, device_info)  -> Eds    a new file
to_dcf(eds, 5, {"heartbeat time": 500})   -> Eds    the configuration of one device

Change a document: one key of an object, or a whole object.

        set_key(document, described, item, "DefaultValue", 1000)       one line
        add_object(document, described)                                its sections, and a line of its list

Every line is parsed again before it is accepted, so a name that would end at a semicolon is refused, not truncated.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from barewire.canopen.cob_ids import check_node
from barewire.canopen.datatypes import BY_NAME
from barewire.canopen.eds.diagnostics import Diagnostic, EdsError
from barewire.canopen.eds.document import (
    BAUD_RATES,
    COMMISSIONING,
    DEVICE_INFO,
    FILE_INFO,
    LISTS,
    Document,
    EdsLine,
    EdsText,
    checked_line,
    decode_text,
    entry_number,
)
from barewire.canopen.eds.objects import EdsItem, EdsObject, every_item, read_objects, to_dictionary
from barewire.canopen.eds.value_syntax import Expression, Formula, read_value, write_value
from barewire.canopen.object_dictionary import ObjectDictionary
from barewire.errors import EncodeError, shown


class Eds(Document):
    """An EDS or DCF. `parse` makes one of bytes, `compose` one from scratch.

    >>> lines = b"[1017]", b"ParameterName = Heartbeat  ; ms", b"DataType=0x0006", b"AccessType=rw", b"DefaultValue=0"
    >>> heartbeat = parse(b"\\n".join(lines))
    >>> heartbeat.get("1017", "parametername")
    'Heartbeat'
    >>> heartbeat.set(0x1017, 0, "DefaultValue", 1000)
    >>> heartbeat.encode()[-33:]
    b'6\\nAccessType=rw\\nDefaultValue=1000'
    >>> [str(diagnostic) for diagnostic in heartbeat.diagnostics][:1]
    ['1: not-listed: [1017]: is in none of the three lists of objects; read all the same']
    """

    __slots__ = ("_object_diagnostics", "_objects")

    def _discard_objects(self) -> None:
        self._objects: dict[int, EdsObject] | None = None
        self._object_diagnostics: list[Diagnostic] = []

    def __repr__(self) -> str:
        return f"<Eds: {len(self.lines)} lines, {len(self.objects)} objects>"

    @property
    def objects(self) -> Mapping[int, EdsObject]:
        """The objects by index, including those of compact storage."""
        if self._objects is None:
            self._object_diagnostics = []
            self._objects = read_objects(self, self._object_diagnostics)
        return self._objects

    @property
    def diagnostics(self) -> tuple[Diagnostic, ...]:
        """All departures from CiA 306, in the order of lines."""
        _ = self.objects  # fills `_object_diagnostics`
        return tuple(sorted({*super().diagnostics, *self._object_diagnostics}))

    def dictionary(self, node_id: int | None = None) -> ObjectDictionary:
        """Return the object dictionary of a node. Each ParameterValue is the present value of its object.

        The default of `node_id` is the one in [DeviceComissioning]. Raise EncodeError if a formula needs it and there
        is none.
        """
        return to_dictionary(self.objects.values(), self.node_id if node_id is None else node_id)

    def set(self, index: int, sub: int, key: str, value: str | Expression | None) -> None:
        """Write a key of a variable, or of one sub-index of an object.

        A value of the object's data type is written in the notation of the old value (decimal or hexadecimal), a str
        as it is; None removes the line. Values and names of sub-indices made by CompactSubObj go to the section
        [hhhhValue] or [hhhhName]. A record implied by CompactPDO is first written out.
        """
        described = self.objects.get(index)
        if described is None:
            raise EncodeError(f"there is no object {index:04X}h")
        set_key(self, described, described.item(sub), key, value)


def parse(data: bytes, *, strict: bool = False) -> Eds:
    """Parse the bytes of a file. With `strict`, raise EdsError if there is any diagnostic; otherwise never raise."""
    eds = Eds(decode_text(data))
    if strict and eds.diagnostics:
        raise EdsError(eds.diagnostics)
    return eds


def compose(
    objects: Iterable[EdsObject],
    file_info: Mapping[str, str] | None = None,
    device_info: Mapping[str, str] | None = None,
    *,
    comments: Iterable[str] = (),
    dummies: Iterable[int] = (),
    end: str = "\r\n",
    encoding: str = "ascii",
) -> Eds:
    """Compose a new EDS from objects.

        file_info, device_info   keys of [FileInfo] and [DeviceInfo]; missing ones are written without a value, or as 0
        comments                 lines of [Comments]
        dummies                  data types that [DummyUsage] allows as placeholders in a mapping
        end, encoding            line end and character encoding of the file

    >>> heartbeat = EdsObject(0x1017, "Producer heartbeat time", 7, (EdsItem(0, "Producer heartbeat time", "u16"),))
    >>> eds = compose([heartbeat], {"FileName": "small.eds"}, {"VendorName": "Example"})
    >>> eds.diagnostics, eds.dictionary().entry(0x1017).type
    ((), 'u16')
    """
    ordered = sorted(objects, key=lambda described: described.index)
    lines = ["[FileInfo]"]
    lines += [pair_line(key, value) for key, value in (dict.fromkeys(FILE_INFO, "") | dict(file_info or {})).items()]
    lines += ["", "[DeviceInfo]"]
    info = {key: "" if key.endswith("Name") or key == "OrderCode" else "0" for key in DEVICE_INFO}
    lines += [pair_line(key, value) for key, value in (info | dict(device_info or {})).items()]
    lines += ["", "[DummyUsage]", *(f"Dummy{code:04X}={int(code in set(dummies))}" for code in range(1, 8))]
    comments = list(comments)
    lines += ["", "[Comments]", f"Lines={len(comments)}"]
    lines += [pair_line(f"Line{number}", line) for number, line in enumerate(comments, 1)]
    for name in LISTS:
        listed = [described for described in ordered if list_name(described.index) == name]
        lines += ["", f"[{name}]", f"SupportedObjects={len(listed)}"]
        lines += [f"{number}=0x{described.index:04X}" for number, described in enumerate(listed, 1)]
        for described in listed:
            lines += object_lines(described)
    text = "".join(line + end for line in lines)
    try:
        text.encode(encoding)
    except UnicodeEncodeError as error:
        raise EncodeError(f"{error.object[error.start : error.end]!r} cannot be written in {encoding}") from None
    return Eds(EdsText(b"", encoding, text))


def to_dcf(
    eds: Eds,
    node_id: int,
    values: Mapping[tuple[int, int] | str, Expression] | None = None,
    *,
    name: str = "",
    bitrate: int | None = None,
    left_out: dict[tuple[int, int], str] | None = None,
) -> Eds:
    """Return the DCF of one device: a copy of its EDS with [DeviceComissioning] and values.

    `values` are the ParameterValues by (index, sub-index) or by name; `name` is the NodeName, `bitrate` is
    in bit/s. Raise EncodeError for an object that the EDS does not have, and a value outside of its data type or
    limits; with `left_out`, put the value there with the reason instead. A text is accepted for a number if a file may
    have it: "0x1F4", "$NODEID+0x200".
    """
    if not isinstance(eds, Eds):
        raise EncodeError(f"to_dcf: {shown(eds)}: expected an EDS, such as eds.parse returns", "eds")
    if not isinstance(values, Mapping | None):
        raise EncodeError(f"to_dcf: values {shown(values)}: expected a mapping, such as {{(0x1017, 0): 500}}", "values")
    check_node(node_id)
    dcf = eds.copy()
    _commission(dcf, node_id, name, bitrate)
    items = {(described.index, item.sub): (described, item) for described, item in every_item(eds.objects.values())}
    dictionary = eds.dictionary(node_id)
    for place, value in (values or {}).items():
        entry = dictionary.at(place)
        described, item = items[entry.index, entry.sub]
        where = f"{entry.index:04X}h:{entry.sub:02X} {item.name}"
        try:
            _check_value(item, where, value, node_id)
            set_key(dcf, described, item, "ParameterValue", value)
        except EncodeError as error:
            if left_out is None:
                if where not in str(error):
                    error.add_context(where)
                raise
            left_out[entry.index, entry.sub] = str(error)
    return dcf


def _commission(dcf: Eds, node_id: int, name: str, bitrate: int | None) -> None:
    """Write LastEDS and [DeviceComissioning]. What is not given stays as it is."""
    if bitrate is not None and f"BaudRate_{bitrate // 1000}" not in BAUD_RATES:
        raise EncodeError(f"{bitrate} bit/s: expected one of {', '.join(rate[9:] for rate in BAUD_RATES)} kbit/s")
    if (file_name := dcf.get("FileInfo", "FileName")) is not None:
        dcf.put("FileInfo", "LastEDS", file_name)
    settings = {"NodeID": str(node_id), "NodeName": name, "Baudrate": str(bitrate // 1000) if bitrate else ""}
    for key in COMMISSIONING:
        if key == "Baudrate" and bitrate is None:
            continue
        if settings.get(key) or dcf.get("DeviceComissioning", key) is None:
            missing = "0" if key in ("NetNumber", "CANopenManager", "LSS_SerialNumber") else ""
            dcf.put("DeviceComissioning", key, settings.get(key) or missing)


def _check_value(item: EdsItem, where: str, value: Expression, node: int) -> None:
    """Raise EncodeError for a value that is not of the data type, or outside of the limits."""
    given: Expression | None = value
    if isinstance(value, str) and item.type not in ("string", "unicode"):
        given, rules = read_value(value, item.type)
        if "bad-hex" in rules:
            given = None
    if given is None:
        raise EncodeError(f"{where} = {shown(value)}: expected a value of {item.type}", "values")
    number = given.at(node) if isinstance(given, Formula) else given
    if not isinstance(number, (int, float)):
        return
    low, high = (limit.at(node) if isinstance(limit, Formula) else limit for limit in item.limits)
    if (low is not None and number < low) or (high is not None and number > high):
        reach = f"{'' if low is None else low}..{'' if high is None else high}"
        raise EncodeError(f"{where} = {number}: expected {reach}", "values")


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
    if at_key != key and (compact := document.sections.get(section.casefold())) is not None:
        document.put(section, "NrOfEntries", str(sum(entry_number(name) is not None for name in compact.keys)))


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
    return checked_line(EdsLine("pair", "", key, "=", value)).text
