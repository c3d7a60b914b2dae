"""Maps the files of the repository to pages of the site, and rewrites the links of a page accordingly.

docs/how-to/tls.md           how-to/tls                      docs/ is the root of the site
README.md                    project/readme                  other Markdown files become pages too
vectors/README.md            vectors/readme
src/barewire/rtu/crc.py      reference/api/rtu               code: the section of the API
tests/canopen/eds/x.py       files/tests/canopen/eds/x.py    any other file: its text as a page
vectors/peers/               -                               a folder has no page: the link becomes plain text
"""

from __future__ import annotations

import os
import posixpath
import re
from collections.abc import Iterator
from pathlib import Path

from tools.website import api
from tools.website.source import ROOT

PROJECT = {
    "README.md": "project/readme.md",
    "CONTRIBUTING.md": "project/contributing.md",
    "ARCHITECTURE.md": "project/architecture.md",
    "CHANGELOG.md": "project/changelog.md",
    "LICENSE": "project/license.md",
    "bench/README.md": "project/bench.md",
    "vectors/README.md": "vectors/readme.md",
    "vectors/START.md": "vectors/start.md",
    "vectors/PROTOCOL.md": "vectors/protocol.md",
    "vectors/CASES.md": "vectors/cases.md",
    **{
        f"vectors/kinds/{file.name}": f"vectors/kinds/{file.name}" for file in (ROOT / "vectors" / "kinds").glob("*.md")
    },
    "vectors/examples/javascript/README.md": "vectors/javascript.md",
    "vectors/AUTHORITY.md": "vectors/authority.md",
    "vectors/CHANGELOG.md": "vectors/changelog.md",
    "vectors/reference/README.md": "vectors/reference.md",
    "vectors/reference/SURVIVORS.md": "vectors/survivors.md",
    "src/barewire/devices/catalog/README.md": "reference/device-description.md",
}
"""The pages that do not stand in docs/, by their file in the repository."""

_LINK = re.compile(r"(!?\[(?:[^\[\]]|\[[^\]]*\])*\])\(([^()\s]+)\)")
_FENCE = re.compile(r"\s{0,3}(```+|~~~+)")


def page_of(file: str) -> str | None:
    """Return the page of a file, both as paths with `/`; None for a file that is no page.

    >>> page_of("docs/how-to/tls.md"), page_of("README.md"), page_of("Makefile")
    ('how-to/tls.md', 'project/readme.md', None)
    """
    if file.startswith("docs/"):
        return file.removeprefix("docs/")
    return PROJECT.get(file)


def file_page(file: str) -> str:
    """Return where a file stands that is no page of its own: its text on a page; JSON as it is, to download.

    >>> file_page("bench/plant.py"), file_page("vectors/cases/rtu/crc16.json")
    ('files/bench/plant.py.md', 'files/vectors/cases/rtu/crc16.json')
    """
    return f"files/{file}" if file.endswith(".json") else f"files/{file}.md"


def split(text: str) -> Iterator[tuple[str, bool]]:
    """Yield the parts of a Markdown page, and whether each is a fenced block.

    >>> list(split("a\\n```text\\nb\\n```\\nc\\n"))
    [('a\\n', False), ('```text\\nb\\n```\\n', True), ('c\\n', False)]
    """
    held, fence = "", ""
    for line in text.splitlines(keepends=True):
        opening = _FENCE.match(line)
        if fence and line.strip() == fence:
            yield held + line, True
            held, fence = "", ""
        elif opening and not fence:
            if held:
                yield held, False
            held, fence = line, opening[1]
        else:
            held += line
    if held:
        yield held, bool(fence)


class Links:
    """Rewrites the links of pages, and remembers the other files that they need."""

    def __init__(self, root: Path = ROOT) -> None:
        self.root = root
        self.files: set[str] = set()
        """Files of the repository that are linked and are no pages: each becomes one."""

    def rewritten(self, text: str, file: str) -> str:
        """Return the text of a page of the repository with the links of the site."""
        return "".join(
            part if code else _LINK.sub(lambda link: self._link(link[1], link[2], file), part)
            for part, code in split(text)
        )

    def _link(self, text: str, target: str, file: str) -> str:
        path, _, anchor = target.partition("#")
        if "://" in target or target.startswith("mailto:") or not path:
            return f"{text}({target})"
        found = posixpath.normpath(posixpath.join(posixpath.dirname(file), path))
        there = self._page(found)
        if there is None:
            return text[1:-1]
        here = page_of(file) or file
        return f"{text}({os.path.relpath(there, posixpath.dirname(here) or '.')}{'#' + anchor if anchor else ''})"

    def _page(self, file: str) -> str | None:
        page = page_of(file)
        if page:
            return page
        if "src/barewire" in file and file.endswith(".py"):
            return f"{api.page_of(posixpath.dirname(file).partition('src/')[2].replace('/', '.'))}.rst"
        if (self.root / file).is_file():
            self.files.add(file)
            return file_page(file)
        return None
