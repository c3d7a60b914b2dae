"""A table in HTML, for the rich display of a notebook: `_repr_html_` of devices, readings and identifications."""

from __future__ import annotations

from collections.abc import Iterable, Sequence


def html_table(titles: Sequence[str], rows: Iterable[Sequence[object]], caption: str = "") -> str:
    """Return a table; its texts are escaped.

    >>> html_table(["name"], [["A > B"]], "One row")
    '<table><caption>One row</caption><tr><th>name</th></tr><tr><td>A &gt; B</td></tr></table>'
    """
    from html import escape  # only a notebook needs it

    def line(tag: str, cells: Sequence[object]) -> str:
        return "<tr>" + "".join(f"<{tag}>{escape(str(cell))}</{tag}>" for cell in cells) + "</tr>"

    head = f"<caption>{escape(caption)}</caption>" if caption else ""
    return f"<table>{head}{line('th', titles)}{''.join(line('td', row) for row in rows)}</table>"
