"""The marker `needs("...")`: a skip names the package; CI allows no skip; a name outside the list is an error."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.long

HERE = Path(__file__).parent

SUITE = """
import pytest

@pytest.mark.needs("shell")
def test_with_what_is_here(): pass

@pytest.mark.needs("shell", "mbfly")
def test_with_what_is_missing(): raise AssertionError("not reached")

@pytest.mark.needs("header")
def test_with_a_missing_file(): raise AssertionError("not reached")

@pytest.mark.xfail(reason="known")
def test_known(): raise AssertionError
"""

LIST = """
# name   package      proof
shell    dash         sh                     # is everywhere
mbfly    mbfly-tools  mbfly                  # does not exist
header   libfly-dev   /usr/include/no/fly.h
"""


def run_suite(folder: Path, suite: str, **environment: str) -> str:
    for path, text in {
        ".ci/apt-packages.txt": LIST,
        "tests/conftest.py": (HERE / "conftest.py").read_text(encoding="utf-8"),
        "tests/test_suite.py": suite,
        "pytest.ini": "[pytest]\naddopts = -q -rs -p no:cacheprovider\nmarkers = needs(program)\n",
    }.items():
        (folder / path).parent.mkdir(exist_ok=True)
        (folder / path).write_text(text, encoding="utf-8")
    usual = {name: value for name, value in os.environ.items() if not name.startswith(("PYTEST_", "BAREWIRE_"))}
    usual["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"
    command = [sys.executable, "-m", "pytest"]
    run = subprocess.run(command, cwd=folder, env=usual | environment, capture_output=True, text=True, check=False)
    return run.stdout + run.stderr


def test_a_missing_program_is_a_skip_with_the_package_to_install(tmp_path: Path) -> None:
    output = run_suite(tmp_path, SUITE)
    assert "needs mbfly: apt-get install mbfly-tools" in output
    assert "needs header: apt-get install libfly-dev" in output
    assert "1 passed, 2 skipped, 1 xfailed" in output


def test_in_ci_a_skip_is_a_failure(tmp_path: Path) -> None:
    output = run_suite(tmp_path, SUITE, BAREWIRE_NO_SKIPS="1")
    assert "needs mbfly: apt-get install mbfly-tools" in output
    assert "1 passed, 1 xfailed, 2 errors" in output


@pytest.mark.parametrize("skip", ["pytest.importorskip('no_such_module')", "pytest.skip('x', allow_module_level=True)"])
def test_in_ci_a_whole_file_cannot_be_skipped_either(tmp_path: Path, skip: str) -> None:
    suite = f"import pytest\n{skip}\ndef test_x(): pass\n"
    assert "1 skipped" in run_suite(tmp_path, suite)
    assert "1 error" in run_suite(tmp_path, suite, BAREWIRE_NO_SKIPS="1")


def test_a_name_that_is_not_in_the_list_is_an_error(tmp_path: Path) -> None:
    output = run_suite(tmp_path, SUITE.replace('"header"', '"haeder"'))
    assert "needs('haeder') is not a name in" in output
