"""The sources as syntax trees, and the meaning of a name in them: which statement of which file defines it.

from barewire.rtu import RtuLine          a name of a lazy package: barewire.rtu.line has it
from struct import Struct                 a name of the standard library: small/_small.py has struct_Struct
from barewire import rtu; rtu.crc16       an attribute of a module: barewire.rtu.crc has it
"""

from __future__ import annotations

import ast
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple, TypeAlias

ROOT = Path(__file__).parent.parent.parent
HOUSES = {"barewire": ROOT / "src", "barewire_workbench": ROOT / "workbench" / "src", "tools": ROOT}
SMALL = "barewire._small"
"""The module with what MicroPython lacks. It defines `MODULE_NAME` for `NAME` of `MODULE` of the standard library."""
OWN = {
    SMALL: "_small.py",
    "barewire.modbus.server.table": "table.py",
    "barewire.ports": "ports.py",
}
"""Modules of the edition that are written for it, in small/: they are not lowered."""
REPLACED = {
    "bisect",
    "collections",
    "collections.abc",
    "contextlib",
    "copy",
    "dataclasses",
    "functools",
    "operator",
    "struct",
}
"""Modules of the standard library whose names are taken from there."""
NATIVE = {"array", "asyncio", "heapq", "json", "machine", "math", "micropython", "select", "socket", "sys", "time"}
"""Modules that MicroPython has, or that small/ has under their own name."""


class Place(NamedTuple):
    """A definition: its module, and its name; the name is empty for the module itself."""

    module: str
    name: str


Statement: TypeAlias = ast.stmt
FunctionNode: TypeAlias = ast.FunctionDef | ast.AsyncFunctionDef
Function = (ast.FunctionDef, ast.AsyncFunctionDef)


class Unknown(Exception):
    """A construct or a name for which the small edition has nothing. The text names the file and the line."""


class Field(NamedTuple):
    """A field of a dataclass or NamedTuple; `default` is source text, None for no default."""

    name: str
    default: str | None
    in_init: bool = True


class Module:
    """One file: what each statement at its top level defines, and what its imports bring."""

    def __init__(self, name: str, source: str) -> None:
        self.name = name
        self.tree = ast.parse(source)
        self.definitions: dict[str, Statement] = {}
        self.imports: dict[str, Place] = {}
        self.lazy: dict[str, Place] = {}
        """Of a lazy package: name -> where it is."""
        self.fields: dict[str, list[Field]] = {}
        """Of each class that was a dataclass or NamedTuple."""
        self.checked: set[str] = set()
        """Those of them that check their values, in `__post_init__`."""
        self.enums: dict[str, dict[str, int]] = {}
        """Of each enumeration the numbers of its members."""
        self.others: list[Statement] = []
        """Statements that define nothing, such as a loop: an edition cannot have such a module."""
        self.rebound = {name for node in ast.walk(self.tree) if isinstance(node, ast.Global) for name in node.names}
        """Names whose value at the top level changes."""
        self.tree.body = _split(self.tree.body)
        self.read()
        self.tree.body = [statement for statement in self.tree.body if not isinstance(statement, ast.AugAssign)]

    def read(self) -> None:
        """Find out which statement defines which name."""
        self.definitions.clear()
        self.others.clear()
        for statement in self.tree.body:
            self._enter(statement)

    def _enter(self, statement: Statement) -> None:
        if isinstance(statement, (ast.Import, ast.ImportFrom)):
            self.imports.update(imported(statement))
        elif isinstance(statement, (*Function, ast.ClassDef)):
            self.definitions[statement.name] = statement
        elif isinstance(statement, ast.Assign):
            self._enter_lazy(statement)
            for target in statement.targets:
                for name in ast.walk(target):
                    if isinstance(name, ast.Name) and isinstance(name.ctx, ast.Store):
                        self.definitions[name.id] = statement
        elif isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name) and statement.value:
            self.definitions[statement.target.id] = statement
        elif isinstance(statement, ast.AugAssign) and isinstance(statement.target, ast.Name):
            before = self.definitions[statement.target.id]
            assert isinstance(before, (ast.Assign, ast.AnnAssign))
            assert before.value is not None
            before.value = ast.BinOp(before.value, statement.op, statement.value)
        elif not _is_for_type_checkers(statement):
            self.others.append(statement)

    def _enter_lazy(self, statement: ast.Assign) -> None:
        call = statement.value
        if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id == "lazy":
            for file, names in ast.literal_eval(_without_calls(call.args[1])).items():
                self.lazy.update({name: Place(f"{self.name}.{file}", name) for name in names.split()})


def _split(body: list[Statement]) -> list[Statement]:
    """Return the statements, with `A, B = 1, 2` as two of them."""
    statements: list[Statement] = []
    for statement in body:
        if isinstance(statement, ast.Assign) and isinstance(statement.targets[0], ast.Tuple):
            values = statement.value.elts if isinstance(statement.value, ast.Tuple) else []
            pairs = list(zip(statement.targets[0].elts, values))
            statements += [ast.copy_location(ast.Assign([name], value), statement) for name, value in pairs]
            if pairs:
                continue
        statements.append(statement)
    return statements


def _without_calls(node: ast.expr) -> ast.expr:
    """Return the table of a lazy package, with an empty list where it computes one: the names of all messages."""
    if isinstance(node, ast.Dict):
        node.values = [ast.Constant("") if isinstance(value, ast.Call) else value for value in node.values]
    return node


def _is_for_type_checkers(statement: Statement) -> bool:
    """Whether a statement at the top level has no effect: a docstring, a declaration, a block for type checkers."""
    if isinstance(statement, ast.If):
        return "TYPE_CHECKING" in ast.unparse(statement.test)
    return isinstance(statement, ast.AnnAssign) or (
        isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)
    )


def imported(statement: ast.Import | ast.ImportFrom) -> dict[str, Place]:
    """Return the names that an import binds, with their places as the import gives them."""
    if isinstance(statement, ast.Import):
        return {alias.asname or alias.name: Place(alias.name, "") for alias in statement.names}
    return {alias.asname or alias.name: Place(statement.module or "", alias.name) for alias in statement.names}


class Sources:
    """All modules that were asked for so far."""

    def __init__(self, prepare: Callable[[Sources, Module], None]) -> None:
        """`prepare` is called with each module after it was read."""
        self._prepare = prepare
        self.modules: dict[str, Module] = {}
        self.written: dict[str, str] = {}
        """Modules that the build writes itself: name -> source."""

    def has(self, name: str) -> bool:
        """Whether this is a module of ours."""
        return name in self.written or self._file(name) is not None

    def _file(self, name: str) -> Path | None:
        if name in OWN:
            return Path(__file__).parent / "small" / OWN[name]
        house = HOUSES.get(name.partition(".")[0])
        if house is None:
            return None
        path = house.joinpath(*name.split("."))
        return next((file for file in (path.with_suffix(".py"), path / "__init__.py") if file.exists()), None)

    def module(self, name: str) -> Module:
        """Return a module of ours, read when it is first asked for."""
        if name not in self.modules:
            source = self.written.get(name)
            if source is None:
                file = self._file(name)
                if file is None:
                    raise Unknown(f"there is no module {name}")
                source = file.read_text()
            module = self.modules[name] = Module(name, source)
            if name not in OWN:
                self._prepare(self, module)
        return self.modules[name]

    def find(self, place: Place) -> Place | None:
        """Return where a name is defined; None if it is not ours: MicroPython has it itself, or lacks it."""
        if place.module in REPLACED and place.name:
            small = Place(SMALL, f"{place.module.replace('.', '_')}_{place.name}")
            return small if small.name in self.module(SMALL).definitions else None
        if not self.has(place.module):
            return place if place.module in REPLACED else None
        if not place.name:
            return place
        module = self.module(place.module)
        if place.name in module.lazy:
            return self.find(module.lazy[place.name])
        if place.name in module.definitions:
            return place
        if place.name in module.imports:
            return self.find(module.imports[place.name])
        if self.has(f"{place.module}.{place.name}"):
            return Place(f"{place.module}.{place.name}", "")
        raise Unknown(f"{place.module} has no {place.name}")

    def definition(self, place: Place) -> Statement:
        """Return the statement that defines a name."""
        return self.module(place.module).definitions[place.name]

    def resolve(self, module: str, node: ast.expr) -> Place | None:
        """Return the definition that a name, or an attribute of a module, means at the top level of a module."""
        if isinstance(node, ast.Attribute):
            of = self.resolve(module, node.value)
            return self.find(Place(of.module, node.attr)) if of is not None and not of.name else None
        if not isinstance(node, ast.Name):
            return None
        here = self.module(module)
        if node.id in here.definitions:
            return Place(module, node.id)
        if node.id not in here.imports or (module == SMALL and not self.has(here.imports[node.id].module)):
            return None
        return self.find(here.imports[node.id])

    def check(self, module: str, name: str) -> None:
        """Raise Unknown for a name that is imported from what MicroPython lacks."""
        place = self.module(module).imports.get(name)
        if place is not None and place.module not in NATIVE and self.find(place) is None:
            raise Unknown(f"{place.module}.{place.name}: MicroPython lacks it, and small/_small.py too")

    def number(self, place: Place) -> int | None:
        """Return the whole number that a name at the top level always stands for; None if it is something else."""
        if place.name in self.module(place.module).rebound:
            return None
        definition = self.module(place.module).definitions.get(place.name)
        value = definition.value if isinstance(definition, (ast.Assign, ast.AnnAssign)) else None
        arithmetic = (ast.Constant, ast.BinOp, ast.UnaryOp, ast.operator, ast.unaryop)
        if value is None or not all(isinstance(node, arithmetic) for node in ast.walk(value)):
            return None
        whole = ast.fix_missing_locations(ast.Expression(value))
        number = eval(compile(whole, place.module, "eval"), {"__builtins__": {}})
        return number if type(number) is int else None
