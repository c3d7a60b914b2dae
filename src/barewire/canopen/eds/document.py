"""The sections and keys of an EDS or DCF file, with changes line by line.

        bytes --> lines --> sections: name -> keys -> positions of their lines
        bytes <-- lines <-- put, append: one line is changed, added or removed

The lines are the only state. Sections are computed from them on demand, and anew after a change.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple, Self

from barewire.canopen.eds.diagnostics import Diagnostic, diagnostic
from barewire.canopen.eds.lexer import EdsLine, EdsText, split_lines, text_diagnostics
from barewire.canopen.eds.section_names import KeyName, SectionName, key_name, section_name
from barewire.canopen.eds.value_syntax import read_integer
from barewire.errors import EncodeError


class Section(NamedTuple):
    """A section: its name, the number of its head line (from 1), and the line position and the name of each key."""

    name: SectionName
    line: int
    keys: dict[str, int]
    names: dict[str, KeyName]


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
        text = self._text._replace(text="".join(line.text for line in self._lines))
        return tuple(sorted({*text_diagnostics(text, self._lines), *self._name_diagnostics}))

    @property
    def sections(self) -> Mapping[str, Section]:
        """The sections by their proper name in lower case: "deviceinfo", "1018sub1"."""
        if self._sections is None:
            self._name_diagnostics = []
            self._sections = {section.name.key: section for section in self._find_sections()}
        return self._sections

    def get(self, section: str, key: str) -> str | None:
        """Return the text of a key; None if it is missing. Capitals do not matter in either name."""
        found = self.sections.get(section_name(section).key)
        return None if found is None else self.value(found, key_name(found.name, key).key)

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
        if section is None:
            return frozenset()
        known = [key for key, name in section.names.items() if name.known]
        allowed = [key for key in known if read_integer(self.value(section, key) or "").value == 1]
        return frozenset(int(key.removeprefix("dummy"), 16) for key in allowed)

    # Changing

    def put(self, section: str, key: str, value: str | None) -> None:
        """Set the text of a key: in its line, or in a new one at the end of the section, which is added if missing.

        None removes the key. Raise EncodeError for a text that would not be read back unchanged.
        """
        name = section_name(section)
        found = self.sections.get(name.key)
        new_key = key_name(found.name if found else name, key)
        position = None if found is None else found.keys.get(new_key.key)
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
            if found is None:
                head = self._checked(EdsLine("section", "[", name.proper, after="]", end=end))
                gap = [EdsLine("blank", end=end)] if self._lines else []
                self._insert(len(self._lines), [*gap, head, new])
                self._discard_computed()
            else:
                position = max([found.line, *(line + 1 for line in found.keys.values())])
                self._insert(position, [new])
                self._move_down(position)
                self._add_key(self.sections[name.key], position, new)
                self._discard_objects()

    def _move_down(self, position: int) -> None:
        """Follow a line that was inserted: a DCF gets hundreds, and to find all sections anew takes long."""
        sections = {}
        for key, section in self.sections.items():
            keys = {name: line + (line >= position) for name, line in section.keys.items()}
            sections[key] = Section(section.name, section.line + (section.line > position), keys, section.names)
        self._sections = sections
        self._name_diagnostics = [one._replace(line=one.line + (one.line > position)) for one in self._name_diagnostics]

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
        """Return the line. Raise EncodeError if it cannot be encoded, or would be read back as another line."""
        try:
            line.text.encode(self._text.encoding)
        except UnicodeEncodeError:
            encoding = self._text.encoding
            raise EncodeError(f"{line.value!r} cannot be written in {encoding}, the encoding of the file") from None
        parsed = split_lines(line.text)
        if len(parsed) != 1 or parsed[0][:5] != line[:5]:
            raise EncodeError(
                f"{line.key}={line.value!r} would not be read back: no line ends, no ' ;', no outer blanks"
            )
        return line

    def _find_sections(self) -> Iterator[Section]:
        """Return every section once. A later section of the same name adds its keys to the first."""
        found: dict[str, Section] = {}
        current: Section | None = None
        for position, line in enumerate(self._lines):
            if line.kind == "section":
                name = section_name(line.key)
                if name.rule:
                    self._report(position, name.rule, f"[{line.key}]")
                if name.key in found:
                    self._report(position, "duplicate-section", f"[{line.key}]")
                current = found.setdefault(name.key, Section(name, position + 1, {}, {}))
            elif line.kind == "pair" and line.key:
                if current is None:
                    self._report(position, "no-section", line.shown)
                else:
                    self._add_key(current, position, line)
        return iter(found.values())

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
