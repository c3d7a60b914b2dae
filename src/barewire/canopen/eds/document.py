"""The text of an EDS or DCF: lines, the sections and keys in them, and changes line by line.   [CiA 306]

        bytes --> lines --> sections: name -> keys -> positions of their lines
        bytes <-- lines <-- put, append: one line is changed, added or removed

A document is the list of its lines, and a line the tuple of its pieces: joined, they are the original bytes. A change
replaces one piece of one line; everything else stays as it is, correct or not.

        EF BB BF    ParameterName = Device type ; in words CR LF
        |           '-----------' ^ '---------' '--------' '---'
        BOM         key           | value       after      end
                                  between

The encoding is the first of UTF-16 (with its byte order mark), ASCII, UTF-8, Windows-1252 and Latin-1 that reproduces
the bytes; Latin-1 always does.

The names, of which files have other spellings too; capitals do not matter, so they are compared in lower case:

        [FileInfo] [DeviceInfo] [DummyUsage] [Comments]               heads
        [MandatoryObjects] [OptionalObjects] [ManufacturerObjects]    lists      1=0x1000
        [1018]        an object                                       [1018sub1]  one sub-index of it, in hexadecimal
        [1003Name] [1003Value] [1003Denotation]                       of sub-indices made by CompactSubObj
        [M1ModuleInfo] [M1Fixed6000] ...                              modules: kept, not read
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Literal, NamedTuple, Self

from barewire.canopen.eds.diagnostics import Diagnostic, diagnostic
from barewire.canopen.eds.value_syntax import read_integer
from barewire.errors import EncodeError

# Bytes and lines ---------------------------------------------------------------------------------------------------

Kind = Literal["blank", "comment", "section", "pair", "junk"]

_MARKS = ((b"\xef\xbb\xbf", "utf-8"), (b"\xff\xfe", "utf-16-le"), (b"\xfe\xff", "utf-16-be"))
_ENCODINGS = ("ascii", "utf-8", "cp1252", "latin-1")
_LINE = re.compile(r"[^\r\n]*(?:\r\n|\n|\r)|[^\r\n]+")
_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f]")

_CONFLICT = re.compile(r"(?:<{7}|={7}|>{7}|\|{7})(?: .*)?")  # of Git, Mercurial, Subversion
_FREE_TEXT = re.compile(r"line[0-9]+", re.IGNORECASE)  # keys of [Comments]: their text has no comments of the file


class EdsText(NamedTuple):
    """A file as text: its byte order mark, its encoding, and the text after the mark."""

    mark: bytes
    encoding: str
    text: str


def decode_text(data: bytes) -> EdsText:
    """Decode the bytes. Never raises; encoding the text reproduces the bytes.

    >>> decode_text(b"[1000]"), decode_text(b"\\xdcberlast").encoding
    (EdsText(mark=b'', encoding='ascii', text='[1000]'), 'cp1252')
    """
    mark, first = next(((mark, name) for mark, name in _MARKS if data.startswith(mark)), (b"", "ascii"))
    rest = data[len(mark) :]
    for encoding in (first, *_ENCODINGS):
        try:
            text = rest.decode(encoding)
            if text.encode(encoding) == rest:  # not so for UTF-16 with half a character at its end
                return EdsText(mark, encoding, text)
        except UnicodeError:
            continue
    raise AssertionError("latin-1 decodes every byte")


class EdsLine(NamedTuple):
    """One line in pieces. The `key` of a section is its name; other lines without a key have all text in `after`."""

    kind: Kind
    before: str = ""
    key: str = ""
    between: str = ""
    value: str = ""
    after: str = ""
    end: str = ""

    @property
    def text(self) -> str:
        """The line as it is in the file."""
        return "".join(self[1:])

    @property
    def shown(self) -> str:
        """The line for messages, without outer blanks."""
        return self.text.strip()


def split_lines(text: str) -> list[EdsLine]:
    """Return all lines of a text.

    >>> [line.kind for line in split_lines("; hello\\n\\n[1000]\\nParameterName=Device type\\n?")]
    ['comment', 'blank', 'section', 'pair', 'junk']
    """
    return [_parse_line(piece) for piece in _LINE.findall(text)]


def _parse_line(piece: str) -> EdsLine:
    """Split one line with its end into pieces."""
    body = piece.rstrip("\r\n")
    end = piece[len(body) :]
    bare = body.strip()
    if not bare:
        return EdsLine("blank", after=body, end=end)
    if _CONFLICT.fullmatch(bare):  # before the search for an equals sign, of which "=======" has seven
        return EdsLine("junk", after=body, end=end)
    if bare.startswith((";", "#", "//")):
        return EdsLine("comment", after=body, end=end)
    if bare.startswith("["):
        return _section(body, end)
    sign = "=" if "=" in body else ":"
    left, equals, right = body.partition(sign)
    # A sentence with a colon is no key; a key with a colon is one word.
    if not equals or (sign == ":" and not left.strip().isalnum()):
        return EdsLine("junk", after=body, end=end)
    key, rest = left.strip(), right.lstrip()
    value = rest[: _comment(key, rest)].rstrip()
    start = left.index(key) if key else len(left)
    between = left[start + len(key) :] + equals + right[: len(right) - len(rest)]
    return EdsLine("pair", left[:start], key, between, value, rest[len(value) :], end)


def _section(body: str, end: str) -> EdsLine:
    opened = body.index("[") + 1
    closed = body.find("]", opened)
    if closed < 0:
        closed = opened + _comment("", body[opened:])
    name = body[opened:closed].strip()
    start = body.index(name, opened)
    return EdsLine("section", body[:start], name, after=body[start + len(name) :], end=end)


def _comment(key: str, rest: str) -> int:
    """Return where the comment after a value begins: at a semicolon after a blank, since names may contain a semicolon.

    >>> _comment("ParameterName", "speed;torque ; in words")
    13
    """
    if _FREE_TEXT.fullmatch(key):
        return len(rest)
    position = rest.find(";")
    while position > 0 and not rest[position - 1].isspace():
        position = rest.find(";", position + 1)
    return len(rest) if position < 0 else position


def _text_diagnostics(text: EdsText, lines: list[EdsLine]) -> Iterator[Diagnostic]:
    """Yield the diagnostics of the text, and of each line by itself."""
    if text.mark:
        yield diagnostic(1, "byte-order-mark", text.mark.hex(" ").upper())
    first_end = next((line.end for line in lines if line.end), "")
    not_ascii = other_end = False  # both are reported once, at the first such line
    for number, line in enumerate(lines, 1):
        if not not_ascii and not line.text.isascii():
            not_ascii = True
            yield diagnostic(number, "not-ascii", f"{line.shown} ({text.encoding})")
        if not other_end and line.end and (line.end != first_end or line.end == "\r"):
            other_end = True
            yield diagnostic(number, "line-ends", line.shown)
        for rule in _broken_rules(line):
            yield diagnostic(number, rule, line.shown)


def _broken_rules(line: EdsLine) -> Iterator[str]:
    if _CONTROL.search(line.text.removesuffix(line.end)):
        yield "control-character"
    if line.kind == "junk":
        yield "conflict" if _CONFLICT.fullmatch(line.after.strip()) else "no-equals"
    elif line.kind == "comment":
        if not line.after.lstrip().startswith(";"):
            yield "foreign-comment"
        elif line.after[0].isspace():
            yield "blanks"
    elif line.kind == "section":
        yield from _broken_by_section(line)
    elif line.kind == "pair":
        yield from _broken_by_pair(line)


def _broken_by_section(line: EdsLine) -> Iterator[str]:
    if line.before != "[" or line.after[:1].isspace():
        yield "blanks"
    behind = line.after.partition("]")[2].strip()
    if "]" not in line.after:
        yield "section-open"
    elif behind:
        yield "inline-comment" if behind.startswith(";") else "behind-section"


def _broken_by_pair(line: EdsLine) -> Iterator[str]:
    if not line.key:
        yield "no-key"
    elif line.between.strip() == ":":
        yield "colon"
    elif line.before or line.between[:1] != "=":
        yield "blanks"
    if line.after.strip():
        yield "inline-comment"


def checked_line(line: EdsLine) -> EdsLine:
    """Return the line. Raise EncodeError if it would be read back as another one."""
    parsed = split_lines(line.text)
    if len(parsed) != 1 or parsed[0][:5] != line[:5]:
        text = "would not be read back unchanged: it has a line end, ' ;' or outer blanks"
        raise EncodeError(f"{line.key}={line.value!r} {text}")
    return line


# Names -------------------------------------------------------------------------------------------------------------

SectionKind = Literal["head", "list", "object", "sub", "compact", "module", "unknown"]

FILE_INFO = [
    *("FileName", "FileVersion", "FileRevision", "EDSVersion", "Description"),
    *("CreationTime", "CreationDate", "CreatedBy", "ModificationTime", "ModificationDate", "ModifiedBy"),
]
BAUD_RATES = [f"BaudRate_{rate}" for rate in (10, 20, 50, 125, 250, 500, 800, 1000)]
DEVICE_INFO = [
    *("VendorName", "VendorNumber", "ProductName", "ProductNumber", "RevisionNumber", "OrderCode"),
    *BAUD_RATES,
    *("SimpleBootUpMaster", "SimpleBootUpSlave", "Granularity", "DynamicChannelsSupported", "GroupMessaging"),
    *("NrOfRXPDO", "NrOfTXPDO", "LSS_Supported"),
]
_OBSOLETE_KEYS = [
    *("ProductVersion", "ProductRevision", "LMT_ManufacturerName", "LMT_ProductName"),
    *("ExtendedBootUpMaster", "ExtendedBootUpSlave"),
]
"""Keys of [DeviceInfo] that older versions had [CiA 306 4.5]."""
COMMISSIONING = ["NodeID", "NodeName", "Baudrate", "NetNumber", "NetworkName", "CANopenManager", "LSS_SerialNumber"]
LISTS = ("MandatoryObjects", "OptionalObjects", "ManufacturerObjects")
OBJECT = [
    *("ParameterName", "ObjectType", "DataType", "AccessType", "LowLimit", "HighLimit", "DefaultValue", "PDOMapping"),
    *("SubNumber", "ObjFlags", "CompactSubObj", "ParameterValue", "Denotation", "UploadFile", "DownloadFile"),
    *("ParamRefd", "SRDOMapping", "InvertedSRAD"),
]

_HEADS: dict[str, list[str]] = {
    "FileInfo": [*FILE_INFO, "LastEDS"],
    "DeviceInfo": [*DEVICE_INFO, "CompactPDO", *_OBSOLETE_KEYS],
    "DeviceComissioning": [*COMMISSIONING, "NodeRefd", "NetRefd"],
    "DummyUsage": [f"Dummy{index:04X}" for index in range(1, 0x20)],
    "Comments": ["Lines"],
    "SupportedModules": ["NrOfEntries"],
    "ConnectedModules": ["NrOfEntries"],
    "DynamicChannels": ["NrOfSeg"],
    "Tools": ["Items"],
}
"""Every head with its possible keys, except numbered ones."""

TEXTS = frozenset(
    {
        *("vendorname", "productname", "ordercode", "nodename", "networkname", "noderefd", "netrefd"),
        *(key.casefold() for key in _OBSOLETE_KEYS),
    }
)
"""Keys of [DeviceInfo] and [DeviceComissioning] with text; the others have numbers."""

_COMPACT = {"name": "Name", "value": "Value", "denotation": "Denotation", "objectlinks": "ObjectLinks"}
_OBJECT = re.compile(
    r"(0x)?([0-9a-f]{1,8})(h?)\s*(?:(sub)\s*(0x)?([0-9a-f]{1,8})|(name|value|denotation|objectlinks))?", re.I
)
_MODULE = re.compile(r"m[0-9]+(moduleinfo|comments|fixed|subext).*|tool[0-9]+", re.I)
_NUMBERED = re.compile(r"([a-z]*)0*([0-9]{1,5})", re.I)
_FREE_HEADS = ("DynamicChannels", "Tools")
_HEAD_OF = {name.casefold(): name for name in _HEADS} | {"devicecommissioning": "DeviceComissioning"}
_LIST_OF = {name.casefold(): name for name in LISTS}
_OWN_SPELLINGS = {"nrofrxpdo": "NrOfRxPDO", "nroftxpdo": "NrOfTxPDO", "edsversion": "EdsVersion"}


class SectionName(NamedTuple):
    """The meaning of a section's name. `proper` is the spelling of CiA 306, `rule` the rule that another one breaks.

    Capitals break no rule: CiA 306 4.2 compares names without them.
    """

    kind: SectionKind
    proper: str
    rule: str = ""
    object: int = 0
    sub: int = 0
    part: str = ""

    @property
    def key(self) -> str:
        """The name for comparisons, in lower case."""
        return self.proper.casefold()

    def other_capitals(self, name: str) -> bool:
        """Return whether a name differs from the proper one in capitals only; hexadecimal digits may have either."""
        if name.casefold() != self.key or self.kind == "object":
            return False
        word = "sub" if self.kind == "sub" else self.part
        return word not in name if word else name != self.proper


def section_name(name: str) -> SectionName:
    """Return the meaning of a name between brackets.

    >>> section_name("1018Sub1")
    SectionName(kind='sub', proper='1018sub1', rule='', object=4120, sub=1, part='')
    >>> section_name("DeviceCommissioning").proper
    'DeviceComissioning'
    """
    folded = name.casefold()
    head, listed = _HEAD_OF.get(folded), _LIST_OF.get(folded)
    if head:
        return SectionName("head", head, "" if folded == head.casefold() else "section-form")
    if listed:
        return SectionName("list", listed)
    match = _OBJECT.fullmatch(name)
    # A short name must have a digit, or [Add] would be an object.
    if match and (len(match[2]) >= 4 or any(letter.isdigit() for letter in match[2])):
        return _object(name, match)
    return SectionName("module" if _MODULE.fullmatch(name) else "unknown", name)


def _object(name: str, match: re.Match[str]) -> SectionName:
    index, sub = int(match[2], 16), int(match[6] or "0", 16)
    if index > 0xFFFF or sub > 0xFF:
        return SectionName("unknown", name, "sub-range")
    part = _COMPACT.get((match[7] or "").casefold(), "")
    kind: SectionKind = "sub" if match[4] else "compact" if part else "object"
    proper = f"{index:04X}" + (f"sub{sub:X}" if match[4] else part)
    rule = "" if name.casefold() == proper.casefold() else "section-form"
    return SectionName(kind, proper, rule, index, sub, part)


class KeyName(NamedTuple):
    """The meaning of a key: its proper spelling, whether its section defines it, the rule that the spelling breaks, and
    whether it differs in capitals only."""

    proper: str
    known: bool
    rule: str = ""
    capitals: bool = False

    @property
    def key(self) -> str:
        """The name for comparisons, in lower case."""
        return self.proper.casefold()


def key_name(section: SectionName, key: str) -> KeyName:
    """Return the meaning of a key of that section.

    >>> key_name(section_name("1018"), "subnumber")
    KeyName(proper='SubNumber', known=True, rule='', capitals=True)
    >>> key_name(section_name("OptionalObjects"), "Supported Objects")
    KeyName(proper='SupportedObjects', known=True, rule='key-form', capitals=False)
    """
    folded = "".join(key.casefold().split())
    proper = _keys_of(section).get(folded)
    if proper:
        if folded != key.casefold():
            return KeyName(proper, True, "key-form")
        return KeyName(proper, True, "", key not in (proper, _OWN_SPELLINGS.get(folded)))
    wanted = "Line" if section.proper == "Comments" else ""
    number = _NUMBERED.fullmatch("".join(key.split()))
    if number and number[1].casefold() == wanted.casefold() and section.kind in ("head", "list", "compact"):
        proper = f"{wanted}{int(number[2])}"
        same = key.casefold() == proper.casefold()
        return KeyName(proper, True, "" if same else "key-form", same and key != proper)
    return KeyName(key, section.kind == "module" or section.proper in _FREE_HEADS)


def entry_number(key: str) -> int | None:
    """Return the number of a numbered key in lower case, None for a name.

    >>> entry_number("12"), entry_number("lines"), entry_number("²")
    (12, None, None)
    """
    return int(key) if len(key) < 6 and key.isascii() and key.isdigit() else None


_OBJECT_KEYS = {key.casefold(): key for key in OBJECT}
_HEAD_KEYS = {name: {key.casefold(): key for key in keys} for name, keys in _HEADS.items()}


def _keys_of(section: SectionName) -> dict[str, str]:
    if section.kind in ("object", "sub"):
        return _OBJECT_KEYS
    if section.kind == "head":
        return _HEAD_KEYS[section.proper]
    if section.kind == "list":
        return {"supportedobjects": "SupportedObjects"}
    if section.kind == "compact":
        return {"objectlinks": "ObjectLinks"} if section.part == "ObjectLinks" else {"nrofentries": "NrOfEntries"}
    return {}


# Sections ----------------------------------------------------------------------------------------------------------


class Section(NamedTuple):
    """A section: its name, the number of its head line (from 1), and the line position and the name of each key."""

    name: SectionName
    line: int
    keys: dict[str, int]
    names: dict[str, KeyName]

    def line_of(self, key: str) -> int:
        """Return the line of a key, or that of the section if it has no such key."""
        position = self.keys.get(key.casefold())
        return self.line if position is None else position + 1


class Document:
    """The lines of a file, and the sections and keys in them."""

    __slots__ = ("_lines", "_name_diagnostics", "_sections", "_text")

    def __init__(self, text: EdsText) -> None:
        self._text = text
        self._lines: list[EdsLine] = split_lines(text.text)
        self._discard_computed()

    def _discard_computed(self) -> None:
        """Discard sections and diagnostics, because lines were changed; they are computed again when needed."""
        self._sections: dict[str, Section] | None = None
        self._name_diagnostics: list[Diagnostic] = []
        self._discard_objects()

    def _discard_objects(self) -> None:
        """Discard what `Eds` computes of the sections, because a value was changed."""

    def copy(self) -> Self:
        """Return another document with the same lines."""
        other = type(self)(self._text._replace(text=""))
        other._lines = list(self._lines)
        return other

    # Reading

    @property
    def encoding(self) -> str:
        """The encoding of the file, by its name in Python."""
        return self._text.encoding

    @property
    def lines(self) -> tuple[EdsLine, ...]:
        """All lines; the first one of the file is at position 0."""
        return tuple(self._lines)

    def encode(self) -> bytes:
        """Return the bytes of the file: as parsed, except for changed lines."""
        return self._text.mark + "".join(line.text for line in self._lines).encode(self._text.encoding)

    @property
    def diagnostics(self) -> tuple[Diagnostic, ...]:
        """All diagnostics of lines, sections and keys, in the order of lines."""
        _ = self.sections  # fills `_name_diagnostics`
        return tuple(sorted({*_text_diagnostics(self._text, self._lines), *self._name_diagnostics}))

    @property
    def sections(self) -> Mapping[str, Section]:
        """The sections by their proper name in lower case: "deviceinfo", "1018sub1"."""
        if self._sections is None:
            self._name_diagnostics = []
            self._sections = {section.name.key: section for section in self._find_sections()}
        return self._sections

    def get(self, section: str, key: str) -> str | None:
        """Return the text of a key; None if it is missing. Capitals do not matter in either name."""
        named = self.sections.get(section_name(section).key)
        return None if named is None else self.value(named, key_name(named.name, key).key)

    def value(self, section: Section, key: str) -> str | None:
        """Return the text of a key, given in lower case, of a section; None if it is missing."""
        position = section.keys.get(key)
        return None if position is None else self._lines[position].value

    @property
    def node_id(self) -> int | None:
        """The node-ID of [DeviceComissioning]; None if it is missing or not in 1..127."""
        number = read_integer(self.get("DeviceComissioning", "NodeID") or "").value
        return number if number is not None and 1 <= number <= 127 else None

    @property
    def dummies(self) -> frozenset[int]:
        """The data types that [DummyUsage] allows as placeholders in a mapping."""
        section = self.sections.get("dummyusage")
        return frozenset(
            int(key.removeprefix("dummy"), 16)
            for key, name in (section.names.items() if section else ())
            if name.known and read_integer(self.get("DummyUsage", key) or "").value == 1
        )

    # Changing

    def put(self, section: str, key: str, value: str | None) -> None:
        """Set the text of a key: in its line, or in a new one at the end of the section, which is added if missing.

        None removes the key. Raise EncodeError for a text that would not be read back unchanged.
        """
        name = section_name(section)
        present = self.sections.get(name.key)
        new_key = key_name(present.name if present else name, key)
        position = None if present is None else present.keys.get(new_key.key)
        if value is None:
            while position is not None:  # the key may occur more than once
                del self._lines[position]
                self._discard_computed()
                position = self.sections[name.key].keys.get(new_key.key)
        elif position is not None:
            old = self._lines[position]
            after = f" {old.after}" if old.after.startswith(";") else old.after  # a comment needs a blank before it
            self._lines[position] = self._checked(old._replace(value=value, after=after))
            self._discard_objects()
        else:
            end = self._line_end()
            new = self._checked(EdsLine("pair", "", new_key.proper, "=", value, "", end))
            if present is None:
                head = self._checked(EdsLine("section", "[", name.proper, after="]", end=end))
                gap = [EdsLine("blank", end=end)] if self._lines else []
                self._insert(len(self._lines), [*gap, head, new])
                self._discard_computed()
            else:
                position = max([present.line, *(line + 1 for line in present.keys.values())])
                self._insert(position, [new])
                self._move_down(position)
                self._add_key(self.sections[name.key], position, new)
                self._discard_objects()

    def _move_down(self, position: int) -> None:
        """Follow a line that was inserted."""
        # Without this, all sections would be found anew for each of the hundreds of lines that a DCF gets.
        sections = {}
        for key, section in self.sections.items():
            keys = {name: line + (line >= position) for name, line in section.keys.items()}
            sections[key] = Section(section.name, section.line + (section.line > position), keys, section.names)
        self._sections = sections
        self._name_diagnostics = [
            finding._replace(line=finding.line + (finding.line > position)) for finding in self._name_diagnostics
        ]

    def append(self, lines: Iterable[str]) -> None:
        """Add lines at the end of the file, with the line end that the file has."""
        end = self._line_end()
        self._insert(len(self._lines), [self._checked(line) for text in lines for line in split_lines(text + end)])
        self._discard_computed()

    def _line_end(self) -> str:
        return next((line.end for line in self._lines if line.end), "\r\n")

    def _insert(self, position: int, new: list[EdsLine]) -> None:
        """Insert lines before the one at `position`; a last line without an end gets one."""
        if position and not self._lines[position - 1].end:
            self._lines[position - 1] = self._lines[position - 1]._replace(end=self._line_end())
        self._lines[position:position] = new

    def _checked(self, line: EdsLine) -> EdsLine:
        try:
            line.text.encode(self._text.encoding)
        except UnicodeEncodeError:
            encoding = self._text.encoding
            raise EncodeError(f"{line.value!r} cannot be written in {encoding}, the encoding of the file") from None
        return checked_line(line)

    def _find_sections(self) -> Iterable[Section]:
        """Return every section once. A later section of the same name adds its keys to the first."""
        sections: dict[str, Section] = {}
        current: Section | None = None
        for position, line in enumerate(self._lines):
            if line.kind == "section":
                name = section_name(line.key)
                if name.rule:
                    self._report(position, name.rule, f"[{line.key}]")
                if name.key in sections:
                    self._report(position, "duplicate-section", f"[{line.key}]")
                current = sections.setdefault(name.key, Section(name, position + 1, {}, {}))
            elif line.kind == "pair" and line.key:
                if current is None:
                    self._report(position, "no-section", line.shown)
                else:
                    self._add_key(current, position, line)
        return sections.values()

    def _add_key(self, section: Section, position: int, line: EdsLine) -> None:
        name = key_name(section.name, line.key)
        if name.rule:
            self._report(position, name.rule, f"[{section.name.proper}] {line.key}")
        if name.key in section.keys:
            self._report(position, "duplicate-key", f"[{section.name.proper}] {line.key}={line.value}")
        else:
            section.keys[name.key] = position
            section.names[name.key] = name

    def _report(self, position: int, rule: str, shown: str) -> None:
        self._name_diagnostics.append(diagnostic(position + 1, rule, shown))
