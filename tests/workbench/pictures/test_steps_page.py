"""A calculation as a page: every text and cell is on it, and blanks in front of a cell stay."""

from __future__ import annotations

from xml.etree import ElementTree

import pytest

from barewire.errors import EncodeError
from barewire_workbench.pictures.picture import as_svg, rendered
from barewire_workbench.pictures.steps import StepsPage
from barewire_workbench.steps import Steps, StepTable, crc_steps


def test_every_cell_and_text_is_on_the_page() -> None:
    steps = crc_steps(bytes.fromhex("0207"))
    body = ElementTree.fromstring(f"<div>{StepsPage(steps).html_body()}</div>")
    cells = [cell.text or "" for cell in body.iter("td")]
    assert cells == [cell for table in steps.tables for row in table.rows for cell in row]
    assert "          0000 0010" in cells
    texts = [text.text for text in body.iter("p")]
    assert texts == [section for section in steps.sections if isinstance(section, str)] + [steps.result]
    assert all(table.get("style") == "white-space:pre" for table in body.iter("table"))


def test_text_is_escaped() -> None:
    steps = Steps("x", "a < b", "s", ("1 <= n.", StepTable("c & d", ("<",), (("&",),))), "<--")
    page = rendered("html", StepsPage(steps))
    assert "<title>a &lt; b</title>" in page
    assert "<p>c &amp; d</p>" in page
    assert "&lt;--" in page


def test_whole_numbers_end_at_the_right() -> None:
    steps = Steps("x", "x", "s", (StepTable("", ("n", "hex"), (("1", "01h"), ("22", "02h"))),), "r")
    body = ElementTree.fromstring(f"<div>{StepsPage(steps).html_body()}</div>")
    assert ["right" in (cell.get("style") or "") for cell in [*body.iter("th"), *body.iter("td")]] == [True, False] * 3


def test_there_is_no_drawing() -> None:
    page = StepsPage(crc_steps(b"1"))
    assert (page.title, page.kind) == ("CRC of 31", "steps")
    with pytest.raises(EncodeError, match="a calculation is text"):
        as_svg(page)
    assert rendered("text", page).startswith("CRC of 31")
