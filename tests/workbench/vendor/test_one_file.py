"""What is in a file: names followed through lazy packages, `getattr` and imports inside functions; items left out."""

from __future__ import annotations

import ast

import pytest

from barewire_workbench.vendor.changes import changes
from barewire_workbench.vendor.one_file import OneFile
from barewire_workbench.vendor.sources import Module, Place, Sources


class Texts(Sources):
    """Modules given as texts."""

    def __init__(self, **texts: str) -> None:
        super().__init__()
        self._modules |= {f"barewire.{name}": Module(f"barewire.{name}", text) for name, text in texts.items()}


def file_of(sources: Sources, *roots: str, left_out: tuple[str, ...] = ()) -> str:
    """Return the text of a file without its imports and comments."""
    places = [Place(f"barewire.{module}", name) for module, _, name in (root.rpartition(".") for root in roots)]
    text = OneFile(sources, places, is_public=lambda module: False, left_out=left_out).text()
    return ast.unparse(ast.parse(text))


def test_what_nothing_uses_is_left_out() -> None:
    sources = Texts(
        low="def used():\n    return 1\n\n\ndef unused():\n    return 2\n",
        high="from barewire.low import used\n\n\ndef root():\n    return used()\n",
    )
    text = file_of(sources, "high.root")
    assert text.split("\n\n") == [
        "from __future__ import annotations",
        "def used():\n    return 1",
        "def root():\n    return used()",
    ]


def test_a_method_that_only_a_later_method_uses_is_there() -> None:
    """`first` is found needed when `last` is read, and `last` when nothing else is new."""
    text = "class A:\n    def first(self): ...\n\n    def last(self):\n        getattr(self, 'first')()\n\n"
    text += "    def other(self): ...\n"
    text += "\n\ndef root(a):\n    a.last()\n\n\nTABLE = A\n"
    shown = file_of(Texts(one=text), "one.root", "one.TABLE")
    assert "def first" in shown
    assert "def last" in shown
    assert "def other" not in shown


def test_two_things_of_one_name_get_two_names() -> None:
    sources = Texts(
        a="LIMIT = 1\n\n\ndef encode():\n    return LIMIT\n",
        b="import barewire.a as low\n\nLIMIT = 2\n\n\ndef encode(x=LIMIT):\n    return low.encode() + LIMIT + x\n",
    )
    text = file_of(sources, "b.encode")
    assert "LIMIT_B = 2" in text
    assert "def encode_b(x=LIMIT_B):\n    return encode() + LIMIT_B + x" in text


def test_a_local_name_is_not_that_of_a_module() -> None:
    text = "size = 1\n\n\ndef root(rows):\n    size = len(rows)\n    return [size for size in rows], size\n"
    assert "size = 1" not in file_of(Texts(one=text), "one.root")


def test_an_import_inside_a_function_is_one_at_the_top() -> None:
    sources = Texts(
        low="def used():\n    return 1\n",
        high="def root():\n    # only here\n    from barewire.low import used as other\n\n    return other()\n",
    )
    assert "def root():\n    return used()" in file_of(sources, "high.root")


@pytest.mark.parametrize(
    ("table", "left"),
    [("(A, B, C)", "(A,)"), ("(B, A, C)", "(A,)"), ("[B, C]", "[]"), ("{'a': A, 'b': B}", "{'a': A}")],
)
def test_items_of_what_is_left_out_go(table: str, left: str) -> None:
    sources = Texts(
        low="A = 1\n", out="B = 2\nC = 3\n",
        high=f"from barewire.low import A\nfrom barewire.out import B, C\n\nTABLE = {table}\n",
    )  # fmt: skip
    assert f"TABLE = {left}" in file_of(sources, "high.TABLE", left_out=("barewire.out",))


def test_what_is_left_out_and_needed_is_an_error() -> None:
    sources = Texts(out="B = 2\n", high="from barewire.out import B\n\n\ndef root():\n    return B\n")
    with pytest.raises(LookupError, match=r"B of barewire\.out is left out, and something else needs it"):
        file_of(sources, "high.root", left_out=("barewire.out",))


def test_a_patch_must_fit_once() -> None:
    for text, count in (("no such text", 0), ("crc16_table", 4)):
        sources = Sources({"barewire.rtu.crc": [(text, "")]})
        with pytest.raises(LookupError, match=f"barewire.rtu.crc has {count} times, and not once: {text}"):
            sources.module("barewire.rtu.crc")


def test_a_package_is_followed_to_the_module_that_defines_a_name() -> None:
    sources = Sources()
    assert sources.resolve(Place("barewire.modbus"), "ReadCoils") == Place(
        "barewire.modbus.messages.coils", "ReadCoils"
    )
    assert sources.resolve(Place("barewire"), "rtu") == Place("barewire.rtu")
    assert sources.resolve(Place("barewire.rtu.crc"), "range") is None


def test_changes_name_what_is_different() -> None:
    before = "A = 1\n\n\nclass B:\n    x = 1\n\n    def m(self): ...\n\n\ndef f(): ...\n"
    after = before.replace("A = 1", "A = 2  # more").replace("def m(self): ...", "def m(self):\n        'Text.'")
    after = after.replace("def f", "def g") + "# a comment\n"
    assert changes(before, after) == (("A", "B.m"), ("g",), ("f",))
    assert str(changes(before, before + "# a comment\n")).strip() == "nothing but comments"
