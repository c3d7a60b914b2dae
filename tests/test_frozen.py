"""The light `dataclass` makes the classes that the real one makes, and refuses what it does not do."""

from __future__ import annotations

import copy
import dataclasses
import inspect
import pickle
import sys
import types
import typing
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import pytest

from barewire import frozen, modbus
from barewire.codecs import Layout
from barewire.errors import EncodeError
from barewire.modbus import ReadHoldingRegisters, ReadInputRegisters, Request, Response

HEAD = """
from __future__ import annotations
import typing
from typing import Any, ClassVar
made = dataclass(frozen=True, slots=True)
"""

BASE = '''
@made
class Base:
    """Somewhere."""

    x: int
    y: int = 2

    @property
    def sum(self) -> int:
        """Both."""
        return self.x + self.y
'''

SHAPES = {
    "no field": ("@made\nclass A:\n    '''Nothing.'''", [()]),
    "one field": ("@made\nclass A:\n    '''One.'''\n    x: Any", [(1,), ("a",), ([1],), ((1, 2),)]),
    "two, one with a default": (BASE + "A = Base", [(1,), (1, 2), (3, 4)]),
    "what is of the class": (
        "@made\nclass A:\n    '''It.'''\n    x: int\n    name: ClassVar[str] = 'a'\n    other: typing.ClassVar = 3\n"
        "    bare: ClassVar[int]\n    plain = 4\n    def f(self): return self.x + self.plain",
        [(1,), (2,)],
    ),
    "nothing but ClassVar": ("@made\nclass A:\n    '''It.'''\n    name: ClassVar[str] = 'a'", [()]),
    "checked": (
        "@made\nclass A:\n    '''It.'''\n    x: Any\n    def __post_init__(self):\n"
        "        if not self.x: raise ValueError('x')\n        object.__setattr__(self, 'x', tuple(self.x))",
        [([1, 2],), ("ab",), ("",), (3,)],
    ),
    "more fields": (BASE + "@made\nclass A(Base):\n    '''More.'''\n    z: str = 'z'", [(1,), (1, 2, "a")]),
    "no more fields": (BASE + "@made\nclass A(Base):\n    '''Same.'''\n    def f(self): return 3", [(1,), (5, 6)]),
    "other default": (
        BASE + "@made\nclass A(Base):\n    '''It.'''\n    y: float = 9.5\n    z: int = 1",
        [(1,), (5, 6)],
    ),
    "default without its type": (BASE + "@made\nclass A(Base):\n    '''Other.'''\n    y = 9", [(1,), (5, 6)]),
    "default gone": (BASE + "@made\nclass A(Base):\n    '''Other.'''\n    y: int", [(1,), (5, 6)]),
    "three in a row": (
        BASE + "@made\nclass B(Base):\n    y: int = 7\n@made\nclass A(B):\n    '''It.'''\n    z: int = 1",
        [(1,), (5, 6)],
    ),
    "undecorated between": (
        BASE + "class B(Base):\n    def __init__(self): raise ValueError\n"
        "@made\nclass A(B):\n    '''It.'''\n    z: int = 3",
        [(1,), (5, 6, 7)],
    ),
    "undecorated below": (BASE + "class A(Base):\n    '''It.'''\n    z: int = 3", [(1,), (5, 6)]),
    "a base of slots": (
        "class B:\n    __slots__ = 'xy'\n@made\nclass A(B):\n    '''It.'''\n    xy: int\n    y: int = 1",
        [(1,), (5, 6)],
    ),
    "two bases": (
        BASE + "class Other:\n    __slots__ = ()\n    y: int = 5\n    def g(self): return 5\n"
        "@made\nclass A(Base, Other):\n    '''It.'''\n    z: int = 1",
        [(1,), (5, 6)],
    ),
    "a default from above": (
        "class B:\n    __slots__ = ()\n    x = 7\n@made\nclass A(B):\n    '''It.'''\n    x: int",
        [(), (5,)],
    ),
    "methods of its own": (
        "@made\nclass A:\n    '''It.'''\n    x: int\n    def __repr__(self): return 'mine'\n"
        "    def __eq__(self, other): return True\n    def __getstate__(self): return [self.x]",
        [(1,), (2,)],
    ),
    "a hash of its own": ("@made\nclass A:\n    '''It.'''\n    x: int\n    def __hash__(self): return 3", [(1,), (2,)]),
    "no hash": ("@made\nclass A:\n    '''It.'''\n    x: int\n    __hash__ = None", [(1,)]),
    "an init of its own": (
        "@made\nclass A:\n    '''It.'''\n    x: int\n    def __init__(self): object.__setattr__(self, 'x', 8)",
        [()],
    ),
    "match args": ("@made\nclass A:\n    '''It.'''\n    x: int\n    __match_args__ = ('x', 'f')\n    f = 3", [(1,)]),
    "within itself": ("@made\nclass A:\n    '''It.'''\n    x: Any", [([],)]),
}


def both(source: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """The names after this source with the light decorator and with the real one."""
    spaces = []
    for name, decorator in (("light", frozen.dataclass), ("real", dataclasses.dataclass)):
        module = types.ModuleType(f"{__name__}.{name}")
        sys.modules[module.__name__] = module  # the real one looks there, and so does pickle
        vars(module)["dataclass"] = decorator
        exec(HEAD + source, vars(module))
        spaces.append(vars(module))
    return spaces[0], spaces[1]


def came_of(what: Callable[[], Any]) -> Any:
    """The value, or the kind of the error: of both ways to make a class the same is expected."""
    try:
        return what()
    except Exception as error:
        return type(error), str(error).replace("light", "").replace("real", "")


@pytest.mark.parametrize(("source", "values"), SHAPES.values(), ids=SHAPES)
def test_it_is_the_class_that_the_real_one_makes(source: str, values: list[tuple[Any, ...]]) -> None:
    light, real = both(source)
    mine, theirs = light["A"], real["A"]
    added = {"__replace__"} if sys.version_info < (3, 13) else set()
    known = {"__static_attributes__", "__firstlineno__"}
    assert set(vars(mine)) - known - (added - set(vars(theirs))) == set(vars(theirs)) - known
    for name in ("__name__", "__qualname__", "__doc__", "__slots__", "__match_args__", "__annotations__"):
        assert vars(mine).get(name) == vars(theirs).get(name), name
    assert str(came_of(lambda: inspect.signature(mine))) == str(came_of(lambda: inspect.signature(theirs)))
    assert [cls.__name__ for cls in mine.__mro__] == [cls.__name__ for cls in theirs.__mro__]
    for row in values:
        seen = [came_of(partial(behaviour, cls, row)) for cls in (mine, theirs)]
        assert seen[0] == seen[1]


def behaviour(cls: Any, row: tuple[Any, ...]) -> list[Any]:
    """All that can be asked of an instance; of copies and pickles, that they are the same again."""
    one, again = cls(*row), cls(*row)
    names = [field.name for field in dataclasses.fields(one)]
    first = names[0] if names else "x"
    found = [
        repr(one),
        str(one),
        one == again,
        one != again,
        one == row,
        one.__eq__(row),
        came_of(lambda: hash(one) == hash(again)),
        came_of(lambda: one == cls(*[0, *row[1:]])),
        [came_of(partial(setattr, one, name, 5)) for name in names],
        [came_of(partial(delattr, one, name)) for name in names],
        came_of(lambda: cls(*row, 1, 2, 3, 4)),
        came_of(lambda: cls(**{"unheard_of": 1})),
        came_of(lambda: repr(cls(**dict(zip(names, row, strict=False))))),
        came_of(lambda: one < again),
        [(field.name, field.type, field.default, field.init) for field in dataclasses.fields(cls)],
        came_of(lambda: dataclasses.asdict(one)),
        came_of(lambda: dataclasses.astuple(one)),
        came_of(lambda: repr(dataclasses.replace(one, **{first: "z"}))),
        came_of(lambda: repr(one.__replace__(**{first: "z"})) if hasattr(dataclasses.Field, "__replace__") else ""),
        came_of(lambda: (one.__getstate__(), vars(one))[0]),
        hasattr(one, "__dict__"),
        hasattr(one, "__weakref__"),
        [getattr(one, name) for name in ("name", "other", "plain", "sum", "unit") if hasattr(one, name)],
        [came_of(getattr(one, name)) for name in ("f", "g") if hasattr(one, name)],
    ]
    for other in (copy.copy(one), copy.deepcopy(one), came_of(lambda: pickle.loads(pickle.dumps(one)))):
        found += [type(other) is cls, repr(other), other == one, [getattr(other, name, None) for name in names]]
    return found


def test_an_instance_within_itself_is_shown() -> None:
    for space in both(SHAPES["within itself"][0]):
        row: list[Any] = []
        one = space["A"](row)
        row.append(one)
        assert repr(one) == "A(x=[...])"


def test_instances_are_told_apart_by_class_and_by_every_field() -> None:
    light, real = both(BASE + "@made\nclass A(Base):\n    pass\nclass B(Base): pass")
    for space in (light, real):
        base, below, plain = space["Base"], space["A"], space["B"]
        assert base(1, 2) == base(1) != base(1, 3) != base(0, 3)
        assert base(1) != below(1)
        assert base(1) != plain(1)
        assert len({base(1), base(1, 2), base(2), below(1)}) == 3
        match below(4, 5):
            case base(x, y):
                assert (x, y) == (4, 5)
            case _:
                pytest.fail("no match")
    assert light["Base"](1) != real["Base"](1)


def test_an_undecorated_subclass_may_have_more_but_not_other_values() -> None:
    """The real one with slots raises TypeError here, before 3.14: its `super()` names the class without slots."""
    space = both(BASE + "class B(Base):\n    pass")[0]
    one = space["B"](1)
    one.more = 3
    assert one.more == 3
    del one.more
    for change in (
        partial(setattr, one, "x", 1),
        partial(delattr, one, "y"),
        partial(setattr, space["Base"](1), "more", 1),
    ):
        with pytest.raises(dataclasses.FrozenInstanceError, match=r"cannot (assign to|delete) field '(x|y|more)'"):
            change()
    assert (one.x, one.y) == (1, 2)
    assert not hasattr(one, "more")


def test_errors_of_a_call_name_the_class() -> None:
    light, real = both(BASE)
    for arguments in ({}, {"x": 1, "z": 2}):
        texts = []
        for space in (light, real):
            with pytest.raises(TypeError) as error:
                space["Base"](**arguments)
            texts.append(str(error.value))
        assert texts[0] == texts[1]
        assert "Base.__init__()" in texts[0]


REFUSED_BY_BOTH = {
    "a field without a default behind one with": "@made\nclass A:\n    x: int = 1\n    y: int",
    "the same, inherited": BASE + "@made\nclass A(Base):\n    z: int",
    "a default that can change": "@made\nclass A:\n    x: list = []",
    "slots of its own": "@made\nclass A:\n    x: int\n    __slots__ = ('x',)",
    "its own way to be assigned": "@made\nclass A:\n    x: int\n    def __setattr__(self, name, value): pass",
    "its own way to lose a value": "@made\nclass A:\n    x: int\n    def __delattr__(self, name): pass",
}
REFUSED_HERE = {
    "other options": "@dataclass(frozen=True, slots=True, order=True)\nclass A:\n    x: int",
    "not frozen": "@dataclass(slots=True)\nclass A:\n    x: int",
    "no slots": "@dataclass(frozen=True)\nclass A:\n    x: int",
    "as a function": "dataclass(type('A', (), {}), frozen=True, slots=True)",
    "no brackets": "@dataclass\nclass A:\n    x: int",
    "field()": "from dataclasses import field\n@made\nclass A:\n    x: int = field(default=3)",
    "keywords only": "from dataclasses import KW_ONLY\n@made\nclass A:\n    x: int\n    _: KW_ONLY\n    y: int = 3",
    "only for __init__": "from dataclasses import InitVar\n@made\nclass A:\n    x: InitVar[int]\n"
    "    def __post_init__(self, x): pass",
    "a field that is of the class below": BASE + "@made\nclass A(Base):\n    y: ClassVar[int] = 3",
    "a base of the real one": "import dataclasses\n"
    "@dataclasses.dataclass(frozen=True, slots=True)\nclass B:\n    x: int\n"
    "@made\nclass A(B):\n    y: int",
}


def run(source: str, decorator: Any) -> None:
    module = types.ModuleType(f"{__name__}.refused")
    sys.modules[module.__name__] = module
    vars(module)["dataclass"] = decorator
    exec(HEAD + source, vars(module))


@pytest.mark.parametrize("source", REFUSED_BY_BOTH.values(), ids=REFUSED_BY_BOTH)
@pytest.mark.parametrize("decorator", [dataclasses.dataclass, frozen.dataclass], ids=["real", "light"])
def test_what_the_real_one_refuses_is_refused(source: str, decorator: Any) -> None:
    with pytest.raises((TypeError, ValueError)):
        run(source, decorator)


@pytest.mark.parametrize("source", REFUSED_HERE.values(), ids=REFUSED_HERE)
def test_what_it_does_not_do_is_refused_and_not_done_otherwise(source: str) -> None:
    run(source, dataclasses.dataclass)
    with pytest.raises(TypeError, match="dataclasses"):
        run(source, frozen.dataclass)


@pytest.mark.parametrize("text", ["x: int", "x: list[str] = 3", "x: int | None = None"])
def test_a_file_without_the_future_statement_is_refused(text: str) -> None:
    code = compile(f"@made\nclass A:\n    {text}", "somewhere", "exec", dont_inherit=True)
    with pytest.raises(TypeError, match="from __future__ import annotations"):
        exec(code, {"made": frozen.dataclass(frozen=True, slots=True), "__name__": __name__})


@pytest.mark.parametrize(
    "method",
    [
        "def said(self): return super().said() + unheard",
        "@classmethod\n        def said(cls): return super().of_class() + unheard",
        "@property\n        def value(self): return super().value + unheard\n        said = lambda self: self.value",
        "def said(self): return 11 if __class__ is type(self) else 0",
        "def said(self): return 1 + unheard\n        borrowed = Other.borrowed",
    ],
    ids=["method", "class method", "property", "by name", "another's"],
)
def test_super_in_every_place_that_a_class_has_for_it(method: str) -> None:
    source = f"""
class Above:
    __slots__ = ()
    def said(self): return 1
    @classmethod
    def of_class(cls): return 1
    @property
    def value(self): return 1

class Other(Above):
    __slots__ = ()
    def borrowed(self): return super()

def later():
    @made
    class A(Above):
        x: int = 0
        {method}
    unheard = 10
    return A
"""
    space = both(source)[0]
    made = space["later"]()
    assert made.__qualname__ == "later.<locals>.A"
    assert made().said() == 11
    assert space["Other"]().borrowed().said() == 1


# The messages -------------------------------------------------------------------------------------------------------

BARE = (modbus.Message, modbus.Request, modbus.Response)
EVERYTHING: list[Any] = [getattr(modbus, name) for name in modbus.__all__]
MESSAGES = [kind for kind in EVERYTHING if isinstance(kind, type) and issubclass(kind, modbus.Message)]
MESSAGES = [kind for kind in MESSAGES if kind not in BARE]


@pytest.mark.parametrize("cls", MESSAGES, ids=lambda cls: cls.__name__)
def test_every_message_is_a_dataclass_to_those_who_ask(cls: Any) -> None:
    assert tuple(field.name for field in dataclasses.fields(cls)) == cls.__match_args__
    assert list(inspect.signature(cls).parameters) == list(cls.__match_args__)
    assert cls.__dataclass_params__.frozen
    assert cls.__name__ in inspect.getsource(cls)
    assert cls.__doc__
    assert dataclasses.is_dataclass(cls)


@pytest.mark.parametrize("cls", MESSAGES, ids=lambda cls: cls.__name__)
def test_the_annotations_of_a_call_are_read_where_the_class_was_written(cls: Any) -> None:
    """As those of the real one are. (Of some the words stand under TYPE_CHECKING, and are nowhere.)"""
    assert cls.__init__.__globals__ is vars(sys.modules[cls.__module__])
    assert modbus.WriteMultipleRegisters in MESSAGES
    signature = inspect.signature(modbus.WriteMultipleRegisters, eval_str=True)
    assert signature.parameters["registers"].annotation == Sequence[int]


def test_fields_are_the_same_ones_whoever_asks_first() -> None:
    """`dataclasses` makes them when they are asked for, and in between another thread may ask as well."""
    made = both(BASE)[0]["Base"]
    known = vars(made)["__dataclass_fields__"]
    real = dataclasses.make_dataclass
    seen: list[Any] = []

    def meanwhile(*args: Any, **kwargs: Any) -> Any:
        if not seen:
            seen.append(0)
            seen[0] = made.__dataclass_fields__
        return real(*args, **kwargs)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(dataclasses, "make_dataclass", meanwhile)
        first = known.__get__(None, made)
    assert first is seen[0] is made.__dataclass_fields__


def test_all_messages_are_held() -> None:
    assert len(MESSAGES) > 40


def test_a_message_can_be_taken_apart_replaced_copied_and_kept() -> None:
    request = ReadHoldingRegisters(107, 3)
    assert dataclasses.asdict(request) == {"address": 107, "quantity": 3}
    assert dataclasses.replace(request, quantity=4) == ReadHoldingRegisters(107, 4)
    with pytest.raises(EncodeError):
        dataclasses.replace(request, quantity=0)
    assert copy.copy(request) == copy.deepcopy(request) == pickle.loads(pickle.dumps(request)) == request
    assert request != ReadInputRegisters(107, 3)
    with pytest.raises(dataclasses.FrozenInstanceError):
        request.address = 3  # type: ignore[misc]


@dataclasses.dataclass(frozen=True, slots=True)
class Hurried(ReadHoldingRegisters):
    """A user's own, with the real decorator, over a message of ours."""

    hurry: int = 1
    layout: typing.ClassVar[Layout] = Layout(">BHHB", "function_code", "address", "quantity", "hurry")


@dataclasses.dataclass(frozen=True, slots=True)
class Spoken(Request[Response]):
    """A user's own from the beginning."""

    word: int

    function_code: typing.ClassVar[int] = 0x6E
    layout: typing.ClassVar[Layout] = Layout(">BH", "function_code", "word")


def test_the_real_decorator_works_over_a_message() -> None:
    one = Hurried(1, 2)
    assert repr(one) == "Hurried(address=1, quantity=2, hurry=1)"
    assert one == Hurried(1, quantity=2) != Hurried(1, 2, 3)
    assert one.encode() == bytes.fromhex("03 0001 0002 01")
    assert Hurried.decode(one.encode()) == one
    assert not hasattr(one, "__dict__")
    assert pickle.loads(pickle.dumps(one)) == copy.copy(one) == one
    assert dataclasses.replace(one, hurry=5) == Hurried(1, 2, 5)
    with pytest.raises(EncodeError):
        Hurried(1, 0)
    with pytest.raises(dataclasses.FrozenInstanceError):
        one.address = 3  # type: ignore[misc]
    assert pickle.loads(pickle.dumps(Spoken(3))) == Spoken(3)
