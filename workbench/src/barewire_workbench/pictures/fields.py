"""A picture of an explanation: the bytes of the frame in boxes, and what each field means.

        0     1     2           4           6            offsets
      +-----+-----+-----+-----+-----+-----+-----+-----+
      | 01  | 03  | 00  | 00  | 00  | 02  | C4  | 0B  |
      +-----+-----+-----+-----+-----+-----+-----+-----+
       1     2     3           4           5             numbers of the fields: 1 unit, 2 function code, ...

Bytes and meaning of a field have the same number and the same tint, and light each other up.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any, NamedTuple

from barewire_workbench.frames.result import ExplainedField, Explanation, counted
from barewire_workbench.pictures.drawing import LETTER_FIXED, TINTS, Drawing, Tile, text_lines, text_width, xml_text
from barewire_workbench.pictures.picture import SVG_WIDTH, Picture

_WIDTH = SVG_WIDTH - 32
_CELL, _CHARACTER, _HEIGHT = 38, 22, 34
_ROW = _HEIGHT + 40
_ESCAPED = re.compile(r"\\x[0-9a-f]{2}|\\.|.", re.DOTALL)
_HEX_WIDTH, _NAME_AT, _HEX_AT = 30, 36, 190
_SHOWN_HEX = 6
"""The most bytes of a field that its row repeats; the boxes have all of them."""


class FieldsPicture(Picture):
    """The fields of one explanation, their bytes, the verdict and the diagnosis.

    >>> from barewire_workbench import explain
    >>> picture = FieldsPicture(explain("rtu", bytes.fromhex("01 03 00 00 00 02 C4 0B")))
    >>> picture.title
    'RTU frame, 8 bytes'
    """

    kind = "fields"

    caption = "The bytes of a field and its line in the list have the same number, and light each other up."

    def __init__(self, explanation: Explanation, name: str = "") -> None:
        self.explanation = explanation
        self.links = len(explanation.fields)
        size = max((field.offset + field.length for field in explanation.fields), default=0)
        name = name or f"{explanation.protocol.upper()} frame"
        if explanation.protocol == "can":
            name += f" {explanation.fields[0].hex if explanation.fields else ''}"
        self.title = f"{name}, {counted(size, 'character' if explanation.protocol == 'ascii' else 'byte')}"

    def lines(self) -> list[str]:
        return self.explanation.lines()

    def as_dict(self) -> dict[str, Any]:
        return self.explanation.as_dict()

    def tiles(self) -> Sequence[Tile]:
        return [self._boxes(), self._list()]

    def _boxes(self) -> Tile:
        drawing = Drawing()
        x, y = 0.0, 0
        for number, field in enumerate(self.explanation.fields):
            boxes = byte_boxes(field)
            if not boxes:
                continue
            with drawing.group(f"f{number}", _said(number, field), focus=True):
                for place, box in enumerate(boxes):
                    starts = place == 0
                    if x + box.width > _WIDTH:
                        x, y, starts = 0.0, y + _ROW, True
                    if starts and box.offset is not None:
                        drawing.text(x + 3, y + 12, box.offset, "s soft")
                    if starts:
                        drawing.text(x + 3, y + 18 + _HEIGHT + 14, number + 1, "s h")
                    drawing.box(x, y + 18, box.width, _HEIGHT, f"o f{number} t{number % TINTS}")
                    drawing.text(x + box.width / 2, y + 18 + 22, box.text, "m b c")
                    x += box.width
                x += 6
        return Tile(_WIDTH, y + _ROW, str(drawing), "the bytes of the frame, in boxes")

    def _list(self) -> Tile:
        drawing = Drawing()
        y = 0
        for number, field in enumerate(self.explanation.fields):
            name = text_lines(field.name, _HEX_AT - _NAME_AT - 10)
            digits = text_lines(_clipped(field), 190, 13, fixed=True)
            meaning = text_lines("; ".join(filter(None, (field.shown, field.meaning))), _WIDTH - 400)
            height = 18 * max(len(name), len(digits), len(meaning)) + 8
            with drawing.group(f"f{number}"):
                drawing.box(0, y + 2, _WIDTH, height - 2, f"paper f{number}")
                drawing.box(0, y + 3, _HEX_WIDTH, 20, f"o f{number} t{number % TINTS}", 4)
                drawing.text(_HEX_WIDTH / 2, y + 18, number + 1, "h c")
                for x, texts, css in ((_NAME_AT, name, "h"), (_HEX_AT, digits, "m"), (400, meaning, "")):
                    for row, text in enumerate(texts):
                        drawing.text(x, y + 18 + 18 * row, text, css)
            drawing.horizontal(y + height + 1, 0, _WIDTH, "g")
            y += height + 2
        for mark, css, text in self.judgement():
            for line in text_lines(f"{mark} {text}", _WIDTH, 16.5):
                y += 22
                drawing.text(0, y, line, f"h b {css}")
        return Tile(_WIDTH, y + 8, str(drawing), "the fields", starts_row=True)

    def judgement(self) -> list[tuple[str, str, str]]:
        """Return verdict and diagnosis as (sign, class, text): the sign says without colour whether it is good."""
        good = self.explanation.valid
        first = ("✓" if good else "✗", "good" if good else "bad", self.explanation.verdict)
        return [first, *(("→", "", finding.line) for finding in self.explanation.diagnosis)]

    def html_body(self) -> str:
        boxes, rows = [], []
        for number, field in enumerate(self.explanation.fields):
            tint = f"t{number % TINTS}"
            if field.hex:
                boxes.append(
                    f'<span class="field f{number} {tint}" tabindex="0" role="img" '
                    f'aria-label="{xml_text(_said(number, field))}"><span class="name">{number + 1} '
                    f'{xml_text(field.name)}</span><span class="hex">{xml_text(field.hex)}</span></span>'
                )
            cells = "".join(f'<td{css}>{xml_text(text)}</td>' for css, text in (
                (' class="m wide"', _clipped(field)), (' class="m"', field.shown), ("", field.meaning)))  # fmt: skip
            rows.append(
                f'<tr class="f{number}"><td><span class="number {tint}">{number + 1}</span></td>'
                f'<td class="wide">{field.offset}</td>'
                f'<th scope="row">{xml_text(field.name)}</th>{cells}</tr>'
            )
        wide = ' class="wide"'
        head = "".join(
            f'<th scope="col"{wide if name in ("offset", "hex") else ""}>{name}</th>'
            for name in ("field", "offset", "name", "hex", "value", "meaning")
        )
        judgement = "".join(
            f'<p class="verdict {css}">{mark} {xml_text(text)}</p>' for mark, css, text in self.judgement()
        )
        return (
            f'<div class="bytes">{"".join(boxes)}</div>{judgement}'
            f'<div class="scroll" role="group" tabindex="0" aria-label="the fields">'
            f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table></div>"
        )


class ByteBox(NamedTuple):
    """One box: its text, its width in pixels, and the offset of its byte; None for an identifier, which has none."""

    text: str
    width: float
    offset: int | None


def byte_boxes(field: ExplainedField) -> list[ByteBox]:
    """Return one box for each byte of a field, or for each character of an ASCII frame; none if it covers none.

    >>> [box.text for box in byte_boxes(ExplainedField(2, 2, "address", "0F B1", 4017, ""))]
    ['0F', 'B1']
    """
    if not field.hex:
        return []
    if not field.length:
        return [ByteBox(field.hex, 20 + text_width(field.hex, 15, fixed=True), None)]
    pairs = field.hex.split(" ")
    if len(pairs) == field.length:
        width = max(_CELL, 12 + max(map(len, pairs)) * 15 * LETTER_FIXED)
        return [ByteBox(pair, width, field.offset + place) for place, pair in enumerate(pairs)]
    return [
        ByteBox(character, max(_CHARACTER, 10 + len(character) * 15 * LETTER_FIXED), field.offset + place)
        for place, character in enumerate(field_characters(field))
    ]


def field_characters(field: ExplainedField) -> list[str]:
    """Return each character of a field of an ASCII frame as it is shown: control characters as CR, LF or \\x00.

    >>> field_characters(ExplainedField(5, 4, "address", "0F B1", 4017, ""))
    ['0', 'F', 'B', '1']
    """
    # `hex` of an ASCII frame has pairs of digits, names of line ends, or escapes: what fits the length is what it is.
    names = field.hex.split(" ")
    if len(names) == field.length and set(names) <= {"CR", "LF"}:
        return names
    digits = field.hex.replace(" ", "")
    if len(digits) == field.length and field.hex == " ".join(re.findall("..?", digits)):
        return list(digits)
    characters = _ESCAPED.findall(field.hex)
    return characters if len(characters) == field.length else [field.hex]


def _said(number: int, field: ExplainedField) -> str:
    parts = (field.hex, field.shown, field.meaning)
    return f"field {number + 1}, {field.name}: {'; '.join(part for part in parts if part)}"


def _clipped(field: ExplainedField) -> str:
    pairs = field.hex.split(" ")
    return field.hex if len(pairs) <= _SHOWN_HEX else " ".join(pairs[: _SHOWN_HEX - 1]) + " ..."
