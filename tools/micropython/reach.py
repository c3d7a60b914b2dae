"""Which definitions are needed: what a part of the edition names, what that names, and so on.

A function or constant is needed if a needed one names it. A method is needed if its class is, and if its name is an
attribute anywhere in what is needed, or a text there (`getattr`), or a name that the edition offers; so that of two
methods with one name both stay. Methods that only show a message field by field, for `explain`, are left out.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator

from tools.micropython.sources import SMALL, Function, FunctionNode, Place, Sources, Unknown, imported

_BASE_FIELDS = {"barewire.modbus.messages.base", "barewire.codecs.layout"}
"""Where `fields` is needed: an error names the offset of a field. The others say what its value means."""


class Needed:
    """What the roots need. `methods` are the names of methods that are needed because a program calls them."""

    def __init__(self, sources: Sources, methods: set[str]) -> None:
        self.sources = sources
        self.places: set[Place] = set()
        self._called = set(methods)
        self._waiting: dict[str, list[tuple[Place, FunctionNode]]] = {}  # methods that nothing has named yet
        self._kept: set[int] = set()
        self._due: list[tuple[Place, ast.AST]] = []

    def add(self, place: Place) -> None:
        """Add a root and all that it needs."""
        self._add(place)
        while self._due:
            self._visit(*self._due.pop())

    def keeps(self, method: FunctionNode) -> bool:
        """Whether a method of a needed class is needed."""
        return id(method) in self._kept

    def _add(self, place: Place) -> None:
        if place in self.places:
            return
        self.places.add(place)
        module = self.sources.module(place.module)
        if not place.name:  # the module itself, whose names are looked up while the program runs
            for name in module.definitions:
                self._add(Place(place.module, name))
            for name in module.imports:
                found = self.sources.find(module.imports[name])
                if found is not None:
                    self._add(found)
            return
        definition = module.definitions[place.name]
        if not isinstance(definition, ast.ClassDef):
            self._due.append((place, definition))
            return
        self._due += [(place, node) for node in (*definition.bases, *definition.decorator_list)]
        for part in definition.body:
            if not isinstance(part, Function):
                self._due.append((place, part))
            elif part.name in self._called or (part.name.startswith("__") and part.name.endswith("__")):
                self._keep(place, part)
            else:
                self._waiting.setdefault(part.name, []).append((place, part))

    def _keep(self, place: Place, method: FunctionNode) -> None:
        if method.name == "fields" and place.module not in _BASE_FIELDS:
            return
        self._kept.add(id(method))
        self._due.append((place, method))

    def _call(self, name: str) -> None:
        self._called.add(name)
        for place, method in self._waiting.pop(name, ()):
            self._keep(place, method)

    def _visit(self, place: Place, tree: ast.AST) -> None:
        local = {name: where for node in ast.walk(tree) for name, where in _imports(node)}
        for node in ast.walk(tree):
            if isinstance(node, ast.Attribute):
                self._call(node.attr)
            elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value.isidentifier():
                self._call(node.value)
            elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load):
                found = self.sources.find(local[node.id]) if node.id in local else self._resolve(place, node)
                if found is not None:
                    self._add(found)
            elif isinstance(node, ast.Match):
                raise Unknown(f"{place.module}, line {node.lineno}: a pattern of `match` that no rule lowers")
            elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
                of = self._resolve(place, node.func)
                if of is not None and of.name in self.sources.module(of.module).enums:
                    raise Unknown(f"{place.module}: {of.name}(...) in {place.name}, which is a class of numbers here")

    def _resolve(self, place: Place, node: ast.Name) -> Place | None:
        try:
            if place.module != SMALL:
                self.sources.check(place.module, node.id)
            return self.sources.resolve(place.module, node)
        except Unknown as error:
            raise Unknown(f"{place.module}, {place.name}: {error}") from None


def _imports(node: ast.AST) -> Iterator[tuple[str, Place]]:
    if isinstance(node, (ast.Import, ast.ImportFrom)):
        yield from imported(node).items()
