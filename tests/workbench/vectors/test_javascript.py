"""The adapter in JavaScript, a second implementation of our own: it fails in none of the cases of its kinds.

Every sixth case is asked here; all of them are:

    barewire vectors check --adapter "node vectors/examples/javascript/main.mjs"
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from barewire_workbench.live.vector_adapter import VectorAdapter
from barewire_workbench.vectors.files import Vectors
from barewire_workbench.vectors.run import run_cases
from tests.workbench.vectors.loaded import VECTORS

FOLDER = Path(__file__).parents[3] / "vectors" / "examples" / "javascript"
BEHAVIOUR = {"rtu-talk", "ascii-talk", "tcp-talk", "sdo-talk", "server", "client", "gateway", "device", "drive-path"}
EVERY = 6


ONCE_WRONG = {"device-cob-ids-56"}
"""Cases in which it has failed before."""


def every_nth(vectors: Vectors, step: int) -> Vectors:
    """The first case of each file, every `step`th behind it, and those of ONCE_WRONG."""
    return vectors._replace(
        files=tuple(
            file._replace(
                cases=tuple(
                    case for place, case in enumerate(file.cases) if place % step == 0 or case["id"] in ONCE_WRONG
                )
            )
            for file in vectors.files
        )
    )


@pytest.mark.needs("node")
def test_the_adapter_in_javascript_fails_in_no_case() -> None:
    with VectorAdapter(f'node "{FOLDER / "main.mjs"}"') as adapter:
        checked = list(run_cases(every_nth(VECTORS, EVERY), adapter))
    kinds = {one.file.kind for one in checked if one.verdict.state != "not offered"}
    assert [(one.id, one.verdict.text) for one in checked if one.verdict.state == "failed"] == []
    assert len(kinds) >= 40
    assert kinds >= BEHAVIOUR


def test_its_modules_use_node_and_one_another_alone() -> None:
    for file in FOLDER.rglob("*.mjs"):
        text = file.read_text(encoding="utf-8")
        imported = re.findall(r"^import .* from '([^']*)'", text, flags=re.MULTILINE)
        assert [name for name in imported if not name.startswith(("./", "../", "node:"))] == []
        assert len(text.splitlines()) <= 400, file.name
