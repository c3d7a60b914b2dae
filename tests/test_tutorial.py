"""The words of the course: each is explained once, in bold, and is in the glossary."""

from __future__ import annotations

import re
from collections import Counter
from itertools import pairwise
from pathlib import Path

from barewire_workbench.cli.labs import LABS

DOCS = Path(__file__).parent.parent / "docs"
PAGES = [DOCS / "tutorial" / lab.page for lab in LABS.values()]


def explained(page: Path) -> list[str]:
    """The words in bold outside of code and tables."""
    text = re.sub(r"```.*?```|^\|.*?$", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    return [" ".join(word.split()).lower() for word in re.findall(r"\*\*([^*]+)\*\*", text) if not word.endswith("?")]


def test_each_word_is_explained_once() -> None:
    words = Counter(word for page in PAGES for word in explained(page))
    assert sum(words.values()) > 60
    assert {word for word, count in words.items() if count > 1} == set()


def test_each_word_is_in_the_glossary() -> None:
    glossary = (DOCS / "reference" / "glossary.md").read_text(encoding="utf-8").lower()
    known = " ".join(row.split("|")[1] for row in glossary.splitlines() if row.startswith("|"))
    unknown = [
        word
        for page in PAGES
        for word in explained(page)
        if not re.search(rf"\b{re.escape(word.removesuffix('s'))}", known)
    ]
    assert unknown == []


def test_each_lab_has_its_page_which_leads_to_the_next() -> None:
    for page, following in pairwise(PAGES):
        assert f"]({following.name})" in page.read_text(encoding="utf-8")
    for lab, page in zip(LABS.values(), PAGES):
        assert page.name.startswith(f"{lab.number:02}-")
        assert f"$ barewire lab {lab.number}\n" in page.read_text(encoding="utf-8")
        assert f"{lab.minutes} minutes" in " ".join(page.read_text(encoding="utf-8").split())
