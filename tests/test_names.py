"""A public name has one meaning: no class, function, alias or constant is defined in two files of src/barewire, and no
class in two files of both packages.

Names that begin with `_` belong to one file. Type variables have no meaning of their own. PARALLEL lists the names that
are the same on purpose.
"""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).parent.parent
HOME, WORKBENCH = ROOT / "src" / "barewire", ROOT / "workbench" / "src" / "barewire_workbench"

PARALLEL = {
    "encode": "one for each framing",
    "decode": "one for each framing",
    "dialer": "one for each transport, blocking",
    "connect": "one for each transport, asyncio; and a machine by name",
    "run": "one for each engine",
    "exchange": "one for each engine",
    "abandon": "one for each engine",
    "channels_locked": "blocking and asyncio",
}


CLASS = re.compile(r"^class ([A-Za-z]\w*)", re.MULTILINE)
"""A public class at the top of a file, in a small part of the time that a tree takes; a text has no such line."""


def is_type_variable(value: ast.expr) -> bool:
    return isinstance(value, ast.Call) and ast.unparse(value.func) in ("TypeVar", "ParamSpec")


def public_names(source: str) -> set[str]:
    """Return the public names that a file defines at its top level; imported names are not defined there."""
    found: set[str] = set()
    for node in ast.parse(source).body:
        if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            found.add(node.name)
        elif isinstance(node, ast.Assign) and not is_type_variable(node.value):
            found.update(target.id for target in node.targets if isinstance(target, ast.Name))
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            found.add(node.target.id)
    return {name for name in found if not name.startswith("_")}


def test_every_public_name_is_defined_once() -> None:
    files = defaultdict(list)
    for path in sorted(HOME.rglob("*.py")):
        for name in public_names(path.read_text(encoding="utf-8")):
            files[name].append(path.relative_to(HOME).as_posix())
    twice = {name: where for name, where in files.items() if len(where) > 1 and name not in PARALLEL}
    assert not twice, "\n".join(f"{name}: {', '.join(where)}" for name, where in sorted(twice.items()))


def test_a_class_of_the_workbench_has_a_name_of_its_own() -> None:
    """Apart from the parts of `barewire vendor`, each of which takes the place of a class of the stack."""
    files = defaultdict(list)
    for home in (HOME, WORKBENCH):
        for path in sorted(home.rglob("*.py")):
            if "one_file" not in path.parts:
                for name in CLASS.findall(path.read_text(encoding="utf-8")):
                    files[name].append(path.relative_to(ROOT).as_posix())
    twice = {name: where for name, where in files.items() if len(where) > 1}
    assert not twice, "\n".join(f"{name}: {', '.join(where)}" for name, where in sorted(twice.items()))


def test_definitions_are_found_and_imports_are_not() -> None:
    source = (
        "from a import B\nT = TypeVar('T')\nX = 1\nY: int = 2\n_Z = 3\nclass C: ...\ndef f(): ...\nasync def g(): ...\n"
    )
    assert public_names(source) == {"X", "Y", "C", "f", "g"}
