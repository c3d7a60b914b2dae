"""Every parameter of the catalogue has the address that `addresses.txt` lists, as compared with the manuals."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

HOME = Path(__file__).parents[2]
WRITTEN = (HOME / "tests" / "devices" / "addresses.txt").read_text(encoding="utf-8").splitlines()
NOW = runpy.run_path(str(HOME / "tools" / "addresses.py"))["addresses"]().splitlines()


@pytest.mark.parametrize("device", ["az3", "adxl", "csd-mt"])
def test_no_parameter_has_moved(device: str) -> None:
    now = [line for line in NOW if line.startswith(f"{device} |")]
    written = [line for line in WRITTEN if line.startswith(f"{device} |")]
    assert now == written, "if this is meant: python tools/addresses.py"


def test_there_is_no_other_device() -> None:
    assert len(NOW) == len(WRITTEN)
