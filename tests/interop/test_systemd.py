"""The unit of systemd: rated by systemd, and used by it in the guest kernel, with all its restrictions."""

from __future__ import annotations

import importlib.util
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.interop.canopen.guest import ROOT, in_guest

UNIT = ROOT / "packaging" / "barewire-gateway.service"


@pytest.mark.long
@pytest.mark.needs("systemd")
def test_it_may_do_little(tmp_path: Path) -> None:
    command = ["systemd-analyze", "security", "--offline=true", str(UNIT)]
    shown = subprocess.run(command, check=True, capture_output=True, text=True, timeout=60).stdout
    level = re.search(r"Overall exposure level for \S+: ([\d.]+)", shown)
    assert level is not None, shown
    assert float(level[1]) <= 1.7


@pytest.mark.long
@pytest.mark.needs("systemd")
def test_systemd_finds_nothing_wrong(tmp_path: Path) -> None:
    unit = tmp_path / UNIT.name
    unit.write_text(UNIT.read_text(encoding="utf-8").replace("/opt/barewire/bin/python", "/usr/bin/python3"))
    command = ["systemd-analyze", "verify", str(unit)]
    done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.proof
@pytest.mark.needs("systemd")
@pytest.mark.needs("uml")
@pytest.mark.needs("busybox")
@pytest.mark.needs("venv")
def test_systemd_runs_it(tmp_path: Path) -> None:
    """With its user, its capabilities, its filters and its limits; reload, crash, stop and faulty files."""
    for name in ("barewire", "microdot", "prometheus_client", "aiomqtt", "paho", "typing_extensions"):
        found = importlib.util.find_spec(name)
        assert found is not None
        assert found.origin is not None
        if found.submodule_search_locations:
            shutil.copytree(
                found.submodule_search_locations[0], tmp_path / name, ignore=shutil.ignore_patterns("*.pyc")
            )
        else:
            shutil.copy(found.origin, tmp_path)
    with in_guest(["sh", "tests/interop/systemd_guest.sh"], {"PACKAGES": str(tmp_path)}) as done:
        lines = done.out.splitlines()
    assert lines[-1:] == ["done"], str(done)
    assert [line for line in lines if line.startswith("NOT SO")] == []
    assert sum(line.startswith("ok: ") for line in lines) >= 17
