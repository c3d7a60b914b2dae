"""What changed between two versions of a file: which functions, classes and constants came, went, or are different.

    changed    Bus.ask, RtuLine.feed
    new        FanOut
    gone       EchoLine

Comments and layout do not count, docstrings do.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from typing import NamedTuple

_NAMED = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)


class Changes(NamedTuple):
    """Names of functions, `Class.method`s, classes and constants."""

    changed: tuple[str, ...]
    new: tuple[str, ...]
    gone: tuple[str, ...]

    def __str__(self) -> str:
        rows = [f"  {kind:8} {', '.join(names)}" for kind, names in self._asdict().items() if names]
        return "\n".join(rows or ["  nothing but comments"])


def changes(before: str, after: str) -> Changes:
    """Return what changed from one text of a file to another, in the order of the file."""
    old, new = dict(_definitions(ast.parse(before))), dict(_definitions(ast.parse(after)))
    return Changes(
        tuple(name for name in new if name in old and old[name] != new[name]),
        tuple(name for name in new if name not in old and _owner(name) not in new.keys() - old.keys()),
        tuple(name for name in old if name not in new and _owner(name) not in old.keys() - new.keys()),
    )


def _owner(name: str) -> str:
    """Return the class of a method: a class that came or went is named without its methods."""
    return name.rpartition(".")[0]


def _definitions(node: ast.Module | ast.ClassDef, owner: str = "") -> Iterator[tuple[str, str]]:
    """Yield each definition by name, with its code; a class without its methods."""
    for part in node.body:
        if isinstance(part, ast.ClassDef):
            yield from _definitions(part, f"{owner}{part.name}.")
            rest = [inner for inner in part.body if not isinstance(inner, _NAMED)]
            bases = [*part.decorator_list, *part.bases, *part.keywords]
            yield f"{owner}{part.name}", "\n".join(ast.dump(inner) for inner in (*bases, *rest))
        elif isinstance(part, ast.FunctionDef | ast.AsyncFunctionDef):
            yield f"{owner}{part.name}", ast.dump(part)
        elif not owner and isinstance(part, ast.Assign | ast.AnnAssign):
            targets = part.targets if isinstance(part, ast.Assign) else [part.target]
            yield ", ".join(map(ast.unparse, targets)), ast.dump(part)
