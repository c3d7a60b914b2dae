"""The page of the errors: every exception that barewire raises on purpose, and every reason of a DecodeError.

The tree and the texts come from the docstrings, the reasons from `REASONS` of `errors.py` with the comment behind each,
and where an exception is raised, from the `raise` statements of the source.
"""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Iterator

from tools import rooms
from tools.website.docstrings import Link, inline, rendered
from tools.website.source import Module, Room, Thing

PATH = "reference/errors.rst"
_BASE = "BarewireError"

_HEAD = """Errors
======

Every error that barewire raises on purpose is a ``BarewireError``: one ``except`` catches them all. Functions raise;
machines, which have a method ``feed``, never raise on received bytes: they report noise as an event. An error names
what was given, where, and what was expected. A command prints it as one line (:doc:`exit statuses <commands>`).
"""

_BUILTIN = """An error that is also one of Python can be caught as that one: ``NoAnswer`` and ``DriveStuck`` are
``TimeoutError``, ``PortError`` is ``OSError``, ``EncodeError`` and ``DecodeError`` are ``ValueError``, ``UnknownName``
is ``LookupError``.
"""


def family(found: list[Room]) -> list[tuple[Module, Thing]]:
    """Return the base class and all classes below it, a class before those below it."""
    classes = [(module, thing) for room in found for module in room.modules for thing in module.things if thing.bases]

    def below(name: str) -> Iterator[tuple[Module, Thing]]:
        for module, thing in classes:
            if thing.bases[0].rpartition(".")[2] == name:
                yield module, thing
                yield from below(thing.name)

    base = [(module, thing) for module, thing in classes if thing.name == _BASE]
    return [*base, *below(_BASE)]


def raised_in() -> dict[str, list[str]]:
    """Return for each exception the modules with a `raise` of it."""
    found: dict[str, set[str]] = defaultdict(set)
    for name, file in rooms.files().items():
        for node in rooms.statements(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call):
                found[ast.unparse(node.exc.func).rpartition(".")[2]].add(name)
    return {error: sorted(modules) for error, modules in found.items()}


def reasons() -> dict[str, str]:
    """Return the reasons of a DecodeError, each with its meaning."""
    text = rooms.files()["barewire.errors"].read_text(encoding="utf-8")
    listed = text[text.index("REASONS") :]
    return dict(re.findall(r'^    "(\w+)",  # (.+)$', listed, re.MULTILINE))


def page(found: list[Room], link: Link) -> str:
    """Return the whole page."""
    lines = [_HEAD, "The tree", "--------", "", ".. code-block:: text", ""]
    members = family(found)
    parent = {thing.name: thing.bases[0].rpartition(".")[2] for _, thing in members}
    for _, thing in members:
        depth, name = 0, thing.name
        while name != _BASE:
            depth, name = depth + 1, parent[name]
        lines.append(f"   {'    ' * depth}{thing.name}")
    lines += ["", _BUILTIN, "Reasons of a DecodeError", "------------------------", ""]
    lines += ["The test vectors use the same words.", ""]
    for reason, meaning in reasons().items():
        lines += [f"``{reason}``", f"   {inline(meaning, link)}", ""]
    lines += ["Every error", "-----------", ""]
    where = raised_in()
    for module, thing in members:
        lines += [f"{thing.name}", "~" * len(thing.name), ""]
        lines += [f":py:exc:`{module.name}.{thing.name}`, a {inline(f'`{parent[thing.name]}`', link)}.", ""]
        lines += rendered(thing.docstring, link)
        if places := where.get(thing.name):
            lines += [f"Raised in {', '.join(inline(f'`{place}`', link) for place in places)}.", ""]
    return "\n".join(lines) + "\n"
