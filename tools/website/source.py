"""Reads the public names of both packages from their source, without importing them.

    Room      a package: its docstring, its modules in reading order, the names it offers in `__all__`
    Module    a file: its docstring and its public objects, in the order of the file
    Thing     a class, function or value: kind, signature, docstring, members

Public is what begins with no underscore and is defined in the file; of a file with a list `__all__`, what is in it.
The reading order of a room is the order in which the docstring of its `__init__.py` names the files.
"""

from __future__ import annotations

import ast
import re
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from tools.rooms import HOUSES, ROOT as ROOT


@dataclass
class Thing:
    """A class, function or value that a caller may use."""

    kind: str
    """`class`, `exception`, `function`, `method`, `property`, `attribute` or `data`."""
    name: str
    signature: str = ""
    docstring: str = ""
    bases: tuple[str, ...] = ()
    is_async: bool = False
    decorators: tuple[str, ...] = ()
    members: list[Thing] = field(default_factory=list)


@dataclass
class Module:
    """One file."""

    name: str
    file: Path
    docstring: str
    things: list[Thing]


@dataclass
class Room:
    """One package."""

    name: str
    file: Path
    docstring: str
    modules: list[Module]
    rooms: list[str]
    """The full names of the packages inside, in reading order."""
    offers: dict[str, str]
    """What may be imported from the package itself: name -> the full name of where it is defined."""


_PARTS_OF_FILES = "one_file"
"""The folder of what `barewire vendor` puts into its files: nobody imports it, and its classes have names of others."""


@cache
def rooms() -> list[Room]:
    """Return every room of both packages, in reading order, an outer one before those inside."""
    return [room for package in HOUSES for room in rooms_below(package)]


def rooms_below(name: str) -> list[Room]:
    """Return the room of that name, and those inside it."""
    found = _room(HOUSES[name.partition(".")[0]] / name.replace(".", "/"), name)
    return [found, *(room for inner in found.rooms for room in rooms_below(inner))]


def _room(folder: Path, name: str) -> Room:
    tree = ast.parse((folder / "__init__.py").read_text(encoding="utf-8"))
    docstring = ast.get_docstring(tree) or ""
    files = [file for file in folder.glob("*.py") if not file.name.startswith("_")]
    inner = [file.parent for file in folder.glob("*/__init__.py") if not file.parent.name.startswith("_")]
    inner = [part for part in inner if part.name != _PARTS_OF_FILES]
    order = reading_order(docstring, {*(file.stem for file in files), *(part.name for part in inner)})
    modules = [module(file, f"{name}.{file.stem}") for file in sorted(files, key=lambda file: order.index(file.stem))]
    return Room(
        name,
        folder / "__init__.py",
        docstring,
        [each for each in modules if each.things or each.docstring],
        [f"{name}.{part.name}" for part in sorted(inner, key=lambda part: order.index(part.name))],
        offers(tree),
    )


def offers(tree: ast.Module) -> dict[str, str]:
    """Return what an `__init__.py` imports for its callers: `from x import A as A`, or A is in `__all__`.

    >>> offers(ast.parse("from a.b import C as C, d as _d, e\\nfrom a import *\\n__all__ = ['e']"))
    {'C': 'a.b.C', 'e': 'a.b.e'}
    """
    listed = _listed(tree)
    found = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module and not node.level:
            for name in node.names:
                if name.asname == name.name or name.name in listed:
                    found[name.name] = f"{node.module}.{name.name}"
    return found


def reading_order(docstring: str, names: set[str]) -> list[str]:
    """Return the names as the drawings of a docstring mention them; the others at the end.

    >>> reading_order("Files:\\n\\n    frame   one frame      line    finds frames", {"line", "crc", "frame"})
    ['frame', 'line', 'crc']
    """
    drawn = "\n".join(line for line in docstring.splitlines() if line.startswith(" "))

    def place(name: str) -> tuple[int, str]:
        # A file stands at the start of a line or of a column, or in a list behind a comma or a slash.
        found = re.search(rf"(?:^|\s\s|, |/|\.){re.escape(name)}(?![\w-])", drawn, re.MULTILINE)
        return (found.start() if found else len(drawn) + 1, name)

    return sorted(names, key=place)


def module(file: Path, name: str) -> Module:
    """Read one file."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    listed = _listed(tree)
    things = [
        thing
        for thing in _things(tree.body, "data")
        if (thing.name in listed if listed else not thing.name.startswith("_"))
    ]
    return Module(name, file, ast.get_docstring(tree) or "", things)


def _listed(tree: ast.Module) -> set[str]:
    for node in tree.body:
        if isinstance(node, ast.Assign) and [ast.unparse(target) for target in node.targets] == ["__all__"]:
            try:
                return set(ast.literal_eval(node.value))
            except ValueError:
                return set()
    return set()


def _things(body: list[ast.stmt], value_kind: str) -> list[Thing]:
    found: list[Thing] = []
    for at, node in enumerate(body):
        below = body[at + 1] if at + 1 < len(body) else None
        text = below.value.value if isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant) else ""
        said = text if isinstance(text, str) else ""
        if isinstance(node, ast.ClassDef):
            found.append(_class(node))
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            thing = _function(node, inside=value_kind == "attribute")
            if thing and not any(other.name == thing.name for other in found):
                found.append(thing)
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            value = f" = {_short(node.value)}" if node.value else ""
            found.append(Thing(value_kind, node.target.id, f": {ast.unparse(node.annotation)}{value}", said))
        elif isinstance(node, ast.Assign) and len(node.targets) == 1 and isinstance(node.targets[0], ast.Name):
            found.append(Thing(value_kind, node.targets[0].id, f" = {_short(node.value)}", said))
    return found


def _short(value: ast.expr | None) -> str:
    text = ast.unparse(value) if value else ""
    return text if len(text) <= 80 and "\n" not in text else "..."


def _class(node: ast.ClassDef) -> Thing:
    members = [member for member in _things(node.body, "attribute") if not member.name.startswith("_")]
    bases = tuple(ast.unparse(base) for base in node.bases)
    decorators = tuple(ast.unparse(decorator) for decorator in node.decorator_list)
    start = [member for member in node.body if isinstance(member, ast.FunctionDef) and member.name == "__init__"]
    if start:
        signature = _arguments(start[-1].args, skip_first=True)
    elif any(decorator.startswith("dataclass") for decorator in decorators) or "NamedTuple" in bases:
        fields = [ast.unparse(member) for member in node.body if _is_field(member)]
        signature = f"({', '.join(fields)})"
    else:
        signature = ""
    kind = (
        "exception"
        if node.name.endswith("Error") or any(b.endswith(("Error", "Exception")) for b in bases)
        else "class"
    )
    return Thing(kind, node.name, signature, ast.get_docstring(node) or "", bases, False, decorators, members)


def _is_field(node: ast.stmt) -> bool:
    return isinstance(node, ast.AnnAssign) and not ast.unparse(node.annotation).startswith(("ClassVar", "KW_ONLY"))


def _function(node: ast.FunctionDef | ast.AsyncFunctionDef, inside: bool) -> Thing | None:
    decorators = tuple(ast.unparse(decorator) for decorator in node.decorator_list)
    if any(decorator.endswith((".setter", "overload")) for decorator in decorators):
        return None
    said = ast.get_docstring(node) or ""
    returns = f" -> {ast.unparse(node.returns)}" if node.returns else ""
    if inside and any(decorator.endswith("property") for decorator in decorators):
        return Thing("property", node.name, f": {ast.unparse(node.returns)}" if node.returns else "", said)
    skip = inside and "staticmethod" not in decorators
    signature = _arguments(node.args, skip_first=skip) + returns
    kind = "method" if inside else "function"
    return Thing(kind, node.name, signature, said, (), isinstance(node, ast.AsyncFunctionDef), decorators)


def _arguments(given: ast.arguments, skip_first: bool) -> str:
    positional = [*given.posonlyargs, *given.args]
    kept = positional[1:] if skip_first else positional
    shown = ast.arguments(
        posonlyargs=[argument for argument in kept if argument in given.posonlyargs],
        args=[argument for argument in kept if argument in given.args],
        vararg=given.vararg,
        kwonlyargs=given.kwonlyargs,
        kw_defaults=given.kw_defaults,
        kwarg=given.kwarg,
        defaults=given.defaults,
    )
    return f"({ast.unparse(shown)})"
