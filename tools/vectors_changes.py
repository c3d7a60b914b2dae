"""Every small change of a program's text: what `make vectors-mutants` puts into the reference of the vectors.

Operators change into their neighbours, a number becomes one more or one less, a bit of a mask is cleared, a condition
is always true or never, an operand, a statement or half a slice is left out. F-strings, imports and `KINDS` stay.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple, TypeAlias

Row: TypeAlias = tuple[str, str, str]
"""A mutant as vectors/reference/SURVIVORS.md names it: file.function, the line before and the line after."""


class Mutant(NamedTuple):
    """One change: the file, the function or the constant, and its lines before and after."""

    file: str
    place: str
    before: str
    after: str
    text: str

    @property
    def row(self) -> Row:
        """What names it in the table of the page."""
        return f"{self.file}.{self.place}", self.before, self.after


_SWAPS: dict[type[ast.AST], Any] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.In: ast.NotIn, ast.NotIn: ast.In, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.And: ast.Or, ast.Or: ast.And,
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.FloorDiv, ast.FloorDiv: ast.Mult, ast.Div: ast.Mult,
    ast.Mod: ast.FloorDiv, ast.LShift: ast.RShift, ast.RShift: ast.LShift, ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd, ast.BitXor: ast.BitOr,
}  # fmt: skip


def mutants(file: str, text: str) -> Iterator[Mutant]:
    """Yield every mutant of a file, in the order of its lines, each one once."""
    tree, seen = ast.parse(text), {text}
    starts = [0]
    for line in text.splitlines(keepends=True):
        starts.append(starts[-1] + len(line.encode()))
    data, lines = text.encode(), text.splitlines()
    for place, node, new in _changes(tree):
        first, last = starts[node.lineno - 1] + node.col_offset, starts[node.end_lineno - 1] + node.end_col_offset
        changed = (data[:first] + new.encode() + data[last:]).decode()
        if changed in seen:
            continue
        seen.add(changed)
        count = node.end_lineno - node.lineno + 1 + len(changed.splitlines()) - len(lines)
        before = _joined(lines[node.lineno - 1 : node.end_lineno])
        yield Mutant(file, place, before, _joined(changed.splitlines()[node.lineno - 1 :][:count]), changed)


def _joined(lines: Sequence[str]) -> str:
    return " ".join(line.strip() for line in lines)


def _changes(tree: ast.Module) -> Iterator[tuple[str, Any, str]]:
    """Yield the place, the node and its new text for each change. Texts of errors, imports and KINDS stay."""
    for statement in tree.body:
        if isinstance(statement, (ast.Assign, ast.AnnAssign, ast.AugAssign)):
            target = statement.targets[0] if isinstance(statement, ast.Assign) else statement.target
            name = ",".join(one.id for one in ast.walk(target) if isinstance(one, ast.Name))
            if statement.value and name not in ("KINDS",):
                yield from _of_node(statement.value, name)
        elif isinstance(statement, ast.FunctionDef):
            yield from _of_function(statement, statement.name)
        elif isinstance(statement, ast.ClassDef):
            for method in statement.body:
                if isinstance(method, ast.FunctionDef):
                    yield from _of_function(method, f"{statement.name}.{method.name}")


def _of_function(function: ast.FunctionDef, place: str) -> Iterator[tuple[str, Any, str]]:
    for default in function.args.defaults:
        yield from _of_node(default, place)
    for statement in function.body:
        yield from _of_node(statement, place)


def _of_node(node: ast.AST, place: str) -> Iterator[tuple[str, Any, str]]:
    """Yield the changes of a node and of what it is made of."""
    if isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)):
        return  # before Python 3.12 nothing tells where the parts of an f-string are; docstrings
    for new in _texts(node):
        yield place, node, new
    if isinstance(node, (ast.If, ast.IfExp, ast.While)):
        for value in ("False",) if isinstance(node, ast.While) else ("True", "False"):
            yield place, node.test, value
    if isinstance(node, ast.comprehension):
        for test in node.ifs:
            yield place, test, "True"
    for child in ast.iter_child_nodes(node):
        yield from _of_node(child, place)


def _texts(node: Any) -> Iterator[str]:
    """Yield the new texts of one node."""
    match node:
        case ast.Constant(value=bool()):
            yield str(not node.value)
        case ast.Constant(value=int(value)):
            yield repr(value + 1)
            if value:
                yield repr(value - 1)
        case ast.Constant(value=str(value)):
            yield repr(value + "G")
        case ast.Constant(value=bytes(data)):
            yield repr(data + b"G")
        case ast.Compare():
            for at, operator in enumerate(node.ops):
                operators = [*node.ops[:at], _SWAPS[type(operator)](), *node.ops[at + 1 :]]
                yield _text(ast.Compare(node.left, operators, node.comparators))
        case ast.BoolOp():
            yield _text(ast.BoolOp(_SWAPS[type(node.op)](), node.values))
            for at in range(len(node.values)):
                yield _text(ast.BoolOp(node.op, [*node.values[:at], *node.values[at + 1 :]]))
        case ast.BinOp():
            if type(node.op) in _SWAPS:
                yield _text(ast.BinOp(node.left, _SWAPS[type(node.op)](), node.right))
            if isinstance(node.op, ast.BitAnd):
                yield _text(node.left)
                mask = node.right.value if isinstance(node.right, ast.Constant) else 0
                if isinstance(mask, int):
                    for bit in range(mask.bit_length()):
                        if mask >> bit & 1:
                            yield _text(ast.BinOp(node.left, node.op, ast.Constant(mask ^ 1 << bit)))
        case ast.AugAssign() if type(node.op) in _SWAPS:
            yield ast.unparse(ast.AugAssign(node.target, _SWAPS[type(node.op)](), node.value))
            yield "pass"
        case ast.UnaryOp():
            yield _text(node.operand)
        case ast.Slice():
            if node.lower:
                yield ast.unparse(ast.Slice(None, node.upper, node.step))
            if node.upper:
                yield ast.unparse(ast.Slice(node.lower, None, node.step))
        case ast.Assign() | ast.Expr() | ast.Raise() | ast.Delete() | ast.Break():
            yield "pass"


def _text(node: ast.expr) -> str:
    return f"({ast.unparse(node)})"
