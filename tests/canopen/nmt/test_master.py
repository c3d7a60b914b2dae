"""NMT commands and their confirmation by a local node, and waiting for a state, in virtual time."""

from __future__ import annotations

import pytest

from barewire.canopen import (
    CanFrame,
    LocalNode,
    NmtCommand,
    NmtState,
    NodeState,
    ObjectDictionary,
    request_state,
    send_nmt,
    standard_objects,
    wait_for_boot_up,
    wait_for_heartbeat,
    wait_for_state,
)
from barewire.conversation import Conversation, Heard, Listen, play
from barewire.errors import NoAnswer
from tests.canopen.virtual_bus import VirtualBus


def bus_with(*nodes: int, heartbeat: int = 100) -> VirtualBus:
    bus = VirtualBus()
    for node in nodes:
        device = LocalNode(node, ObjectDictionary(standard_objects(heartbeat=heartbeat)))
        bus.add(device, sent=device.start(0.0))
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
    (confirmed,) = bus_with(5).run(send_nmt(command, 5))
    assert (confirmed.node, confirmed.state) == (5, state)
    assert confirmed.after < 0.11


HINT = "without heartbeat it does not report by itself: with ask_every=0.1 its state is requested by node guarding"


@pytest.mark.parametrize(
    ("command", "ask_every", "hint"),
    [
        (NmtCommand.START, None, f": {HINT}, or write its heartbeat time in ms to 1017h"),
        (NmtCommand.START, 0.2, ": it did not answer node guarding either"),
        (NmtCommand.RESET_NODE, None, ": a reset is confirmed by the boot-up message only"),
        (NmtCommand.RESET_NODE, 0.2, ": a reset is confirmed by the boot-up message only"),
    ],
)
def test_an_unconfirmed_command_says_what_to_do(command: NmtCommand, ask_every: float | None, hint: str) -> None:
    with pytest.raises(NoAnswer) as caught:
        VirtualBus().run(send_nmt(command, 5, timeout=0.5, ask_every=ask_every))
    assert str(caught.value).endswith(f": node 5: it did not report its state (0 frames came){hint}")


def test_a_node_that_reports_another_state_gets_no_advice() -> None:
    with pytest.raises(NoAnswer) as caught:
        bus_with(5, heartbeat=10).run(send_nmt(NmtCommand.START, 6, confirmed_by=[5], timeout=0.1))
    assert str(caught.value).endswith("frames came)")


def test_a_node_without_heartbeat_is_polled() -> None:
    bus = bus_with(5, heartbeat=0)
    with pytest.raises(NoAnswer, match="start was not confirmed within 1 s: node 5: it did not report its state"):
        bus.run(send_nmt(NmtCommand.START, 5, timeout=1.0))
    assert bus.run(send_nmt(NmtCommand.STOP, 5, ask_every=0.05))[0].after < 0.06
    assert bus.run(request_state(5)).name == "stopped"
    with pytest.raises(NoAnswer, match="node 6 did not report its state"):
        bus.run(request_state(6))


def test_a_command_to_all_nodes_is_confirmed_by_each() -> None:
    bus = bus_with(5, 6, 7)
    assert bus.run(send_nmt(NmtCommand.START)) == []  # returns without waiting
    confirmed = bus.run(send_nmt(NmtCommand.STOP, 0, confirmed_by=[5, 6, 7]))
    assert sorted(confirmation.node for confirmation in confirmed) == [5, 6, 7]


def test_the_last_state_of_a_node_that_does_not_confirm_is_in_the_error() -> None:
    bus = VirtualBus()
    for tick in range(30):
        bus.inject("705#04", tick / 10)
    with pytest.raises(NoAnswer, match=r"it last reported stopped, 1\.\d+ s after the command"):
        bus.run(send_nmt(NmtCommand.START, 5))


def listening(conversation: Conversation[CanFrame, NodeState], *lines: tuple[float, str]) -> NodeState:
    """Run a conversation that only listens, with frames that arrive at given times."""
    coming = [(time, CanFrame.parse(text)) for time, text in lines]
    now = 0.0
    step = next(conversation)
    try:
        while True:
            assert isinstance(step, Listen)
            if coming and coming[0][0] <= max(step.until, now):
                at, frame = coming.pop(0)
                now = max(now, at)
                step = conversation.send(Heard(frame, now))
            else:
                now = max(now, step.until)
                step = conversation.send(Heard(None, now))
    except StopIteration as stop:
        result: NodeState = stop.value
        return result


def test_waiting_for_boot_up_heartbeat_and_state() -> None:
    beats = (0.1, "706#00"), (0.2, "705#00"), (0.3, "705#7F"), (0.4, "185#00"), (0.5, "705#05")
    assert listening(wait_for_boot_up(5), *beats).node == 5
    assert listening(wait_for_boot_up(), *beats).node == 6
    assert listening(wait_for_heartbeat(5), *beats).state == NmtState.PRE_OPERATIONAL
    assert listening(wait_for_state(5, [NmtState.OPERATIONAL]), *beats).state == 5
    with pytest.raises(NoAnswer, match=r"from node 5 within 0\.35 s: last reported was pre-operational"):
        listening(wait_for_state(5, [NmtState.OPERATIONAL], timeout=0.35), *beats)
    with pytest.raises(NoAnswer, match="no boot-up message from any node within 1 s"):
        listening(wait_for_boot_up(timeout=1.0))


def test_a_heartbeat_of_one_second_is_the_state_by_default_and_a_slower_one_is_explained() -> None:
    beats = lambda frame, now: [(now + 1.0, CanFrame.parse("705#7F"))]  # noqa: E731
    assert play(request_state(5), beats)[0].name == "pre-operational"
    with pytest.raises(NoAnswer, match=r"within 2 s; .*heartbeats \(1017h\) reports it with the next one"):
        play(request_state(5), lambda frame, now: [])
