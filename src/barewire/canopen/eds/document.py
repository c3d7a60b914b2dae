"""An EDS or DCF as a document: lines that stay, sections that are found in them, objects that are read out of them.

        bytes --parse--> lines --> sections: name -> keys -> where their lines are --> objects --> ObjectDictionary
        bytes <-encode-- lines <-- put, remove: one line changes, or one comes, or one goes

The lines are the only truth. Sections and objects are read out of them when asked for, and again after a change.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, NamedTuple

from barewire.canopen.eds.diagnostics import Diagnostic, EdsError, diagnostic
from barewire.canopen.eds.lexer import EdsLine, EdsText, decode_text, split_lines, text_diagnostics
from barewire.canopen.eds.section_names import KeyName, SectionName, key_name, section_name
from barewire.canopen.eds.value_syntax import read_integer
from barewire.errors import EncodeError

if TYPE_CHECKING:
    from barewire.canopen.eds.model import EdsObject
    from barewire.canopen.eds.value_syntax import Expression
    from barewire.canopen.object_dictionary import ObjectDictionary


class Section(NamedTuple):
    """A section: what its name means, the line of its head (from 1), and its keys with the places of their lines."""

    name: SectionName
    line: int
    keys: dict[str, int]
    names: dict[str, KeyName]


class Document:
    """An EDS or DCF. `parse` makes one of bytes, `compose` one from scratch.

    >>> lines = b"[1017]", b"ParameterName = Heartbeat  ; ms", b"DataType=0x0006", b"AccessType=rw", b"DefaultValue=0"
    >>> document = parse(b"\\n".join(lines))
    >>> document.get("1017", "parametername")
    'Heartbeat'
    >>> document.set(0x1017, 0, "DefaultValue", 1000)
    >>> document.encode()[-33:]
    b'6\\nAccessType=rw\\nDefaultValue=1000'
    >>> [str(oddity) for oddity in document.diagnostics][:1]
    ['1: not-listed: [1017]: stands in none of the three lists of objects; read all the same']
    """

    __slots__ = ("_lines", "_objects", "_odd_names", "_odd_objects", "_sections", "_text")

    def __init__(self, text: EdsText) -> None:
        self._text = text
        self._lines: list[EdsLine] = split_lines(text.text)
        self._forget()

    def _forget(self) -> None:
        self._sections: dict[str, Section] | None = None
        self._objects: dict[int, EdsObject] | None = None
        self._odd_names: list[Diagnostic] = []
        self._odd_objects: list[Diagnostic] = []

    def __repr__(self) -> str:
        return f"<Document: {len(self._lines)} lines, {len(self.objects)} objects>"

    def copy(self) -> Document:
        """Another document of the same lines."""
        other = Document(self._text._replace(text=""))
        other._lines = list(self._lines)
        return other

    # What comes out

    @property
    def encoding(self) -> str:
        """The encoding of the file, as Python calls it."""
        return self._text.encoding

    @property
    def lines(self) -> tuple[EdsLine, ...]:
        """All lines, the first one of the file at 0."""
        return tuple(self._lines)

    def encode(self) -> bytes:
        """The file: the bytes that were parsed, but for the lines that were changed."""
        return self._text.mark + "".join(line.text for line in self._lines).encode(self._text.encoding)

    @property
    def diagnostics(self) -> tuple[Diagnostic, ...]:
        """Everything odd, in the order of lines."""
        self._read_objects()
        text = self._text._replace(text="".join(line.text for line in self._lines))
        return tuple(sorted({*text_diagnostics(text, self._lines), *self._odd_names, *self._odd_objects}))

    @property
    def sections(self) -> Mapping[str, Section]:
        """The sections by their folded proper name: "deviceinfo", "1018sub1"."""
        if self._sections is None:
            self._odd_names = []
            self._sections = {section.name.key: section for section in self._find_sections()}
        return self._sections

    @property
    def objects(self) -> Mapping[int, EdsObject]:
        """The objects by index, those of compact storage too."""
        return self._read_objects()

    def dictionary(self, node_id: int | None = None) -> ObjectDictionary:
        """The objects as a device has them: formulas counted out for the node, ParameterValue as the present value.

        Without a node-ID that of [DeviceComissioning] is taken. EncodeError if there is none and a formula needs it.
        """
        from barewire.canopen.eds.model import to_dictionary

        return to_dictionary(self, node_id)

    def get(self, section: str, key: str) -> str | None:
        """The text behind a key, whatever the capitals; None if there is none."""
        found = self.sections.get(section_name(section).key)
        return None if found is None else self.value(found, key_name(found.name, key).key)

    def value(self, section: Section, key: str) -> str | None:
        """The text behind a folded key of a section."""
        at = section.keys.get(key)
        return None if at is None else self._lines[at].value

    @property
    def dummies(self) -> frozenset[int]:
        """The data types that [DummyUsage] allows as placeholders in a mapping."""
        section = self.sections.get("dummyusage")
        keys = () if section is None else section.keys
        allowed = (key for key in keys if read_integer(self.get("DummyUsage", key) or "").value == 1)
        return frozenset(int(key[5:], 16) for key in allowed if section and section.names[key].known)

    # What goes in

    def put(self, section: str, key: str, value: str | None) -> None:
        """Write a text behind a key: in its line, or in a new one at the end of the section, or of a new section.

        None takes the line away. EncodeError for a text that would not be read back as it is.
        """
        name = section_name(section)
        found = self.sections.get(name.key)
        wanted = key_name(found.name if found else name, key)
        at = None if found is None else found.keys.get(wanted.key)
        if value is None:
            while at is not None:  # the same key may be there again
                del self._lines[at]
                self._forget()
                at = self.sections[name.key].keys.get(wanted.key)
        elif at is not None:
            old = self._lines[at]
            after = f" {old.after}" if old.after.startswith(";") else old.after
            self._lines[at] = self._checked(old._replace(value=value, after=after))
        else:
            end = self._line_end()
            new = self._checked(EdsLine("pair", "", wanted.proper, "=", value, "", end))
            if found is None:
                head = self._checked(EdsLine("section", "[", name.proper, after="]", end=end))
                gap = [EdsLine("blank", end=end)] if self._lines else []
                self._insert(len(self._lines), [*gap, head, new])
            else:
                self._insert(max([found.line, *(place + 1 for place in found.keys.values())]), [new])
        self._forget()

    def set(self, index: int, sub: int, key: str, value: str | Expression | None) -> None:
        """Write what is told of a variable, or of one sub-index of an object.

        A value of the object's data type is written as a number or text of it, in the form that the old one had; a
        str is written as it is. What CompactSubObj makes has its values and names in a section of their own, and a
        record that CompactPDO implies is written out first. None takes the line away.
        """
        from barewire.canopen.eds.writer import set_key

        set_key(self, index, sub, key, value)

    def append(self, lines: Iterable[str]) -> None:
        """Lines at the end of the file, with the line end that it has."""
        end = self._line_end()
        self._insert(len(self._lines), [self._checked(line) for text in lines for line in split_lines(text + end)])
        self._forget()

    def _line_end(self) -> str:
        return next((line.end for line in self._lines if line.end), "\r\n")

    def _insert(self, at: int, new: list[EdsLine]) -> None:
        """New lines before the one at `at`; the last line of a file may have no end, and gets one then."""
        if at and not self._lines[at - 1].end:
            self._lines[at - 1] = self._lines[at - 1]._replace(end=self._line_end())
        self._lines[at:at] = new

    def _checked(self, line: EdsLine) -> EdsLine:
        try:
            line.text.encode(self._text.encoding)
        except UnicodeEncodeError:
            raise EncodeError(f"{line.value!r} cannot be written in {self._text.encoding}, as the file is") from None
        again = split_lines(line.text)
        if len(again) != 1 or again[0][:5] != line[:5]:
            raise EncodeError(
                f"{line.key}={line.value!r} would not be read back: no line ends, no ' ;', no outer blanks"
            )
        return line

    # Reading

    def _read_objects(self) -> dict[int, EdsObject]:
        if self._objects is None:
            from barewire.canopen.eds.model import read_objects

            self._odd_objects = []
            self._objects = read_objects(self, self._odd_objects)
        return self._objects

    def _find_sections(self) -> Iterator[Section]:
        """Every section once; one of the same name later adds to the first."""
        found: dict[str, Section] = {}
        current: Section | None = None
        for at, line in enumerate(self._lines):
            if line.kind == "section":
                name = section_name(line.key)
                if name.rule:
                    self._say(at, name.rule, f"[{line.key}]")
                if name.key in found:
                    self._say(at, "duplicate-section", f"[{line.key}]")
                current = found.setdefault(name.key, Section(name, at + 1, {}, {}))
            elif line.kind == "pair" and line.key:
                if current is None:
                    self._say(at, "no-section", line.shown)
                else:
                    self._key(current, at, line)
        return iter(found.values())

    def _key(self, section: Section, at: int, line: EdsLine) -> None:
        name = key_name(section.name, line.key)
        if name.rule:
            self._say(at, name.rule, f"[{section.name.proper}] {line.key}")
        if name.key in section.keys:
            self._say(at, "duplicate-key", f"[{section.name.proper}] {line.key}={line.value}")
        else:
            section.keys[name.key] = at
            section.names[name.key] = name

    def _say(self, at: int, rule: str, what: str) -> None:
        self._odd_names.append(diagnostic(at + 1, rule, what))


def parse(data: bytes, *, strict: bool = False) -> Document:
    """The document that the bytes are. Never raises, unless `strict`: then EdsError for the first oddity."""
    document = Document(decode_text(data))
    if strict and document.diagnostics:
        raise EdsError(document.diagnostics)
    return document
