"""`NamedTuple` as `typing` has it, for the rooms that stay light: a class with annotations becomes a named tuple.

    TYPE_CHECKING = False  # which type checkers take for True
    if TYPE_CHECKING:
        from typing import NamedTuple, Literal
    else:
        from barewire.record import NamedTuple

`import typing` takes three times as long as all of `barewire.rtu`, and most of its memory, for names that only a type
checker reads. What is needed when a program runs is here; the rest is under `TYPE_CHECKING`.

I know: how to make a class.  I never know: of what.  Everybody may import me; only the light rooms need to.
"""

from __future__ import annotations

from collections import namedtuple

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any

_PYTHONS_OWN = {"__annotations__", "__module__", "__qualname__"}


class _Maker(type):
    """Takes the body of a class apart: annotations are fields, their values defaults, the rest stays."""

    def __new__(cls, name: str, bases: tuple[type, ...], body: dict[str, Any]) -> Any:
        if not bases:
            return super().__new__(cls, name, bases, body)  # NamedTuple itself
        fields = tuple(body["__annotations__"])
        defaults = [body[field] for field in fields if field in body]
        made = namedtuple(name, fields, defaults=defaults, module=body["__module__"])  # type: ignore[misc]
        made.__annotations__ = body["__annotations__"]
        for key, value in body.items():
            if key not in fields and key not in _PYTHONS_OWN:
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
