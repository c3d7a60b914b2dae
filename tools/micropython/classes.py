"""Lowers classes: dataclasses, NamedTuples and enumerations become plain classes.

    @dataclass(frozen=True, slots=True)          class ReadCoils(Request):
    class ReadCoils(Request[ReadCoilsResponse]):     def __init__(self, address, quantity):
        address: int                                     self.address = address
        quantity: int                                    self.quantity = quantity
                                                         self.__post_init__()

    class Heard(NamedTuple, Generic[Item])       class Heard(Row)          iterates, and has items by number
    class AbortCode(IntEnum)                     class AbortCode           whose members are numbers
    class EncodeError(BarewireError, ValueError) class EncodeError(BarewireError)
    class Units(dict), with `__missing__`        class Units(Missing)

MicroPython ignores `__slots__`, because an instance is a table of its attributes; so nothing keeps a message from being
changed. An exception has one builtin base there, so `except ValueError` does not catch an `EncodeError`.
"""

from __future__ import annotations

import ast
import builtins
from collections.abc import Callable

from tools.micropython.sources import Field, Module, Sources

_FOR_TYPES = {"ABC", "Generic", "Protocol"}
_ENUMS = {"Enum", "IntEnum"}
_UNUSED_METHODS = {"__init_subclass__", "__repr__", "__dir__", "_repr_html_"}
_BUILTIN_ERRORS = {
    name for name, thing in vars(builtins).items() if isinstance(thing, type) and issubclass(thing, BaseException)
}


def is_text(node: ast.stmt) -> bool:
    """Whether a statement is a docstring, or another constant without effect."""
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


class Classes:
    """Lowers the classes of one module. `small` returns a name of `_small`, which is then imported."""

    def __init__(self, sources: Sources, module: Module, small: Callable[[str], str]) -> None:
        self.sources = sources
        self.module = module
        self.small = small

    def lower(self, node: ast.ClassDef) -> ast.ClassDef:
        """Return the class without what MicroPython lacks; its methods are still those of CPython."""
        decorators = [ast.unparse(decorator) for decorator in node.decorator_list]
        bases = [base.value if isinstance(base, ast.Subscript) else base for base in node.bases]
        names = [ast.unparse(base) for base in bases]
        is_record = any(text.startswith("dataclass") for text in decorators)
        is_row = "NamedTuple" in names
        is_enum = bool(_ENUMS & set(names))
        own = _own_fields(node) if is_record or is_row else []
        inherited = (
            [field for base in reversed(bases) for field in self.fields_of(self.module.name, base)] if is_record else []
        )
        self.module.fields[node.name] = _together(inherited, own)
        node.decorator_list = [
            decorator for decorator, text in zip(node.decorator_list, decorators) if not text.startswith("dataclass")
        ]
        node.keywords = []
        node.body = [part for part in node.body if not self._is_left_out(part, is_enum)]
        if is_enum:
            for member in node.body:
                if isinstance(member, ast.Assign) and isinstance(member.value, ast.Tuple):
                    member.value = member.value.elts[0]
            self.module.enums[node.name] = {
                ast.unparse(member.targets[0]): ast.literal_eval(member.value)
                for member in node.body
                if isinstance(member, ast.Assign)
            }
        elif is_record or is_row:
            node.body = [part for part in node.body if not _is_field(part)]
            node.body[:0] = self._record_methods(node, own)
        kept = [base for base, name in zip(bases, names) if name not in _FOR_TYPES | _ENUMS | {"NamedTuple"}]
        if len(kept) > 1:
            kept = [base for base in kept if ast.unparse(base) not in _BUILTIN_ERRORS]
        if "__missing__" in [part.name for part in node.body if isinstance(part, ast.FunctionDef)]:
            kept = [ast.Name(self.small("Missing"), ast.Load())]
        elif is_row:
            kept.append(ast.Name(self.small("Row"), ast.Load()))
        elif is_record and not inherited:
            kept.append(ast.Name(self.small("Record"), ast.Load()))
        node.bases = kept
        node.body = node.body or [ast.Pass()]
        return node

    def _is_left_out(self, part: ast.stmt, is_enum: bool) -> bool:
        if isinstance(part, ast.FunctionDef):
            return is_enum or part.name in _UNUSED_METHODS
        if isinstance(part, ast.Assign):
            return ast.unparse(part.targets[0]) == "__slots__"
        return is_text(part)

    def _record_methods(self, node: ast.ClassDef, own: list[Field]) -> list[ast.stmt]:
        """Return `_fields` and `__init__`, if the class does not inherit both as they must be."""
        fields = self.module.fields[node.name]
        has_check = any(isinstance(part, ast.FunctionDef) and part.name == "__post_init__" for part in node.body)
        checks = has_check or self._inherits_check(self.module.name, node)
        self.module.checked.update({node.name} if checks else ())
        if not own and not has_check:
            return []
        parameters = [
            field.name + (f"={_parameter(field.default)}" if field.default is not None else "")
            for field in fields
            if field.in_init
        ]
        lines = [f"self.{field.name} = {_initial(field)}" for field in fields if field.in_init]
        lines += ["self.__post_init__()"] if checks else []
        text = f"def __init__({', '.join(['self', *parameters])}):\n    " + "\n    ".join(lines or ["pass"])
        row = f"_fields = {tuple(field.name for field in fields if field.in_init)!r}\n"
        return ast.parse(row + text).body

    def _inherits_check(self, module: str, node: ast.ClassDef) -> bool:
        for base in node.bases:
            place = self.sources.resolve(module, base.value if isinstance(base, ast.Subscript) else base)
            if place is not None and place.name and place.name in self.sources.module(place.module).checked:
                return True
        return False

    def fields_of(self, module: str, base: ast.expr) -> list[Field]:
        """Return the fields of a class, which are those of a dataclass or NamedTuple; none for any other class."""
        if isinstance(base, ast.Name) and base.id in (*_BUILTIN_ERRORS, *_FOR_TYPES, *_ENUMS, "NamedTuple"):
            return []
        place = self.sources.resolve(module, base)
        return [] if place is None or not place.name else self.sources.module(place.module).fields.get(place.name, [])


def _is_field(part: ast.stmt) -> bool:
    return (
        isinstance(part, ast.AnnAssign)
        and isinstance(part.target, ast.Name)
        and not ast.unparse(part.annotation).startswith(("ClassVar", "KW_ONLY"))
    )


def _own_fields(node: ast.ClassDef) -> list[Field]:
    fields = []
    for part in node.body:
        if _is_field(part):
            assert isinstance(part, ast.AnnAssign)
            assert isinstance(part.target, ast.Name)
            default, in_init = part.value, True
            if isinstance(default, ast.Call) and ast.unparse(default.func) == "field":
                options = {str(keyword.arg): keyword.value for keyword in default.keywords}
                in_init = "init" not in options
                factory = options.get("default_factory")
                default = None if factory is None else ast.Call(factory, [], [])
            fields.append(Field(part.target.id, None if default is None else ast.unparse(default), in_init))
    return fields


def _together(inherited: list[Field], own: list[Field]) -> list[Field]:
    by_name = {field.name: field for field in inherited}
    by_name.update({field.name: field for field in own})
    return list(by_name.values())


def _parameter(default: str) -> str:
    return "None" if default.endswith("()") else default


def _initial(field: Field) -> str:
    """Return the value of a field: its parameter, or a new object for each instance."""
    if field.default is not None and field.default.endswith("()"):
        return f"{field.default} if {field.name} is None else {field.name}"
    return field.name
