"""`barewire vendor`: the list, files, updates and checks."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path

import pytest

from barewire import __version__
from barewire_workbench.vendor.recipes import RECIPES
from tests.workbench.cli.helpers import error_of, output_of, run_here
from tests.workbench.vendor.made import made, written

pytestmark = pytest.mark.long


def test_without_a_name_it_lists_what_there_is() -> None:
    assert [line.split()[0] for line in output_of("vendor").splitlines()] == list(RECIPES)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["modbus-rtu"], "file 'modbus-rtu': expected one of modbus-rtu-client, "),
        (["modbus-rtu-client", "--with", "coil"], "--with 'coil': expected one of coils, combined, "),
        (["modbus-rtu-client", "--check", "x.py"], "give one of NAME, --update FILE and --check FILE"),
    ],
)
def test_wrong_use(arguments: list[str], text: str) -> None:
    assert text in error_of("vendor", *arguments, status=2)


def test_a_file_of_somebody_else_is_neither_updated_nor_checked(tmp_path: Path) -> None:
    path = tmp_path / "other.py"
    path.write_text("print()\n")
    for option in ("--update", "--check"):
        assert "no file of `barewire vendor`" in error_of("vendor", option, str(path), status=2)
        assert "No such file" in error_of("vendor", option, str(tmp_path / "none.py"), status=1)


def test_without_ruff_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("barewire_workbench.cli.vendor.find_spec", lambda name: None)
    assert "pip install 'barewire-workbench[vendor]'" in error_of("vendor", "modbus-tcp-client")


def test_an_update_says_what_changed(tmp_path: Path) -> None:
    path = written(tmp_path, "modbus-tcp-client", "coils")
    assert output_of("vendor", "--update", str(path)) == f"{path}: modbus-tcp-client {__version__}, no change\n"
    text = path.read_text().replace("PREFIX + length == len(data)", "length + PREFIX == len(data)")
    path.write_text(text.replace("def reason(", "def motive(").replace("class Refused(", "class Declined("))
    assert "it was edited since it was made" in error_of("vendor", "--update", str(path), status=2)
    assert output_of("vendor", "--update", str(path), "--force").splitlines() == [
        f"{path}: modbus-tcp-client {__version__} -> {__version__}",
        "  changed  TcpLine.feed",
        "  new      Refused, reason",
        "  gone     Declined, motive",
    ]
    assert path.read_text() == made("modbus-tcp-client", "coils")


def test_a_file_that_is_not_python_any_more_is_made_again(tmp_path: Path) -> None:
    path = written(tmp_path, "modbus-tcp-client", "coils")
    path.write_text(path.read_text() + "def (\n")
    for command, text in (("'", "No closing quotation"), (shlex.quote(sys.executable), "invalid syntax")):
        assert text in error_of("vendor", "--check", str(path), "--python", command)
    assert "all of it" in output_of("vendor", "--update", str(path), "--force")
    assert path.read_text() == made("modbus-tcp-client", "coils")


def test_an_update_keeps_the_families_or_takes_others(tmp_path: Path) -> None:
    path = written(tmp_path, "modbus-tcp-client", "coils")
    output = output_of("vendor", "--update", str(path), "--with", "fifo")
    assert "ModbusClient.read_coils" in output.split("gone")[1]
    assert path.read_text() == made("modbus-tcp-client", "fifo")


def test_a_check_notices_a_wrong_file(tmp_path: Path) -> None:
    path = written(tmp_path, "modbus-ascii-client")
    path.write_text(path.read_text().replace("return -sum(data) & 0xFF", "return sum(data) & 0xFF"))
    done = run_here("vendor", "--check", str(path))
    assert done.returncode == 1
    assert "failed  lrc-1" in done.stdout
