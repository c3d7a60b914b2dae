"""Docstrings as reStructuredText: drawings keep every sign, names become links, nothing else has a form."""

from __future__ import annotations

import ast
from pathlib import Path

from tools.website.docstrings import clause, drawings, inline, parts, rendered, summary

SRC = Path(__file__).parents[2] / "src"

DOCSTRING = """The registers that were read.                                 [MB-APP 6.3]

        03 | byte count | registers ...
            '-- one byte

    The second is `Bus` or `x_y`*, not a_b.

    - first
      and more
    - second

    >>> 1 + 1
    2

    **Both** ends. [not a link]
    """


def link(name: str) -> str | None:
    return "barewire.modbus.client.bus.Bus" if name == "Bus" else None


def test_every_part_has_its_form() -> None:
    assert rendered(DOCSTRING, link) == [
        "The registers that were read. *[MB-APP 6.3]*",
        "",
        ".. code-block:: text",
        "",
        "   03 | byte count | registers ...",
        "       '-- one byte",
        "",
        r"The second is :py:obj:`Bus <barewire.modbus.client.bus.Bus>` or ``x_y``\ \*, not a\_b.",
        "",
        "- first and more",
        "",
        "- second",
        "",
        ".. code-block:: pycon",
        "",
        "   >>> 1 + 1",
        "   2",
        "",
        "**Both** ends. [not a link]",
        "",
    ]


def test_a_drawing_without_indentation_is_known_by_its_columns() -> None:
    table = ["unit        0..255, the unit", "            that methods address", "gap         seconds"]
    text = "\n".join(["A client.", "", *table, "", "More."])
    assert list(parts(text)) == [("text", ["A client."]), ("drawing", table), ("text", ["More."])]
    assert drawings("The request, repeated.      [MB-APP 6.5]\n\n05 | address 2 | value 2") == [
        ["05 | address 2 | value 2"]
    ]
    assert drawings("One.\n\nA sentence.      [MB-APP 6.5]") == []


def test_a_clause_is_known_by_its_number_or_by_the_standard() -> None:
    assert clause("SYNC: a message.   [CiA 301, SYNC]") == "CiA 301, SYNC"
    assert clause("A list [of words]") == ""


def test_a_first_sentence_ends_before_the_next_one() -> None:
    assert summary("Waits 0.5 s, i.e. half of it. Then more.") == "Waits 0.5 s, i.e. half of it."
    assert summary("No full stop") == "No full stop"


def test_no_sign_of_a_paragraph_has_a_meaning() -> None:
    assert inline("*a |b| `c **d", link) == r"\*a \|b\| \`c \*\*d"


def test_every_drawing_of_the_source_keeps_its_signs() -> None:
    """What is indented in a docstring of barewire stands on the site as it is."""
    count = 0
    for file in sorted((SRC / "barewire" / "modbus").rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Module | ast.ClassDef) and (text := ast.get_docstring(node)):
                for drawing in drawings(text):
                    count += 1
                    shown = "\n".join(f"   {line}".rstrip() for line in drawing)
                    assert shown in "\n".join(rendered(text, link))
                assert sum(len(block) for _, block in parts(text)) <= len(text.splitlines())
    assert count > 50
