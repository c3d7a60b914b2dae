"""The modules of barewire as text: what each statement at their top defines, and which names of others it uses.

    module      barewire.rtu.frame
    statement   def decode(data): ...        names: decode      uses: crc16 of barewire.rtu.crc, SHORTEST of this module

Sources are read, not imported. A name that a package only passes on is followed to the module that defines it; an
import inside a function counts as one at the top. Comments above a statement, and the text below a constant that
documents it, belong to that statement.
"""

from __future__ import annotations

import ast
from collections.abc import Container, Iterable, Iterator, Mapping
from importlib.util import find_spec
from itertools import accumulate
from pathlib import Path
from typing import NamedTuple

HOUSES = ("barewire", "barewire_workbench")
_COMPREHENSIONS = ast.ListComp | ast.SetComp | ast.DictComp | ast.GeneratorExp


class Place(NamedTuple):
    """A name at the top of one of our modules. Without a name it is the module."""

    module: str
    name: str = ""


class Foreign(NamedTuple):
    """A name of another library, and what a module calls it. Without a name it is the module."""

    module: str
    name: str
    alias: str

    def __str__(self) -> str:
        statement = f"from {self.module} import {self.name}" if self.name else f"import {self.module}"
        return statement if self.alias == (self.name or self.module) else f"{statement} as {self.alias}"


Target = Place | Foreign


class Use(NamedTuple):
    """A node that stands for a name at the top of a module, ours or another: `crc16`, or `rtu.crc16`."""

    node: ast.expr
    target: Target


class Statement:
    """A statement at the top of a module, and its lines, from `first` up to and without `end`, counted from 0."""

    def __init__(self, node: ast.stmt, names: Iterable[str], first: int) -> None:
        self.node = node
        self.names = tuple(names)
        self.extends = ast.unparse(node.target) if isinstance(node, ast.AugAssign) else ""
        """The constant that this statement adds to."""
        self.first, self.end = first, node.end_lineno or node.lineno


class Module:
    """One module: its text, docstring, statements, and what its imports bring."""

    def __init__(self, name: str, text: str) -> None:
        self.name = name
        self.text = text
        self.lines = text.splitlines(keepends=True)
        self.offsets = [0, *accumulate(len(line.encode()) for line in self.lines)]
        """Where each line begins, in bytes."""
        tree = ast.parse(text)
        self.docstring = ast.get_docstring(tree, clean=False) or ""
        self.statements: list[Statement] = []
        self.imports: dict[str, Target] = {}
        self.stars: list[str] = []
        end = 0
        for node in tree.body:
            if isinstance(node, ast.Import | ast.ImportFrom):
                self._import(node)
            elif isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
                for inner in node.body:
                    if isinstance(inner, ast.Import | ast.ImportFrom):
                        self._import(inner)
            elif not isinstance(node, ast.Expr):
                names = () if isinstance(node, ast.AugAssign) else _bound([node])
                self.statements.append(Statement(node, names, self._first_line(node, end)))
            elif self.statements:  # the text below a constant
                self.statements[-1].end = node.end_lineno or node.lineno
            end = node.end_lineno or node.lineno
        self.names = {name: statement for statement in self.statements for name in statement.names}

    def _import(self, node: ast.Import | ast.ImportFrom) -> None:
        for alias, target in imported(node):
            if alias == "*":
                self.stars.append(target.module)
            else:
                self.imports[alias] = target

    def _first_line(self, node: ast.stmt, after: int) -> int:
        """Return the line where a statement begins: its first decorator, or the comments above it."""
        decorators: list[ast.expr] = getattr(node, "decorator_list", [])
        first = min([node.lineno, *(decorator.lineno for decorator in decorators)]) - 1
        while first > after and (not self.lines[first - 1].strip() or self.lines[first - 1].startswith("#")):
            first -= 1
        return first


def imported(node: ast.Import | ast.ImportFrom) -> Iterator[tuple[str, Target]]:
    """Yield what an import brings, by the name that it gets."""
    module = getattr(node, "module", None) or ""
    for alias in node.names:
        name = alias.asname or alias.name
        home = (module or alias.name).split(".")[0]
        if isinstance(node, ast.ImportFrom):
            yield name, Place(module, alias.name) if home in HOUSES else Foreign(module, alias.name, name)
        else:
            yield name, Place(alias.name) if home in HOUSES else Foreign(alias.name, "", name)


def _bound(nodes: Iterable[ast.AST]) -> dict[str, Target | None]:
    """Return the names that these statements bind in the scope around them; for imported ones with what they are."""
    names: dict[str, Target | None] = {}
    not_here: set[str] = set()
    for part in (part for node in nodes for part in parts(node)):
        if isinstance(part, ast.Name) and isinstance(part.ctx, ast.Store):
            names[part.id] = None
        elif isinstance(part, ast.Import | ast.ImportFrom):
            names |= imported(part)
        elif isinstance(part, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef | ast.ExceptHandler) and part.name:
            names[part.name] = None
        elif isinstance(part, ast.Global | ast.Nonlocal):
            not_here.update(part.names)
    return {name: target for name, target in names.items() if name not in not_here}


def folder_of(package: str) -> Path:
    """Return the folder of the sources of a package."""
    spec = find_spec(package)
    assert spec is not None
    assert spec.submodule_search_locations is not None, f"{package} is a module"
    return Path(spec.submodule_search_locations[0])


def parts(node: ast.AST) -> Iterator[ast.AST]:
    """Yield a node and all nodes inside it, without what is inside functions, classes and comprehensions."""
    yield node
    if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef | ast.Lambda | _COMPREHENSIONS):
        for child in ast.iter_child_nodes(node):
            yield from parts(child)


class Sources:
    """All modules, each read when it is first needed.

    patches     by module: texts and what stands in their place
    in_place    names whose definition is another one
    """

    def __init__(
        self,
        patches: Mapping[str, Iterable[tuple[str, str]]] | None = None,
        in_place: Mapping[Place, Place] | None = None,
    ) -> None:
        self._patches = patches or {}
        self._in_place = in_place or {}
        self._modules: dict[str, Module | None] = {}
        self._resolved: dict[Place, Target | None] = {}

    def module(self, name: str) -> Module:
        """Return a module. Raise LookupError if there is none, or if a patch does not fit its text."""
        module = self._module(name)
        if module is None:
            raise LookupError(f"no module {name}")
        return module

    def _module(self, name: str) -> Module | None:
        if name not in self._modules:
            spec = find_spec(name)
            self._modules[name] = Module(name, self._text(name, spec.origin)) if spec and spec.origin else None
        return self._modules[name]

    def _text(self, name: str, path: str) -> str:
        """Return the text of a module, patched."""
        text = Path(path).read_text(encoding="utf-8")
        for old, new in self._patches.get(name, ()):
            if text.count(old) != 1:
                raise LookupError(f"{name} has {text.count(old)} times, and not once: {old}")
            text = text.replace(old, new)
        return text

    def resolve(self, target: Target | None, name: str) -> Target | None:
        """Return what `name` is in a module, followed to where it is defined; None for a builtin and the like."""
        if not isinstance(target, Place) or target.name:
            return None
        place = Place(target.module, name)
        if place not in self._resolved:
            self._resolved[place] = self._follow(place.module, name)
        return self._resolved[place]

    def _follow(self, home: str, name: str) -> Target | None:
        module = self.module(home)
        if name in module.names:
            return self._in_place.get(Place(module.name, name), Place(module.name, name))
        brought = module.imports.get(name)
        if isinstance(brought, Place) and brought.name:
            target = self.resolve(Place(brought.module), brought.name)
            if target is None:
                raise LookupError(f"{home} imports {brought.name}, which {brought.module} does not define")
            return target
        if brought is not None:
            return brought
        if module.text and self._is_submodule(module.name, name):
            return Place(f"{module.name}.{name}")
        for star in module.stars:
            if (target := self.resolve(Place(star), name)) is not None:
                return target
        return None

    def _is_submodule(self, package: str, name: str) -> bool:
        spec = find_spec(package)
        is_package = spec is not None and spec.submodule_search_locations is not None
        return is_package and find_spec(f"{package}.{name}") is not None

    def uses(self, module: Module, node: ast.AST, skipped: Container[ast.AST] = ()) -> Iterator[Use]:
        """Yield the nodes inside this one that stand for names at the top of a module, without those to skip."""
        yield from self._uses(module, node, skipped, [])

    def _uses(self, module: Module, node: ast.AST, skipped: Container[ast.AST], scopes: list[_Scope]) -> Iterator[Use]:
        if node in skipped:
            return
        if isinstance(node, ast.Name | ast.Attribute):
            target = self._target(module, node, scopes)
            if target is not None:
                yield Use(node, target)
                return
        inside: set[ast.AST] = set()
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            inside.update(node.body if isinstance(node.body, list) else [node.body])
        elif isinstance(node, ast.ClassDef):
            inside.update(node.body)
        elif isinstance(node, _COMPREHENSIONS):
            inside.update(ast.iter_child_nodes(node))
        within = [*scopes, self._scope(node)] if inside else scopes
        for child in ast.iter_child_nodes(node):
            yield from self._uses(module, child, skipped, within if child in inside else scopes)

    def _scope(self, node: ast.AST) -> _Scope:
        """Return the names that a function, class or comprehension has for itself, with what they are if imported."""
        names = _bound(ast.iter_child_nodes(node))
        arguments = getattr(node, "args", None)
        if isinstance(arguments, ast.arguments):
            names |= {part.arg: None for part in ast.walk(arguments) if isinstance(part, ast.arg)}
        for name, target in names.items():
            if isinstance(target, Place) and target.name:
                names[name] = self.resolve(Place(target.module), target.name)
        return _Scope(names, isinstance(node, ast.ClassDef))

    def _target(self, module: Module, node: ast.expr, scopes: list[_Scope]) -> Target | None:
        """Return what `name` or `module.name` stands for; None for a local name, and for an attribute of a value."""
        if isinstance(node, ast.Attribute):
            return self.resolve(self._target(module, node.value, scopes), node.attr)
        if not isinstance(node, ast.Name):
            return None
        for depth, scope in enumerate(reversed(scopes)):
            if node.id in scope.names and not (scope.is_class and depth):
                return scope.names[node.id]
        return self.resolve(Place(module.name), node.id)


class _Scope(NamedTuple):
    names: dict[str, Target | None]
    is_class: bool
