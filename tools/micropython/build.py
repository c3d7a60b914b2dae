"""Puts an edition together: which parts, what they offer, and its files.

parts -> places of their names -> all that these need (reach) -> one file for each file of the sources that is needed
"""

from __future__ import annotations

import ast
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from barewire.modbus import messages
from barewire.modbus.messages.registry import _encapsulated, _functions
from tools.micropython.lower import Lower
from tools.micropython.patches import PATCHES
from tools.micropython.reach import Needed
from tools.micropython.seconds import count_in_microseconds
from tools.micropython.sources import OWN, SMALL, Function, Module, Place, Sources, Unknown


class Part(NamedTuple):
    """What a part offers: names by their module, the methods that programs call, and functions that it leaves out."""

    names: dict[str, str]
    methods: str = ""
    left_out: tuple[str, ...] = ()


_LINE = "request response sent feed deadline quiet_at answers held"
PARTS: dict[str, Part] = {
    "rtu": Part({"barewire.rtu.line": "RtuLine", "barewire.rtu.frame": "Timing"}, _LINE + " of"),
    "ascii": Part({"barewire.ascii.line": "AsciiLine"}, _LINE),
    "tcp": Part({"barewire.tcp.line": "TcpLine"}, _LINE),
    "client": Part(
        {"barewire.modbus.client.bus": "Bus", "barewire.conversation": "Send Listen Heard"},
        "ask broadcast overhear settle items",
    ),
    "server": Part(
        {"barewire.modbus.server.server": "Server", "barewire.modbus.server.table": "Table"}, "feed deadline overrun"
    ),
    "sdo": Part(
        {"barewire.canopen.sdo.client": "upload download", "barewire.canopen.sdo.channel": "Channel"},
        "items",
        left_out=(
            "barewire.canopen.sdo.client:_upload_blocks",
            "barewire.canopen.sdo.client:_download_blocks",
            "barewire.canopen.sdo.client:_initiate_block_upload",
        ),
    ),
    "ports": Part(
        {"barewire.ports": "UartPort SocketPort run run_async serving"}, "send receive receive_async arrived items"
    ),
    "codecs": Part({"barewire.codecs.numbers": "codec", "barewire.codecs.text": "Text"}),
}
FAMILIES = (
    "coils",
    "registers",
    "combined",
    "fifo",
    "files",
    "diagnostics",
    "comm_events",
    "identification",
    "canopen_reference",
)
"""The families of messages, which are parts as well."""


def message_package(families: Iterable[str]) -> str:
    """Return the source of the package of messages: the classes of these families, and the numbers of requests."""
    lines = [f"from {messages.__name__}.exception_response import ExceptionResponse"]
    tables = dict[str, dict[int, str]]()
    of_family = {f"{messages.__name__}.{family}" for family in families}
    for table, known in (("FUNCTIONS", _functions), ("MEI_TYPES", _encapsulated)):
        requests = {number: known.get(number) for number in (*known.classes, *known.names)}
        tables[table] = {n: r.__name__ for n, r in requests.items() if r is not None and r.__module__ in of_family}
        for number in sorted(tables[table]):
            lines.append(f"from {requests[number].__module__} import {tables[table][number]}")
    if "canopen_reference" in families:
        lines.append("from barewire.modbus.messages.canopen_reference import ExtendedExceptionResponse")
    else:  # no exception response begins like this one
        lines.append("class ExtendedExceptionResponse:\n    BEGINNING = b''")
    return "\n".join(lines + [f"{table} = {names!r}" for table, names in tables.items()])


class Edition:
    """The files of an edition, as source text by their paths."""

    def __init__(
        self,
        parts: Iterable[str],
        roots: Iterable[Place] = (),
        kinds: Mapping[str, Collection[str]] | None = None,
        constants: Mapping[str, int] | None = None,
    ) -> None:
        """For tests: `roots` are further names; `kinds` are the answers to the vectors that it has, with their
        operations; `constants` are numbers in the place of those of the sources, by MODULE:NAME."""
        self._kinds = kinds or {}
        self._constants = constants or {}
        chosen = [PARTS[part] for part in parts if part in PARTS]
        families = [part for part in parts if part in FAMILIES]
        unknown = [part for part in parts if part not in PARTS and part not in FAMILIES]
        if unknown:
            raise Unknown(f"part {unknown[0]}: expected some of {', '.join((*PARTS, *FAMILIES))}")
        self._left_out = {place for part in chosen for place in part.left_out}
        self.sources = Sources(self._prepare)
        self.sources.written[messages.__name__] = message_package(families)
        self.needed = Needed(self.sources, {name for part in chosen for name in part.methods.split()})
        for part in chosen:
            for module, names in part.names.items():
                for name in names.split():
                    self.needed.add(self.sources.find(Place(module, name)) or Place(module, name))
        for root in roots:
            self.needed.add(root)
        self.files = {_path(module): text for module in self._modules() if (text := self._text(module))}

    def _prepare(self, sources: Sources, module: Module) -> None:
        if ROWS in module.definitions and self._kinds:
            _keep_rows(module.definitions[ROWS], self._kinds)
        count_in_microseconds(module.name, module.tree)
        for place, number in self._constants.items():
            of, _, name = place.partition(":")
            if of == module.name:
                assignment = module.definitions[name]
                assert isinstance(assignment, (ast.Assign, ast.AnnAssign))
                assignment.value = ast.Constant(number)
        for place, source in PATCHES.items():
            of, _, name = place.partition(":")
            if of == module.name:
                _replace(module, name, source)
        for place in self._left_out:
            of, _, name = place.partition(":")
            if of == module.name:
                text = f"def {name}(*_):\n    raise NotImplementedError('{name} is not in this edition')"
                _replace(module, name, text)
        Lower(sources, module).visit(module.tree)
        module.read()

    def _modules(self) -> list[str]:
        return sorted({place.module for place in self.needed.places})

    def _text(self, name: str) -> str:
        module = self.sources.module(name)
        if module.others and name not in OWN:
            raise Unknown(f"{name}, line {module.others[0].lineno}: a statement that defines nothing")
        body: list[ast.stmt] = []
        for statement in module.tree.body:
            if any(module.definitions.get(place.name) is statement for place in self._of(name)):
                if isinstance(statement, ast.ClassDef):
                    kept = [
                        part for part in statement.body if not isinstance(part, Function) or self.needed.keeps(part)
                    ]
                    statement.body = kept or [ast.Pass()]
                body.append(statement)
        whole = ast.Module(body, [])
        used = {node.id for node in ast.walk(whole) if isinstance(node, ast.Name)}
        imports = list(
            self._imports(module, used if Place(name, "") not in self.needed.places else set(module.imports))
        )
        return ast.unparse(ast.fix_missing_locations(ast.Module([*_parsed(imports), *body], [])))

    def _of(self, module: str) -> list[Place]:
        return [place for place in self.needed.places if place.module == module]

    def _imports(self, module: Module, used: set[str]) -> Iterator[str]:
        """Yield the import statements for the names that a module uses, each from the file that defines it."""
        by_module: dict[str, list[str]] = {}
        for name in sorted(used & set(module.imports) - set(module.definitions)):
            given = module.imports[name]
            place = None if module.name == SMALL else self.sources.find(given)
            if place is None:
                place = given
            if not place.name:
                yield f"import {place.module} as {name}" if name != place.module else f"import {name}"
            else:
                by_module.setdefault(place.module, []).append(
                    place.name if place.name == name else f"{place.name} as {name}"
                )
        for of, names in by_module.items():
            yield f"from {of} import {', '.join(names)}"

    def write(self, folder: Path) -> None:
        """Write the files, and an empty `__init__` for each package without one."""
        for path, text in self.files.items():
            target = folder / path
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_text(text + "\n")
        for package in {parent for path in self.files for parent in Path(path).parents if parent != Path()}:
            (folder / package / "__init__.py").touch()


ROWS = "ANSWERS"
"""The table of the answers to the vectors, by kind and operation."""


def _keep_rows(statement: ast.stmt, kinds: Mapping[str, Collection[str]]) -> None:
    """Leave out of such a table what the edition does not answer."""
    for table in ast.walk(statement):
        if isinstance(table, ast.Dict) and any(isinstance(row, ast.Dict) for row in table.values):
            for row, operations in [(row, kinds.get(kind)) for kind, row in _rows(table)]:
                if operations and isinstance(row, ast.Dict):
                    _keep(row, [pair for pair in _rows(row) if pair[0] in operations])
            _keep(table, [pair for pair in _rows(table) if pair[0] in kinds])


def _rows(table: ast.Dict) -> list[tuple[str, ast.expr]]:
    return [(ast.literal_eval(key), row) for key, row in zip(table.keys, table.values) if key is not None]


def _keep(table: ast.Dict, rows: list[tuple[str, ast.expr]]) -> None:
    table.keys, table.values = [ast.Constant(key) for key, _ in rows], [row for _, row in rows]


def _parsed(lines: list[str]) -> list[ast.stmt]:
    return ast.parse("\n".join(lines)).body


def _path(module: str) -> str:
    name = module.replace(".", "/")
    return f"{name}/__init__.py" if module == messages.__name__ else f"{name}.py"


def _replace(module: Module, name: str, source: str | None) -> None:
    """Put a function or method in the place of that with this name. Raise Unknown if there is none."""
    body, _, function = name.rpartition(".")
    owner: ast.Module | ast.stmt = module.definitions[body] if body else module.tree
    assert isinstance(owner, (ast.Module, ast.ClassDef))
    places = [place for place, part in enumerate(owner.body) if isinstance(part, Function) and part.name == function]
    if not places:
        raise Unknown(f"{module.name} has no {name}: patches.py must be changed")
    owner.body[places[0] : places[0] + 1] = ast.parse(source).body if source else []
