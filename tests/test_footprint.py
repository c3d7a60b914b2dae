"""What an import loads, module by module: read off a fresh interpreter, so that nothing comes in unnoticed.

How long it takes and how much memory it needs is measured by `bench/test_footprint.py`; here nothing is timed.
"""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

from barewire.errors import REASONS

SRC = Path(__file__).parent.parent / "src"

# What the interpreter brings along differs by version, and so do the helpers of `collections`: these may be there.
ALLOWED = {
    *("__future__", "collections", "collections.abc", "_collections", "_collections_abc", "_weakref"),
    *("itertools", "keyword", "operator", "_operator", "reprlib", "builtins", "_thread", "abc", "_abc"),
    *("struct", "_struct", "math"),
}
ENVELOPE = {"barewire", "barewire.door", "barewire.errors", "barewire.modbus", "barewire.modbus.adu", "barewire.record"}


def loaded(statement: str) -> set[str]:
    """The modules that a statement adds. `-I -S`: nothing of the environment is there before it."""
    look = f"import sys; sys.path.insert(0, {str(SRC)!r}); there = set(sys.modules); {statement}; "
    look += "print(*(set(sys.modules) - there))"
    run = subprocess.run([sys.executable, "-I", "-S", "-c", look], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    return set(run.stdout.split())


@pytest.mark.parametrize(
    ("room", "needs"),
    [
        ("codecs", {"barewire", "barewire.errors", "barewire.record"}),
        ("rtu", ENVELOPE),
        ("ascii", ENVELOPE),
        ("tcp", ENVELOPE),
    ],
)
def test_a_light_room_loads_itself_and_next_to_nothing(room: str, needs: set[str]) -> None:
    found = loaded(f"import barewire.{room}")
    strangers = {name for name in found if not name.startswith("barewire")} - ALLOWED
    assert not strangers
    files = {name for name in found if name.startswith(f"barewire.{room}")}
    assert {name for name in found if name.startswith("barewire")} - files == needs


def test_the_line_of_rtu_is_loaded_when_it_is_asked_for() -> None:
    assert "barewire.rtu.line" not in loaded("import barewire.rtu")
    assert "barewire.rtu.line" in loaded("import barewire.rtu; barewire.rtu.RtuLine")


def test_the_blocking_tcp_client_loads_no_loop_no_devices_and_no_other_bus() -> None:
    found = loaded("from barewire.shells import open_modbus; import barewire.shells.tcp_socket")
    heavy = {"asyncio", "ssl", "logging", "tomllib", "fractions", "subprocess"}
    heavy |= {"typing", "dataclasses", "inspect", "re", "urllib.parse", "ipaddress", "random"}
    assert not heavy & found
    for room in ("barewire.canopen", "barewire.devices", "barewire.explain", "barewire.ascii", "barewire.rtu.line"):
        assert room not in found
    # No message before one is said, not even what a bus itself may have to say, nor how values become bytes.
    assert "barewire.codecs" not in found
    letter = {name.removeprefix("barewire.modbus.") for name in found if name.startswith("barewire.modbus.")}
    assert letter == {"adu", "bus", "exceptions", "lost", "turns"}


def test_reading_registers_loads_the_file_of_that_message_only_when_said() -> None:
    found = loaded("from barewire.shells.verbs import Verbs; Verbs.read_holding_registers")
    assert "barewire.modbus.registers" in found
    assert "barewire.modbus.files" not in found


def test_the_reasons_are_those_of_their_type() -> None:
    """Which is written for type checkers only, so a program cannot read it: the source can be."""
    tree = ast.parse((SRC / "barewire" / "errors.py").read_text(encoding="utf-8"))
    literals = [
        node.value.slice
        for node in ast.walk(tree)
        if isinstance(node, ast.Assign)
        and isinstance(node.targets[0], ast.Name)
        and node.targets[0].id == "Reason"
        and isinstance(node.value, ast.Subscript)
    ]
    assert [ast.literal_eval(literal) for literal in literals] == [REASONS]
