"""Each file of `barewire vendor`: short enough, complete, alone, typed, and right by the vectors."""

from __future__ import annotations

import doctest
import re
import subprocess
import sys
from pathlib import Path

import pytest

from barewire import __version__
from barewire_workbench.vendor.head import read_head
from barewire_workbench.vendor.recipes import RECIPES
from tests.helpers import some_of
from tests.workbench.cli.helpers import run_here
from tests.workbench.vendor.made import imported, made, run_alone, written

LONGEST = {
    "modbus-rtu-client": 2600,
    "modbus-tcp-client": 2300,
    "modbus-ascii-client": 2600,
    "modbus-rtu-server": 3200,
    "modbus-tcp-server": 3200,
    "sdo-client": 2500,
}
"""Lines with their docstrings."""

PASSED = {
    "modbus-rtu-client": {"client": 174, "pdu": 170, "exchange": 31, "rtu-talk": 10, "rtu-frame": 106, "crc16": 32},
    "modbus-tcp-client": {"client": 183, "pdu": 167, "exchange": 31, "tcp-talk": 17, "tcp-frame": 25},
    "modbus-ascii-client": {"client": 174, "pdu": 167, "exchange": 31, "ascii-talk": 28, "ascii-frame": 53, "lrc": 20},
    "modbus-rtu-server": {"server": 189, "pdu": 217, "rtu-talk": 52, "rtu-frame": 106, "crc16": 32, "rtu-timing": 16},
    "sdo-client": {"sdo": 110, "sdo-talk": 29},
    "modbus-tcp-server": {"server": 26, "pdu": 217, "tcp-talk": 17, "tcp-frame": 25},
}
"""Cases that each file is asked at least, with coils: what it does not have is not asked."""

pytestmark = pytest.mark.long

RUFF = [sys.executable, "-m", "ruff"]

OF_EACH_KIND = ("modbus-rtu-client", "modbus-tcp-server", "sdo-client")
"""A client, a server and CANopen: the files of `make test`. Each takes half a second to make."""
every_file = pytest.mark.parametrize(
    "name", some_of(sorted(RECIPES, key=lambda name: name not in OF_EACH_KIND), len(OF_EACH_KIND))
)


def families(name: str) -> tuple[str, ...]:
    return ("coils",) if "coils" in RECIPES[name].optional else ()


@every_file
def test_length(name: str) -> None:
    assert made(name).count("\n") <= LONGEST[name]


@every_file
def test_it_is_imported_alone(name: str, tmp_path: Path) -> None:
    path = written(tmp_path, name)
    done = run_alone(tmp_path, f"import {path.stem}; print([n for n in sys.modules if n.startswith('barewire')])")
    assert (done.stdout, done.stderr) == ("[]\n", "")


@every_file
def test_nothing_in_it_is_undefined_or_unused(name: str, tmp_path: Path) -> None:
    path = written(tmp_path, name)
    rules = ["--isolated", "--target-version", "py311", "--line-length", "120"]
    checks = ["--select", "F,E9,I", "--ignore", "F402", "--config", "lint.isort.combine-as-imports=true"]
    subprocess.run([*RUFF, "format", "--check", *rules, str(path)], check=True)
    done = subprocess.run(
        [*RUFF, "check", *rules, *checks, str(path)],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout


@every_file
def test_examples_of_its_docstrings_run(name: str, tmp_path: Path) -> None:
    module = imported(tmp_path, name)
    assert not re.search(r"(>>> |^ *)(from|import) barewire", made(name), re.MULTILINE)
    results = doctest.testmod(module, optionflags=doctest.IGNORE_EXCEPTION_DETAIL)
    assert results.failed == 0
    assert results.attempted > 20


@every_file
def test_its_head_says_how_it_was_made(name: str) -> None:
    text = made(name)
    assert read_head(text) == (name, (), __version__, False)
    assert read_head(text.replace("def ", "def  ", 1)).is_edited
    assert "Permission is hereby granted, free of charge" in text


def test_its_licence_is_ours() -> None:
    licence = Path(__file__).parents[3] / "LICENSE"
    head = made("modbus-rtu-client").partition('"""\n\n')[2].partition("# barewire vendor")[0]
    assert licence.read_text().split() == head.replace("#", "").split()


def passed(output: str) -> dict[str, int]:
    """Return the cases passed by kind, of the table of a check."""
    return {kind: int(count) for kind, count in re.findall(r"^(\S+) +(\d+)", output, re.MULTILINE)}


@pytest.mark.proof
@every_file
def test_vectors(name: str, tmp_path: Path) -> None:
    path = written(tmp_path, name, *families(name))
    done = run_here("vendor", "--check", str(path), "--python", f"{sys.executable} -S")
    assert done.returncode == 0, done.stdout
    counts = passed(done.stdout)
    assert {kind: min(count, counts.get(kind, 0)) for kind, count in PASSED[name].items()} == PASSED[name]


@pytest.mark.proof
@every_file
def test_types(name: str, tmp_path: Path) -> None:
    path = written(tmp_path, name, *families(name))
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", "--python-version", "3.11", "--config-file=", path.name],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout


@pytest.mark.proof
@every_file
def test_with_all_families(name: str, tmp_path: Path) -> None:
    path = written(tmp_path, name, *RECIPES[name].optional)
    done = run_here("vendor", "--check", str(path), "--python", f"{sys.executable} -S")
    assert done.returncode == 0, done.stdout
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", "--python-version", "3.11", "--config-file=", path.name],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout
