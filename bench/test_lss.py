"""An LSS fastscan on python-can's virtual bus: who is there that has no node-ID yet?"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack

import pytest

from barewire.canopen import Device, LssAddress, LssSlave, LssState, ObjectDictionary
from barewire.shells import open_canopen, open_host
from bench.race import Many, Race, entries


def fastscan(closing: ExitStack) -> Many:
    """128 unknown bits, 92 of them ones, which cost a wait each: on the clock, since waiting is what it does."""
    address = LssAddress(0xFFFF0360, 0xDEADBEEF, 0x7FFF0002, 0xFFFFFFFF)
    nameless = Device(None, ObjectDictionary(), lss=LssSlave(address))
    closing.enter_context(open_host("can://virtual/lss", node=nameless))
    client = closing.enter_context(open_canopen("can://virtual/lss"))

    def work(count: int) -> None:
        for _ in range(count):
            client.switch_global(LssState.WAITING)
            assert client.fastscan() == address

    return Many(work)


FASTSCAN = Race("LSS", "fastscan, python-can's virtual bus", "128 bits", {"barewire": fastscan}, rounds=3, turn=0.0)


@pytest.mark.parametrize(("race", "who"), entries(FASTSCAN))
def test_fastscan(enter: Callable[[Race, str], None], race: Race, who: str) -> None:
    enter(race, who)
