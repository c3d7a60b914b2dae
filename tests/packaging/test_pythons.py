"""The page about Pythons names what `.ci/run` and pyproject.toml have."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "reference" / "pythons.md").read_text(encoding="utf-8")


def test_each_step_that_the_page_names_is_a_step_of_ci() -> None:
    steps = re.findall(r'^ *step "([^"$]*)', (ROOT / ".ci" / "run").read_text(encoding="utf-8"), re.MULTILINE)
    rows = [line.partition(": ")[2] for line in PAGE.splitlines() if "each run of" in line]
    named = [name for row in rows for name in re.findall(r"`([^`]+)`", row)]
    assert len(named) >= 5
    for name in named:
        assert any(step.startswith(name) for step in steps), name


def test_each_version_of_the_project_has_a_row() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    versions = re.findall(r"Python :: (3\.\d+)", " ".join(project["classifiers"]))
    assert versions == ["3.11", "3.12", "3.13", "3.14"]
    for version in versions:
        assert re.search(rf"^\| CPython .*{re.escape(version)}", PAGE, re.MULTILINE), version
