"""The sources of the site: every page of the repository is one of them, every link between them has a target."""

from __future__ import annotations

import posixpath
import re
from functools import cache
from pathlib import Path

import pytest

from tools.website import source
from tools.website.api import linker
from tools.website.commands import commands
from tools.website.docstrings import clause, drawings
from tools.website.links import PROJECT, Links, split
from tools.website.messages import EXAMPLES, Messages
from tools.website.source import ROOT
from tools.website.stage import collected, page, write

pytestmark = pytest.mark.long


@cache
def sources() -> dict[str, str | Path]:
    return collected()


def text_of(path: str) -> str:
    text = sources()[path]
    assert isinstance(text, str)
    return text


def test_every_markdown_page_is_on_the_site() -> None:
    files = [file.relative_to(ROOT).as_posix() for file in (ROOT / "docs").rglob("*.md")]
    assert {file.removeprefix("docs/") for file in files} | set(PROJECT.values()) <= set(sources())


def test_every_link_between_pages_has_a_target() -> None:
    dead = []
    for path, text in sources().items():
        if isinstance(text, str) and path.endswith(".md") and not path.startswith("files/"):
            prose = "".join(re.sub(r"`[^`]*`", "", part) for part, code in split(text) if not code)
            for target in re.findall(r"\]\(([^)#\s]+)", prose):
                there = posixpath.normpath(posixpath.join(posixpath.dirname(path), target))
                if "://" not in target and not target.startswith("mailto:") and there not in sources():
                    dead.append(f"{path}: {target}")
    assert not dead, "\n".join(dead)


def test_marks_of_the_tests_are_not_on_the_site() -> None:
    pages = {path: text for path, text in sources().items() if isinstance(text, str) and path.endswith(".md")}
    assert [path for path, text in pages.items() if "<!-- test:" in text and not path.startswith("files/")] == []
    assert page("a\n\n<!-- test: skip (x) -->\n\n```sh\n<!-- b -->\n```\n", "docs/a.md", Links()).count("<!--") == 1


def test_every_command_shows_its_help() -> None:
    text = text_of("reference/commands.md")
    found = [words for words, _, _ in commands()]
    assert {"barewire", "barewire explain", "barewire vectors check"} <= set(found)
    assert [words for words in found if f"# {words}\n" not in text] == []
    assert text.count("Usage: barewire") == len(found)


def test_every_function_code_has_its_bytes_and_a_frame() -> None:
    from barewire.modbus.messages.registry import known_requests

    text = text_of("reference/messages-modbus.rst")
    for request in known_requests():
        title = f"{request.name}\n"
        assert title in text, request
        assert f"\n{request.__name__}\n" in text
        assert f"\n{request.response.__name__}\n" in text
    assert text.count("$ barewire explain rtu") >= 2 * len(known_requests())
    assert text.count("   valid: ") >= 2 * len(known_requests())


def test_every_message_has_its_drawing_and_its_clause() -> None:
    from barewire.modbus.messages.registry import known_requests

    found = source.rooms()
    messages = Messages(found, linker(found))
    for request in known_requests():
        for name in (request.__name__, request.response.__name__):
            assert ".. code-block:: text" in list(messages.lines(name, "~")), name
            assert messages.clause(name).startswith("MB-APP "), name
    for name in EXAMPLES:
        module = messages.modules[f"barewire.canopen.{name}"]
        assert drawings(module.docstring), name
        assert clause(module.docstring).startswith("CiA 30"), name
    text = text_of("reference/messages-canopen.rst")
    for name in ("ExpeditedUpload", "InitiateDownload", "Abort", "NextSegment", "BlockEnded", "Fastscan", "Emergency"):
        assert f"\n{name}\n~~~" in text, name


def test_every_frame_of_the_canopen_page_is_valid() -> None:
    text = text_of("reference/messages-canopen.rst")
    assert text.count("$ barewire explain can") == text.count("\n   valid: ") > 12


def test_every_parameter_is_on_the_page_of_its_device() -> None:
    from barewire.devices import load, names

    for name in names():
        text = text_of(f"reference/devices-{name}.md").replace("\\", "")
        rows = [row for row in text.splitlines() if row.startswith("| **")]
        assert len(rows) == len(load(name).parameters)
        assert [each.name for each in load(name).parameters if f"| **{each.name}** |" not in text] == []


def test_only_what_changed_is_written(tmp_path: Path) -> None:
    write({"a.md": "one", "sub/b.md": "two"}, tmp_path)
    before = (tmp_path / "a.md").stat().st_mtime_ns
    write({"a.md": "one", "sub/c.md": "three"}, tmp_path)
    assert (tmp_path / "a.md").stat().st_mtime_ns == before
    assert sorted(file.name for file in tmp_path.rglob("*.md")) == ["a.md", "c.md"]


def test_the_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").split()) < 600


@pytest.mark.parametrize("room", ["how-to", "reference"])
def test_every_page_is_in_the_table_of_its_room(room: str) -> None:
    """A new page appears in the sidebar by itself; the table says for which task it is."""
    prose = "".join(part for part, code in split(text_of(f"{room}/index.md")) if not code)
    pages = [path.split("/")[1] for path in sources() if re.fullmatch(rf"{room}/[\w-]+\.(md|rst)", path)]
    missing = [page for page in pages if f"({page})" not in prose and f"`{page.rpartition('.')[0]}`" not in prose]
    assert missing == ["index.md"], f"docs/{room}/index.md does not name them"
