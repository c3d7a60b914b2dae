"""Pictures of calculations: a 32-bit value in two registers, in the four orders; the steps of any calculation as HTML.

              register 0    register 1
    ABCD       3F  8C        CC  CD        big-endian: the high word first
    CDAB       CC  CD        3F  8C        the low word first
    BADC       8C  3F        CD  CC        bytes exchanged in each register
    DCBA       CD  CC        8C  3F        little-endian

A is the most significant byte. Modbus sends a register with its high byte first [MB-APP 4.2], and does not say which
of two registers has the high word: the manual of the device has to.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from barewire.codecs import ORDERS, codec, reorder
from barewire.codecs.order import Order
from barewire.errors import EncodeError
from barewire_workbench.pictures.drawing import Drawing, Tile, xml_text
from barewire_workbench.pictures.picture import Picture
from barewire_workbench.steps.model import Steps, StepTable

TYPES = ("f32", "i32", "u32")
_TEXTS: dict[Order, str] = {
    "ABCD": "high word first",
    "CDAB": "low word first",
    "BADC": "high word first, bytes exchanged",
    "DCBA": "low word first, bytes exchanged",
}
_CELL, _HEIGHT, _GAP = 46, 40, 14


class OrderRow(NamedTuple):
    """One order: the four bytes as they lie in the registers, the letter of each, and the value that they are."""

    order: Order
    data: bytes
    value: int | float


class RegistersPicture(Picture):
    """Four bytes in two registers from `address` on, in each order. Make one with `of_value` or `of_bytes`."""

    kind = "registers"
    links = len("ABCD")

    def __init__(
        self, title: str, caption: str, type_: str, address: int, rows: Sequence[OrderRow], chosen: str
    ) -> None:
        self.title, self.caption = title, caption
        self.type, self.address, self.rows, self.chosen = type_, address, tuple(rows), chosen

    @classmethod
    def of_value(cls, value: float, type_: str = "f32", *, order: str = "", address: int = 0) -> RegistersPicture:
        """Return where the bytes of one value lie in each order; `order` marks one of them.

        >>> print(*RegistersPicture.of_value(1.1, order="CDAB").lines(), sep="\\n")
                register 0    register 1
          ABCD    3F  8C        CC  CD    high word first
        > CDAB    CC  CD        3F  8C    low word first
          BADC    8C  3F        CD  CC    high word first, bytes exchanged
          DCBA    CD  CC        8C  3F    low word first, bytes exchanged

        Raises EncodeError for a type that is not f32, i32 or u32, for another order, and for a value that the type
        cannot hold.
        """
        _check(type_, order)
        rows = [OrderRow(name, codec(type_, name).encode(value), _decoded(type_, codec(type_).encode(value), "ABCD"))
                for name in ORDERS]  # fmt: skip
        big = rows[0].data.hex(" ").upper()
        title = f"{value} as {type_} in two registers"
        caption = (
            f"The value is {big}: A is {big[:2]}, the most significant byte, D is {big[-2:]}. "
            "A register is sent with its left byte first. The standard does not say which order a device has."
        )
        return cls(title, caption, type_, address, rows, order)

    @classmethod
    def of_bytes(cls, data: bytes, type_: str = "f32", *, order: str = "", address: int = 0) -> RegistersPicture:
        """Return which value four received bytes are in each order.

        >>> [row.value for row in RegistersPicture.of_bytes(bytes.fromhex("00 01 00 00"), "u32").rows]
        [65536, 1, 16777216, 256]

        Raises EncodeError for other than 4 bytes, and for a wrong type or order.
        """
        _check(type_, order)
        if len(data) != 4:
            raise EncodeError(f"{len(data)} bytes: expected the 4 bytes of two registers", "data")
        rows = [OrderRow(name, data, _decoded(type_, data, name)) for name in ORDERS]
        title = f"{data.hex(' ').upper()} in two registers, read as {type_}"
        caption = "The same bytes in four orders: a value that is plausible shows the order of the device."
        return cls(title, caption, type_, address, rows, order)

    @property
    def _same_bytes(self) -> bool:
        return len({row.data for row in self.rows}) == 1 and len({str(row.value) for row in self.rows}) > 1

    def lines(self) -> list[str]:
        names = [f"register {self.address + place}" for place in (0, 1)]
        lines = [f"        {names[0]:<14}{names[1]}"]
        for row in self.rows:
            first, second = row.data[:2].hex("|"), row.data[2:].hex("|")
            digits = f"{first.replace('|', '  ').upper():<14}{second.replace('|', '  ').upper():<8}"
            mark = ">" if row.order == self.chosen else " "
            value = f"{_shown(row.value):<14}  " if self._same_bytes else ""
            lines.append(f"{mark} {row.order}    {digits}  {value}{_TEXTS[row.order]}".rstrip())
        return lines

    def as_dict(self) -> dict[str, Any]:
        return {
            "picture": self.kind,
            "type": self.type,
            "address": self.address,
            "order": self.chosen or None,
            "orders": [
                {
                    "order": row.order,
                    "registers": [int.from_bytes(row.data[:2]), int.from_bytes(row.data[2:])],
                    "bytes": row.data.hex(" ").upper(),
                    "value": row.value if math.isfinite(row.value) else str(row.value),
                    "meaning": _TEXTS[row.order],
                }
                for row in self.rows
            ],
        }

    def tiles(self) -> Sequence[Tile]:
        return [self._tile(number, row) for number, row in enumerate(self.rows)]

    def _tile(self, number: int, row: OrderRow) -> Tile:
        drawing = Drawing()
        width, left = 330, 6
        letters = reorder(b"ABCD", row.order).decode()
        chosen = row.order == self.chosen
        drawing.text(left, 16, f"{row.order}{' (this device)' if chosen else ''}", "b h")
        for place in range(4):
            x = left + place * _CELL + (_GAP if place > 1 else 0)
            letter = letters[place]
            tint = "ABCD".index(letter)
            if place in (0, 2):
                drawing.text(x, 36, f"register {self.address + place // 2}", "s")
            with drawing.group(f"f{tint}", f"byte {letter}: {row.data[place]:02X}", focus=True):
                drawing.box(x, 44, _CELL, _HEIGHT, f"o f{tint} t{tint}")
                drawing.text(x + _CELL / 2, 69, f"{row.data[place]:02X}", "m b c")
                drawing.text(x + _CELL / 2, 100, letter, "h c")
        if chosen:
            drawing.box(left - 4, 40, 4 * _CELL + _GAP + 8, _HEIGHT + 8, "l", 4)
        x = left + 4 * _CELL + _GAP + 14
        if self._same_bytes:
            drawing.text(left, 122, f"= {_shown(row.value)}", "m h")
        drawing.text(left, 142 if self._same_bytes else 122, _TEXTS[row.order], "soft")
        registers = f"{row.data[:2].hex().upper()}h {row.data[2:].hex().upper()}h"
        drawing.text(x, 69, registers, "m s")
        said = f"{row.order}: registers {registers}, {_shown(row.value)}, {_TEXTS[row.order]}"
        return Tile(width, 156 if self._same_bytes else 136, str(drawing), said, starts_row=number == 2)


def _check(type_: str, order: str) -> None:
    if type_ not in TYPES:
        raise EncodeError(f"type {type_!r}: expected one of {', '.join(TYPES)}", "type")
    if order and order not in ORDERS:
        raise EncodeError(f"byte order {order!r}: expected one of {', '.join(ORDERS)}", "order")


def _decoded(type_: str, data: bytes, order: Order) -> int | float:
    value = codec(type_, order).decode(data)
    assert isinstance(value, int | float)
    return value


def _shown(value: int | float) -> str:
    return f"{value:.7g}" if isinstance(value, float) else str(value)


class StepsPage(Picture):
    """A calculation for a page. It is text and tables, so it has no drawing, and no SVG."""

    kind = "steps"

    def __init__(self, steps: Steps) -> None:
        self.steps = steps
        self.title, self.caption = steps.title, steps.source

    def lines(self) -> list[str]:
        return self.steps.lines()

    def as_dict(self) -> dict[str, Any]:
        return self.steps.as_dict()

    def tiles(self) -> Sequence[Tile]:
        """Raise EncodeError: there is no drawing."""
        raise EncodeError(f"steps {self.steps.subject}: a calculation is text, without a drawing")

    def html_body(self) -> str:
        parts = [
            _table(section) if isinstance(section, StepTable) else f"<p>{xml_text(section)}</p>"
            for section in self.steps.sections
        ]
        return f'{"".join(parts)}<p class="verdict">{xml_text(self.steps.result)}</p>'


def _table(table: StepTable) -> str:
    """Return a table; the cells keep the blanks in front of them, as the rows of a division need it."""
    styles = [' style="text-align:right;min-width:0"' if right else "" for right in table.right_columns]
    head = "".join(f'<th scope="col"{css}>{xml_text(cell)}</th>' for cell, css in zip(table.header, styles))
    rows = "".join(f"<tr>{_cells(row, styles)}</tr>" for row in table.rows)
    caption = f"<p>{xml_text(table.caption)}</p>" if table.caption else ""
    label = xml_text(table.caption or ", ".join(filter(None, table.header)))
    return (
        f'{caption}<div class="scroll" role="group" tabindex="0" aria-label="{label}">'
        f'<table style="white-space:pre"><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>'
    )


def _cells(row: Sequence[str], styles: Sequence[str]) -> str:
    return "".join(f'<td class="m"{css}>{xml_text(cell)}</td>' for cell, css in zip(row, styles))
