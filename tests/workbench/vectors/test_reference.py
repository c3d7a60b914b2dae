"""The reference beside the vectors: it passes every case of its kinds, as an adapter too, and uses no barewire."""

from __future__ import annotations

import ast
import json
import sys

import pytest

from barewire_workbench.live.vector_adapter import VectorAdapter
from barewire_workbench.vectors.run import run_cases, selected
from tests.helpers import every_case, part_or_whole
from tests.workbench.vectors.loaded import VECTORS
from tools import vectors, vectors_mutants
from tools.vectors_changes import mutants

TEXTS = vectors_mutants.sources()
ASKED = vectors_mutants.asked_of_kinds()
NUMBERS = json.loads(vectors_mutants.NUMBERS.read_text(encoding="utf-8"))
REFERENCE = vectors_mutants.Reference(vectors_mutants.compiled(TEXTS))


@pytest.mark.parametrize("step", part_or_whole(4, 1))
@every_case("kind", REFERENCE.module("main").KINDS)
def test_the_reference_passes_every_case(kind: str, step: int) -> None:
    """A fourth of each kind, from those with one question to those with many."""
    assert vectors_mutants.first_failure(REFERENCE, ASKED[kind][::step]) == ""


@every_case("name", TEXTS)
def test_a_file_uses_the_standard_library_and_its_neighbours_alone(name: str) -> None:
    tree = ast.parse(TEXTS[name])
    imported = {node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    imported |= {one.name for node in ast.walk(tree) if isinstance(node, ast.Import) for one in node.names}
    assert {one.partition(".")[0] for one in imported} <= {*sys.stdlib_module_names, *TEXTS}


def test_the_reference_is_an_adapter() -> None:
    command = f'"{sys.executable}" "{vectors_mutants.REFERENCE / "main.py"}"'
    with VectorAdapter(command) as adapter:
        checked = list(run_cases(selected(VECTORS, kinds=["lrc", "sync"]), adapter))
    assert adapter.name == "reference"
    assert {one.verdict.state for one in checked} == {"passed"}


def test_a_mutant_is_noticed_by_a_case() -> None:
    first = next(one for one in mutants("checks", TEXTS["checks"]) if one.place == "lrc")
    assert vectors_mutants.is_noticed(vectors_mutants.compiled(TEXTS), first, ASKED["lrc"])


def test_a_mutant_has_a_row_below_a_policy() -> None:
    (found,) = [one for one in mutants("x", "def f(a):\n    return a & 1 | 4\n") if one.after == "return a & 2 | 4"]
    assert found.row == ("x.f", "return a & 1 | 4", "return a & 2 | 4")
    page = f"### Which bit\n\nIt is reserved.\n\n{vectors_mutants.row(found.row)}\n\n### Another\n"
    assert vectors_mutants.explained(page) == {found.row: "Which bit"}


def test_the_numbers_of_the_mutants_are_those_of_the_reference() -> None:
    changed = {name: text for name, text in TEXTS.items() if name not in vectors_mutants.NOT_CHANGED}
    digests = {name: vectors_mutants.digest(text) for name, text in changed.items()}
    assert {name: one["digest"] for name, one in NUMBERS.items()} == digests, "run make vectors-mutants ARGS=<file>"
    assert {kind for one in NUMBERS.values() for kind in one["kinds"]} == {*REFERENCE.module("main").KINDS}


def test_every_surviving_mutant_has_a_policy() -> None:
    survivors = vectors_mutants.explained(vectors_mutants.PAGE.read_text(encoding="utf-8"))
    assert {name: one["all"][-1] for name, one in NUMBERS.items() if one["all"][-1]} == {}
    assert {place.partition(".")[0] for place, _, _ in survivors} == {
        name for name, one in NUMBERS.items() if one["all"][1]
    }


def test_the_table_of_the_page_is_made_of_these_numbers() -> None:
    readme = (vectors_mutants.REFERENCE / "README.md").read_text(encoding="utf-8")
    made = sum(sum(one["kinds"].get("sdo", ())) for one in NUMBERS.values())
    assert made > 300
    assert f"| `sdo` | {made} | " in readme
    assert vectors.mutants() in readme, "run python tools/vectors.py"
