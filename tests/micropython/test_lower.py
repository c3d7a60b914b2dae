"""What the build of the small edition makes of single constructs, and that they still mean the same."""

from __future__ import annotations

import ast
import textwrap
from typing import Any

import pytest

from tools.micropython.lower import Lower
from tools.micropython.reach import Needed
from tools.micropython.seconds import count_in_microseconds
from tools.micropython.sources import SMALL, Module, Place, Sources, Unknown

NAME = "barewire.example"


def prepared(source: str) -> Sources:
    """Return sources with a module of the stack that has this text."""

    def prepare(sources: Sources, module: Module) -> None:
        count_in_microseconds(module.name, module.tree)
        Lower(sources, module).visit(module.tree)
        module.read()

    sources = Sources(prepare)
    sources.written[NAME] = textwrap.dedent(source)
    return sources


def lowered(source: str) -> str:
    """Return the text of the module in an edition, without its imports."""
    tree = prepared(source).module(NAME).tree
    tree.body = [part for part in tree.body if not isinstance(part, (ast.Import, ast.ImportFrom))]
    return ast.unparse(ast.fix_missing_locations(tree))


def run(source: str) -> dict[str, Any]:
    """Run the lowered module on CPython, which has all that MicroPython has, and return its names."""
    sources = prepared(source)
    names: dict[str, Any] = {}
    exec(ast.unparse(sources.module(SMALL).tree), names)
    for name, place in sources.module(NAME).imports.items():
        found = sources.find(place)
        if found is not None and found.name:
            names[name] = names[found.name]
    exec(lowered(source), names)
    return names


@pytest.mark.parametrize(
    ("python", "micropython"),
    [
        ("def f(a: int, /, *, b: str = '') -> None:\n    'text'", "def f(a, *, b=''):\n    pass"),
        ("f = lambda a: [*a, 1, 2, *a]", "f = lambda a: list(a) + [1, 2] + list(a)"),
        ("f = lambda a: (0, *a)", "f = lambda a: (0,) + tuple(a)"),
        ("f = lambda a: {0, *a}", "f = lambda a: set([0] + list(a))"),
        ("f = lambda x, n: f'{{{x:0{n}X}}}, {x!r}'", "f = lambda x, n: '{{{:0{}X}}}, {!r}'.format(x, n, x)"),
        ("f = lambda a, b: zip(a, b, strict=True)", "f = lambda a, b: zip(a, b)"),
        ("_LIMIT = 0x700 >> 7\nf = lambda: _LIMIT", "_LIMIT = 1792 >> 7\nf = lambda: 14"),
        ("LIMIT = 5\nf = lambda LIMIT: LIMIT", "LIMIT = 5\nf = lambda LIMIT: LIMIT"),
        ("class A(ValueError):\n    __slots__ = ()", "class A(ValueError):\n    pass"),
        ("class A(OSError): n = 1\nclass B(A, OSError): n = 2",
         "class A(OSError):\n    n = 1\n\nclass B(A):\n    n = 2"),
    ],
)  # fmt: skip
def test_lowered_text(python: str, micropython: str) -> None:
    assert lowered(python) == micropython


@pytest.mark.parametrize(
    ("source", "result"),
    [
        ("f = lambda: {**{1: 2}, 3: 4, **{5: 6}}", {1: 2, 3: 4, 5: 6}),
        ("f = lambda: b'abc'[::-1]", b"cba"),
        ("f = lambda: (b'ab'.ljust(4, b'.'), 'f00f'.removeprefix('f'), (255).bit_length())", (b"ab..", "00f", 8)),
        ("f = lambda: ((-2).to_bytes(2, 'big', signed=True), int.from_bytes(b'\\xff', 'big', signed=True))",
         (b"\xff\xfe", -1)),
        ("f = lambda: ('°'.encode('latin-1'), b'\\xb0'.decode('latin-1'))", (b"\xb0", "°")),
        ("f = lambda: (b'a1b2'.translate(None, b'12'), bytes.fromhex('01 02'))", (b"ab", b"\x01\x02")),
        ("import struct\nf = lambda: struct.Struct('>BH').pack(1, 2)", b"\x01\x00\x02"),
        ("from collections import deque\ndef f():\n    row = deque(maxlen=2)\n    row.append(1)\n    row.append(2)\n"
         "    row.append(3)\n    return list(row)", [2, 3]),
        ("class Held:\n    def __init__(self):\n        self.held = bytearray()\n    def f(self):\n"
         "        self.held += b'abcd'\n        del self.held[:1]\n        first = bytes(self.held)\n"
         "        self.held.clear()\n        return first, bytes(self.held)\nf = Held().f", (b"bcd", b"")),
        ("def f():\n    try:\n        raise ValueError('a') from KeyError('b')\n    except ValueError as error:\n"
         "        return repr(error.__cause__)", "KeyError('b')"),
    ],
)  # fmt: skip
def test_lowered_code_does_the_same(source: str, result: object) -> None:
    assert run(source)["f"]() == result


def test_a_dataclass_keeps_its_fields_defaults_and_checks() -> None:
    names = run(
        """
        from dataclasses import dataclass, field
        from typing import ClassVar

        @dataclass(frozen=True, slots=True)
        class Read:
            address: int
            quantity: int = 1
            notes: list = field(default_factory=list)
            name: ClassVar[str] = "read"

            def __post_init__(self) -> None:
                if not self.quantity:
                    raise ValueError("none")
                object.__setattr__(self, "address", int(self.address))

        @dataclass(frozen=True, slots=True)
        class ReadCoils(Read):
            name: ClassVar[str] = "coils"
        """
    )
    first, second = names["ReadCoils"]("7"), names["ReadCoils"](7, quantity=1)
    assert first == second
    assert first != names["Read"](7)
    assert (first.address, first.quantity, first.notes, first.name) == (7, 1, [], "coils")
    assert first.notes is not second.notes
    assert repr(first) == "ReadCoils(address=7, quantity=1, notes=[])"
    with pytest.raises(ValueError, match="none"):
        names["ReadCoils"](0, 0)


def test_a_named_tuple_can_be_unpacked_and_compared() -> None:
    names = run("from typing import NamedTuple\nclass Adu(NamedTuple):\n    unit: int\n    pdu: bytes = b''")
    unit, pdu = names["Adu"](5)
    assert (unit, pdu) == (5, b"")
    assert names["Adu"](5, b"\x01")[:1] == (5,)
    assert names["Adu"](5) == names["Adu"](5)


def test_members_of_an_enumeration_are_numbers() -> None:
    text = lowered(
        """
        from enum import IntEnum

        class Code(IntEnum):
            A = 1, "text"
            B = 2, "more"

        def f():
            return Code.B, [code for code in Code]
        """
    )
    assert text.endswith("return (2, [code for code in (1, 2)])")


def test_match_becomes_tests() -> None:
    names = run(
        """
        from dataclasses import dataclass

        @dataclass
        class Write:
            place: int
            value: int

        def f(request):
            match request:
                case Write(place, value):
                    return place, value
                case 5:
                    return "five"
                case _:
                    return None
        """
    )
    assert names["f"](names["Write"](1, 2)) == (1, 2)
    assert (names["f"](5), names["f"](6)) == ("five", None)


def test_seconds_become_whole_microseconds() -> None:
    text = lowered("T: float = 1.0\ndef f(t=1750e-6, n=2):\n    return f'{t:g} s, {t:g} steps', 1.5 * n, 1e-7")
    assert text == ("T = 1000000\n\ndef f(t=1750, n=2):\n    return ('{} us, {:g} steps'.format(t, t), 1.5 * n, 1)")


@pytest.mark.parametrize(
    ("source", "text"),
    [
        ("from subprocess import run\ndef f():\n    run('x')", "subprocess.run: MicroPython lacks it"),
        ("def f(x):\n    match x:\n        case {'a': 1}:\n            pass", "pattern of `match` that no rule lowers"),
        ("from enum import IntEnum\nclass A(IntEnum):\n    B = 1\ndef f():\n    A(1)", "a class of numbers here"),
    ],
)
def test_what_cannot_be_lowered_is_an_error_that_names_it(source: str, text: str) -> None:
    with pytest.raises(Unknown, match=text):
        Needed(prepared(source), set()).add(Place(NAME, "f"))
