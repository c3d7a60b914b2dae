"""Makes one file of many modules: what its public names need, and nothing else, bottom up.

    roots           ModbusRtuClient of rtu_client, ReadCoils ... of coils
    what they use   RtuLine, Bus, Request, crc16, Layout, ...          statement by statement, until nothing is added
    of a class      its methods with two underscores, and those whose name something in the file uses
    the text        module by module, each behind those that it imports, with its docstring and its comments

A method is needed if any attribute or text of the file has its name: so one that is reached by `getattr` stays, and
some stay that nothing calls. A name that two modules give to different things gets the name of its module as well.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import NamedTuple

from barewire_workbench.vendor.sources import Foreign, Module, Place, Sources, Statement, Use, imported

_METHODS = (ast.FunctionDef, ast.AsyncFunctionDef)
_WIDTH = 120


class _Edit(NamedTuple):
    """A replacement of text, by places in the UTF-8 bytes of a module, in which the nodes of `ast` count too."""

    start: int
    end: int
    text: str = ""


class OneFile:
    """The statements that the roots need, and their text.

    roots       what the file is for
    is_public   whether the classes of a module keep all their methods, except those that use what is left out
    without     methods that are left out, as Place(module, "Class.method") or Place(module, "*.method")
    docstrings  of modules of which little is in the file, in place of their own
    left_out    modules of which nothing may be in the file: items of lists that name something of them are left out
    """

    def __init__(
        self,
        sources: Sources,
        roots: Iterable[Place],
        *,
        is_public: Callable[[str], bool],
        left_out: Iterable[str] = (),
        without: Iterable[Place] = (),
        docstrings: Mapping[str, str] | None = None,
    ) -> None:
        self._sources = sources
        self._is_public = is_public
        self._without = frozenset(without)
        self._left_out = frozenset(left_out)
        self._docstrings = docstrings or {}
        self._statements: dict[str, set[Statement]] = {}
        self._methods: set[ast.AST] = set()
        self._attributes: set[str] = set()
        self._foreign: set[Foreign] = set()
        self._dropped: dict[ast.AST, list[_Edit]] = {}
        self._without_items: dict[ast.AST, set[ast.AST]] = {}
        self._waiting = list(roots)
        has_grown = True
        while self._waiting or has_grown:
            while self._waiting:
                self._add(self._waiting.pop())
            has_grown = self._add_methods()
        self.modules = [self._sources.module(name) for name in self._order()]
        """The modules that have something in the file, each behind those that it imports."""
        self._names = self._distinct_names()

    # What is needed

    def _add(self, place: Place) -> None:
        """Add the statement that defines a name, and what it needs. Of a class, its methods are added later."""
        if place.module in self._left_out:
            raise LookupError(f"{place.name} of {place.module} is left out, and something else needs it")
        module = self._sources.module(place.module)
        statement = module.names[place.name]
        kept = self._statements.setdefault(module.name, set())
        for part in (statement, *(other for other in module.statements if other.extends in statement.names)):
            if part not in kept:
                kept.add(part)
                self._scan(module, part.node, {node for name, node in _methods(part.node)})

    def _add_methods(self) -> bool:
        """Add the methods whose names are used by now, and what they need. Return whether there were any."""
        before = len(self._methods)
        for name, kept in self._statements.items():
            for statement in kept:
                for method, node in _methods(statement.node):
                    is_used = method in self._attributes or self._is_public(name) or method.startswith("__")
                    places = {Place(name, f"{statement.names[0]}.{method}"), Place(name, f"*.{method}")}
                    if not is_used or places & self._without or node in self._methods:
                        continue
                    module = self._sources.module(name)
                    if self._is_public(name) and self._is_left_out(module, node):
                        continue  # a method for messages that are not in the file
                    self._methods.add(node)
                    self._scan(module, node, set())
        return len(self._methods) > before

    def _scan(self, module: Module, node: ast.AST, skipped: set[ast.AST]) -> None:
        """Note what a node uses: names of modules, and the names of attributes."""
        skipped = skipped | self._drop_items(module, node)
        for use in self._sources.uses(module, node, skipped):
            if isinstance(use.target, Foreign):
                self._foreign.add(use.target)
            elif use.target.name:
                self._waiting.append(use.target)
        for part in _walk(node, skipped):
            if isinstance(node, ast.ClassDef) and isinstance(part, ast.Name):
                self._attributes.add(part.id)  # in the body of a class, a method may have a second name
            elif isinstance(part, ast.Attribute):
                self._attributes.add(part.attr)
            elif isinstance(part, ast.Constant) and isinstance(part.value, str):
                self._attributes.update(_names_in(part.value))

    def _drop_items(self, module: Module, node: ast.AST) -> set[ast.AST]:
        """Return the items of lists and dicts that name something that is left out, and note their edits."""
        if node in self._without_items:
            return self._without_items[node]
        dropped: set[ast.AST] = set()
        self._without_items[node] = dropped
        for part in ast.walk(node) if self._left_out else ():
            if isinstance(part, ast.Tuple | ast.List | ast.Set):
                items = [(item, item) for item in part.elts]
            elif isinstance(part, ast.Dict):
                items = [(key, value) for key, value in zip(part.keys, part.values) if key is not None]
            else:
                continue
            kept: list[ast.expr] = []
            for place, item in enumerate(items):
                if not any(self._is_left_out(module, node) for node in item):
                    kept.append(item[1])
                    continue
                dropped.update(item)
                following = items[place + 1][0] if place + 1 < len(items) else None
                start = _end(module, kept[-1]) if kept else _offset(module, part) + 1
                end = _end(module, part) - 1 if following is None else _offset(module, following)
                self._dropped.setdefault(part, []).append(_Edit(start, end, ", " if kept else ""))
        return dropped

    def _is_left_out(self, module: Module, node: ast.AST) -> bool:
        uses = self._sources.uses(module, node)
        return any(isinstance(use.target, Place) and use.target.module in self._left_out for use in uses)

    # The order, and the names

    def _order(self) -> Iterator[str]:
        """Yield the modules, each behind those that its statements use."""
        seen: set[str] = set()

        def visit(name: str) -> Iterator[str]:
            if name not in seen:
                seen.add(name)
                module = self._sources.module(name)
                below = {use.target.module for use in self._uses(module) if isinstance(use.target, Place)}
                for other in sorted(below, key=_reading_order):
                    yield from visit(other)
                yield name

        for name in sorted(self._statements, key=_reading_order):
            yield from visit(name)

    def _uses(self, module: Module) -> Iterator[Use]:
        for statement in module.statements:
            if statement in self._statements.get(module.name, ()):
                yield from self._sources.uses(module, statement.node, self._absent(module, statement))

    def _absent(self, module: Module, statement: Statement) -> set[ast.AST]:
        """Return the parts of a statement that are not in the file."""
        methods = {node for _, node in _methods(statement.node) if node not in self._methods}
        return methods | self._drop_items(module, statement.node)

    def _distinct_names(self) -> dict[Place, str]:
        """Return the name of everything in the file. The same statement in two modules is one name."""
        names: dict[Place, str] = {}
        owners: dict[str, str] = {foreign.alias: str(foreign) for foreign in self._foreign}
        for module in self.modules:
            for statement in module.statements:
                if statement not in self._statements[module.name]:
                    continue
                text = ast.unparse(statement.node)
                for name in statement.names:
                    own = name
                    if owners.setdefault(own, text) != text:
                        own = _with_module(name, module.name)
                        owners[own] = text
                    names[Place(module.name, name)] = own
        return names

    # The text

    def text(self) -> str:
        """Return the imports and the modules, not yet formatted."""
        modules = sorted(str(foreign) for foreign in self._foreign if not foreign.name)
        brought: dict[str, list[str]] = {}
        for foreign in sorted(self._foreign, key=lambda foreign: (foreign.name[:1].islower(), foreign.name)):
            if foreign.name:
                alias = "" if foreign.alias == foreign.name else f" as {foreign.alias}"
                brought.setdefault(foreign.module, []).append(foreign.name + alias)
        imports = [*modules, *(f"from {module} import {', '.join(brought[module])}" for module in sorted(brought))]
        written: set[str] = set()
        sections = [self._section(module, written) for module in self.modules]
        return "\n".join(["from __future__ import annotations", "", *imports, "", *sections])

    def _section(self, module: Module, written: set[str]) -> str:
        content = module.text.encode()
        texts = []
        for statement in module.statements:
            if statement in self._statements[module.name]:
                text = self._statement_text(module, statement, content)
                if text.strip() not in written:  # a type variable of another module
                    written.add(text.strip())
                    texts.append(text)
        absent = [name for name in module.names if Place(module.name, name) not in self._names]
        docstring = self._docstrings.get(module.name, module.docstring)
        return "\n".join([*_banner(module.name, docstring, absent, "".join(texts)), "".join(texts)])

    def _statement_text(self, module: Module, statement: Statement, content: bytes) -> str:
        edits: list[_Edit] = []
        absent = self._absent(module, statement)
        for part in ast.walk(statement.node):
            edits += self._dropped.get(part, ())
            if isinstance(part, ast.stmt) and (part in absent or _is_import_of_ours(part)):
                edits.append(_Edit(*_lines_of(module, part)))
        for use in self._sources.uses(module, statement.node, absent):
            if isinstance(use.target, Place) and use.target in self._names:
                edits.append(_Edit(_offset(module, use.node), _end(module, use.node), self._names[use.target]))
        if isinstance(statement.node, (*_METHODS, ast.ClassDef)):
            own = self._names[Place(module.name, statement.node.name)]
            start = content.index(statement.node.name.encode(), _offset(module, statement.node))
            edits.append(_Edit(start, start + len(statement.node.name.encode()), own))
        start, end = module.offsets[statement.first], module.offsets[statement.end]
        return _edited(content, start, end, edits)


def _walk(node: ast.AST, skipped: set[ast.AST]) -> Iterator[ast.AST]:
    if node not in skipped:
        yield node
        for child in ast.iter_child_nodes(node):
            yield from _walk(child, skipped)


def _methods(node: ast.stmt) -> Iterator[tuple[str, ast.AST]]:
    """Yield the methods of a class by name; none for another statement. A property may have several definitions."""
    for part in node.body if isinstance(node, ast.ClassDef) else ():
        if isinstance(part, _METHODS):
            yield part.name, part


def _is_import_of_ours(node: ast.AST) -> bool:
    targets = imported(node) if isinstance(node, ast.Import | ast.ImportFrom) else ()
    return any(isinstance(target, Place) for _, target in targets)


def _names_in(text: str) -> Iterator[str]:
    """Yield the names that a text may stand for: itself, given to `getattr`, and the attributes of its examples."""
    if text.isidentifier():
        yield text
    for example in re.findall(r"^ *>{3} (.*)$", text, re.MULTILINE):
        yield from re.findall(r"\.([A-Za-z_]\w*)", example)


def _offset(module: Module, node: ast.expr | ast.stmt) -> int:
    return module.offsets[node.lineno - 1] + node.col_offset


def _end(module: Module, node: ast.expr | ast.stmt) -> int:
    return module.offsets[(node.end_lineno or 0) - 1] + (node.end_col_offset or 0)


def _lines_of(module: Module, node: ast.stmt) -> tuple[int, int]:
    """Return where a statement inside another begins, with its decorators and the comments above it, and ends."""
    first = min([node.lineno, *(decorator.lineno for decorator in getattr(node, "decorator_list", ()))]) - 1
    while module.lines[first - 1].lstrip().startswith("#"):
        first -= 1
    return module.offsets[first], module.offsets[node.end_lineno or 0]


def _edited(content: bytes, start: int, end: int, edits: Iterable[_Edit]) -> str:
    """Return a part of the content with its edits. One inside another, which removes it, has no effect."""
    pieces, at = [], start
    for edit in sorted(edits, key=lambda edit: (edit.start, -edit.end)):
        if edit.start >= at:
            pieces += [content[at : edit.start], edit.text.encode()]
            at = edit.end
        elif edit.end > at:
            at = edit.end
    return b"".join([*pieces, content[at:end]]).decode()


def _with_module(name: str, module: str) -> str:
    """Return a name with the last part of its module, in the form of the name: `encode_frame`, `SHORTEST_FRAME`."""
    last = module.rpartition(".")[2]
    if name.lstrip("_").isupper():
        return f"{name}_{last.upper()}"
    return f"{name}{last.title().replace('_', '')}" if name.lstrip("_")[0].isupper() else f"{name}_{last}"


def _reading_order(module: str) -> tuple[int, str]:
    """Return the place of a module among those that do not need each other: errors first, ports and clients last."""
    rooms = ("errors", "conversation", "_callbacks", "codecs", "modbus", "rtu", "ascii", "tcp", "canopen", "io")
    room = module.split(".")[1]
    return (rooms.index(room) if module.startswith("barewire.") and room in rooms else len(rooms), module)


def _banner(module: str, docstring: str, absent: list[str], text: str) -> Iterator[str]:
    """Yield the heading of a module, and its docstring. Names in it that are not in the file are listed."""
    yield f"# {module} {'-' * (_WIDTH - len(module) - 3)}"
    named = [name for name in absent if re.search(rf"\b{name}\b", docstring + text)]
    if named:
        yield f"# Not in this file: {', '.join(named)}."
    yield f'\n"""{docstring}"""\n' if docstring else ""
