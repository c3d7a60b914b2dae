"""The reference beside the vectors: it passes every case of its kinds, as an adapter too, and uses no barewire."""

from __future__ import annotations

import ast
import re
import sys

import pytest

from barewire.io.vector_adapter import VectorAdapter
from barewire.vectors.files import load_vectors
from barewire.vectors.run import run_cases, selected
from tools import vectors_mutants

TEXTS = vectors_mutants.sources()
ASKED = vectors_mutants.asked_of_kinds()
REFERENCE = vectors_mutants.Reference(vectors_mutants.compiled(TEXTS))


@pytest.mark.parametrize("kind", REFERENCE.module("main").KINDS)
def test_the_reference_passes_every_case(kind: str) -> None:
    assert vectors_mutants.first_failure(REFERENCE, ASKED[kind]) == ""


@pytest.mark.parametrize("name", TEXTS)
def test_a_file_uses_the_standard_library_and_its_neighbours_alone(name: str) -> None:
    tree = ast.parse(TEXTS[name])
    imported = {node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    imported |= {one.name for node in ast.walk(tree) if isinstance(node, ast.Import) for one in node.names}
    assert {one.partition(".")[0] for one in imported} <= {*sys.stdlib_module_names, *TEXTS}


def test_the_reference_is_an_adapter() -> None:
    command = f'"{sys.executable}" "{vectors_mutants.REFERENCE / "main.py"}"'
    with VectorAdapter(command) as adapter:
        checked = list(run_cases(selected(load_vectors(), kinds=["lrc", "sync"]), adapter))
    assert adapter.name == "reference"
    assert {one.verdict.state for one in checked} == {"passed"}


def test_a_mutant_is_noticed_by_a_case() -> None:
    first = next(one for one in vectors_mutants.mutants("checks", TEXTS["checks"]) if one.place == "lrc")
    assert vectors_mutants.is_noticed(vectors_mutants.compiled(TEXTS), first, [ASKED["lrc"]])


def test_a_mutant_has_a_row() -> None:
    (found,) = [
        one for one in vectors_mutants.mutants("x", "def f(a):\n    return a & 1\n") if one.after == "return a & 2"
    ]
    assert found.row == ("x.f", "return a & 1", "return a & 2")
    row = vectors_mutants.row(found.row, "a reason")
    assert vectors_mutants.explained(row + "\n") == {found.row: "a reason"}


def test_the_table_of_mutants_names_the_files_and_adds_up() -> None:
    page = (vectors_mutants.REFERENCE / "README.md").read_text(encoding="utf-8")
    rows = [
        (name, int(made), int(noticed)) for name, made, noticed in re.findall(r"`(\w+)\.py` \| (\d+) \| (\d+)", page)
    ]
    assert {name for name, _, _ in rows} <= {*TEXTS}
    assert f"| **all** | {sum(made for _, made, _ in rows)} | {sum(noticed for _, _, noticed in rows)} |" in page
