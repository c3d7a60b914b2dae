"""`dataclass` as `dataclasses` has it, for messages: frozen, with slots, and no other kind.

    from barewire.frozen import dataclass         for type checkers it is the one of `dataclasses`

`import dataclasses` brings `inspect`, `ast` and `tokenize` along and takes as long as all of a blocking client. Then
each of its classes takes a third of a millisecond and more, since every method is compiled by itself. Here it takes a
tenth of that: what is called often is compiled, once for all classes whose fields have the same names, and `__init__`
puts a value straight into its slot. What comes out behaves as the real thing, and `dataclasses` knows it: `fields`,
`asdict` and `replace` work, and so does a subclass with the real decorator. `tests/test_frozen.py` holds the two
against each other. Only `typing.get_type_hints` does not know the words that stand under `TYPE_CHECKING`.

What is not here is refused, and the real one has it: `field()`, `InitVar`, `KW_ONLY`, other options. An annotation is a
text (`from __future__ import annotations`), and is `ClassVar` if it is called so. `super()` works in methods, class
methods and properties; within a decorator of another kind it does not, as it does not with slots of the real one.

I know: how to make a class.  I never know: of what.  Everybody may import me; the messages do.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from reprlib import recursive_repr
from sys import modules

TYPE_CHECKING = False
if TYPE_CHECKING:
    from dataclasses import dataclass as dataclass
    from typing import Any

_NO_DEFAULT = object()
_MEMBER: type = type(type(lambda: None).__globals__)  # type: ignore[attr-defined]  # what a slot is in a class
_function: type = type(lambda: None)
_makers: dict[tuple[tuple[str, ...], bool], Callable[..., Any]] = {}
"""What makes `__init__`, `__eq__` and `__hash__`, by the names of the fields, and whether `__post_init__` follows."""


def _dataclass(cls: type | None = None, /, **options: bool) -> Callable[[type], type]:
    """A decorator: the class with fields for its annotations.

    >>> @dataclass(frozen=True, slots=True)
    ... class Point:
    ...     x: int
    ...     y: int = 0
    >>> Point(3), Point(3) == Point(3, 0), hash(Point(1)) == hash(Point(x=1))
    (Point(x=3, y=0), True, True)
    """
    if cls is not None or options != {"frozen": True, "slots": True}:
        raise TypeError("here it is @dataclass(frozen=True, slots=True); `dataclasses` has the others")
    return _made


if not TYPE_CHECKING:
    dataclass = _dataclass


class _Known:
    """`__dataclass_fields__` or `__dataclass_params__`: made by `dataclasses` itself, when somebody asks for them."""

    def __init__(self, name: str, rows: Mapping[str, tuple[str, Any]]) -> None:
        self.name = name
        self.rows = rows
        self._found: dict[str, Any] = {}

    def __get__(self, instance: object, owner: type) -> Any:
        if self.name not in self._found:
            from dataclasses import MISSING, field, make_dataclass

            rows = [(n, k, field(default=MISSING if d is _NO_DEFAULT else d)) for n, (k, d) in self.rows.items()]
            found = vars(make_dataclass("Known", rows, frozen=True, slots=True))[self.name]
            self._found.setdefault(self.name, found)  # another thread may have been quicker: one answer for all
        return self._found[self.name]


def _rows(cls: type, body: Mapping[str, Any]) -> dict[str, tuple[str, Any]]:
    """The fields, in their order: name -> annotation and default. A base's come first, and stay where they are."""
    rows: dict[str, tuple[str, Any]] = {}
    for base in reversed(cls.__mro__[1:]):
        known = vars(base).get("__dataclass_fields__")
        if not isinstance(known, _Known | None):
            raise TypeError(f"{cls.__name__}: {base.__name__} is made by `dataclasses`, so this has to be too")
        rows |= known.rows if known else {}
    kinds = body.get("__annotations__", {})
    late = not kinds and any(key.startswith("__annotate") for key in body)
    if late or not all(isinstance(kind, str) for kind in kinds.values()):
        raise TypeError(f"{cls.__name__}: its file has to begin with: from __future__ import annotations")
    for name, kind in kinds.items():
        word, default = kind.partition("[")[0].rpartition(".")[2].strip(), getattr(cls, name, _NO_DEFAULT)
        if word == "ClassVar" and name not in rows:
            continue
        if word in ("ClassVar", "InitVar", "KW_ONLY") or type(default).__module__ == "dataclasses":
            raise TypeError(f"{cls.__name__}.{name}: here a field is a type and a default; `dataclasses` has the rest")
        if type(default).__hash__ is None:
            raise ValueError(f"{cls.__name__}.{name}: all instances would share this default, and it can change")
        rows[name] = kind, _NO_DEFAULT if isinstance(default, _MEMBER) else default
    has_default = [default is not _NO_DEFAULT for _, default in rows.values()]
    if has_default != sorted(has_default):
        raise TypeError(f"{cls.__name__}: a field without a default stands behind one that has one")
    return rows


def _made(cls: type) -> type:
    """A second class of the same body: slots are given when a class is made, and then only."""
    body = dict(vars(cls))
    if wrong := body.keys() & {"__slots__", "__setattr__", "__delattr__"}:
        raise TypeError(f"{cls.__name__}: cannot have its own {', '.join(sorted(wrong))}")
    rows = _rows(cls, body)
    names = tuple(rows)
    for name in (*names, "__dict__", "__weakref__"):
        body.pop(name, None)
    inherited = {name for base in cls.__mro__[1:-1] for name in _slots(base)}
    body["__slots__"] = tuple(name for name in names if name not in inherited)
    body["__dataclass_fields__"] = _Known("__dataclass_fields__", rows)
    body["__dataclass_params__"] = _Known("__dataclass_params__", rows)
    body.setdefault("__match_args__", names)
    if body.get("__hash__", 0) is None and "__eq__" in body:
        del body["__hash__"]  # Python put it there, because of the `__eq__`
    made = type(cls)(cls.__name__, cls.__bases__, body)
    made.__qualname__ = cls.__qualname__
    for function in (*_compiled(made, rows), *_methods(made, names)):
        if function.__name__ not in body:
            function.__qualname__, function.__module__ = f"{cls.__qualname__}.{function.__name__}", cls.__module__
            setattr(made, function.__name__, function)
    _move_super(body, cls, made)
    return made


def _slots(cls: type) -> tuple[str, ...]:
    slots = vars(cls).get("__slots__", ())
    return (slots,) if isinstance(slots, str) else tuple(slots)


def _move_super(body: Mapping[str, Any], old: type, new: type) -> None:
    """A method that says `super()` remembers the class that it was written in: from now on this is the new one."""
    for method in body.values():
        one: Any
        for one in (method, getattr(method, "__func__", None), getattr(method, "fget", None)):
            names = one.__code__.co_freevars if hasattr(one, "__code__") else ()
            if "__class__" in names and (cell := one.__closure__[names.index("__class__")]).cell_contents is old:
                cell.cell_contents = new


def _compiled(cls: type, rows: Mapping[str, tuple[str, Any]]) -> tuple[Any, ...]:
    """What is called often."""
    names, after = tuple(rows), hasattr(cls, "__post_init__")
    if (names, after) not in _makers:
        space: dict[str, Any] = {}
        exec(_source(names, after), space)
        _makers[names, after] = space["make"]
    made, *others = _makers[names, after](*(getattr(cls, name).__set__ for name in names))
    init = _function(made.__code__, _words(cls), closure=made.__closure__)
    init.__defaults__ = tuple(default for _, default in rows.values() if default is not _NO_DEFAULT) or None
    init.__annotations__ = {name: kind for name, (kind, _) in rows.items()} | {"return": None}
    return init, *others


def _words(cls: type) -> dict[str, Any]:
    """What the file of the class knows: there annotations are looked up, by who wants more than their text."""
    return vars(modules[cls.__module__]) if cls.__module__ in modules else {}


def _source(names: tuple[str, ...], after: bool) -> str:
    """For `x` and `y`, without `__post_init__`:

    def make(set_0, set_1):
        def __init__(self, x, y): set_0(self, x); set_1(self, y)
        def __eq__(self, other): return (self.x, self.y,) == (other.x, other.y,) if ... else NotImplemented
        def __hash__(self): return hash((self.x, self.y,))
        return __init__, __eq__, __hash__
    """
    sets = [f"__set_{name}__" for name in names]
    lines = [f"{put}(self, {name})" for put, name in zip(sets, names, strict=True)] + ["self.__post_init__()"] * after
    mine, others = (f"({''.join(f'{of}.{name}, ' for name in names)})" for of in ("self", "other"))
    return f"""def make({", ".join(sets)}):
    def __init__({", ".join(("self", *names))}): {"; ".join(lines) or "pass"}
    def __eq__(self, other): return {mine} == {others} if other.__class__ is self.__class__ else NotImplemented
    def __hash__(self): return hash({mine})
    return __init__, __eq__, __hash__"""


def _methods(cls: Any, names: tuple[str, ...]) -> Iterator[Any]:
    """The others: closures, which cost next to nothing."""

    @recursive_repr()
    def __repr__(self: Any) -> str:
        fields = ", ".join([f"{name}={getattr(self, name)!r}" for name in names])
        return f"{self.__class__.__qualname__}({fields})"

    def __setattr__(self: Any, name: str, value: object) -> None:
        _refuse(self, cls, names, name, "assign to")
        super(cls, self).__setattr__(name, value)

    def __delattr__(self: Any, name: str) -> None:
        _refuse(self, cls, names, name, "delete")
        super(cls, self).__delattr__(name)

    def __getstate__(self: Any) -> list[Any]:
        return [getattr(self, name) for name in names]

    def __setstate__(self: Any, state: list[Any]) -> None:
        for name, value in zip(names, state, strict=False):
            object.__setattr__(self, name, value)

    def __replace__(self: Any, /, **changes: Any) -> Any:
        from dataclasses import replace

        return replace(self, **changes)

    yield from (__repr__, __setattr__, __delattr__, __getstate__, __setstate__, __replace__)


def _refuse(self: object, cls: type, names: tuple[str, ...], name: str, what: str) -> None:
    if type(self) is cls or name in names:
        from dataclasses import FrozenInstanceError

        raise FrozenInstanceError(f"cannot {what} field {name!r}")
