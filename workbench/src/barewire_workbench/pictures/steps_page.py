"""A calculation step by step as HTML: its texts and tables on a page, below the picture if it has one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from barewire.errors import EncodeError
from barewire_workbench.pictures.drawing import Tile, xml_text
from barewire_workbench.pictures.picture import Picture
from barewire_workbench.steps.model import Steps, StepTable


class StepsPage(Picture):
    """A calculation for a page. It is text and tables, so it has no drawing, and no SVG."""

    kind = "steps"

    def __init__(self, steps: Steps) -> None:
        self.steps = steps

    @property
    def title(self) -> str:
        """The calculation."""
        return self.steps.title

    @property
    def caption(self) -> str:
        """The source."""
        return self.steps.source

    def lines(self) -> list[str]:
        """Return the calculation as text."""
        return self.steps.lines()

    def as_dict(self) -> dict[str, Any]:
        """Return the calculation as data."""
        return self.steps.as_dict()

    def tiles(self) -> Sequence[Tile]:
        """Raise EncodeError: there is no drawing."""
        raise EncodeError(f"steps {self.steps.subject}: a calculation is text, without a drawing")

    def html_body(self) -> str:
        """Return paragraphs and tables, and the result."""
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
