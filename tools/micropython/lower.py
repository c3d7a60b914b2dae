"""Lowers a module to the Python of MicroPython, by rules that hold for every module; patches.py has the exceptions.

annotations, docstrings, decorators for type checkers       left out, and so are `__slots__`, see `classes`
[*a, b]   {**a}   f"{x:02X}"   zip(a, b, strict=True)       list(a) + [b]   merged(a)   "{:02X}".format(x)   zip(a, b)
match, raise ... from ...                                   if ... elif, two statements
data.ljust(8)   data[::-1]   n.to_bytes(2, o, signed=True)  functions of small/_small.py
del held[:n]   held.clear()          (of a bytearray)       held[:n] = b""
LIMIT = 253; ... LIMIT                                      253: a number is cheaper than a name
"""

from __future__ import annotations

import ast
import importlib
from collections.abc import Iterator
from typing import Any

from tools.micropython.classes import Classes, is_text
from tools.micropython.sources import SMALL, Function, Module, Place, Sources

_METHODS = {"bit_length", "fromhex", "ljust", "lstrip", "removeprefix", "strip", "translate"}
"""Methods that MicroPython lacks, or has in part; small/_small.py has functions of the same names."""
_CHARSETS = {"self.encoding", "'ascii'", "'latin-1'"}
"""Arguments of `encode` and `decode` that show a method of text or bytes, not one of ours."""
_ERRORS = {"UnicodeDecodeError", "UnicodeEncodeError"}
"""Errors that MicroPython lacks."""
_GENERIC = {"defaultdict", "deque", "dict", "frozenset", "list", "set", "tuple"}
_FOR_TYPES = {"abstractmethod", "final", "override", "overload"}


def expression(text: str) -> ast.expr:
    """Return the tree of an expression."""
    return ast.parse(text, mode="eval").body


class Lower(ast.NodeTransformer):
    """Lowers the tree of one module in place, and adds to its imports what the lowered form needs of `_small`."""

    def __init__(self, sources: Sources, module: Module) -> None:
        self.sources = sources
        self.module = module
        self.classes = Classes(sources, module, self.small)
        self._buffers: set[str] = set()  # the attributes of the present class that are bytearrays
        self._local = set(_bound_inside(module.tree))

    def small(self, name: str) -> str:
        """Return the name under which the module will import a function or class of `_small`."""
        bound = f"small_{name}"
        self.module.imports[bound] = Place(SMALL, name)
        return bound

    def call(self, name: str, *arguments: ast.expr) -> ast.Call:
        """Return the call of a function of `_small`."""
        return ast.Call(ast.Name(self.small(name), ast.Load()), list(arguments), [])

    # Statements

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.FunctionDef:
        node.returns = None
        node.decorator_list = [name for name in node.decorator_list if ast.unparse(name) not in _FOR_TYPES]
        node.args.args, node.args.posonlyargs = node.args.posonlyargs + node.args.args, []
        node.body = [part for part in node.body if not is_text(part)] or [ast.Pass()]
        self.generic_visit(node)
        return node

    visit_AsyncFunctionDef = visit_FunctionDef  # type: ignore[assignment]

    def visit_arg(self, node: ast.arg) -> ast.arg:
        node.annotation = None
        return node

    def visit_ClassDef(self, node: ast.ClassDef) -> ast.ClassDef:
        outer, self._buffers = (
            self._buffers,
            {
                target.attr
                for part in ast.walk(node)
                if isinstance(part, ast.Assign) and ast.unparse(part.value).startswith("bytearray(")
                for target in part.targets
                if isinstance(target, ast.Attribute)
            },
        )
        node = self.classes.lower(node)
        self.generic_visit(node)
        self._buffers = outer
        return node

    def visit_Assign(self, node: ast.Assign) -> ast.stmt:
        name = ast.unparse(node.targets[0])
        if self.module.definitions.get(name) is node and self._is_of_members(node.value):
            known = getattr(importlib.import_module(self.module.name), name)
            node.value = expression(repr(_plain(known)))
        self.generic_visit(node)
        return node

    def _is_of_members(self, node: ast.expr) -> bool:
        """Whether this is a table made of the members of an enumeration, which cannot be iterated here."""
        rows = [part.iter for part in ast.walk(node) if isinstance(part, ast.comprehension)]
        of = [self.sources.resolve(self.module.name, row) for row in rows if isinstance(row, ast.Name)]
        return any(place is not None and place.name in self.sources.module(place.module).enums for place in of)

    def visit_comprehension(self, node: ast.comprehension) -> ast.comprehension:
        of = self.sources.resolve(self.module.name, node.iter)
        members = self.sources.module(of.module).enums.get(of.name) if of is not None else None
        if members is not None:
            node.iter = ast.Tuple([ast.Constant(number) for number in members.values()], ast.Load())
        self.generic_visit(node)
        return node

    def visit_BinOp(self, node: ast.BinOp) -> ast.expr:
        """A product with one, and a quotient by one: the factor between seconds and the unit of time here."""
        self.generic_visit(node)
        if isinstance(node.op, (ast.Mult, ast.Div)) and isinstance(node.right, ast.Constant) and node.right.value == 1:
            return node.left
        return node

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.stmt | None:
        if node.value is None:
            return None
        assign = ast.Assign([node.target], node.value, lineno=node.lineno)
        self.generic_visit(assign)
        return assign

    def visit_Delete(self, node: ast.Delete) -> ast.stmt:
        self.generic_visit(node)
        (target,) = node.targets
        if isinstance(target, ast.Subscript) and self._is_buffer(target.value):
            target.ctx = ast.Store()
            return ast.Assign([target], ast.Constant(b""), lineno=node.lineno)
        return node

    def visit_Expr(self, node: ast.Expr) -> ast.stmt | None:
        if is_text(node):
            return None
        self.generic_visit(node)
        call = node.value
        function = call.func if isinstance(call, ast.Call) else None
        if isinstance(function, ast.Attribute) and function.attr == "clear" and self._is_buffer(function.value):
            whole = ast.Subscript(function.value, ast.Slice(), ast.Store())
            return ast.Assign([whole], ast.Constant(b""), lineno=node.lineno)
        return node

    def _is_buffer(self, node: ast.expr) -> bool:
        return isinstance(node, ast.Attribute) and node.attr in self._buffers

    def visit_Raise(self, node: ast.Raise) -> Any:
        """MicroPython ignores the cause: here it is an attribute like others."""
        self.generic_visit(node)
        cause, node.cause = node.cause, None
        if cause is None or (isinstance(cause, ast.Constant) and cause.value is None):
            return node
        assert node.exc is not None
        error = ast.Name("_error", ast.Store())
        keep = ast.Assign([error], node.exc, lineno=node.lineno)
        set_cause = ast.Assign([ast.Attribute(error, "__cause__", ast.Store())], cause, lineno=node.lineno)
        return [keep, set_cause, ast.Raise(ast.Name("_error", ast.Load()), None, lineno=node.lineno)]

    def visit_Match(self, node: ast.Match) -> Any:
        """`match` of an object with classes, their fields bound to names, or with values and `_`."""
        subject = ast.unparse(node.subject)
        chain: list[ast.stmt] = []
        for case in reversed(node.cases):
            lowered = self._pattern(case.pattern, subject)
            if lowered is None or case.guard is not None:
                return node  # `reach` raises Unknown, if this is needed
            test, bound = lowered
            if test is None:
                chain = bound + case.body
            else:
                chain = [ast.If(expression(test), bound + case.body, chain, lineno=node.lineno)]
        return [self.visit(part) for part in chain]

    def _pattern(self, pattern: ast.pattern, subject: str) -> tuple[str | None, list[ast.stmt]] | None:
        """Return the test of a pattern, None if it always fits, and what binds its names; None for another pattern."""
        if isinstance(pattern, ast.MatchAs) and pattern.pattern is None and pattern.name is None:
            return None, []
        if isinstance(pattern, ast.MatchValue):
            return f"{subject} == {ast.unparse(pattern.value)}", []
        if isinstance(pattern, ast.MatchClass) and not pattern.kwd_patterns:
            bound = []
            fields = self.classes.fields_of(self.module.name, pattern.cls)
            for field, part in zip(fields, pattern.patterns):
                if not isinstance(part, ast.MatchAs) or part.name is None:
                    break
                bound += ast.parse(f"{part.name} = {subject}.{field.name}").body
            else:
                return f"isinstance({subject}, {ast.unparse(pattern.cls)})", bound
        return None

    # Expressions

    def visit_Name(self, node: ast.Name) -> ast.expr:
        """Put a number in the place of its name."""
        if not isinstance(node.ctx, ast.Load) or node.id in self._local:
            return node
        if node.id in _ERRORS:
            return ast.Name(self.small(node.id), ast.Load())
        number = self._number(node)
        return node if number is None else ast.Constant(number)

    def visit_Attribute(self, node: ast.Attribute) -> ast.expr:
        if node.attr == "__cause__" and isinstance(node.ctx, ast.Load):
            return expression(f"getattr({ast.unparse(node.value)}, '__cause__', None)")
        if not isinstance(node.value, ast.Name) or node.value.id in self._local:
            self.generic_visit(node)
            return node
        of = self.sources.resolve(self.module.name, node.value)
        if of is None:
            return node
        if of.name:  # a class perhaps
            members = self.sources.module(of.module).enums.get(of.name, {})
            return ast.Constant(members[node.attr]) if node.attr in members else node
        number = self._number(node)
        if number is not None:
            return ast.Constant(number)
        # An attribute of a module is imported under a name of its own, so that the import brings only that.
        name = f"{node.value.id}_{node.attr}"
        self.module.imports[name] = Place(of.module, node.attr)
        return ast.Name(name, ast.Load())

    def _number(self, node: ast.expr) -> int | None:
        """Return the number that a name at the top level stands for, None if it is not one."""
        place = self.sources.resolve(self.module.name, node)
        return None if place is None or not place.name or place.module == SMALL else self.sources.number(place)

    def visit_JoinedStr(self, node: ast.JoinedStr) -> ast.expr:
        template, arguments = "", list[ast.expr]()
        for part in node.values:
            if isinstance(part, ast.Constant):
                template += str(part.value).replace("{", "{{").replace("}", "}}")
                continue
            assert isinstance(part, ast.FormattedValue)
            arguments.append(self.visit(part.value))
            spec = ""
            if part.format_spec is not None:
                assert isinstance(part.format_spec, ast.JoinedStr)
                for inner in part.format_spec.values:
                    if isinstance(inner, ast.Constant):
                        spec += str(inner.value)
                    else:
                        assert isinstance(inner, ast.FormattedValue)
                        spec += "{}"
                        arguments.append(self.visit(inner.value))
            conversion = f"!{chr(part.conversion)}" if part.conversion > 0 else ""
            template += f"{{{conversion}{':' if spec else ''}{spec}}}"
        return ast.Call(ast.Attribute(ast.Constant(template), "format", ast.Load()), arguments, [])

    def visit_List(self, node: ast.List) -> ast.expr:
        return self._display(node, "list", lambda parts: ast.List(parts, ast.Load()))

    def visit_Tuple(self, node: ast.Tuple) -> ast.expr:
        return self._display(node, "tuple", lambda parts: ast.Tuple(parts, ast.Load()))

    def visit_Set(self, node: ast.Set) -> ast.expr:
        if not any(isinstance(part, ast.Starred) for part in node.elts):
            self.generic_visit(node)
            return node
        row = self._display(ast.List(node.elts, ast.Load()), "list", lambda parts: ast.List(parts, ast.Load()))
        return ast.Call(ast.Name("set", ast.Load()), [row], [])

    def _display(self, node: ast.List | ast.Tuple, kind: str, make: Any) -> ast.expr:
        """Return a display without stars: a sum of rows."""
        if not isinstance(node.ctx, ast.Load) or not any(isinstance(part, ast.Starred) for part in node.elts):
            self.generic_visit(node)
            return node
        rows: list[ast.expr] = []
        for part in node.elts:
            if isinstance(part, ast.Starred):
                rows.append(ast.Call(ast.Name(kind, ast.Load()), [self.visit(part.value)], []))
            elif rows and isinstance(rows[-1], (ast.List, ast.Tuple)):
                rows[-1].elts.append(self.visit(part))
            else:
                rows.append(make([self.visit(part)]))
        total = rows[0]
        for row in rows[1:]:
            total = ast.BinOp(total, ast.Add(), row)
        return total

    def visit_Dict(self, node: ast.Dict) -> ast.expr:
        self.generic_visit(node)
        if all(key is not None for key in node.keys):
            return node
        parts: list[ast.expr] = []
        for key, value in zip(node.keys, node.values):
            if key is None:
                parts.append(value)
            elif parts and isinstance(parts[-1], ast.Dict):
                parts[-1].keys.append(key)
                parts[-1].values.append(value)
            else:
                parts.append(ast.Dict([key], [value]))
        return self.call("merged", *parts)

    def visit_Subscript(self, node: ast.Subscript) -> ast.expr:
        self.generic_visit(node)
        if isinstance(node.slice, ast.Slice) and node.slice.step is not None:
            parts = (node.slice.lower, node.slice.upper, node.slice.step)
            return self.call("stepped", node.value, *(part or ast.Constant(None) for part in parts))
        return node

    def visit_Call(self, node: ast.Call) -> ast.expr:
        text = ast.unparse(node)
        if text == "super().__str__()":  # an exception has no such method
            return self.call("exception_text", ast.Name("self", ast.Load()))
        if isinstance(node.func, ast.Subscript) and ast.unparse(node.func.value) in _GENERIC:  # list[int]()
            node.func = node.func.value
        if text.startswith("partial(tuple.__new__, "):  # past the `__new__` of a NamedTuple, which is a class here
            return expression(f"lambda values: {ast.unparse(node.args[1])}(*values)")
        if text.startswith("object.__setattr__("):  # in a frozen dataclass, which is not frozen here
            node.func = ast.Name("setattr", ast.Load())
        if text.startswith("hasattr(") and text.endswith("'__len__')"):  # builtin types do not show these names
            return self.call("has_length", self.visit(node.args[0]))
        self.generic_visit(node)
        node.keywords = [keyword for keyword in node.keywords if keyword.arg != "strict"]
        if not isinstance(node.func, ast.Attribute):
            return node
        method, of = node.func.attr, node.func.value
        if method in _METHODS:
            of = ast.Constant(None) if method == "fromhex" else of
            return self.call(method, *([] if method == "fromhex" else [of]), *node.args)
        if method in ("to_bytes", "from_bytes") and any(keyword.arg == "signed" for keyword in node.keywords):
            (signed,) = (keyword.value for keyword in node.keywords if keyword.arg == "signed")
            return self.call(f"signed_{method}", *([of] if method == "to_bytes" else []), *node.args, signed)
        if method in ("encode", "decode") and len(node.args) == 1 and ast.unparse(node.args[0]) in _CHARSETS:
            return self.call(f"text_{method}", of, *node.args)
        if method == "join" and isinstance(of, ast.Constant) and of.value == b"":  # of memoryviews too
            return self.call("joined", *node.args)
        return node


def _plain(value: Any) -> Any:
    """Return the value with numbers in the place of members of enumerations."""
    if isinstance(value, dict):
        return {_plain(key): _plain(of_key) for key, of_key in value.items()}
    if isinstance(value, (frozenset, set, tuple, list)):
        return type(value)(map(_plain, value))
    return int(value) if isinstance(value, int) and not isinstance(value, bool) else value


def _bound_inside(tree: ast.Module) -> Iterator[str]:
    """Yield the names that are bound inside functions and classes: there they mean something else."""
    for top in tree.body:
        inside = ast.walk(top) if isinstance(top, (*Function, ast.ClassDef)) else iter(())
        for node in inside:
            if isinstance(node, ast.Name) and not isinstance(node.ctx, ast.Load):
                yield node.id
    for node in ast.walk(tree):
        if isinstance(node, ast.arg):
            yield node.arg
        elif isinstance(node, ast.comprehension):
            yield from (name.id for name in ast.walk(node.target) if isinstance(name, ast.Name))
