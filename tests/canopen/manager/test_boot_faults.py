"""A manager whose nodes, or whose application, fail at a bad moment: frame by frame, in virtual time."""

from __future__ import annotations

import pytest

from barewire.canopen import BootManager, BootSlave, CanFrame, NetworkList

DEVICE_TYPE = "585#4300100001000000"


def fed(manager: BootManager, text: str | None, now: float) -> list[str]:
    return [str(item) for item in manager.feed(CanFrame.parse(text) if text else None, now)]


def booted(network: NetworkList) -> BootManager:
    """Return a manager whose node 5 has booted at 0.12 s, and must send heartbeats every 0.2 s."""
    manager = BootManager(network)
    fed(manager, None, 0.0)
    fed(manager, "705#00", 0.1)
    fed(manager, DEVICE_TYPE, 0.11)
    assert "node 5: booted" in fed(manager, "705#7F", 0.12)
    return manager


def test_a_stopped_network_needs_nothing_before_its_boot_time_is_over() -> None:
    slaves = [BootSlave(5, mandatory=True, heartbeat=0.2), BootSlave(6, mandatory=True)]
    manager = booted(NetworkList(slaves, stop_all=True, boot_time=1.5))
    assert fed(manager, None, 0.5)[-1] == "network: stopped"
    assert (manager.deadline, manager.busy) == (None, False)


def test_no_node_boots_in_the_feed_that_stops_the_network() -> None:
    manager = booted(NetworkList([BootSlave(5, mandatory=True, heartbeat=0.2), BootSlave(6)], stop_all=True))
    assert fed(manager, "706#00", 0.6)[1:] == ["000#0200", "network: stopped"]
    assert (manager.deadline, manager.busy) == (None, False)


@pytest.mark.parametrize("step", [1, 2])
def test_an_error_of_progress_ends_the_process_of_the_node(step: int) -> None:
    steps = []

    def progress(node: int, text: str) -> None:
        steps.append(text)
        if len(steps) == step:
            raise ZeroDivisionError

    manager = BootManager(NetworkList([BootSlave(5, mandatory=True, vendor=1)]), progress=progress)
    fed(manager, None, 0.0)
    if step == 2:
        fed(manager, "705#00", 0.1)
    with pytest.raises(ZeroDivisionError):
        fed(manager, "705#00" if step == 1 else DEVICE_TYPE, 0.1)
    assert (manager.deadline, manager.busy) == (None, False)
    assert fed(manager, "705#00", 0.2) == ["605#4000100000000000"]  # its boot-up message starts it again
