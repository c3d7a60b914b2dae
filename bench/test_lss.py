"""An LSS fastscan on python-can's virtual bus: who is there that has no node-ID yet?

Each on a bus of its own, with a device of ours. What is not answered is waited out, so the time is mostly waits: the
`canopen` library is told to wait as short as ours does at its shortest. Left alone it waits half a second for each.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack

import pytest

from barewire import CanopenClient, CanopenServer
from barewire.canopen import LocalNode, LssAddress, LssSlave, LssState, ObjectDictionary
from barewire.canopen.lss.fastscan import _FLOOR
from bench.race import Many, Race, entries

ADDRESS = LssAddress(0xFFFF0360, 0xDEADBEEF, 0x7FFF0002, 0xFFFFFFFF)
"""128 unknown bits, 92 of them ones, which cost a wait each."""


def _device(channel: str, closing: ExitStack) -> None:
    nameless = LocalNode(None, ObjectDictionary(), lss=LssSlave(ADDRESS))
    closing.enter_context(CanopenServer(f"can://virtual/{channel}", device=nameless))


def ours(closing: ExitStack) -> Many:
    _device("lss", closing)
    client = closing.enter_context(CanopenClient("can://virtual/lss"))

    def work(count: int) -> None:
        for _ in range(count):
            client.lss.switch_global(LssState.WAITING)
            assert client.lss.fastscan() == ADDRESS

    return Many(work)


def theirs(closing: ExitStack) -> Many:
    import canopen

    _device("their lss", closing)
    network = canopen.Network()
    network.connect(interface="virtual", channel="their lss")
    closing.callback(network.disconnect)
    master = network.lss
    master.RESPONSE_TIMEOUT = _FLOOR

    def work(count: int) -> None:
        for _ in range(count):
            master.send_switch_state_global(master.WAITING_STATE)
            assert master.fast_scan() == (True, list(ADDRESS))

    return Many(work)


WHO = {"barewire": ours, "canopen": theirs}
FASTSCAN = Race("LSS", "fastscan, python-can's virtual bus", "128 bits", WHO, rounds=3, turn=0.0)


@pytest.mark.parametrize(("race", "who"), entries(FASTSCAN))
def test_fastscan(enter: Callable[[Race, str], None], race: Race, who: str) -> None:
    enter(race, who)
