"""Placeholders in the cases of the vectors: values of the device under test in frames, patterns and texts.

        <600+node>#40<1018:01/4>        605#4060030000      node 5, whose vendor-ID is 0000 0360h
        <00+node>                       05                  a sum has as many digits as its first number
        <rpdo.word|80000000/4>          05020080            /4: as four bytes, the lowest first
        <..*tpdo.size>                  ....                two dots for each byte that the TPDO maps

vectors/README.md has the names and the rules, under `device-conformance`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from functools import cached_property

from barewire.canopen.cob_ids import CobEntry
from barewire.canopen.sdo.messages import SEGMENT
from barewire.errors import EncodeError, shown
from barewire_workbench.conform.canopen.model import Subject, SubjectPdo

_PLACEHOLDER = re.compile("<([^<>]+)>")
_PLACE = "(?:[0-9A-F]{4}|[a-z]+(?:[.][a-z]+)?):(?:[0-9A-F]{2}|[a-z]+)"
_TERM = re.compile(rf"([-+^|&]?)({_PLACE}|[a-z]+(?:[.][a-z]+)?|[0-9A-F]+)")
_OPERATIONS: dict[str, Callable[[int, int], int]] = {
    "": lambda _, term: term,
    "+": int.__add__,
    "-": int.__sub__,
    "^": int.__xor__,
    "|": int.__or__,
    "&": int.__and__,
}
_NUMBER = re.compile("[0-9A-F]+")


class Placeholders:
    """The values of one device by the names that placeholders use; `variable` is that of the innermost loop."""

    def __init__(self, subject: Subject, outer: Placeholders | None = None, variable: str = "", value: int = 0) -> None:
        self.subject = subject
        self._outer, self._variable, self._value = outer, variable, value
        self._filled: dict[str, str] = {}

    def __repr__(self) -> str:
        return f"Placeholders: node {self.subject.node}"

    def each(self, variable: str, values: Iterable[int]) -> Iterator[Placeholders]:
        """Yield the placeholders of each round of a loop, in which the variable has the next value."""
        return (Placeholders(self.subject, self, variable, value) for value in values)

    def fill(self, text: str) -> str:
        """Return the text with the values. Raise EncodeError for a placeholder that cannot be read."""
        if "<" not in text:
            return text
        if self._outer is not None and self._variable not in text:
            return self._outer.fill(text)
        if text not in self._filled:
            self._filled[text] = _PLACEHOLDER.sub(lambda found: self._text(found[1]), text)
        return self._filled[text]

    def _text(self, words: str) -> str:
        unit, star, repeated = words.partition("*")
        if star:
            return unit * self.number(repeated)
        expression, _, size = words.partition("/")
        if size:
            width = int(size, 16)
            return (self.number(expression) & (1 << 8 * width) - 1).to_bytes(width, "little").hex().upper()
        first = _NUMBER.match(expression)
        if first is None:
            raise EncodeError(f"placeholder <{words}>: expected a number first, or a size such as /4", "placeholder")
        return f"{self.number(expression):0{first.end()}X}"

    def number(self, expression: str) -> int:
        """Return the value of terms between + - ^ | and &, from left to right. Raise EncodeError if it has none."""
        value, at = 0, 0
        while found := _TERM.match(expression, at):
            if bool(found[1]) != (at > 0):
                break
            value, at = _OPERATIONS[found[1]](value, self._term(found[2])), found.end()
        if at != len(expression) or not at:
            raise EncodeError(f"placeholder {shown(expression)}: expected names and numbers", "placeholder")
        return value

    def _term(self, term: str) -> int:
        if ":" in term:
            index, _, sub = term.partition(":")
            return int.from_bytes(self.subject.values.get((self._term(index), self._term(sub)), b""), "little")
        return int(term, 16) if _NUMBER.fullmatch(term) else self._named(term)

    def _named(self, name: str) -> int:
        if name == self._variable:
            return self._value
        if self._outer is not None:
            return self._outer._named(name)
        if name not in self._values:
            raise EncodeError(f"placeholder: no name {shown(name)}; expected {', '.join(self._values)}", "placeholder")
        return self._values[name]

    @cached_property
    def _values(self) -> dict[str, int]:
        subject, node = self.subject, self.subject.node
        rpdo = subject.pdo(0x1400, 0x1600) or SubjectPdo(0x1400, 0x1600, CobEntry(0x200 + node), 2, 2)
        tpdo = subject.pdo(0x1800, 0x1A00) or SubjectPdo(0x1800, 0x1A00, CobEntry(0x180 + node), 2, 2)
        (text_index, text), large = subject.text_object, subject.large or (0x2000, 0)
        segments = -(-len(text) // SEGMENT)
        values = {"node": node, "other": subject.other_node, "large.index": large[0], "large.sub": large[1]}
        values |= {"text.index": text_index, "text.size": len(text), "text.segments": segments}
        for name, span in (("servers.first", range(0x1202, 0x1280)), ("clients.first", range(0x1281, 0x1300))):
            there = (index for index in span if subject.has(index, 1) and subject.has(index, 2))
            values[name] = next(there, span[0])
        for name, pdo in (("rpdo", rpdo), ("tpdo", tpdo)):
            first = subject.number(pdo.mapping, 1) & 0xFF or 64
            values |= {
                f"{name}.record": pdo.communication,
                f"{name}.mapping": pdo.mapping,
                f"{name}.word": pdo.cob.pack(),
                f"{name}.cob": pdo.cob.identifier,
                f"{name}.size": pdo.size,
                f"{name}.toomany": 64 // first + 1,
            }
        return values
