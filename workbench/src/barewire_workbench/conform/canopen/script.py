"""Reads conformance cases of CANopen devices from the fields of the vectors, kind `device-conformance`.

    {"name": "NMT-02", "comment": "stop: SDO is silent", "clause": "CiA 301 7.2.8 NMT", "effect": "commands",
     "steps": [{"send": ["000#02<00+node>"], "wait": 20000},
               {"send": ["<600+node>#4000100000000000"], "wait": 100000}]}

    step          frames that are sent, and the patterns of accepted responses; a loop over steps; a whole SDO transfer
    condition     what the device must have (1017h, 1016h:02, TPDO ...), or "<...> is ..." between two texts
    placeholder   a value of the device:

        <600+node>#40<1018:01/4>        605#4060030000      node 5, whose vendor-ID is 0000 0360h
        <00+node>                       05                  a sum has as many digits as its first number
        <rpdo.word|80000000/4>          05020080            /4: as four bytes, the lowest first
        <..*tpdo.size>                  ....                two dots for each byte that the TPDO maps

vectors/kinds/device-conformance.md has the fields, the names and the rules.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cached_property
from typing import Any, Literal, TypeAlias, get_args

from barewire.canopen.cob_ids import CobEntry
from barewire.canopen.sdo.messages import SEGMENT
from barewire.errors import EncodeError, shown
from barewire_workbench.conform.canopen.model import (
    SILENCE,
    Effect,
    NodeCase,
    NodeStep,
    Sdo,
    Subject,
    SubjectPdo,
    block_end,
    block_segment,
    little,
    make_case,
    parts,
    provides,
    segment,
    silence,
)

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
        while term := _TERM.match(expression, at):
            if bool(term[1]) != (at > 0):
                break
            value, at = _OPERATIONS[term[1]](value, self._term(term[2])), term.end()
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


# Transfers ----------------------------------------------------------------------------------------------------------


BlockPart = Literal["begun", "sent", "ended", "done"]
"""How far a block upload goes: its start, its blocks, the end that the device sends, the answer to that."""
NO_BLOCKS = 0x0504_0001


def upload_steps(s: Sdo, place: str, value: bytes, count: int | None = None) -> list[NodeStep]:
    """Return the steps that read a value in segments; with `count` only the first ones. `place` is a multiplexer."""
    pieces = parts(value)
    begin = s.response(f"41{place}{little(len(value), 4)}"), s.response(f"40{place}")
    segments = [
        NodeStep((s.request("70" if number & 1 else "60"),), (s.response(segment(number, piece, piece is pieces[-1])),))
        for number, piece in enumerate(pieces)
    ]
    return [NodeStep((s.request(f"40{place}"),), begin), *segments[:count]]


def download_steps(
    s: Sdo, place: str, value: bytes, count: int | None = None, *, size: int | None = None
) -> list[NodeStep]:
    """Return the steps that write a value in segments; with `count` only the first ones. `size` is announced."""
    pieces = parts(value)
    announced = little(len(value) if size is None else size, 4)
    segments = [
        NodeStep((s.request(segment(number, piece, piece is pieces[-1])),), (s.response("30" if number & 1 else "20"),))
        for number, piece in enumerate(pieces)
    ]
    return [NodeStep((s.request(f"21{place}{announced}"),), (s.response(f"60{place}"),)), *segments[:count]]


def block_upload_steps(
    s: Sdo, place: str, value: bytes, *, crc: bool = True, blksize: int = 20, until: BlockPart = "done"
) -> list[NodeStep]:
    """Return the steps that read a value in blocks of `blksize` segments."""
    sized = s.response(f"C[26]{place}{little(len(value), 4)}")
    request = s.request(f"{'A4' if crc else 'A0'}{place}{blksize:02X}00")
    steps = [NodeStep((request,), (f"{sized}|{s.response(f'C[04]{place}')}",), (s.aborted(NO_BLOCKS),))]
    count, first, sends = len(parts(value)), 1, "A3"
    while first <= count:
        last = min(first + blksize - 1, count)
        steps.append(block_step(s, s.request(sends), value, first, last))
        first, sends = last + 1, f"A2{last - first + 1:02X}{blksize:02X}"
    ends = s.response(block_end(value, 0))
    end = NodeStep((s.request(sends),), (f"{s.response(block_end(value))}|{ends}" if crc else ends,))
    whole = [*steps, end, silence(s.request("A1"), wait=0.02)]
    return whole[: {"begun": 1, "sent": -2, "ended": -1, "done": None}[until]]


def block_step(s: Sdo, request: str, value: bytes, first: int, last: int) -> NodeStep:
    """Return the step that sends a request and expects the segments `first` to `last` of a value, numbered from 1."""
    pieces = parts(value)
    frames = [
        s.response(block_segment(number - first + 1, pieces[number - 1], number == len(pieces)))
        for number in range(first, min(last, len(pieces)) + 1)
    ]
    return NodeStep((request,), (", ".join(frames),))


def block_download_steps(s: Sdo, place: str, value: bytes) -> list[NodeStep]:
    """Return the steps that write a value in one block with a CRC."""
    pieces = parts(value)
    begin = s.request(f"C6{place}{little(len(value), 4)}")
    sends = [s.request(block_segment(number, piece, piece is pieces[-1])) for number, piece in enumerate(pieces, 1)]
    return [
        NodeStep((begin,), (s.response(f"A[04]{place}"),), (s.aborted(NO_BLOCKS),)),
        NodeStep(tuple(sends), (s.response(f"A2{len(pieces):02X}"),)),
        NodeStep((s.request(block_end(value)),), (s.response("A1"),)),
    ]


# Cases --------------------------------------------------------------------------------------------------------------


CaseFields: TypeAlias = Mapping[str, Any]

_NAME = re.compile("[A-Z]{2,3}-[0-9]{2}")
_RESPONSES = ("<580+node>#",)


def applies(fields: CaseFields, device: Placeholders) -> bool:
    """Return whether a case is for this kind of device: other devices do not have it."""
    return _holds(fields, device)


def read_node_case(fields: CaseFields, device: Placeholders) -> NodeCase:
    """Return the case that these fields describe, for one device. Raise EncodeError for fields that cannot be read."""
    name, effect = fields["name"], fields["effect"]
    if not _NAME.fullmatch(name):
        raise EncodeError(f"name {shown(name)}: expected letters, a hyphen and two digits, such as SDO-01", "name")
    if effect not in get_args(Effect):
        raise EncodeError(f"effect {shown(effect)}: expected one of {', '.join(get_args(Effect))}", "effect")
    return make_case(
        device.subject,
        fields.get("clause", ""),
        tuple(map(device.fill, fields.get("listens", _RESPONSES))),
        name,
        device.fill(fields.get("comment", "")),
        *_steps(fields["steps"], device),
        effect=effect,
        needs=tuple(map(device.fill, fields.get("needs", ()))),
        why=fields.get("why", ""),
    )


def _steps(rows: list[CaseFields], device: Placeholders) -> Iterator[NodeStep]:
    for row in rows:
        if "each" in row:
            for inner in device.each(row["each"], _numbers(row["in"], device)):
                yield from _steps(row["steps"], inner) if _holds(row, inner) else ()
        elif _holds(row, device):
            yield from _transfer(row, device) if "transfer" in row else (_step(row, device),)


def _numbers(ranges: list[str], device: Placeholders) -> Iterator[int]:
    """Yield the numbers of ranges such as 000-07F, or of single numbers, in hexadecimal digits."""
    for text in map(device.fill, ranges):
        first, _, last = text.partition("-")
        yield from range(int(first, 16), int(last or first, 16) + 1)


def _holds(row: CaseFields, device: Placeholders) -> bool:
    return all(_is_true(device.fill(condition), device) for condition in row.get("if", ()))


def _is_true(condition: str, device: Placeholders) -> bool:
    left, word, right = condition.partition(" is ")
    if word:
        return (left != right.removeprefix("not ")) if right.startswith("not ") else left == right
    if condition.startswith("no "):
        return not provides(device.subject, condition.removeprefix("no "))
    return provides(device.subject, condition)


def _step(row: CaseFields, device: Placeholders) -> NodeStep:
    sends = tuple(map(device.fill, row.get("send", ())))
    wait = row.get("wait")
    return NodeStep(
        sends,
        tuple(map(device.fill, row.get("accept", (SILENCE,)))),
        tuple(map(device.fill, row.get("ends", ()))),
        None if wait is None else wait / 1e6,
        row.get("whole", False),
    )


def _transfer(row: CaseFields, device: Placeholders) -> list[NodeStep]:
    s = Sdo(device.subject.node)
    if row["of"] == "text":
        place, (_, value) = device.fill("<text.index/2>00"), device.subject.text_object
    else:
        place, value = device.fill(row["of"]), bytes.fromhex(device.fill(row["value"]))
    match row["transfer"]:
        case "upload":
            return upload_steps(s, place, value, row.get("segments"))
        case "download":
            return download_steps(s, place, value, row.get("segments"), size=row.get("size"))
        case "block upload":
            options = {name: row[name] for name in ("crc", "blksize", "until") if name in row}
            return block_upload_steps(s, place, value, **options)
        case "block segments":
            (request,) = map(device.fill, row["send"])
            return [block_step(s, request, value, row.get("from", 1), row.get("to", 127))]
        case "block download":
            return block_download_steps(s, place, value)
    expected = "upload, download, block upload, block segments or block download"
    raise EncodeError(f"transfer {shown(row['transfer'])}: expected {expected}", "transfer")
