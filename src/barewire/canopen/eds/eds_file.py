"""`Eds`: an EDS or DCF, its text and the objects that it describes.

bytes --parse--> Eds --.objects-------> EdsObject, EdsItem
                  |  --.dictionary(5)-> ObjectDictionary of node 5
bytes <--encode---'  <-.set, .put       one line is changed

compose(objects, file_info, device_info)  -> Eds    a new file
to_dcf(eds, 5, {"heartbeat time": 500})   -> Eds    the configuration of one device
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from barewire.canopen.cob_ids import check_node
from barewire.canopen.eds.diagnostics import Diagnostic, EdsError
from barewire.canopen.eds.document import Document
from barewire.canopen.eds.edit import list_name, object_lines, pair_line, set_key
from barewire.canopen.eds.lexer import EdsText, decode_text
from barewire.canopen.eds.model import EdsItem, EdsObject, every_item, to_dictionary
from barewire.canopen.eds.reader import read_objects
from barewire.canopen.eds.section_names import BAUD_RATES, COMMISSIONING, DEVICE_INFO, FILE_INFO, LISTS
from barewire.canopen.eds.value_syntax import Expression, Formula, read_value
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

        The default of `node_id` is the one in [DeviceComissioning]. Raise EncodeError if there is none and a formula
        needs it.
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
    text = list(comments)
    lines += ["", "[Comments]", f"Lines={len(text)}"]
    lines += [pair_line(f"Line{number}", line) for number, line in enumerate(text, 1)]
    for name in LISTS:
        listed = [described for described in ordered if list_name(described.index) == name]
        lines += ["", f"[{name}]", f"SupportedObjects={len(listed)}"]
        lines += [f"{number}=0x{described.index:04X}" for number, described in enumerate(listed, 1)]
        for described in listed:
            lines += object_lines(described)
    whole = "".join(line + end for line in lines)
    try:
        whole.encode(encoding)
    except UnicodeEncodeError as error:
        raise EncodeError(f"{error.object[error.start : error.end]!r} cannot be written in {encoding}") from None
    return Eds(EdsText(b"", encoding, whole))


def to_dcf(
    eds: Eds,
    node_id: int,
    values: Mapping[tuple[int, int] | str, Expression] | None = None,
    *,
    name: str = "",
    bitrate: int | None = None,
) -> Eds:
    """Return the DCF of one device: a copy of its EDS with [DeviceComissioning] and values.

    `values` are the ParameterValues by (index, sub-index) or by name; `name` is the NodeName, `bitrate` is
    in bit/s. Raise EncodeError for an object that the EDS does not have, and a value outside of its data type or
    limits. A text is accepted for a number if a file may have it: "0x1F4", "$NODEID+0x200".
    """
    if not isinstance(eds, Eds):
        raise EncodeError(f"to_dcf: {shown(eds)}: expected an EDS, such as eds.parse returns", "eds")
    if not isinstance(values, Mapping | None):
        raise EncodeError(f"to_dcf: values {shown(values)}: expected a mapping, such as {{(0x1017, 0): 500}}", "values")
    check_node(node_id)
    dcf = eds.copy()
    if bitrate is not None and f"BaudRate_{bitrate // 1000}" not in BAUD_RATES:
        raise EncodeError(f"{bitrate} bit/s: expected one of {', '.join(rate[9:] for rate in BAUD_RATES)} kbit/s")
    if (file_name := eds.get("FileInfo", "FileName")) is not None:
        dcf.put("FileInfo", "LastEDS", file_name)
    settings = {"NodeID": str(node_id), "NodeName": name, "Baudrate": str(bitrate // 1000) if bitrate else ""}
    for key in COMMISSIONING:
        if key == "Baudrate" and bitrate is None:
            continue  # not given
        if settings.get(key) or dcf.get("DeviceComissioning", key) is None:
            missing = "0" if key in ("NetNumber", "CANopenManager", "LSS_SerialNumber") else ""
            dcf.put("DeviceComissioning", key, settings.get(key) or missing)
    items = {(described.index, item.sub): (described, item) for described, item in every_item(eds.objects.values())}
    dictionary = eds.dictionary(node_id)
    for place, value in (values or {}).items():
        entry = dictionary.at(place)
        described, item = items[entry.index, entry.sub]
        where = f"{entry.index:04X}h:{entry.sub:02X} {item.name}"
        _check_value(item, where, value, node_id)
        try:
            set_key(dcf, described, item, "ParameterValue", value)
        except EncodeError as error:
            error.add_context(where)
            raise
    return dcf


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
