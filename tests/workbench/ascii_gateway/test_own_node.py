"""A gateway that is itself a node of the net: its lines about that node, in virtual time."""

from __future__ import annotations

import pytest

from barewire.canopen import CanFrame, Entry, LocalNode, LssAddress, ObjectDictionary, PdoConfig, standard_objects
from barewire.conversation import play
from barewire_workbench.ascii_gateway.own_node import GatewayNode, gateway_node
from barewire_workbench.ascii_gateway.session import GatewaySession


def numbered(node: int = 1) -> tuple[GatewaySession, GatewayNode]:
    own = gateway_node(node)
    assert [str(frame) for frame in own.device.start(0.0)] == [f"7{node:02X}#00"]
    return GatewaySession(own=own), own


def ask(session: GatewaySession, line: str, now: float = 1.0) -> tuple[str, list[str]]:
    """Return the answer to a line that concerns the gateway's own node, and the frames that the node sends."""
    assert session.target(line) == "own"
    assert session.own is not None
    (answer,), frames = session.own.carry_out(session.answer(line), now)
    return answer, [str(frame) for frame in frames]


def test_its_own_objects_are_read_and_written_without_a_frame_on_the_bus() -> None:
    session, own = numbered()
    assert ask(session, "[1] 1 r 0x1017 0 u16") == ("[1] 0", [])
    assert ask(session, "[2] 1 r 0x1008 0 vs") == ('[2] "barewire gateway"', [])
    assert ask(session, "[3] 1 w 0x1017 0 u16 160") == ("[3] OK", ["701#7F"])
    assert own.device.deadline == pytest.approx(1.16)
    assert ask(session, "[4] 1 r 0x6999 0")[0].startswith("[4] ERROR:0x06020000 #")


def test_long_values_and_block_transfers_reach_its_own_objects() -> None:
    objects = ObjectDictionary(
        [*standard_objects(LssAddress(0, 0, 0, 0)), Entry(0x2000, 0, "text", "string", "rw", "")]
    )
    session = GatewaySession(own=GatewayNode(device := LocalNode(7, objects)))
    device.start(0.0)
    for number, block in enumerate((0, 1)):
        text = f"{number} " + "a long text" * 90
        assert play(session.answer(f"[1] set sdo_block {block}"), lambda frame, at: [])[0] == ["[1] OK"]
        assert ask(session, f'[2] 7 w 0x2000 0 vs "{text}"') == ("[2] OK", [])
        assert ask(session, "[3] 7 r 0x2000 0 vs") == (f'[3] "{text}"', [])


def test_a_stopped_gateway_node_does_not_answer() -> None:
    session, own = numbered()
    own.device.feed(CanFrame.parse("000#0201"), 0.5)
    assert ask(session, "[1] 1 r 0x1017 0 u16")[0].startswith("[1] ERROR:0x05040000 #")


def test_pdos_that_a_write_triggers_go_to_the_bus() -> None:
    objects = ObjectDictionary([*standard_objects(LssAddress(0, 0, 0, 0)), Entry(0x2000, 0, "speed", "u16", "rw", 0)])
    device = LocalNode(1, objects, [PdoConfig("TPDO", 1, (0x20000010,), type=255)])
    session = GatewaySession(own=GatewayNode(device))
    device.start(0.0)
    device.feed(CanFrame.parse("000#0101"), 0.1)
    device.feed(None, 0.2)
    assert ask(session, "[1] 1 w 0x2000 0 u16 0x1234") == ("[1] OK", ["181#3412"])


def test_its_heartbeat_is_set_by_a_command() -> None:
    session, own = numbered()
    assert ask(session, "[1] set heartbeat 500")[0] == "[1] OK"
    assert own.device.objects.get(0x1017) == 500
    assert own.device.deadline is not None
    assert own.device.deadline <= 1.5


def test_a_node_without_1017h_has_no_heartbeat() -> None:
    device = LocalNode(1, ObjectDictionary([Entry(0x1000, 0, "device type", "u32", "ro", 0)]))
    session = GatewaySession(own=GatewayNode(device))
    device.start(0.0)
    answer, frames = ask(session, "[1] set heartbeat 500")
    assert answer.startswith("[1] ERROR:0x06020000 #1017h")
    assert frames == []


def test_a_new_node_id_is_valid_after_init_or_a_reset_of_communication() -> None:
    session, own = numbered()
    assert ask(session, "[1] set id 9") == ("[1] OK", [])
    assert own.device.node == 1
    assert ask(session, "[2] init 9") == ("[2] OK", ["709#00"])
    assert ask(session, "[3] 9 r 0x1000 0 u32") == ("[3] 0", [])
    assert session.target("[4] 1 r 0x1000 0") != "own"
    assert ask(session, "[5] set id 10") == ("[5] OK", [])
    assert [str(frame) for frame in own.device.feed(CanFrame.parse("000#8209"), 2.0)] == ["70A#00"]


def test_init_does_not_change_the_bit_rate() -> None:
    session, _ = numbered()
    answer, frames = ask(session, "[1] init 4")
    assert answer.startswith("[1] ERROR:100 #")
    assert "init 9" in answer
    assert frames == []
    (refusal,) = play(session.answer("[2] set id 0"), lambda frame, at: [])[0]
    assert refusal.startswith("[2] ERROR:101 #")


def test_the_net_is_checked_for_its_own_node_too() -> None:
    session, _ = numbered()
    assert ask(session, "[1] 2 1 r 0x1000 0")[0].startswith("[1] ERROR:106 #")
    assert session.target("[2] 1 1 r 0x1000 0") == "own"


def test_a_gateway_node_has_a_repr() -> None:
    assert repr(numbered(3)[1]) == "<GatewayNode 3: pre-operational>"
