"""The objects of an EDS: read from the sections of a document, and made into an object dictionary.   [CiA 306]

        [1018]     ObjectType=9 ParameterName=Identity       EdsObject(1018h, "Identity", 9, items)
        [1018sub1] DataType=7 ParameterName=Vendor-ID            '-- EdsItem(1, "Vendor-ID", "u32", ...)
                                                                        '-- Entry(1018h, 1, ...) of the dictionary

        own sections [hhhh] [hhhhsubN]  --.
        CompactSubObj, [hhhhName]       ---+--> EdsObject
        CompactPDO, NrOfRxPDO           --'

An object is read in this order: its section, the object type, the data type, then the values of that type. Whatever
the file does not state clearly gets a defined reading, and a diagnostic with the line where it should be.

Compact storage describes sub-indices and PDO records without a section for each:

        [1003]                          1003h:00   NrOfObjects        UNSIGNED8, 8
        ParameterName=Error             1003h:01   first              as the object, with its name and a number,
        ObjectType=8                    1003h:02   Error2             or the name in [1003Name]
        DataType=7                      ...
        CompactSubObj=8                 1003h:08   Error8
        [1003Name] NrOfEntries=1  1=first          [1003Value] ParameterValue  [1003Denotation] Denotation

        [DeviceInfo]
        CompactPDO=0x13    bit k: communication records have sub-index k+1; here 1, 2 and 5
        NrOfRXPDO=4        the number of RPDOs: those without a section are added, with 64 mapping entries

A sub-index that has a section of its own is read from there.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Literal

from barewire.canopen.cob_ids import check_node
from barewire.canopen.datatypes import BY_CODE, object_codec
from barewire.canopen.eds.diagnostics import Diagnostic, diagnostic
from barewire.canopen.eds.document import LISTS, TEXTS, Document, Section, entry_number
from barewire.canopen.eds.value_syntax import Expression, Formula, read_integer, read_value, strip_comment
from barewire.canopen.object_dictionary import Entry, ObjectAccess, ObjectDictionary
from barewire.codecs import Value
from barewire.errors import EncodeError

DOMAIN, DEFTYPE, DEFSTRUCT, VAR, ARRAY, RECORD = 2, 5, 6, 7, 8, 9
"""Object types, without NULL (0)."""

EdsAccess = Literal["ro", "wo", "rw", "rwr", "rww", "const"]
Limit = int | float | Formula | None

MAPPABLE: dict[EdsAccess, tuple[Literal["RPDO", "TPDO"], ...]] = {
    "ro": ("TPDO",),
    "const": ("TPDO",),
    "rwr": ("TPDO",),
    "wo": ("RPDO",),
    "rww": ("RPDO",),
    "rw": ("RPDO", "TPDO"),
}
"""The PDOs that an object of this access may be mapped to, if it may be mapped."""
REFUSES_WRITE, REFUSES_READ = 1, 2
"""The bits of ObjFlags: a configuration must not write the object; a scan of all objects must not read it [CiA 306]."""


@dataclass(frozen=True, slots=True)
class EdsItem:
    """The description of one sub-index of an object. `code` is the number of DataType, `type` its meaning."""

    sub: int
    name: str
    type: str
    access: EdsAccess = "rw"
    default: Expression | None = None
    low: Limit = None
    high: Limit = None
    pdo: bool = False
    value: Expression | None = None
    denotation: str = ""
    flags: int = 0
    code: int = 0
    object_type: int = VAR

    @property
    def limits(self) -> tuple[Limit, Limit]:
        """The lowest and the highest value."""
        return self.low, self.high


@dataclass(frozen=True, slots=True)
class EdsObject:
    """One object; a variable has one item, sub-index 0. `line` is that of its section, 0 if CompactPDO implies it."""

    index: int
    name: str
    object_type: int
    items: tuple[EdsItem, ...]
    line: int = 0
    compact: bool = False

    def __repr__(self) -> str:
        entries = f"{len(self.items)} entr{'y' if len(self.items) == 1 else 'ies'}"
        return f"<EdsObject {self.index:04X}h {self.name}: {entries}>"

    @property
    def is_record(self) -> bool:
        """Whether the object has sub-indices."""
        return self.object_type in (ARRAY, RECORD, DEFSTRUCT)

    def item(self, sub: int = 0) -> EdsItem:
        """Return the item of a sub-index. Raise EncodeError if there is none."""
        for item in self.items:
            if item.sub == sub:
                return item
        raise EncodeError(f"{self.index:04X}h {self.name} has no sub-index {sub:02X}h")


def every_item(objects: Iterable[EdsObject]) -> Iterator[tuple[EdsObject, EdsItem]]:
    """Yield all items that have a value. Items of DEFTYPE and DEFSTRUCT have none: they describe types."""
    for described in objects:
        if described.object_type not in (DEFTYPE, DEFSTRUCT):
            for item in described.items:
                yield described, item


def to_dictionary(objects: Iterable[EdsObject], node: int | None) -> ObjectDictionary:
    """Return the object dictionary of a node, with each ParameterValue as the present value.

    Raise EncodeError if `node` is None and a formula needs it.
    """
    if node is not None:
        check_node(node)
    items = list(every_item(objects))
    dictionary = ObjectDictionary(_entry(described, item, node) for described, item in items)
    for described, item in items:
        value = _evaluated(item.value, described.index, item.sub, node)
        if value is not None and _fits(value, item.type):
            dictionary.set(described.index, item.sub, value)
    return dictionary


def _entry(described: EdsObject, item: EdsItem, node: int | None) -> Entry:
    place = described.index, item.sub
    default = _evaluated(item.default, *place, node)
    low, high = _evaluated(item.low, *place, node), _evaluated(item.high, *place, node)
    access: ObjectAccess = "rw" if item.access == "rwr" or item.access == "rww" else item.access
    return Entry(
        *place,
        item.name,
        item.type,
        access,
        default if default is not None and _fits(default, item.type) else 0,
        low if isinstance(low, (int, float)) else None,
        high if isinstance(high, (int, float)) else None,
        object_name=described.name if described.is_record else "",
        mappable=MAPPABLE[item.access] if item.pdo else (),
    )


def _evaluated(value: Expression | None, index: int, sub: int, node: int | None) -> Value | None:
    if not isinstance(value, Formula):
        return value
    if node is None:
        raise EncodeError(f"{index:04X}h:{sub:02X} is {value}: a node-ID is needed")
    return value.at(node)


def _fits(value: Value, type: str) -> bool:
    try:
        object_codec(type).encode(value)
    except EncodeError:
        return False
    return True


# Reading -----------------------------------------------------------------------------------------------------------

_ACCESS: dict[str, EdsAccess] = {access: access for access in MAPPABLE}
_NUMBERS = frozenset(
    {f"i{bits}" for bits in range(8, 65, 8)} | {f"u{bits}" for bits in range(8, 65, 8)} | {"f32", "f64"}
)
_ACCESS_WORDS: dict[str, EdsAccess] = {
    **dict.fromkeys(("r", "readonly", "read"), "ro"),
    **dict.fromkeys(("w", "writeonly", "write"), "wo"),
    **dict.fromkeys(("r/w", "wr", "readwrite", "read/write", "readandwrite"), "rw"),
    "constant": "const",
}
_OPTIONAL = frozenset({"objecttype", "pdomapping", "subnumber", "objflags", "compactsubobj", "compactpdo"})
"""Keys with numbers that may be missing, and so may be empty as well [CiA 306 4.3]."""
_TYPES_END = 0x1000
_PDOS_MAX = 512  # of each direction
_NOT_USED = 0x8000_0000  # bit 31 of a COB-ID
_PDOS = (("RPDO", "nrofrxpdo", 0x1400, 0x200), ("TPDO", "nroftxpdo", 0x1800, 0x180))
_COMMUNICATION = (
    ("COB-ID", "u32", 0x07),
    ("Transmission type", "u8", 0x05),
    ("Inhibit time", "u16", 0x06),
    ("Compatibility entry", "u8", 0x05),
    ("Event timer", "u16", 0x06),
    ("SYNC start value", "u8", 0x05),
)


def read_objects(document: Document, findings: list[Diagnostic]) -> dict[int, EdsObject]:
    """Return all objects of a document, in the order of their indices. Diagnostics are added to `findings`."""
    reader = _Reader(document, findings)
    objects = {index: reader.object(index) for index in sorted(reader.indices)}
    reader.check_heads()
    reader.check_lists(objects)
    for implied in reader.implied_pdos(objects):
        objects[implied.index] = implied
    return dict(sorted(objects.items()))


class _Reader:
    def __init__(self, document: Document, findings: list[Diagnostic]) -> None:
        self.document = document
        self._findings = findings
        self.subs: dict[int, dict[int, Section]] = {}
        self.indices: set[int] = set()
        for section in document.sections.values():
            name = section.name
            if name.kind in ("object", "sub"):
                self.indices.add(name.object)
            if name.kind == "sub":
                self.subs.setdefault(name.object, {})[name.sub] = section

    # Single keys

    def report(self, section: Section, key: str, rule: str) -> None:
        """Report a broken rule at the line of a key, or at the head of a section that lacks the key."""
        text = f"[{section.name.proper}]"
        if key in section.keys:
            text += f" {section.names[key].proper} = {self.text(section, key)}"
        self._findings.append(diagnostic(section.line_of(key), rule, text))

    def text(self, section: Section, key: str) -> str:
        """Return the text of a key, given in lower case; empty if the key is missing."""
        return self.document.value(section, key) or ""

    def number(self, section: Section | None, key: str, missing: int = 0) -> int:
        if section is None or key not in section.keys:
            return missing
        value, rules = read_integer(self.text(section, key))
        for rule in rules:
            if rule != "empty" or key not in _OPTIONAL:
                self.report(section, key, rule)
        return missing if value is None else value

    def value(self, section: Section, key: str, type: str, *, reports: bool = True) -> Expression | None:
        """Return the value of a key, read as a data type; None if the key is missing."""
        if key not in section.keys:
            return None
        reading = read_value(self.text(section, key), type)
        for rule in reading.rules if reports else ():
            self.report(section, key, rule)
        return reading.value

    # Objects

    def object(self, index: int) -> EdsObject:
        section = self.document.sections.get(f"{index:04x}")
        subs = dict(sorted(self.subs.get(index, {}).items()))
        if section is None:
            first = next(iter(subs.values()))
            self.report(first, "", "no-parent")
            return EdsObject(index, f"{index:04X}h", RECORD, self.items(subs), first.line)
        compact = min(max(self.number(section, "compactsubobj"), 0), 0xFE)
        object_type = self.type_of_object(section, subs, compact)
        name = self.name(section)
        self.number(section, "subnumber")  # only checked: the sections themselves say which sub-indices there are
        if compact and object_type in (ARRAY, RECORD):
            if subs:
                self.report(section, "compactsubobj", "compact-and-subs")
            # In this order, because sections of sub-indices take precedence.
            items = {item.sub: item for item in (*self.compact_items(section, compact), *self.items(subs))}
            ordered = tuple(items[sub] for sub in sorted(items))
            return EdsObject(index, name, object_type, ordered, section.line, compact=True)
        if not subs:
            return EdsObject(index, name, object_type, (self.item(0, section),), section.line)
        if 0 not in subs and object_type in (ARRAY, RECORD):
            self.report(section, "", "no-sub0")
        return EdsObject(index, name, object_type, self.items(subs), section.line)

    def type_of_object(self, section: Section, subs: dict[int, Section], compact: int) -> int:
        """Return the object type that agrees with the sub-indices of the file."""
        object_type = self.object_type(section)
        if subs and object_type not in (ARRAY, RECORD, DEFSTRUCT, DEFTYPE):
            if "objecttype" in section.keys:
                self.report(section, "objecttype", "subs-of-variable")
            object_type = RECORD
        if compact and object_type == VAR:
            self.report(section, "compactsubobj", "compact-variable")
            object_type = ARRAY
        if object_type in (ARRAY, RECORD) and not subs and not compact:
            self.report(section, "objecttype", "no-subs")
            object_type = VAR
        return object_type

    def items(self, subs: dict[int, Section]) -> tuple[EdsItem, ...]:
        return tuple(self.item(sub, section) for sub, section in subs.items())

    def object_type(self, section: Section) -> int:
        object_type = self.number(section, "objecttype", VAR)  # VAR is the default of CiA 306
        if object_type not in (DOMAIN, DEFTYPE, DEFSTRUCT, VAR, ARRAY, RECORD):
            self.report(section, "objecttype", "bad-object-type")
            return VAR
        return object_type

    def name(self, section: Section) -> str:
        name = self.text(section, "parametername")
        if not name:
            self.report(section, "parametername", "no-name")
        return name or section.name.proper

    def item(self, sub: int, section: Section) -> EdsItem:
        object_type = self.object_type(section)
        if section.name.kind == "sub" and object_type not in (VAR, DOMAIN):
            self.report(section, "objecttype", "sub-type")
            object_type = VAR
        code, type = self.data_type(section, object_type)
        # The form of a value of an unknown type is unknown, and the unknown type is reported already.
        reports = code in BY_CODE or type != "domain" or object_type == DOMAIN
        low, high = self.limits(section, type)
        return EdsItem(
            sub,
            self.name(section),
            type,
            self.access(section, object_type),
            self.value(section, "defaultvalue", type, reports=reports),
            low,
            high,
            self.number(section, "pdomapping") != 0,
            self.value(section, "parametervalue", type, reports=reports),
            self.text(section, "denotation"),
            self.number(section, "objflags"),
            code,
            object_type,
        )

    def data_type(self, section: Section, object_type: int) -> tuple[int, str]:
        """Return the number of the data type, and the type; for a number above 1Bh the file may have a DEFTYPE."""
        if "datatype" not in section.keys:
            if object_type not in (DOMAIN, DEFTYPE, DEFSTRUCT):
                self.report(section, "", "no-data-type")
            return 0, "domain" if object_type not in (DEFTYPE, DEFSTRUCT) else "u32"
        code = self.number(section, "datatype")
        if code in BY_CODE:
            return code, BY_CODE[code].name
        base = self._base_type(code)
        self.report(section, "datatype", "own-data-type" if base else "bad-data-type")
        return code, BY_CODE[base].name if base else "domain"

    def _base_type(self, code: int) -> int:
        """Return the base type of a DEFTYPE, 0 if unknown."""
        if not 0 <= code < _TYPES_END:
            return 0
        # CiA 306 has no place for it; CanFestival writes it as the default of sub-index 1.
        section = self.document.sections.get(f"{code:04x}sub1")
        base = read_integer(self.text(section, "defaultvalue")).value if section else None
        return base if base in BY_CODE else 0

    def access(self, section: Section, object_type: int) -> EdsAccess:
        text = self.text(section, "accesstype")
        if "accesstype" not in section.keys:
            if object_type not in (DOMAIN, DEFTYPE, DEFSTRUCT):
                self.report(section, "", "no-access")
            return "rw" if object_type == DOMAIN else "ro"
        bare, comments = strip_comment(text)
        word = "".join(bare.casefold().replace("-", " ").split())
        access = _ACCESS.get(word) or _ACCESS_WORDS.get(word)
        for rule in comments:
            self.report(section, "accesstype", rule)
        if access != bare:
            self.report(section, "accesstype", "bad-access" if access is None else "access-form")
        return access or "ro"

    def limits(self, section: Section, type: str) -> tuple[Limit, Limit]:
        if type not in _NUMBERS:
            return None, None
        low, high = (self._limit(section, key, type) for key in ("lowlimit", "highlimit"))
        if isinstance(low, (int, float)) and isinstance(high, (int, float)) and low > high:
            self.report(section, "lowlimit", "limits-crossed")
            return None, None
        return low, high

    def _limit(self, section: Section, key: str, type: str) -> Limit:
        limit = self.value(section, key, type)
        return limit if isinstance(limit, (int, float, Formula)) else None

    # Compact storage

    def compact_items(self, section: Section, highest: int) -> Iterator[EdsItem]:
        """Yield the sub-indices that CompactSubObj makes. They differ in name, value and denotation only."""
        like = self.item(1, section)
        names = self._compact_texts(section, "name", highest)
        values = self._compact_texts(section, "value", highest)
        denotations = self._compact_texts(section, "denotation", highest)
        yield EdsItem(0, "NrOfObjects", "u8", "ro", highest, code=0x05)
        for sub in range(1, highest + 1):
            key = str(sub)
            value: Expression | None = like.value
            if key in values and (own_values := self.document.sections.get(f"{section.name.key}value")):
                value = self.value(own_values, key, like.type)
            name = names.get(key) or f"{like.name}{sub}"
            yield replace(like, object_type=VAR, sub=sub, name=name, value=value, denotation=denotations.get(key, ""))

    def _compact_texts(self, section: Section, part: str, highest: int) -> dict[str, str]:
        """Return the texts of [hhhhName], [hhhhValue] or [hhhhDenotation], by sub-index."""
        texts_section = self.document.sections.get(f"{section.name.key}{part}")
        if texts_section is None:
            return {}
        self.number(texts_section, "nrofentries")
        texts = {}
        for key in texts_section.keys:
            sub = entry_number(key)
            if sub is not None and not 1 <= sub <= highest:
                self.report(texts_section, key, "compact-entry")
            elif sub is not None:
                texts[key] = self.text(texts_section, key)
        return texts

    def implied_pdos(self, objects: dict[int, EdsObject]) -> Iterator[EdsObject]:
        """Yield the PDO records without a section that CompactPDO implies, up to the stated number of PDOs."""
        info = self.document.sections.get("deviceinfo")
        mask = self.number(info, "compactpdo") & 0x3F
        for direction, key, first, cob_id in _PDOS:
            count = min(max(self.number(info, key), 0), _PDOS_MAX)  # read, and so checked, without a mask too
            if not mask:
                continue
            has_record = [first + number in objects or first + 0x200 + number in objects for number in range(_PDOS_MAX)]
            missing = count - sum(has_record)
            for number in range(_PDOS_MAX):
                if not has_record[number]:
                    missing -= 1
                    if missing < 0:
                        continue
                if first + number not in objects:
                    default = Formula(cob_id + 0x100 * number) if number < 4 else _NOT_USED
                    yield _communication_record(first + number, direction, mask, default)
                if first + 0x200 + number not in objects:
                    yield _mapping_record(first + 0x200 + number, direction)

    # Checks

    def check_heads(self) -> None:
        for name in ("deviceinfo", "devicecomissioning", "dummyusage"):
            section = self.document.sections.get(name)
            for key, name_of in section.names.items() if section else ():
                if name_of.known and key not in TEXTS:
                    self.number(section, key)
        self.number(self.document.sections.get("comments"), "lines")

    def check_lists(self, objects: dict[int, EdsObject]) -> None:
        """Check that each object is in one of the three lists, and that each listed index has a section."""
        listed: set[int] = set()
        for name in LISTS:
            section = self.document.sections.get(name.casefold())
            for key in section.keys if section else ():
                if section is None or entry_number(key) is None:
                    continue
                index = self.number(section, key, -1)
                if index in listed:
                    self.report(section, key, "listed-twice")
                elif index >= 0 and index not in objects:
                    self.report(section, key, "no-object")
                listed.add(index)
            self.number(section, "supportedobjects")
        for index, described in objects.items():
            if index not in listed and index >= _TYPES_END and described.line:
                self._findings.append(diagnostic(described.line, "not-listed", f"[{index:04X}]"))


def _communication_record(index: int, direction: str, mask: int, cob_id: Expression) -> EdsObject:
    """Return the communication record with the sub-indices whose bit is set in the mask."""
    items = [EdsItem(0, "Highest sub-index supported", "u8", "const", mask.bit_length(), code=0x05)]
    for bit, (name, type, code) in enumerate(_COMMUNICATION):
        if mask >> bit & 1:
            items.append(EdsItem(bit + 1, name, type, "rw", cob_id if bit == 0 else None, code=code))
    return EdsObject(index, f"{direction} communication parameter", RECORD, tuple(items))


def _mapping_record(index: int, direction: str) -> EdsObject:
    items = [EdsItem(0, "Number of mapped objects", "u8", "rw", 0, code=0x05)]
    items += [EdsItem(sub, f"Application object {sub}", "u32", "rw", 0, code=0x07) for sub in range(1, 65)]
    return EdsObject(index, f"{direction} mapping parameter", RECORD, tuple(items))
