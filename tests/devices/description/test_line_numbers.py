"""Line numbers of TOML keys: which lines are keys and headers, and which are inside of strings, arrays and comments."""

from __future__ import annotations

import tomllib
from typing import Any

import pytest

from barewire.devices.description.check import KeyLines, KeyPath
from barewire.devices.description.load import CATALOG

TEXT = '''\
top = 1  # [not.a.header]
a.b.c = 2
"quoted key" = { inner = 3 }
long = """
[[parameter]]
key = "inside"
"quote" at the end""""
literal = \'\'\'
[x]
\'\'\'
array = [
  [1, 2],  # ]
  ["]", '['],
]
[ table . sub ]
key = 4
[[parameter]]
name = "one # no comment"
[parameter.bits]
0 = "zero"
[[ parameter ]]
name = "two"
bits.5 = "five"
[[parameter.deeper]]
key = 6
'''


@pytest.mark.parametrize(
    ("path", "line"),
    [
        (("top",), 1),
        (("a",), 2),
        (("a", "b", "c"), 2),
        (("quoted key",), 3),
        (("quoted key", "inner"), 3),
        (("long",), 4),
        (("literal",), 8),
        (("array",), 11),
        (("table", "sub"), 15),
        (("table", "sub", "key"), 16),
        (("parameter", 0), 17),
        (("parameter", 0, "name"), 18),
        (("parameter", 0, "bits"), 19),
        (("parameter", 0, "bits", "0"), 20),
        (("parameter", 0, "missing"), 17),
        (("parameter", 1), 21),
        (("parameter", 1, "name"), 22),
        (("parameter", 1, "bits", "5"), 23),
        (("parameter", 1, "deeper", 0), 24),
        (("parameter", 1, "deeper", 0, "key"), 25),
        (("key",), 1),
        (("nowhere",), 1),
    ],
)
def test_line_of_a_key(path: KeyPath, line: int) -> None:
    assert KeyLines(TEXT).of(path) == line


def test_the_example_is_valid_toml() -> None:
    assert tomllib.loads(TEXT)["parameter"][1]["bits"] == {"5": "five"}


@pytest.mark.parametrize("file", sorted(CATALOG.glob("*/*.toml")), ids=lambda file: f"{file.parent.name}/{file.name}")
def test_every_key_of_the_catalogue_is_found_on_its_line(file: Any) -> None:
    text = file.read_text(encoding="utf-8")
    lines, written = KeyLines(text), text.splitlines()
    for place, row in enumerate(tomllib.loads(text).get("parameter", [])):
        assert written[lines.of(("parameter", place)) - 1] == "[[parameter]]"
        for key in row:
            line = written[lines.of(("parameter", place, key)) - 1]
            assert line.startswith(f"{key} =") or line == f"[parameter.{key}]"
