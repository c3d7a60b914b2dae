"""Collects the sources of the site in build/docs: pages of docs/, other Markdown files, and pages made of the code.

A file is written only if its text differs from that of the last run, so that Sphinx reads again what has changed and
nothing else; what is no longer a page is removed.
"""

from __future__ import annotations

import re
import shlex
import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path

from barewire_workbench import explain_text
from barewire_workbench.pictures.fields import FieldsPicture
from barewire_workbench.pictures.picture import html_fragment, page_style
from tools import pictures
from tools.website import api, classroom, commands, errors, messages, parameters, source
from tools.website.links import PROJECT, Links, file_page, split
from tools.website.source import ROOT

_COMMENT = re.compile(r"^[ \t]*<!--.*?-->[ \t]*\n?", re.MULTILINE | re.DOTALL)
_LAST_EMPTY = re.compile(r"\n\s*\n(?=\s*(```|~~~)[`~]*\s*$)")
"""Empty lines at the end of a block, which end its last example."""
PAIR = "<!-- side by side -->"
_AS_HTML = re.compile(r"^<!-- the picture as HTML -->\n!\[[^]]*\]\(pictures/([\w-]+)\.svg\)$", re.MULTILINE)
"""A picture that the site shows as HTML, which is as wide as the page and follows its theme; a forge shows the SVG."""
_LANGUAGES = {
    ".py": "python",
    ".json": "json",
    ".toml": "toml",
    ".sh": "bash",
    ".mjs": "javascript",
    ".js": "javascript",
}


def collected(root: Path = ROOT) -> dict[str, str | Path]:
    """Return every source of the site by path: its text, or the file to copy."""
    links = Links(root)
    found: dict[str, str | Path] = {}
    for file in sorted((root / "docs").rglob("*")):
        path = file.relative_to(root).as_posix()
        if path.startswith("docs/explorer/"):  # a page of its own, see `explorer`
            continue
        if file.suffix == ".md":
            text = _AS_HTML.sub(lambda name: picture_as_html(name[1]), file.read_text(encoding="utf-8"))
            text = text.replace(classroom.TABLE_PLACE, classroom.table())
            found[path.removeprefix("docs/")] = page(text, path, links)
        elif file.is_file() and "__pycache__" not in path:
            found[path.removeprefix("docs/")] = file
    for path, target in PROJECT.items():
        text = (root / path).read_text(encoding="utf-8")
        found[target] = page(text if path.endswith(".md") else f"# Licence\n\n```text\n{text}```\n", path, links)
    for path in sorted(links.files):
        target = file_page(path)
        found[target] = _file_page(root / path, path) if target.endswith(".md") else root / path
    rooms = source.rooms()
    link = api.linker(rooms)
    found.update(api.pages(rooms, link))
    found[errors.PATH] = errors.page(rooms, link)
    found[messages.MODBUS_PATH] = messages.modbus_page(rooms, link)
    found[messages.CANOPEN_PATH] = messages.canopen_page(rooms, link)
    found[commands.PATH] = commands.page()
    found[classroom.SOLUTIONS] = classroom.solutions()
    found.update(parameters.pages())
    return found


def picture_as_html(name: str) -> str:
    """Return a picture of docs/pictures as a block of HTML. It is a frame that `barewire explain` draws."""
    _, _, framing, frame, *_ = shlex.split(pictures.COMMANDS[f"{name}.svg"])
    figure = html_fragment(FieldsPicture(explain_text(framing, frame)), heading=2)
    return f"<style>{page_style(follows_page=True)}</style>\n{figure}"


def page(text: str, file: str, links: Links) -> str:
    """Return a Markdown file of the repository as a page: links lead to pages, comments are left out."""
    parts = side_by_side(split(text))
    kept = "".join(_LAST_EMPTY.sub("\n", part) if code else _COMMENT.sub("", part) for part, code in parts)
    return links.rewritten(kept, file)


def side_by_side(parts: Iterable[tuple[str, bool]]) -> Iterator[tuple[str, bool]]:
    """Put two blocks behind the comment `<!-- side by side -->` beside each other: into a container for site.css.

    >>> "".join(part for part, _ in side_by_side(split(f"{PAIR}\\n```text\\na\\n```\\n\\n```text\\nb\\n```\\nc\\n")))
    '<!-- side by side -->\\n````{container} pair\\n```text\\na\\n```\\n\\n```text\\nb\\n```\\n````\\nc\\n'
    """
    held = 0
    for part, code in parts:
        if code and held:
            yield ("````{container} pair\n" if held == 2 else "") + part + ("````\n" if held == 1 else ""), True
            held -= 1
        else:
            held = 2 if PAIR in part else held
            yield part, code


def _file_page(file: Path, path: str) -> str:
    language = _LANGUAGES.get(file.suffix, "text")
    text = file.read_text(encoding="utf-8")
    fence = "`" * (max((len(run) for run in re.findall(r"`+", text)), default=2) + 3)
    return f"---\norphan: true\n---\n\n# {path}\n\n{fence}{language}\n{text}{fence}\n"


def write(sources: dict[str, str | Path], folder: Path) -> None:
    """Make the folder equal to the sources."""
    for old in [file for file in folder.rglob("*") if file.is_file()]:
        if old.relative_to(folder).as_posix() not in sources:
            old.unlink()
    for path, given in sources.items():
        target = folder / path
        target.parent.mkdir(parents=True, exist_ok=True)
        if isinstance(given, Path):
            if not target.exists() or target.stat().st_mtime < given.stat().st_mtime:
                shutil.copyfile(given, target)
        elif not target.exists() or target.read_text(encoding="utf-8") != given:
            target.write_text(given, encoding="utf-8")
