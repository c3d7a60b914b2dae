"""The doors that load on demand: their three lists name the same, and asking for a name loads its file and no other."""

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


def imported(body: list[ast.stmt], within: str) -> dict[str, set[str]]:
    """File -> names, of the imports in these lines that come from the room itself."""
    found: dict[str, set[str]] = {}
    for one in body:
        if isinstance(one, ast.ImportFrom) and (one.module or "").startswith(within + "."):
            file = str(one.module).removeprefix(within + ".")
            found.setdefault(file, set()).update(alias.name for alias in one.names)
    return found


def lists(door: Path) -> tuple[dict[str, set[str]], dict[str, set[str]], set[str], list[str]]:
    """What the door says to type checkers, what it says to `lazy`, what it loads at once, and `__all__`."""
    tree = ast.parse(door.read_text("utf-8"))
    said = {
        one.targets[0].id: ast.literal_eval(one.value)
        for one in tree.body
        if isinstance(one, ast.Assign)
        and isinstance(one.targets[0], ast.Name)
        and one.targets[0].id[1:] != "_getattr__"
    }
    [typed] = [one.body for one in tree.body if isinstance(one, ast.If)]
    files = {file: set(names.split()) for file, names in said["_FILES"].items()}
    at_once = set().union(*imported(tree.body, room(door)).values())
    return imported(typed, room(door)), files, at_once, said["__all__"]


@pytest.mark.parametrize("door", DOORS, ids=room)
def test_the_three_lists_of_a_door_name_the_same(door: Path) -> None:
    typed, files, at_once, everything = lists(door)
    assert files == typed
    names = [name for held in files.values() for name in held]
    assert len(names) == len(set(names)), "two files for one name"
    assert len(everything) == len(set(everything))
    assert set(everything) == set(names) | at_once


@pytest.mark.parametrize("door", DOORS, ids=room)
def test_every_name_is_where_the_door_says(door: Path) -> None:
    """In a fresh interpreter: `import *` asks for all, and each name is found in the file that is said to hold it."""
    _, files, _, everything = lists(door)
    look = (
        f"import sys; sys.path.insert(0, {str(SRC)!r})\nfrom {room(door)} import *\n"
        f"for name in {everything!r}: globals()[name]\n"
        f"for file, names in { {file: sorted(names) for file, names in files.items()}!r}.items():\n"
        f"    for name in names: assert hasattr(sys.modules['{room(door)}.' + file], name), (file, name)\n"
    )
    run = subprocess.run([sys.executable, "-c", look], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr


def test_all_doors_are_found() -> None:
    assert {room(door) for door in DOORS} == {
        *("barewire.modbus", "barewire.canopen", "barewire.canopen.gateway", "barewire.canopen.sdo"),
        *("barewire.devices", "barewire.io"),
    }
