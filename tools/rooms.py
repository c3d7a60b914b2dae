"""Draws the imports between rooms into ARCHITECTURE.md: run `python tools/rooms.py`.

There is one drawing for each distribution. A room is a package; in the drawing of the inside of a room, the files
beside its packages are rooms too. A room is drawn above every room that it imports, so all arrows point down.
`tests/test_layers.py` uses the same functions: it fails on a circle of files, and when the drawing is out of date.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parent.parent
HOUSES = {"barewire": ROOT / "src", "barewire_workbench": ROOT / "workbench" / "src"}
"""The package of each distribution, and the folder that holds it."""
PAGE = ROOT / "ARCHITECTURE.md"
BEGIN, END = "<!-- drawn by tools/rooms.py -->\n", "<!-- end of the drawing -->\n"
INSIDE = {
    "barewire": ("modbus", "canopen", "canopen.sdo", "devices", "io"),
    "barewire_workbench": (),
}
"""The rooms of each package whose inside is drawn, too."""

Graph = dict[str, set[str]]


@cache
def files() -> dict[str, Path]:
    """Return every module of both packages by its dotted name."""
    found = {}
    for package, folder in HOUSES.items():
        for path in sorted((folder / package).rglob("*.py")):
            parts = path.relative_to(folder).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


@cache
def loading_nodes(path: Path) -> list[ast.Import | ast.ImportFrom | ast.Call]:
    """Return `nodes_that_load` of a file, which is read once for the drawing and its tests."""
    return nodes_that_load(path.read_text(encoding="utf-8"))


def nodes_that_load(source: str) -> list[ast.Import | ast.ImportFrom | ast.Call]:
    """Return the imports in a source, and calls whose first argument is a constant, such as `import_module("x")`."""
    tree = ast.parse(source)
    calls = "import_module" in source or "__import__" in source
    return [
        node
        for node in (ast.walk(tree) if calls else statements(tree))
        if isinstance(node, ast.Import | ast.ImportFrom)
        or (isinstance(node, ast.Call) and node.args and isinstance(node.args[0], ast.Constant))
    ]


def statements(node: ast.AST) -> Iterator[ast.stmt]:
    """Yield every statement inside a node, in a small part of the time of `ast.walk`: no expression is looked into.

    >>> [type(found).__name__ for found in statements(ast.parse("try:\\n    import a\\nexcept E:\\n    raise"))]
    ['Try', 'Import', 'Raise']
    """
    for inside in ast.iter_child_nodes(node):
        if isinstance(inside, ast.stmt):
            yield inside
        if isinstance(inside, ast.stmt | ast.excepthandler | ast.match_case):
            yield from statements(inside)


def imports(path: Path) -> Iterator[tuple[str, str]]:
    """Yield every (module, name) of our packages that the file imports, wherever in the file: functions and type
    checking too."""
    for node in loading_nodes(path):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] in HOUSES:
            yield from ((node.module, alias.name) for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from ((alias.name, "") for alias in node.names if alias.name.split(".")[0] in HOUSES)


@cache
def file_imports() -> Graph:
    """File -> files. A name that a package re-exports is an import of the file that defines it.

    A lazy package loads nothing by itself, so its own re-exports are not imports.
    """
    known = files()
    exported = {
        (module, name): (home, name)
        for module, path in known.items()
        if path.name == "__init__.py"
        for home, name in imports(path)
    }
    graph: Graph = {module: set() for module in known}
    for module, path in known.items():
        if "lazy(" in path.read_text(encoding="utf-8") and path.name == "__init__.py":
            continue
        for home, name in imports(path):
            while (home, name) in exported and f"{home}.{name}".strip(".") not in known:
                home, name = exported[home, name]
            whole = f"{home}.{name}".strip(".")
            graph[module].add(whole if whole in known else home)
        graph[module] -= {module}
    return graph


def circles(graph: Mapping[str, Iterable[str]]) -> list[list[str]]:
    """Return the groups of two or more that import each other, directly or through others (Tarjan's algorithm)."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(node: str) -> None:
        index[node] = low[node] = len(index)
        stack.append(node)
        for other in graph.get(node, ()):
            if other not in index:
                visit(other)
                low[node] = min(low[node], low[other])
            elif other in stack:
                low[node] = min(low[node], index[other])
        if low[node] == index[node]:
            group = stack[stack.index(node) :]
            del stack[stack.index(node) :]
            if len(group) > 1:
                found.append(sorted(group))

    for node in sorted(graph):
        if node not in index:
            visit(node)
    return found


def rooms(within: str) -> Graph:
    """Return the rooms directly inside the package `within`, each with the others of them that it imports."""
    start = f"{within}."

    def room(module: str) -> str | None:
        return module.removeprefix(start).partition(".")[0] if module.startswith(start) else None

    graph: Graph = {}
    for module, targets in file_imports().items():
        if (here := room(module)) is not None:
            graph.setdefault(here, set()).update(found for found in map(room, targets) if found not in (None, here))
    return graph


def floors(graph: Graph) -> list[list[str]]:
    """Return the rooms in floors, the lowest first: each stands one floor above the highest room that it imports."""
    height: dict[str, int] = {}

    def of(room: str, above: tuple[str, ...] = ()) -> int:
        if room not in height:
            below = [of(other, (*above, room)) for other in graph[room] if other not in above]
            height[room] = 1 + max(below, default=-1)
        return height[room]

    for room in graph:
        of(room)
    return [sorted(room for room in graph if height[room] == floor) for floor in range(max(height.values()) + 1)]


def drawing(within: str) -> str:
    """Return the floors of one package as text, the highest first: a row for each room, with what it imports."""
    graph = rooms(within)
    width = max(map(len, graph))
    rows = []
    for floor in reversed(floors(graph)):
        for room in floor:
            below = ", ".join(sorted(graph[room])) or "-"
            rows.append(f"{room:{width}}  ->  {below}")
        rows.append("")
    return "\n".join(rows[:-1])


def page() -> str:
    """ARCHITECTURE.md with the drawings up to date."""
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    _, _, after = rest.partition(END)
    parts = []
    for package, inside in INSIDE.items():
        parts.append(f"`{package}`:\n\n```\n{drawing(package)}\n```\n")
        parts += [f"Inside `{package}.{room}`:\n\n```\n{drawing(f'{package}.{room}')}\n```\n" for room in inside]
    return f"{before}{BEGIN}\n{chr(10).join(parts)}\n{END}{after}"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
