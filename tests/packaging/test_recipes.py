"""The recipes of distributions have the names, the version and the requirements of pyproject.toml."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGING = ROOT / "packaging"
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def read(name: str) -> str:
    return (PACKAGING / name).read_text(encoding="utf-8")


def test_debian_has_the_version_of_the_project() -> None:
    head = read("debian/changelog").splitlines()[0]
    assert re.match(r"barewire \((.*)-\d+\) ", head)[1] == PROJECT["version"]  # type: ignore[index]


def test_debian_asks_for_the_python_of_the_project() -> None:
    oldest = PROJECT["requires-python"].removeprefix(">=")
    assert f"python3 (>= {oldest})" in read("debian/control")
    assert PROJECT["dependencies"] == []  # one would be a package of the distribution


def test_the_unit_that_is_packed_has_no_path_of_a_venv() -> None:
    """`debian/rules` and the recipe for Yocto replace the interpreter of the how-to, and nothing else is to replace."""
    unit = read("barewire-gateway.service").replace("/opt/barewire/bin/python", "/usr/bin/python3")
    assert "/opt" not in unit
    assert unit.count("/usr/bin/python3 -m barewire.gateway") == 3
