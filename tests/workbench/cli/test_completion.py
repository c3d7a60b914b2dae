"""What shells complete, by the interface of click that they call."""

from __future__ import annotations

import shlex
import shutil
import subprocess
from pathlib import Path

import pytest
from click.shell_completion import ShellComplete, get_completion_class

from barewire_workbench.cli.app import barewire_command
from tests.workbench.cli.helpers import COMMAND, ENVIRONMENT
from tests.workbench.eds.test_device import plant

URL = "can://memory/nobody?node=5"


def completed(*words: str) -> list[str]:
    *arguments, incomplete = words
    shell = ShellComplete(barewire_command, {}, "barewire", "_BAREWIRE_COMPLETE")
    return [item.value for item in shell.get_completions(list(arguments), incomplete)]


def test_commands_options_and_devices() -> None:
    assert completed("wa") == ["watch"]
    assert completed("canopen", "n") == ["nmt"]
    assert completed("canopen", "nmt", URL, "res") == ["reset", "reset-comm"]
    assert "--verify" in completed("write", "--")
    assert completed("read", URL, "") == ["adxl", "az3", "csd-mt", "raw"]
    assert completed("read", URL, "AZ") == ["az3"]
    shell = ShellComplete(barewire_command, {}, "barewire", "_BAREWIRE_COMPLETE")
    assert [item.type for item in shell.get_completions(["read", URL], "./my")] == ["file"]


def test_names_of_parameters() -> None:
    assert completed("read", URL, "az3", "target v") == ["TARGET VELOCITY"]
    assert completed("watch", URL, "az3", "STATUS WORD", "TARGET VELOC") == ["TARGET VELOCITY"]
    assert completed("write", URL, "az3", "target v") == ["TARGET VELOCITY="]
    assert completed("write", URL, "az3", "STATUS W") == []  # it is read only
    assert completed("read", URL, "raw", "h") == []
    assert completed("read", URL, "unknown", "h") == []


def test_names_of_an_eds(tmp_path: Path) -> None:
    file = tmp_path / "pump.eds"
    file.write_bytes(plant().encode())
    assert completed("read", URL, str(file), "speed") == ["Speed [rpm]"]
    assert completed("read", URL, str(tmp_path / "missing.eds"), "speed") == []


@pytest.mark.parametrize(
    ("words", "value"),
    [
        (f"barewire read '{URL}' az3 targ", r"TARGET\\ VELOCITY"),
        (f"barewire read '{URL}' az3 \"targ", "TARGET VELOCITY"),
    ],
)
def test_bash_gets_blanks_with_a_backslash_outside_of_quotes(
    words: str, value: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COMP_WORDS", words)
    monkeypatch.setenv("COMP_CWORD", "4")
    monkeypatch.setenv("_BAREWIRE_COMPLETE", "bash_complete")
    kind = get_completion_class("bash")
    assert kind is not None
    shell = kind(barewire_command, {}, "barewire", "_BAREWIRE_COMPLETE")
    assert f"plain,{value}" in shell.complete().splitlines()


@pytest.mark.long
@pytest.mark.skipif(shutil.which("bash") is None, reason="bash is missing")
def test_bash_itself_gets_words_that_it_can_insert(tmp_path: Path) -> None:
    program = tmp_path / "barewire"  # the script of the completion calls what it completes, by one word
    program.write_text(f'#!/bin/sh\nexec {shlex.join(COMMAND)} "$@"\n')
    program.chmod(0o755)
    script = f"""
    eval "$(_BAREWIRE_COMPLETE=bash_source {program})"
    COMP_WORDS=(barewire read '"{URL}"' az3 targ) COMP_CWORD=4
    _barewire_completion {program} targ az3
    printf '%s\\n' "${{COMPREPLY[0]}}"
    """
    done = subprocess.run(
        ["bash", "-c", script], capture_output=True, text=True, timeout=60, env=ENVIRONMENT, check=False
    )
    assert done.stdout == "TARGET\\ VELOCITY\n", done.stderr


@pytest.mark.long
@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_each_shell_gets_its_script(shell: str) -> None:
    environment = ENVIRONMENT | {"_BAREWIRE_COMPLETE": f"{shell}_source"}
    done = subprocess.run(COMMAND, capture_output=True, text=True, timeout=60, env=environment, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert f"{shell}_complete" in done.stdout
