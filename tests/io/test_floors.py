"""The floors of `barewire.io`: a file imports only from its room and lower floors, type-only imports counted."""

from __future__ import annotations

import ast
from pathlib import Path

import barewire.io

HOME = Path(barewire.io.__file__).parent
FLOORS = [
    {"adapter"},
    {"endpoint", "log"},
    {"ports"},
    {"engine"},
    {"drive"},
    {"named_values"},
    {"modbus", "canopen"},
    {"machine", "fault_injection"},
    {"server"},
]
"""From the lowest to the highest. Rooms on one floor do not import each other."""


def floor(room: str) -> int:
    return next(level for level, rooms in enumerate(FLOORS) if room in rooms)


def test_no_file_imports_from_a_higher_floor() -> None:
    wrong = []
    for file in sorted(HOME.rglob("*.py")):
        parts = file.relative_to(HOME).with_suffix("").parts
        if parts == ("__init__",):
            continue
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("barewire.io."):
                other = str(node.module).split(".")[2]
                if other != parts[0] and floor(other) >= floor(parts[0]):
                    wrong.append(f"io/{'/'.join(parts)}.py:{node.lineno} imports io.{other}")
    assert not wrong, "\n".join(wrong)


def test_every_room_is_on_a_floor() -> None:
    rooms = {path.stem for path in HOME.iterdir() if path.stem not in ("__init__", "__pycache__")}
    assert rooms == set().union(*FLOORS)
