"""`barewire gateway` is `python -m barewire.gateway`."""

from __future__ import annotations

from pathlib import Path

from barewire.gateway.config import example
from tests.workbench.cli.helpers import error_of, run_here


def test_the_command_has_the_arguments_of_the_program(tmp_path: Path) -> None:
    assert run_here("gateway", "--example").stdout == example()
    file = tmp_path / "gateway.toml"
    file.write_text("dran = 1\n")
    wrong = run_here("gateway", "--check", str(file))
    assert wrong.returncode == 2
    assert f"{file}:1:1: unknown 'dran'" in wrong.stderr
    assert "expected CONFIG; --example prints one" in error_of("gateway", status=2)
