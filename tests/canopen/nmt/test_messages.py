"""NMT: five commands, four states, and the services of each state."""

from __future__ import annotations

import pytest

from barewire.canopen import CanFrame, NmtCommand, NmtMessage, NmtSlave, NmtState
from barewire.errors import DecodeError, EncodeError, Reason
from tests.helpers import every_case


# The table of the AZ3's guide, 4.2.1: "00 02 01 ID" is COB-ID 000h, length 2, command, node.
@pytest.mark.parametrize(
    ("command", "text"),
    [
        (NmtCommand.START, "000#010F"),
        (NmtCommand.STOP, "000#020F"),
        (NmtCommand.ENTER_PRE_OPERATIONAL, "000#800F"),
        (NmtCommand.RESET_NODE, "000#810F"),
        (NmtCommand.RESET_COMMUNICATION, "000#820F"),
    ],
)
def test_encode_and_decode_commands(command: NmtCommand, text: str) -> None:
    assert str(NmtMessage(command, 15).encode()) == text
    assert NmtMessage.decode(CanFrame.parse(text)) == NmtMessage(command, 15)
    broadcast = text[:-2] + "00"
    assert str(NmtMessage(command).encode()) == broadcast
    assert NmtMessage.decode(CanFrame.parse(broadcast)).node == 0


@pytest.mark.parametrize(
    ("text", "reason", "at"),
    [
        ("001#0105", "mismatch", 0),
        ("00000000#0105", "mismatch", 0),
        ("000#R2", "mismatch", 0),
        ("000#01", "short", 1),
        ("000#010500", "long", 2),
        ("000#0305", "function", 0),
        ("000#0180", "value", 1),
    ],
)
def test_invalid_commands_raise(text: str, reason: Reason, at: int) -> None:
    with pytest.raises(DecodeError) as caught:
        NmtMessage.decode(CanFrame.parse(text))
    assert (caught.value.reason, caught.value.at) == (reason, at)


def test_a_command_to_an_invalid_node_raises() -> None:
    with pytest.raises(EncodeError, match="node 128"):
        NmtMessage(NmtCommand.START, 128).encode()


def slave_in(state: NmtState) -> NmtSlave:
    slave = NmtSlave(5)
    slave.state = state
    return slave


RUNNING = [NmtState.PRE_OPERATIONAL, NmtState.OPERATIONAL, NmtState.STOPPED]


@every_case("before", RUNNING)
@every_case(
    ("command", "after"),
    [
        (NmtCommand.START, NmtState.OPERATIONAL),
        (NmtCommand.STOP, NmtState.STOPPED),
        (NmtCommand.ENTER_PRE_OPERATIONAL, NmtState.PRE_OPERATIONAL),
        (NmtCommand.RESET_NODE, NmtState.INITIALISING),
        (NmtCommand.RESET_COMMUNICATION, NmtState.INITIALISING),
    ],
)
@every_case("node", [0, 5])
def test_every_transition(before: NmtState, command: NmtCommand, after: NmtState, node: int) -> None:
    slave = slave_in(before)
    assert slave.feed(NmtMessage(command, node).encode(), 1.0) == [(command, before, after)]
    assert slave.state is after


def test_frames_that_do_not_change_the_state() -> None:
    slave = slave_in(NmtState.PRE_OPERATIONAL)
    for text in ("000#0106", "000#0305", "000#01", "00000000#0105", "000#R2", "705#05"):
        assert slave.feed(CanFrame.parse(text), 0.0) == []
    assert slave.feed(None, 9.0) == []
    assert slave.state is NmtState.PRE_OPERATIONAL
    assert slave.deadline is None


def test_initialising_ignores_commands_and_ends_once() -> None:
    slave = NmtSlave(5)
    assert slave.feed(CanFrame.parse("000#0105"), 0.0) == []
    slave.booted()
    assert slave.state is NmtState.PRE_OPERATIONAL
    with pytest.raises(EncodeError):
        slave.booted()


@pytest.mark.parametrize(
    ("state", "sdo", "pdo", "emcy", "error_control"),
    [
        (NmtState.INITIALISING, False, False, False, False),
        (NmtState.PRE_OPERATIONAL, True, False, True, True),
        (NmtState.OPERATIONAL, True, True, True, True),
        (NmtState.STOPPED, False, False, False, True),
    ],
)
def test_services_by_state(state: NmtState, sdo: bool, pdo: bool, emcy: bool, error_control: bool) -> None:
    slave = slave_in(state)
    assert slave.may("SDO request") is sdo
    assert slave.may("TPDO1") is pdo
    assert slave.may("EMCY") is emcy
    assert slave.may("error control") is error_control
