"""What axe-core finds on a page, at the widths of a phone and of a desk, light and dark."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Page

from tools.website.explorer import pyodide_folder

SCREENS = [
    (390, "dark"),
    (1280, "light"),
    pytest.param(390, "light", marks=pytest.mark.proof),
    pytest.param(1280, "dark", marks=pytest.mark.proof),
]
"""`make test` has each width and each scheme, `make proof` also the other pairs."""


def serious_faults(page: Page) -> list[str]:
    """Return the elements in which axe-core finds a serious or critical fault, each behind the name of its rule."""
    if not page.evaluate("'axe' in window"):
        page.evaluate((Path(pyodide_folder()).parent / "axe-core" / "axe.min.js").read_text(encoding="utf-8"))
    found: dict[str, Any] = page.evaluate("axe.run({resultTypes: ['violations']})")
    return [
        f"{violation['id']}: {node['html'][:120]}"
        for violation in found["violations"]
        if violation["impact"] in ("serious", "critical")
        for node in violation["nodes"]
    ]
