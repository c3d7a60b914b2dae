"""Lazy doors: type checkers and programs are given the same names, and each name is in the file that the door gives."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

SRC = Path(__file__).parent.parent / "src"
DOORS = [file for file in sorted((SRC / "barewire").rglob("__init__.py")) if "lazy(" in file.read_text("utf-8")]


def room(door: Path) -> str:
    return ".".join(door.parent.relative_to(SRC).parts)


def lists(door: Path) -> tuple[dict[str, set[str]], dict[str, set[str]]]:
    """File -> names, as the door imports them for type checkers, and as it gives them to `lazy`."""
    tree = ast.parse(door.read_text("utf-8"))
    within = room(door) + "."
    typed: dict[str, set[str]] = {}
    for one in ast.walk(tree):
        if isinstance(one, ast.ImportFrom) and (one.module or "").startswith(within):
            assert all(alias.asname == alias.name for alias in one.names), f"{door}:{one.lineno}: not `name as name`"
            typed.setdefault(str(one.module).removeprefix(within), set()).update(alias.name for alias in one.names)
    [call] = [one for one in ast.walk(tree) if isinstance(one, ast.Call) and ast.unparse(one.func) == "lazy"]
    return typed, {file: set(names.split()) for file, names in ast.literal_eval(call.args[1]).items()}


@pytest.mark.parametrize("door", DOORS, ids=room)
def test_type_checkers_and_programs_are_given_the_same_names(door: Path) -> None:
    typed, files = lists(door)
    assert files == typed
    names = [name for held in files.values() for name in held]
    assert len(names) == len(set(names)), "two files for one name"


@pytest.mark.parametrize("door", DOORS, ids=room)
def test_every_name_is_in_the_file_that_the_door_names(door: Path) -> None:
    """In a fresh interpreter: `import *` asks for all, and each name is found in its file."""
    _, files = lists(door)
    look = (
        f"import sys; sys.path.insert(0, {str(SRC)!r})\nfrom {room(door)} import *\n"
        f"for file_, names_ in { {file: sorted(names) for file, names in files.items()}!r}.items():\n"
        f"    module_ = sys.modules['{room(door)}.' + file_]\n"
        f"    for name_ in names_: assert globals()[name_] is getattr(module_, name_), name_\n"
    )
    run = subprocess.run([sys.executable, "-c", look], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr


def test_these_rooms_have_lazy_doors() -> None:
    assert {room(door) for door in DOORS} == {
        *("barewire.modbus", "barewire.canopen", "barewire.canopen.gateway", "barewire.canopen.sdo"),
        *("barewire.devices", "barewire.io"),
    }
