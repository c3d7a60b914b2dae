"""The explanation of a frame, a value: its fields byte by byte, and a verdict.

    offset  hex     name            value         meaning
       0    01      unit            1             unit 1
       2    0F B1   address         0FB1h (4017)  0-based; number 4018 in 1-based tables

**Every byte is in exactly one field, in order, however broken the frame is.** Bytes outside the known fields are a
field called "left over". A field of length 0 covers no byte: the identifier of a CAN frame, which is not part of its
data, or a line end that was not typed.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, NamedTuple

from barewire.codecs import Field
from barewire.errors import DecodeError, Reason
from barewire_workbench.frames.findings import Finding

ProtocolName = Literal["rtu", "ascii", "tcp", "can"]
FrameRole = Literal["request", "response"]

LEFT_OVER = "left over"
_HEX_SHOWN = 8
"""The most bytes of a field in `lines`; `as_dict` has all of them."""

# Fields that are never read in decimal. All other numbers are shown in both bases where they differ.
_IN_HEX_ONLY = frozenset({"LRC", "COB-ID", "command", "index", "abort code", "error code", "error register"})


class ExplainedField(NamedTuple):
    """One field: its place, name, bytes, value and meaning.

    `offset` and `length` count bytes, or characters in an ASCII frame. `hex` has the bytes as hexadecimal pairs, or the
    characters of an ASCII frame. `value` is a number, a text, or None if the field is incomplete.
    """

    offset: int
    length: int
    name: str
    hex: str
    value: int | str | None
    meaning: str

    @property
    def shown(self) -> str:
        """The value as `lines` shows it: numbers above 9 in both bases; empty if it equals `hex`.

        >>> ExplainedField(2, 2, "address", "0F B1", 4017, "").shown
        '0FB1h (4017)'
        """
        if self.value is None or self.value == self.hex:
            return ""
        if isinstance(self.value, str):
            return repr(self.value) if self.name.endswith("value") else self.value
        if self.name == "CRC":
            return ""  # sent low byte first: as a number its bytes would be in another order than in `hex`
        digits = f"{self.value:0{len(self.hex.replace(' ', ''))}X}h"
        if self.name in _IN_HEX_ONLY:
            return digits
        return str(self.value) if self.value < 10 else f"{digits} ({self.value})"


class Problem(NamedTuple):
    """The reason why a frame is not valid: a `barewire.errors.Reason`, the offset of the first wrong byte, a text."""

    reason: Reason
    at: int
    text: str


@dataclass(frozen=True, slots=True)
class Explanation:
    """The explanation of one frame. `error` is None exactly when the frame is valid.

    `summary` is the message in one line; the verdict shows it only if the frame is valid. `diagnosis` has what is wrong
    in the words of an engineer, the likeliest finding first; it is empty for a good frame, and where nothing is proved.
    `notes` has what a good frame may mean otherwise.
    """

    protocol: ProtocolName
    role: FrameRole | None
    fields: tuple[ExplainedField, ...]
    error: Problem | None
    summary: str
    diagnosis: tuple[Finding, ...] = ()
    notes: tuple[Finding, ...] = ()

    def __repr__(self) -> str:
        return f"<Explanation {self.protocol}: {self.verdict}>"

    @property
    def valid(self) -> bool:
        """Whether the frame is complete, intact, and allowed by the standard."""
        return self.error is None

    @property
    def verdict(self) -> str:
        """The last line: valid, or why not."""
        if self.error is None:
            return f"valid: {self.summary}"
        unit = "character" if self.protocol == "ascii" else "byte"
        return f"not valid: {self.error.text} ({unit} {self.error.at})"

    def as_dict(self) -> dict[str, object]:
        """Return the explanation for `json.dumps`: only numbers, texts, lists, dicts, True, False and None."""
        names = ("offset", "length", "name", "hex", "value", "meaning")
        return {
            "protocol": self.protocol,
            "valid": self.valid,
            "role": self.role,
            "fields": [dict(zip(names, field)) for field in self.fields],
            "error": self.error._asdict() if self.error else None,
            "diagnosis": [finding._asdict() for finding in self.diagnosis],
            "notes": [note._asdict() for note in self.notes],
        }

    def lines(self) -> list[str]:
        """Return one line for each field, in columns, then the verdict and the first finding, if there is one."""
        rows = [(str(field.offset), _clipped(field.hex), field.name, field.shown) for field in self.fields]
        widths = [max((len(row[column]) for row in rows), default=0) for column in range(4)]
        lines = []
        for (offset, digits, name, value), field in zip(rows, self.fields):
            columns = f"{offset:>{widths[0]}}  {digits:<{widths[1]}}  {name:<{widths[2]}}  {value:<{widths[3]}}"
            lines.append(f"{columns}  {field.meaning}".rstrip())
        notes = (f"note: {note.text} [{note.code}]: {note.proof}" for note in self.notes)
        return [*lines, self.verdict, *(finding.line for finding in self.diagnosis[:1]), *notes]


def _clipped(digits: str) -> str:
    pairs = digits.split(" ")
    return digits if len(pairs) <= _HEX_SHOWN else " ".join(pairs[: _HEX_SHOWN - 1]) + " ..."


def fill_gaps(fields: Iterable[Field], size: int, cut: str = "") -> list[Field]:
    """Return the fields of `size` bytes, with a field for each gap between them and after the last one.

    `cut` is the name of the field after the last one, if the frame ends inside it.

    >>> [(field.offset, field.length, field.name) for field in fill_gaps([Field(0, 1, "unit", 1)], 3)]
    [(0, 1, 'unit'), (1, 2, 'left over')]
    """
    filled: list[Field] = []
    end = 0
    for field in fields:
        if field.offset > end:
            filled.append(Field(end, field.offset - end, LEFT_OVER, None))
        filled.append(field)
        end = field.offset + field.length
    if end < size:
        filled.append(Field(end, size - end, cut or LEFT_OVER, None, "cut short" if cut else ""))
    return filled


def counted(number: int, noun: str = "byte") -> str:
    """Return a number and its noun: '1 byte', '2 bytes'."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def text_error(reason: Reason, text: str, position: int, message: str) -> DecodeError:
    """Return the error for a text that cannot be read at character `position`."""
    return DecodeError(reason, text.encode("latin-1", "replace"), position, message)


def shifted(fields: Iterable[Field], offset: int) -> list[Field]:
    """Return the same fields with their offsets moved by `offset` bytes."""
    return [field._replace(offset=field.offset + offset) for field in fields]


def as_problem(error: DecodeError | None, offset: int = 0) -> Problem | None:
    """Return a decoding error as a value; `offset` is that of its bytes in the frame."""
    return None if error is None else Problem(error.reason, error.at + offset, error.text)


def explained_fields(fields: Iterable[Field], data: bytes) -> tuple[ExplainedField, ...]:
    """Return the fields with their hexadecimal digits."""
    return tuple(
        explained_field(field, data[field.offset : field.offset + field.length].hex(" ").upper()) for field in fields
    )


def explained_field(field: Field, digits: str) -> ExplainedField:
    """Return one field with its digits; underscores in its name become blanks."""
    value = field.value if field.value is None or isinstance(field.value, (int, str)) else str(field.value)
    return ExplainedField(field.offset, field.length, field.name.replace("_", " "), digits, value, field.meaning)
