"""Commands and their proof, against our own device, in virtual time."""

from __future__ import annotations

import pytest

from barewire.canopen import (
    LocalNode,
    NmtCommand,
    NmtState,
    ObjectDictionary,
    request_state,
    send_nmt,
    standard_objects,
)
from barewire.errors import NoAnswer
from tests.canopen.virtual_bus import VirtualBus


def bus_with(*nodes: int, heartbeat: int = 100) -> VirtualBus:
    bus = VirtualBus()
    for node in nodes:
        device = LocalNode(node, ObjectDictionary(standard_objects(heartbeat=heartbeat)))
        bus.add(device, said=device.start(0.0))
    bus.pass_time(0.01)
    return bus


@pytest.mark.parametrize(
    ("command", "state"),
    [
        (NmtCommand.START, NmtState.OPERATIONAL),
        (NmtCommand.STOP, NmtState.STOPPED),
        (NmtCommand.ENTER_PRE_OPERATIONAL, NmtState.PRE_OPERATIONAL),
        (NmtCommand.RESET_NODE, NmtState.INITIALISING),
        (NmtCommand.RESET_COMMUNICATION, NmtState.INITIALISING),
    ],
)
def test_every_command_is_confirmed(command: NmtCommand, state: NmtState) -> None:
    (obeyed,) = bus_with(5).run(send_nmt(command, 5))
    assert (obeyed.node, obeyed.state) == (5, state)
    assert obeyed.after < 0.11


def test_a_node_without_heartbeat_is_asked() -> None:
    bus = bus_with(5, heartbeat=0)
    with pytest.raises(NoAnswer, match="start was not confirmed within 1 s: node 5: it said nothing of its state"):
        bus.run(send_nmt(NmtCommand.START, 5, timeout=1.0))
    assert bus.run(send_nmt(NmtCommand.STOP, 5, ask_every=0.05))[0].after < 0.06
    assert bus.run(request_state(5)).name == "stopped"
    with pytest.raises(NoAnswer, match="node 6 did not tell its state"):
        bus.run(request_state(6))


def test_all_of_them() -> None:
    bus = bus_with(5, 6, 7)
    assert bus.run(send_nmt(NmtCommand.START)) == []  # nobody is waited for
    obeyed = bus.run(send_nmt(NmtCommand.STOP, 0, confirmed_by=[5, 6, 7]))
    assert sorted(told.node for told in obeyed) == [5, 6, 7]


def test_the_last_word_of_a_node_that_does_not_obey_is_told() -> None:
    bus = VirtualBus()
    for tick in range(30):
        bus.inject("705#04", tick / 10)
    with pytest.raises(NoAnswer, match=r"its last word was stopped, 1\.\d+ s after the command"):
        bus.run(send_nmt(NmtCommand.START, 5))
