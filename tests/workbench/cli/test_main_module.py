"""`python -m barewire` runs the command that is installed, and says how to install it if none is."""

from __future__ import annotations

import runpy
from importlib.metadata import EntryPoint, entry_points
from typing import Any

import pytest


def test_the_stack_has_no_command_of_its_own() -> None:
    (command,) = entry_points(group="console_scripts", name="barewire")
    assert command.dist is not None
    assert command.dist.name == "barewire-workbench"


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
