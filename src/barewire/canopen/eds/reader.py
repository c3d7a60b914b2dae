"""Reading objects out of sections: what each key means, and what is meant where it does not say.

The order is that of doubt: is there a section, which object type, which data type, then the values of that data type.
Every answer that the file does not give clearly is a diagnostic with the line where it should have stood.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from barewire.canopen.datatypes import BY_CODE
from barewire.canopen.eds.diagnostics import Diagnostic, diagnostic
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

if TYPE_CHECKING:
    from barewire.canopen.eds.document import Document, Section

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
"""Numbers that may be missing, and so may be empty as well [CiA 306 4.3]."""
_TYPES_END = 0x1000


class Reader:
    """One reading of a document; what is odd is added to `found`."""

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

    def say(self, section: Section, key: str, rule: str) -> None:
        """Report a rule at the line of a key, or at the head of the section if the key is not there."""
        at = section.keys.get(key)
        text = f"[{section.name.proper}]"
        if at is not None:
            text += f" {section.names[key].proper} = {self.document.lines[at].value}"
        self._found.append(diagnostic(section.line if at is None else at + 1, rule, text))

    def text(self, section: Section, key: str) -> str:
        """The text behind a folded key, empty if there is none."""
        return self.document.value(section, key) or ""

    def number(self, section: Section | None, key: str, missing: int = 0) -> int:
        """An integer behind a key."""
        if section is None or key not in section.keys:
            return missing
        value, rules = read_integer(self.text(section, key))
        for rule in rules:
            if rule != "empty" or key not in _OPTIONAL:
                self.say(section, key, rule)
        return missing if value is None else value

    def value(self, section: Section, key: str, type: str) -> Expression | None:
        """A value of a data type behind a key."""
        if key not in section.keys:
            return None
        reading = read_value(self.text(section, key), type)
        for rule in reading.rules:
            self.say(section, key, rule)
        return reading.value

    def unjudged(self, section: Section, key: str, type: str) -> Expression | None:
        """As `value`, with nothing to say about its form."""
        return read_value(self.text(section, key), type).value if key in section.keys else None

    # Objects

    def object(self, index: int) -> EdsObject:
        """One object with its sub-indices."""
        from barewire.canopen.eds.compact import compact_items

        section = self.document.sections.get(f"{index:04x}")
        subs = dict(sorted(self.subs.get(index, {}).items()))
        if section is None:
            first = next(iter(subs.values()))
            self.say(first, "", "no-parent")
            items = tuple(self.item(sub, one) for sub, one in subs.items())
            return EdsObject(index, f"{index:04X}h", RECORD, items, first.line)
        kind = self.kind(section)
        name = self.name(section)
        self.number(section, "subnumber")
        compact = min(max(self.number(section, "compactsubobj"), 0), 0xFE)
        if subs and kind not in (ARRAY, RECORD, DEFSTRUCT, DEFTYPE):
            if "objecttype" in section.keys:
                self.say(section, "objecttype", "subs-of-variable")
            kind = RECORD
        if compact and kind == VAR:
            self.say(section, "compactsubobj", "compact-variable")
            kind = ARRAY
        if compact and kind in (ARRAY, RECORD):
            if subs:
                self.say(section, "compactsubobj", "compact-and-subs")
            made = {item.sub: item for item in compact_items(self, section, compact)}
            told = {sub: self.item(sub, one) for sub, one in subs.items()}
            items = tuple(item for _, item in sorted((made | told).items()))
            return EdsObject(index, name, kind, items, section.line, compact=True)
        if kind in (ARRAY, RECORD) and not subs:
            self.say(section, "objecttype", "no-subs")
            kind = VAR
        if subs:
            if 0 not in subs and kind in (ARRAY, RECORD):
                self.say(section, "", "no-sub0")
            return EdsObject(index, name, kind, tuple(self.item(sub, one) for sub, one in subs.items()), section.line)
        return EdsObject(index, name, kind, (self.item(0, section),), section.line)

    def kind(self, section: Section) -> int:
        """The object type; one that is missing is VAR [CiA 306], or RECORD if there are sub-indices."""
        kind = self.number(section, "objecttype", VAR)
        if kind not in (DOMAIN, DEFTYPE, DEFSTRUCT, VAR, ARRAY, RECORD):
            self.say(section, "objecttype", "bad-object-type")
            return VAR
        return kind

    def name(self, section: Section) -> str:
        """The ParameterName, or the place."""
        name = self.text(section, "parametername")
        if not name:
            self.say(section, "parametername", "no-name")
        return name or section.name.proper

    def item(self, sub: int, section: Section) -> EdsItem:
        """What one section tells of one sub-index."""
        kind = self.kind(section)
        if section.name.kind == "sub" and kind not in (VAR, DOMAIN):
            self.say(section, "objecttype", "sub-type")
            kind = VAR
        code, type = self.data_type(section, kind)
        # Nobody knows in which form a value of an unknown type stands, so that has been said once and is enough.
        value = self.value if code in BY_CODE or type != "domain" or kind == DOMAIN else self.unjudged
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
        """The number of the data type, and the type; a number beyond 1Bh may have a DEFTYPE in the file."""
        if "datatype" not in section.keys:
            if kind not in (DOMAIN, DEFTYPE, DEFSTRUCT):
                self.say(section, "", "no-data-type")
            return 0, "domain" if kind not in (DEFTYPE, DEFSTRUCT) else "u32"
        code = self.number(section, "datatype")
        if code in BY_CODE:
            return code, BY_CODE[code].name
        base = self._base_type(code)
        self.say(section, "datatype", "own-data-type" if base else "bad-data-type")
        return code, BY_CODE[base].name if base else "domain"

    def _base_type(self, code: int) -> int:
        """What a DEFTYPE is made of, 0 if nobody says it. CanFestival writes it as the default of sub-index 1."""
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
                self.say(section, "", "no-access")
            return "rw" if kind == DOMAIN else "ro"
        bare, comments = strip_comment(text)
        word = "".join(bare.casefold().replace("-", " ").split())
        access = _ACCESS.get(word) or _ACCESS_WORDS.get(word)
        for rule in comments:
            self.say(section, "accesstype", rule)
        if access != bare:
            self.say(section, "accesstype", "bad-access" if access is None else "access-form")
        return access or "ro"

    def limits(self, section: Section, type: str) -> tuple[int | float | Formula | None, int | float | Formula | None]:
        """LowLimit and HighLimit, for what has an order."""
        if type not in _NUMBERS:
            return None, None
        low, high = (self._limit(section, key, type) for key in ("lowlimit", "highlimit"))
        if isinstance(low, (int, float)) and isinstance(high, (int, float)) and low > high:
            self.say(section, "lowlimit", "limits-crossed")
            return None, None
        return low, high

    def _limit(self, section: Section, key: str, type: str) -> int | float | Formula | None:
        limit = self.value(section, key, type)
        if isinstance(limit, tuple):
            return limit
        return limit if isinstance(limit, (int, float)) else None

    # Heads and lists

    def heads(self) -> None:
        """The numbers of the heads."""
        for name in ("deviceinfo", "devicecomissioning", "dummyusage"):
            section = self.document.sections.get(name)
            for key, name_of in section.names.items() if section else ():
                if name_of.known and key not in TEXTS:
                    self.number(section, key)
        self.number(self.document.sections.get("comments"), "lines")

    def lists(self, objects: dict[int, EdsObject]) -> None:
        """Hold the three lists against the objects: each object in one of them, each index a section."""
        listed: set[int] = set()
        for name in LISTS:
            section = self.document.sections.get(name.casefold())
            for key in section.keys if section else ():
                if section is None or entry_number(key) is None:
                    continue
                index = self.number(section, key, -1)
                if index in listed:
                    self.say(section, key, "listed-twice")
                elif index >= 0 and index not in objects:
                    self.say(section, key, "no-object")
                listed.add(index)
            self.number(section, "supportedobjects")
        for index, described in objects.items():
            if index not in listed and index >= _TYPES_END and described.line:
                text = f"[{index:04X}]"
                self._found.append(diagnostic(described.line, "not-listed", text))
