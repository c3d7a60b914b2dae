"""An LSS fastscan on python-can's virtual bus: find a device without a node-ID.

Each library is on a bus of its own, with a device of ours. A request without an answer costs a time-out, so the time is
mostly waiting: the `canopen` library is set to the shortest time-out that ours uses; its default is half a second.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack

import pytest

from barewire import CanopenClient, CanopenServer
from barewire.canopen import LocalNode, LssAddress, LssSlave, LssState, ObjectDictionary
from barewire.canopen.lss.master import _FLOOR
from bench.race import Many, Race, entries

ADDRESS = LssAddress(0xFFFF0360, 0xDEADBEEF, 0x7FFF0002, 0xFFFFFFFF)
"""128 unknown bits; each of the 92 ones costs a time-out."""


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


CONTESTANTS = {"barewire": ours, "canopen": theirs}
FASTSCAN = Race("LSS", "fastscan, python-can's virtual bus", "128 bits", CONTESTANTS, rounds=3, turn=0.0)


@pytest.mark.parametrize(("race", "contestant"), entries(FASTSCAN))
def test_fastscan(enter: Callable[[Race, str], None], race: Race, contestant: str) -> None:
    enter(race, contestant)
