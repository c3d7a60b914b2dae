"""The command `barewire eds`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from barewire.canopen import eds
from tests.workbench.cli.helpers import (
    error_of,
    output_of,
    run_here,
)


def test_export_to_a_file_and_lint_it(tmp_path: Path) -> None:
    file = tmp_path / "drive.eds"
    assert output_of("eds", "export", "az3", str(file)) == f"{file}: 171 objects\n"
    assert eds.parse(file.read_bytes(), strict=True).get("FileInfo", "FileName") == "drive.eds"
    assert output_of("eds", "lint", str(file)) == f"{file}: no findings\n"
    assert json.loads(output_of("eds", "lint", str(file), "--json")) == {"file": str(file), "ok": True}
    assert output_of("eds", "export", "az3").startswith("[FileInfo]\nFileName=az3.eds\n")


def test_lint_prints_line_rule_and_text(tmp_path: Path) -> None:
    file = tmp_path / "odd.eds"
    file.write_bytes(b"[1000]\nDataType=010\n")
    done = run_here("eds", "lint", str(file))
    assert done.returncode == 1
    assert f"{file}:2: leading-zeros: [1000] DataType = 010: a leading zero makes a number octal;" in done.stdout
    assert done.stderr == ""
    rows = [json.loads(line) for line in run_here("eds", "lint", "--json", str(file)).stdout.splitlines()]
    assert {"file", "line", "rule", "text"} == set(rows[0])


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (("lint", "nowhere.eds"), 1, "nowhere.eds: No such file or directory"),
        (
            ("lint", "README.md"),
            2,
            "README.md is no EDS: it has no object and none of the sections that CiA 306 requires",
        ),
        (("export", "az3", "nowhere/az3.eds"), 1, "nowhere/az3.eds: No such file or directory"),
        (("export", "adxl"), 2, "adxl has no CANopen in its description"),
        (("export", "az33"), 2, "no device 'az33' in the catalogue"),
    ],
)
def test_errors_are_one_line(arguments: tuple[str, ...], status: int, message: str) -> None:
    assert message in error_of("eds", *arguments, status=status)
