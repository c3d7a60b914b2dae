"""Every parameter of the catalogue has the address that `addresses.txt` lists, as compared with the manuals."""

from __future__ import annotations

import pytest

from barewire.devices import names
from tools import addresses

LISTED = addresses.FILE.read_text(encoding="utf-8").splitlines()
NOW = addresses.addresses().splitlines()


@pytest.mark.parametrize("device", names())
def test_every_parameter_has_its_listed_address(device: str) -> None:
    now = [line for line in NOW if line.startswith(f"{device} |")]
    listed = [line for line in LISTED if line.startswith(f"{device} |")]
    assert now == listed, "if the change is intended: python tools/addresses.py"


def test_the_list_has_no_other_device() -> None:
    assert len(NOW) == len(LISTED)
