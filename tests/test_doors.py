"""Lazy doors: type checkers and programs are given the same names, and each name is in the file that the door gives."""

from __future__ import annotations

import ast
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

from tools.rooms import HOUSES

DOORS = [
    file
    for package, folder in HOUSES.items()
    for file in sorted((folder / package).rglob("__init__.py"))
    if "lazy(" in file.read_text("utf-8")
]


def room(door: Path) -> str:
    folder = next(folder for folder in HOUSES.values() if door.is_relative_to(folder))
    return ".".join(door.parent.relative_to(folder).parts)


def lists(door: Path) -> tuple[dict[str, set[str]], dict[str, set[str]]]:
    """File -> names, as the door imports them for type checkers, and as it gives them to `lazy`.

    A door that offers everything of a door below it has `import *` in one list and `" ".join(...)` in the other.
    """
    tree = ast.parse(door.read_text("utf-8"))
    within = room(door) + "."
    typed: dict[str, set[str]] = {}
    for node in ast.walk(tree):
        if (
            isinstance(node, ast.ImportFrom)
            and (node.module or "").startswith(within)
            and node.names[0].name not in ("NAMES", "lazy", "TYPE_CHECKING")
        ):
            file = str(node.module).removeprefix(within)
            if node.names[0].name == "*":
                typed[file] = set().union(*lists(door.parent / file / "__init__.py")[0].values())
                continue
            assert all(alias.asname == alias.name for alias in node.names), f"{door}:{node.lineno}: not `name as name`"
            typed.setdefault(file, set()).update(alias.name for alias in node.names)
    [call] = [node for node in ast.walk(tree) if isinstance(node, ast.Call) and ast.unparse(node.func) == "lazy"]
    files: dict[str, set[str]] = {}
    assert isinstance(call.args[1], ast.Dict)
    for key, value in zip(call.args[1].keys, call.args[1].values, strict=True):
        assert isinstance(key, ast.Constant)
        file = str(key.value)
        if isinstance(value, ast.Constant):
            files[file] = set(str(value.value).split())
        else:
            files[file] = set().union(*lists(door.parent / file / "__init__.py")[1].values())
    return typed, files


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
        f"import sys; sys.path[:0] = {[*map(str, HOUSES.values())]}\nfrom {room(door)} import *\n"
        f"for file_, names_ in { {file: sorted(names) for file, names in files.items()}!r}.items():\n"
        f"    module_ = sys.modules['{room(door)}.' + file_]\n"
        f"    for name_ in names_: assert globals()[name_] is getattr(module_, name_), name_\n"
    )
    run = subprocess.run([sys.executable, "-c", look], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr


def test_these_rooms_have_lazy_doors() -> None:
    assert {room(door) for door in DOORS} == {
        *("barewire.modbus", "barewire.modbus.messages", "barewire.canopen", "barewire.canopen.sdo"),
        *("barewire", "barewire.codecs", "barewire.devices", "barewire.gateway", "barewire.io", "barewire.rtu"),
        "barewire_workbench",
    }


@pytest.mark.parametrize("door", DOORS, ids=room)
def test_a_console_completes_the_names_that_are_not_loaded(door: Path) -> None:
    module = import_module(room(door))
    _, files = lists(door)
    assert {name for names in files.values() for name in names} <= set(dir(module))
    assert "__doc__" in dir(module)
