"""The light `NamedTuple` makes the classes that `typing`'s makes, and refuses what that refuses."""

from __future__ import annotations

import copy
import pickle
import sys
import typing
from typing import Any

import pytest

from barewire import record
from barewire.codecs import Field
from barewire.modbus import Adu, Noise
from barewire.rtu import Timing

WHOLE = '''
from __future__ import annotations

class Point(NamedTuple):
    """Somewhere."""

    x: int
    y: int = 2
    name: str = "somewhere"

    unit = "m"

    @property
    def sum(self) -> int:
        """Both."""
        return self.x + self.y

    @classmethod
    def there(cls) -> Point:
        return cls(7)

    def __str__(self) -> str:
        return f"{self.x}/{self.y}"
'''

REFUSED = {
    "a field without a default behind one with": "class A(NamedTuple):\n    x: int = 1\n    y: int",
    "a field of an underscore": "class A(NamedTuple):\n    _x: int",
    "a second base": "class Other: pass\nclass A(NamedTuple, Other):\n    x: int",
    "a way of its own to be made": "class A(NamedTuple):\n    x: int\n    def __new__(cls): return None",
    "slots": "class A(NamedTuple):\n    x: int\n    __slots__ = ('y',)",
}


def test_it_is_the_class_that_typing_makes() -> None:
    space: dict[str, Any] = {"__name__": "somewhere", "NamedTuple": record.NamedTuple}
    exec(WHOLE, space)
    theirs: dict[str, Any] = {"__name__": "somewhere", "NamedTuple": typing.NamedTuple}
    exec(WHOLE, theirs)
    mine, other = space["Point"], theirs["Point"]
    assert mine.__mro__[1:] == other.__mro__[1:]
    for name in ("__name__", "__qualname__", "__module__", "__doc__", "_fields", "_field_defaults", "unit"):
        assert getattr(mine, name) == getattr(other, name), name
    assert set(vars(mine)) == set(vars(other)) - {"__orig_bases__"}
    assert typing.get_type_hints(mine) == typing.get_type_hints(other) == {"x": int, "y": int, "name": str}
    for point in (mine(1), mine(x=1, y=2), mine.there(), mine(1)._replace(y=9)):
        assert repr(point) == repr(other(*point))
        assert (point.sum, str(point), point) == (other(*point).sum, str(other(*point)), other(*point))


@pytest.mark.parametrize("source", REFUSED.values(), ids=REFUSED)
@pytest.mark.parametrize("base", [typing.NamedTuple, record.NamedTuple], ids=["typing", "record"])
def test_what_typing_refuses_is_refused(source: str, base: Any) -> None:
    with pytest.raises((TypeError, ValueError, AttributeError)):
        exec("from __future__ import annotations\n" + source, {"__name__": "somewhere", "NamedTuple": base})


def test_without_the_future_statement_the_fields_are_found_or_it_says_what_is_missing() -> None:
    """From 3.14 on a class keeps its annotations as a function, unless its file has that statement."""
    space: dict[str, Any] = {"__name__": "somewhere", "NamedTuple": record.NamedTuple}
    code = compile("class A(NamedTuple):\n    x: int", "somewhere", "exec", dont_inherit=True)
    if sys.version_info >= (3, 14):
        with pytest.raises(TypeError, match="from __future__ import annotations"):
            exec(code, space)
    else:
        exec(code, space)
        assert space["A"](3).x == 3


@pytest.mark.parametrize(
    "row",
    [Adu(1, b"\3\0\0\0\1"), Noise(b"\xff", "length"), Field(0, 1, "function_code", 3), Timing.of(19200)],
    ids=lambda row: type(row).__name__,
)
def test_rows_of_the_light_rooms_can_be_copied_kept_and_compared(row: Any) -> None:
    assert pickle.loads(pickle.dumps(row)) == copy.deepcopy(row) == row
    assert type(row)._make(row) == row
    assert row._replace() == row
    assert row.__doc__


def test_a_row_may_have_a_parameter_as_typings_may() -> None:
    source = (
        "Item = TypeVar('Item', bound=int)\nclass Row(NamedTuple, Generic[Item]):\n    item: Item\n    at: float = 0.0"
    )
    source = f"from __future__ import annotations\n{source}\nwith_brackets = Row[int](3)"
    for words in (typing, record):
        space: dict[str, Any] = {"__name__": "somewhere", **vars(words)}
        exec(source, space)
        assert repr(space["with_brackets"]) == "Row(item=3, at=0.0)"
        assert isinstance(space["with_brackets"], space["Row"])
        assert space["Row"](3) == space["with_brackets"] == (3, 0.0)


def test_what_stands_in_the_brackets_of_a_class_is_for_type_checkers() -> None:
    source = """
Item, Said = TypeVar("Item"), ParamSpec("Said")

class Port(Protocol[Item]):
    def send(self, item: Item) -> None: ...

class Tap(Generic[Said, Item]):
    def __init__(self, behind: Port[Item]) -> None:
        self.behind = behind

class Two(Tap[[str], bytes]):
    pass

made = Two("behind"), Tap[[str], int]("behind")
"""
    for words in (typing, record):
        space: dict[str, Any] = {"__name__": "somewhere", **vars(words)}
        exec("from __future__ import annotations\n" + source, space)
        assert [one.behind for one in space["made"]] == ["behind", "behind"]
        assert isinstance(space["made"][0], space["Tap"])
