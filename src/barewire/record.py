"""`NamedTuple` as `typing` has it, for the rooms that stay light: a class with annotations becomes a named tuple.

    TYPE_CHECKING = False  # which type checkers take for True
    if TYPE_CHECKING:
        from typing import Generic, NamedTuple, Literal, TypeVar
    else:
        from barewire.record import Generic, NamedTuple, TypeVar

`import typing` takes three times as long as all of `barewire.rtu`, and most of its memory, for names that only a type
checker reads. What is needed when a program runs is here: named tuples, and the words that stand in the head of a class
(`Generic[Item]`), which mean nothing then. The rest is under `TYPE_CHECKING`.

What `typing` refuses is refused here too: a default before a field without one, a second base, a `__new__` of its own.
`tests/test_record.py` holds the two against each other. Subclass what was made, if something has to be added to it.

I know: how to make a class.  I never know: of what.  Everybody may import me; only the light rooms need to.
"""

from __future__ import annotations

from collections import namedtuple

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any

_LEFT_OUT = {"__annotations__", "__module__", "__qualname__", "__dict__", "__weakref__"}
"""What Python puts into the body of a class for itself, and a finished class has anyway."""
_MADE_OF = ("__new__", "__init__", "__slots__", "__getnewargs__", "_fields", "_field_defaults", "_make", "_replace")
_REFUSED = {*_MADE_OF, "__classcell__"}
"""What a named tuple is made of; and what says that a method uses `super()`, of which nothing would come."""


class Generic:
    """The base of a class that has parameters. Which, is for type checkers: `Generic[Item]` is `Generic`.

    `typing.Protocol` does not know these: a protocol of typing's cannot extend one of them when a program runs.
    """

    __slots__ = ()

    def __class_getitem__(cls, parameters: object) -> type:
        return cls


Protocol = Generic


def TypeVar(name: str, *kinds: type, **rules: object) -> str:
    """A parameter: its name, to stand in `Generic[...]`."""
    return name


ParamSpec = TypeVar


class _Maker(type):
    """Takes the body of a class apart: annotations are fields, their values defaults, the rest stays."""

    def __new__(cls, name: str, bases: tuple[type, ...], body: dict[str, Any]) -> Any:
        if not bases:
            return super().__new__(cls, name, bases, body)  # NamedTuple itself
        if bases not in ((NamedTuple,), (NamedTuple, Generic)):
            raise TypeError(f"{name}: a NamedTuple has no other base than Generic")
        if "__annotations__" not in body and any(key.startswith("__annotate") for key in body):
            raise TypeError(f"{name}: its file has to begin with: from __future__ import annotations")
        types = body.get("__annotations__", {})
        fields = tuple(types)
        with_default = tuple(field for field in fields if field in body)
        if with_default != fields[len(fields) - len(with_default) :]:
            raise TypeError(f"{name}: a field without a default stands behind one that has one")
        if wrong := _REFUSED & body.keys():
            raise AttributeError(f"{name}: a NamedTuple cannot have its own {', '.join(sorted(wrong))}")
        defaults = [body[field] for field in with_default]
        made = namedtuple(name, fields, defaults=defaults, module=body["__module__"])  # type: ignore[misc]
        made.__annotations__ = types
        made.__qualname__ = body["__qualname__"]
        for key, value in body.items():
            if key not in types and key not in _LEFT_OUT:
                setattr(made, key, value)
        return made


class NamedTuple(metaclass=_Maker):
    """The base of a row of named values.

    >>> class Point(NamedTuple):
    ...     x: int
    ...     y: int = 0
    ...
    ...     def mirrored(self):
    ...         return Point(-self.x, self.y)
    >>> Point(3).mirrored()
    Point(x=-3, y=0)
    """


class Shown:
    """The base of what counts: an object that is shown as what it holds.

    >>> class Hits(Shown):
    ...     def __init__(self):
    ...         self.left, self.right = 0, 2
    >>> Hits()
    Hits(left=0, right=2)
    """

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{name}={value!r}' for name, value in vars(self).items())})"
