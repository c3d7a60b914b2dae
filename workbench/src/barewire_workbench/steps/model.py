"""A calculation worked out step by step, as a value: a title, its source, texts and tables, and the result.

    CRC of 02 07                                        title
    Modbus over Serial Line 1.02, 6.2.2                 source

    The register starts with all ones ...               a text

    step      register              out                 a table: caption, header, rows
    --------  --------------------  ---
    start     1111 1111 1111 1111
    ...

    CRC 1241h, sent 41 12                               result

`values` holds the result for programs. The steps are computed apart from the codecs of the package, whose results they
must reach.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple, TypeAlias

from barewire.errors import EncodeError, shown

LINE_WIDTH = 110
"""Characters of a line of text. Tables may be wider: their rows are never broken."""


class StepTable(NamedTuple):
    """A table of steps. Every row has as many cells as the header; cells keep the blanks in front of them."""

    caption: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    @property
    def right_columns(self) -> list[bool]:
        """Whether each column ends at the right: those of whole numbers do."""
        columns = list(zip(*self.rows)) or [()] * len(self.header)
        return [all(cell.isdecimal() or cell in ("", "-") for cell in cells) for cells in columns]

    def lines(self) -> list[str]:
        """Return the caption, the header, and the rows in aligned columns. Columns of whole numbers end at the right.

        >>> print(*StepTable("", ("byte", "sum"), (("02h", "2"), ("0Ah", "12"))).lines(), sep="\\n")
        byte  sum
        ----  ---
        02h     2
        0Ah    12
        """
        columns = list(zip(self.header, *self.rows))
        widths = [max(map(len, cells)) for cells in columns]
        to_right = self.right_columns
        rules = tuple("-" * width for width in widths)
        lines = [*textwrap.wrap(self.caption, LINE_WIDTH), ""] if self.caption else []
        for row in (self.header, rules, *self.rows):
            cells = (
                cell.rjust(width) if right else cell.ljust(width) for cell, width, right in zip(row, widths, to_right)
            )
            lines.append("  ".join(cells).rstrip())
        return lines

    def as_dict(self) -> dict[str, object]:
        """Return the table for `json.dumps`."""
        return {"caption": self.caption, "header": list(self.header), "rows": [list(row) for row in self.rows]}


StepSection: TypeAlias = str | StepTable
"""A text in one line, which is wrapped when it is shown, or a table."""


@dataclass(frozen=True, slots=True)
class Steps:
    """A calculation: `subject` is the name of the command, `sections` are texts and tables in reading order.

    `result` is the last line. `values` has it for programs, with texts, numbers, lists, True, False and None only.
    """

    subject: str
    title: str
    source: str
    sections: tuple[StepSection, ...]
    result: str
    values: Mapping[str, object] = field(default_factory=dict)

    def __repr__(self) -> str:
        return f"<Steps {self.subject}: {self.result}>"

    @property
    def tables(self) -> list[StepTable]:
        """The tables alone."""
        return [section for section in self.sections if isinstance(section, StepTable)]

    def lines(self) -> list[str]:
        """Return the calculation as lines of text, with an empty line between sections."""
        lines = [self.title, *textwrap.wrap(self.source, LINE_WIDTH)]
        for section in self.sections:
            wrapped = section.lines() if isinstance(section, StepTable) else textwrap.wrap(section, LINE_WIDTH)
            lines += ["", *wrapped]
        return [*lines, "", *textwrap.wrap(self.result, LINE_WIDTH)]

    def as_dict(self) -> dict[str, object]:
        """Return the calculation for `json.dumps`: a section is {"text"} or {"caption", "header", "rows"}."""
        return {
            "subject": self.subject,
            "title": self.title,
            "source": self.source,
            "sections": [
                section.as_dict() if isinstance(section, StepTable) else {"text": section} for section in self.sections
            ],
            "result": self.result,
            "values": dict(self.values),
        }


def grouped_bits(number: int, width: int) -> str:
    """Return the bits of a number in groups of four, the highest first.

    >>> grouped_bits(0xA001, 16), grouped_bits(5, 6)
    ('1010 0000 0000 0001', '00 0101')
    """
    digits = f"{number:0{width}b}"
    first = len(digits) % 4
    groups = [digits[place : place + 4] for place in range(first, len(digits), 4)]
    return " ".join([digits[:first], *groups] if first else groups)


def spaced_hex(data: Iterable[int]) -> str:
    """Return bytes as hexadecimal pairs with blanks between.

    >>> spaced_hex(b"\\x02\\x07")
    '02 07'
    """
    return bytes(data).hex(" ").upper()


def parse_hex_number(text: str, digits: int, name: str, example: str, field: str) -> int:
    """Return a number in hexadecimal digits, with 0x in front or h behind, or neither.

    Raises EncodeError for any other text, and for more `digits`; `name` and `field` say there what the number is.
    """
    match = re.fullmatch(rf"(?:0[xX])?([0-9a-fA-F]{{1,{digits}}})[hH]?", text.strip())
    if match is None:
        form = f"expected up to {digits} hexadecimal digits, such as {example}h or 0x{example}"
        raise EncodeError(f"{name} {shown(text)}: {form}", field)
    return int(match[1], 16)


def check_length(data: bytes, longest: int) -> None:
    """Raise EncodeError for no bytes and for more than `longest`."""
    if not 1 <= len(data) <= longest:
        raise EncodeError(f"{len(data)} bytes: expected 1..{longest}, for example 01 03 00 00 00 02")
