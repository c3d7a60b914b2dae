"""`python -m barewire` runs the command that is installed, and says how to install it if none is. The command says what
it lacks, or that its two packages are not of one version; it runs with the oldest click that it asks for."""

from __future__ import annotations

import re
import runpy
import subprocess
import sys
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

import pytest


def test_the_stack_has_no_command_of_its_own() -> None:
    (command,) = entry_points(group="console_scripts", name="barewire")
    assert command.dist is not None
    assert command.dist.name == "barewire-workbench"


WORKBENCH = Path(__file__).parents[3] / "workbench" / "src"
STACK = Path(__file__).parents[3] / "src"


def started(code: str, *options: str) -> subprocess.CompletedProcess[str]:
    """Run the command behind some code, in an interpreter that has no other packages than those of `code`."""
    code = (
        f"import sys; sys.path.insert(0, {str(WORKBENCH)!r}); {code}; from barewire_workbench.cli import main; main()"
    )
    command = [sys.executable, "-I", *options, "-c", code, "--version"]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


def test_without_the_stack_one_line_says_what_to_install() -> None:
    done = started("pass", "-S")
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == "barewire: the command needs barewire 0.1.0: pip install 'barewire[cli]==0.1.0'\n"


def test_little_is_loaded_before_ctrl_c_is_handled() -> None:
    """An interrupt that early has the traceback of Python. `typing` would take most of that time."""
    code = f"import sys; sys.path[:0] = [{str(WORKBENCH)!r}, {str(STACK)!r}]; before = set(sys.modules); "
    code += "import barewire, barewire_workbench.cli; print(*(set(sys.modules) - before))"
    done = subprocess.run([sys.executable, "-I", "-S", "-c", code], capture_output=True, text=True, check=True)
    assert {"typing", "re", "click", "rich"}.isdisjoint(done.stdout.split())


def test_the_module_runs_the_command() -> None:
    command = [sys.executable, "-m", "barewire", "--version"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.startswith("barewire, version ")


def test_ctrl_c_while_the_command_is_looked_for_ends_with_130(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(**_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("importlib.metadata.entry_points", interrupted)
    with pytest.raises(SystemExit) as ended:
        runpy.run_module("barewire", run_name="__main__")
    assert ended.value.code == 130


def test_a_program_is_told_what_the_workbench_needs() -> None:
    code = f"import sys; sys.path.insert(0, {str(WORKBENCH)!r}); from barewire_workbench import explain"
    done = subprocess.run([sys.executable, "-I", "-S", "-c", code], capture_output=True, text=True, check=False)
    assert done.stderr.endswith("ModuleNotFoundError: barewire-workbench needs barewire 0.1.0\n")


def test_another_version_of_the_stack_is_one_line_and_the_command_runs() -> None:
    done = started("import barewire; barewire.__version__ = '9.9'")
    assert (done.returncode, done.stdout) == (0, "barewire, version 9.9\n")
    assert done.stderr == (
        "barewire: installed are barewire 9.9 and barewire-workbench 0.1.0: the command needs one version of both\n"
    )


def test_no_type_of_click_is_subscripted() -> None:
    """ParamType is generic since click 8.3 and Choice since 8.2; pyproject.toml asks for 8.1."""
    for file in (WORKBENCH / "barewire_workbench" / "cli").rglob("*.py"):
        assert not re.search(r"^class .*click\.\w+\[", file.read_text("utf-8"), re.M), file


@pytest.mark.parametrize("left", [(), (EntryPoint("barewire", "a_package_that_is_gone.cli:main", "console_scripts"),)])
def test_without_the_command_one_line_says_how_to_install_it(
    left: tuple[EntryPoint, ...], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def installed(**_: Any) -> tuple[EntryPoint, ...]:
        return left

    monkeypatch.setattr("importlib.metadata.entry_points", installed)
    with pytest.raises(SystemExit) as ended:
        runpy.run_module("barewire", run_name="__main__")
    assert ended.value.code == 1
    assert capsys.readouterr().err == "barewire: the command is not installed: pip install 'barewire[cli]'\n"
