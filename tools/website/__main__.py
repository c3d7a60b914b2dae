"""Builds the site: `python -m tools.website`; with the argument `linkcheck` it visits the external links instead."""

from __future__ import annotations

import sys

from tools.website import classroom, explorer
from tools.website.check import faults
from tools.website.source import ROOT
from tools.website.stage import collected, write

BUILD = ROOT / "build"
SITE = BUILD / "site"


def main(builder: str = "html") -> int:
    """Collect the sources and run Sphinx over them; a warning is an error, and so is a fault of the HTML."""
    from sphinx.cmd.build import main as sphinx

    write(collected(), BUILD / "docs")
    target = SITE if builder == "html" else BUILD / builder
    options = ["-W", "--keep-going", "-q", "-j", "2", "-b", builder, "-d", str(BUILD / "doctrees")]
    if sphinx([*options, str(BUILD / "docs"), str(target)]):
        return 1
    if builder == "html":
        explorer.build(SITE / "explorer")
        classroom.build(SITE / "class")
    found = faults(SITE) if builder == "html" else []
    sys.stderr.write("".join(f"{line}\n" for line in found))
    if builder == "html" and not found:
        sys.stdout.write(f"{target.relative_to(ROOT)}/index.html, {len(list(target.rglob('*.html')))} pages\n")
    return bool(found)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
