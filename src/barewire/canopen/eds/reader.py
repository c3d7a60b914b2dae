"""Read objects from the sections of a document.   [CiA 306]

        own sections [hhhh] [hhhhsubN]  --.
        CompactSubObj, [hhhhName]       ---+--> EdsObject
        CompactPDO, NrOfRxPDO           --'

Each object is read in the order of doubt: its section, the object type, the data type, then the values of that type.
What the file does not state clearly gets a defined reading, and a diagnostic with the line where it should be.

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

from collections.abc import Iterator
from dataclasses import replace

from barewire.canopen.datatypes import BY_CODE
from barewire.canopen.eds.diagnostics import Diagnostic, diagnostic
from barewire.canopen.eds.document import Document, Section
from barewire.canopen.eds.model import (
    ARRAY,
    DEFSTRUCT,
    DEFTYPE,
    DOMAIN,
    MAPPABLE,
    RECORD,
    VAR,
    EdsAccess,
    EdsItem,
    EdsObject,
)
from barewire.canopen.eds.section_names import LISTS, TEXTS, entry_number
from barewire.canopen.eds.value_syntax import Expression, Formula, read_integer, read_value, strip_comment

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
_PDOS = 512
_NOT_USED = 0x8000_0000  # bit 31 of a COB-ID
_PDO_KINDS = (("RPDO", "nrofrxpdo", 0x1400, 0x200), ("TPDO", "nroftxpdo", 0x1800, 0x180))
_COMMUNICATION = (
    ("COB-ID", "u32", 0x07),
    ("Transmission type", "u8", 0x05),
    ("Inhibit time", "u16", 0x06),
    ("Compatibility entry", "u8", 0x05),
    ("Event timer", "u16", 0x06),
    ("SYNC start value", "u8", 0x05),
)


def read_objects(document: Document, found: list[Diagnostic]) -> dict[int, EdsObject]:
    """All objects of a document, in the order of their indices. Diagnostics are added to `found`."""
    reader = _Reader(document, found)
    objects = {index: reader.object(index) for index in sorted(reader.indices)}
    reader.check_heads()
    reader.check_lists(objects)
    for implied in reader.implied_pdos(objects):
        objects[implied.index] = implied
    return dict(sorted(objects.items()))


class _Reader:
    """Reads the objects of one document; adds diagnostics to `found`."""

    def __init__(self, document: Document, found: list[Diagnostic]) -> None:
        self.document = document
        self._found = found
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
        """Report a broken rule at the line of a key, or at the head of the section without that key."""
        at = section.keys.get(key)
        text = f"[{section.name.proper}]"
        if at is not None:
            text += f" {section.names[key].proper} = {self.document.lines[at].value}"
        self._found.append(diagnostic(section.line if at is None else at + 1, rule, text))

    def text(self, section: Section, key: str) -> str:
        """The text of a key in lower case, empty without it."""
        return self.document.value(section, key) or ""

    def number(self, section: Section | None, key: str, missing: int = 0) -> int:
        """The integer of a key."""
        if section is None or key not in section.keys:
            return missing
        value, rules = read_integer(self.text(section, key))
        for rule in rules:
            if rule != "empty" or key not in _OPTIONAL:
                self.report(section, key, rule)
        return missing if value is None else value

    def value(self, section: Section, key: str, type: str) -> Expression | None:
        """The value of a key, of a data type."""
        if key not in section.keys:
            return None
        reading = read_value(self.text(section, key), type)
        for rule in reading.rules:
            self.report(section, key, rule)
        return reading.value

    def value_unchecked(self, section: Section, key: str, type: str) -> Expression | None:
        """As `value`, without diagnostics."""
        return read_value(self.text(section, key), type).value if key in section.keys else None

    # Objects

    def object(self, index: int) -> EdsObject:
        """One object with its sub-indices."""
        section = self.document.sections.get(f"{index:04x}")
        subs = dict(sorted(self.subs.get(index, {}).items()))
        if section is None:
            first = next(iter(subs.values()))
            self.report(first, "", "no-parent")
            items = tuple(self.item(sub, one) for sub, one in subs.items())
            return EdsObject(index, f"{index:04X}h", RECORD, items, first.line)
        kind = self.kind(section)
        name = self.name(section)
        self.number(section, "subnumber")
        compact = min(max(self.number(section, "compactsubobj"), 0), 0xFE)
        if subs and kind not in (ARRAY, RECORD, DEFSTRUCT, DEFTYPE):
            if "objecttype" in section.keys:
                self.report(section, "objecttype", "subs-of-variable")
            kind = RECORD
        if compact and kind == VAR:
            self.report(section, "compactsubobj", "compact-variable")
            kind = ARRAY
        if compact and kind in (ARRAY, RECORD):
            if subs:
                self.report(section, "compactsubobj", "compact-and-subs")
            implied = {item.sub: item for item in self.compact_items(section, compact)}
            own = {sub: self.item(sub, one) for sub, one in subs.items()}
            items = tuple(item for _, item in sorted((implied | own).items()))
            return EdsObject(index, name, kind, items, section.line, compact=True)
        if kind in (ARRAY, RECORD) and not subs:
            self.report(section, "objecttype", "no-subs")
            kind = VAR
        if subs:
            if 0 not in subs and kind in (ARRAY, RECORD):
                self.report(section, "", "no-sub0")
            return EdsObject(index, name, kind, tuple(self.item(sub, one) for sub, one in subs.items()), section.line)
        return EdsObject(index, name, kind, (self.item(0, section),), section.line)

    def kind(self, section: Section) -> int:
        """The object type; without one VAR [CiA 306], or RECORD if there are sub-indices."""
        kind = self.number(section, "objecttype", VAR)
        if kind not in (DOMAIN, DEFTYPE, DEFSTRUCT, VAR, ARRAY, RECORD):
            self.report(section, "objecttype", "bad-object-type")
            return VAR
        return kind

    def name(self, section: Section) -> str:
        """The ParameterName, or the name of the section."""
        name = self.text(section, "parametername")
        if not name:
            self.report(section, "parametername", "no-name")
        return name or section.name.proper

    def item(self, sub: int, section: Section) -> EdsItem:
        """The description of one sub-index in its section."""
        kind = self.kind(section)
        if section.name.kind == "sub" and kind not in (VAR, DOMAIN):
            self.report(section, "objecttype", "sub-type")
            kind = VAR
        code, type = self.data_type(section, kind)
        # The form of a value of an unknown type is unknown, and the unknown type is reported already.
        value = self.value if code in BY_CODE or type != "domain" or kind == DOMAIN else self.value_unchecked
        low, high = self.limits(section, type)
        return EdsItem(
            sub,
            self.name(section),
            type,
            self.access(section, kind),
            value(section, "defaultvalue", type),
            low,
            high,
            self.number(section, "pdomapping") != 0,
            value(section, "parametervalue", type),
            self.text(section, "denotation"),
            self.number(section, "objflags"),
            code,
            kind,
        )

    def data_type(self, section: Section, kind: int) -> tuple[int, str]:
        """The number of the data type, and the type; for a number above 1Bh the file may have a DEFTYPE."""
        if "datatype" not in section.keys:
            if kind not in (DOMAIN, DEFTYPE, DEFSTRUCT):
                self.report(section, "", "no-data-type")
            return 0, "domain" if kind not in (DEFTYPE, DEFSTRUCT) else "u32"
        code = self.number(section, "datatype")
        if code in BY_CODE:
            return code, BY_CODE[code].name
        base = self._base_type(code)
        self.report(section, "datatype", "own-data-type" if base else "bad-data-type")
        return code, BY_CODE[base].name if base else "domain"

    def _base_type(self, code: int) -> int:
        """The base type of a DEFTYPE, 0 if unknown. CanFestival writes it as the default of sub-index 1."""
        if not 0 <= code < _TYPES_END:
            return 0
        section = self.document.sections.get(f"{code:04x}sub1")
        base = read_integer(self.text(section, "defaultvalue")).value if section else None
        return base if base in BY_CODE else 0

    def access(self, section: Section, kind: int) -> EdsAccess:
        """The access right; a DOMAIN needs none."""
        text = self.text(section, "accesstype")
        if "accesstype" not in section.keys:
            if kind not in (DOMAIN, DEFTYPE, DEFSTRUCT):
                self.report(section, "", "no-access")
            return "rw" if kind == DOMAIN else "ro"
        bare, comments = strip_comment(text)
        word = "".join(bare.casefold().replace("-", " ").split())
        access = _ACCESS.get(word) or _ACCESS_WORDS.get(word)
        for rule in comments:
            self.report(section, "accesstype", rule)
        if access != bare:
            self.report(section, "accesstype", "bad-access" if access is None else "access-form")
        return access or "ro"

    def limits(self, section: Section, type: str) -> tuple[int | float | Formula | None, int | float | Formula | None]:
        """LowLimit and HighLimit of numbers."""
        if type not in _NUMBERS:
            return None, None
        low, high = (self._limit(section, key, type) for key in ("lowlimit", "highlimit"))
        if isinstance(low, (int, float)) and isinstance(high, (int, float)) and low > high:
            self.report(section, "lowlimit", "limits-crossed")
            return None, None
        return low, high

    def _limit(self, section: Section, key: str, type: str) -> int | float | Formula | None:
        limit = self.value(section, key, type)
        if isinstance(limit, tuple):
            return limit
        return limit if isinstance(limit, (int, float)) else None

    # Compact storage

    def compact_items(self, section: Section, highest: int) -> Iterator[EdsItem]:
        """The sub-indices that CompactSubObj makes: they differ in name, value and denotation only."""
        like = self.item(1, section)
        names = self._compact_texts(section, "name", highest)
        values = self._compact_texts(section, "value", highest)
        denotations = self._compact_texts(section, "denotation", highest)
        yield EdsItem(0, "NrOfObjects", "u8", "ro", highest, code=0x05)
        for sub in range(1, highest + 1):
            key = str(sub)
            value: Expression | None = like.value
            if key in values and (found := self.document.sections.get(f"{section.name.key}value")):
                value = self.value(found, key, like.type)
            name = names.get(key) or f"{like.name}{sub}"
            yield replace(like, object_type=VAR, sub=sub, name=name, value=value, denotation=denotations.get(key, ""))

    def _compact_texts(self, section: Section, part: str, highest: int) -> dict[str, str]:
        """The texts of [hhhhName], [hhhhValue] or [hhhhDenotation], by sub-index."""
        found = self.document.sections.get(f"{section.name.key}{part}")
        if found is None:
            return {}
        self.number(found, "nrofentries")
        texts = {}
        for key in found.keys:
            sub = entry_number(key)
            if sub is not None and not 1 <= sub <= highest:
                self.report(found, key, "compact-entry")
            elif sub is not None:
                texts[key] = self.text(found, key)
        return texts

    def implied_pdos(self, objects: dict[int, EdsObject]) -> Iterator[EdsObject]:
        """The PDO records that CompactPDO implies: those without a section, up to the stated number of PDOs."""
        info = self.document.sections.get("deviceinfo")
        mask = self.number(info, "compactpdo") & 0x3F
        for name, key, first, cob_id in _PDO_KINDS:
            wanted = min(max(self.number(info, key), 0), _PDOS)
            if not mask:
                continue
            own = [number for number in range(_PDOS) if first + number in objects or first + 0x200 + number in objects]
            free = [number for number in range(_PDOS) if number not in own][: max(wanted - len(own), 0)]
            for number in sorted([*own, *free]):
                if first + number not in objects:
                    default = Formula(cob_id + 0x100 * number) if number < 4 else _NOT_USED
                    yield _communication_record(first + number, name, mask, default)
                if first + 0x200 + number not in objects:
                    yield _mapping_record(first + 0x200 + number, name)

    # Checks

    def check_heads(self) -> None:
        """Check the numbers in [DeviceInfo] and the other heads."""
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
                text = f"[{index:04X}]"
                self._found.append(diagnostic(described.line, "not-listed", text))


def _communication_record(index: int, name: str, mask: int, cob_id: Expression) -> EdsObject:
    """The communication record with the sub-indices whose bit is set in the mask."""
    items = [EdsItem(0, "Highest sub-index supported", "u8", "const", mask.bit_length(), code=0x05)]
    for bit, (what, type, code) in enumerate(_COMMUNICATION):
        if mask >> bit & 1:
            items.append(EdsItem(bit + 1, what, type, "rw", cob_id if bit == 0 else None, code=code))
    return EdsObject(index, f"{name} communication parameter", RECORD, tuple(items))


def _mapping_record(index: int, name: str, entries: int = 64) -> EdsObject:
    """The mapping record with room for `entries`."""
    items = [EdsItem(0, "Number of mapped objects", "u8", "rw", 0, code=0x05)]
    items += [EdsItem(sub, f"Application object {sub}", "u32", "rw", 0, code=0x07) for sub in range(1, entries + 1)]
    return EdsObject(index, f"{name} mapping parameter", RECORD, tuple(items))
