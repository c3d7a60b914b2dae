"""The LSS services: master and local node on one bus, in virtual time."""

from __future__ import annotations

import pytest

from barewire.canopen import (
    CanFrame,
    Fastscan,
    LocalNode,
    LssAddress,
    LssMessage,
    LssRefused,
    LssService,
    LssSlave,
    LssState,
    NmtCommand,
    NmtState,
    ObjectDictionary,
    activate_bit_timing,
    configure_bit_timing,
    configure_node,
    identify_slaves,
    identify_unconfigured,
    inquire_address,
    inquire_node,
    send_nmt,
    standard_objects,
    store_configuration,
    switch_global,
    switch_selective,
)
from barewire.canopen.lss.messages import ANSWER_KEY, REQUEST_KEY
from barewire.errors import DecodeError, EncodeError, NoAnswer
from tests.canopen.virtual_bus import VirtualBus

ADDRESS = LssAddress(0x360, 0x00010203, 0x00020001, 0xDEADBEEF)
OTHER = LssAddress(0x360, 0x00010203, 0x00020001, 0x00000001)


def device(
    node: int | None, address: LssAddress = ADDRESS, *, stored: list[tuple[int | None, int | None]]
) -> LocalNode:
    def store(number: int | None, rate: int | None) -> bool:
        stored.append((number, rate))
        return True

    return LocalNode(node, ObjectDictionary(standard_objects(address)), lss=LssSlave(address, store=store))


@pytest.fixture
def stored() -> list[tuple[int | None, int | None]]:
    return []


def with_device(node: int | None, stored: list[tuple[int | None, int | None]]) -> tuple[VirtualBus, LocalNode]:
    bus, one = VirtualBus(), device(node, stored=stored)
    bus.add(one, sent=one.start(0.0))
    return bus, one


def test_the_identifiers_of_both_directions() -> None:
    assert (REQUEST_KEY, ANSWER_KEY) == ((0x7E5, False), (0x7E4, False))
    assert LssMessage(LssService.SELECTED, answer=True).encode().id == 0x7E4


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("7E5#11", "short"),
        ("7E5#4400000000000000", "function"),  # an answer in the direction of the master
        ("7E4#0400000000000000", "function"),
        ("000007E5#0400000000000000", "mismatch"),
        ("7E5#R8", "mismatch"),
        ("605#0400000000000000", "mismatch"),
    ],
)
def test_frames_that_are_not_lss_messages(text: str, reason: str) -> None:
    with pytest.raises(DecodeError) as caught:
        LssMessage.decode(CanFrame.parse(text))
    assert caught.value.reason == reason


def test_messages_that_cannot_be_encoded() -> None:
    with pytest.raises(EncodeError):
        LssMessage(LssService.STORE, bytes(8)).encode()
    for wrong in (Fastscan(0, 32, 0, 0), Fastscan(0, 0, 4, 0), Fastscan(1 << 32, 0, 0, 0)):
        with pytest.raises(EncodeError):
            wrong.encode()


def test_a_device_without_a_node_id_is_silent_until_lss_gives_it_one(
    stored: list[tuple[int | None, int | None]],
) -> None:
    bus, node = with_device(None, stored)
    others = ["000#0100", "67F#4000100000000000", "080#", "77F#R1"]
    for text in others:
        bus.inject(text, bus.now)
    assert bus.pass_time(10.0) == others
    assert node.deadline is None
    assert bus.run(identify_unconfigured()) == 1
    assert bus.run(switch_selective(ADDRESS)) is True
    assert bus.run(inquire_node()) is None
    bus.run(configure_node(5))
    bus.run(store_configuration())
    assert stored == [(5, None)]
    assert node.deadline is None  # still in configuration
    bus.run(switch_global(LssState.WAITING))
    assert bus.pass_time(0.1) == ["705#00"]
    assert (node.node, node.state) == (5, NmtState.PRE_OPERATIONAL)
    bus.inject("605#4000100000000000", bus.now)
    assert "585#4300100000000000" in bus.pass_time(0.1)
    assert bus.run(identify_unconfigured()) == 0


def test_a_configured_device_activates_its_new_node_id_at_the_next_reset(
    stored: list[tuple[int | None, int | None]],
) -> None:
    bus, node = with_device(5, stored)
    assert bus.pass_time(0.1) == ["705#00"]
    assert node.objects.get(0x1014) == 0x85
    assert bus.run(switch_selective(ADDRESS))
    bus.run(configure_node(6))
    bus.run(switch_global(LssState.WAITING))
    assert bus.pass_time(0.1) == []
    assert node.node == 5
    confirmed = bus.run(send_nmt(NmtCommand.RESET_COMMUNICATION, 5, confirmed_by=[6]))
    assert [(node.node, node.state) for node in confirmed] == [(6, 0)]
    assert node.objects.get(0x1014) == 0x86
    bus.run(switch_global(LssState.CONFIGURATION))
    bus.run(configure_node(None))
    bus.run(send_nmt(NmtCommand.RESET_NODE, 6, confirmed_by=[]))
    assert bus.pass_time(1.0) == []
    assert node.node is None


def test_switch_selective_finds_one_of_two_devices(stored: list[tuple[int | None, int | None]]) -> None:
    bus, node = with_device(5, stored)
    two = device(6, OTHER, stored=stored)
    bus.add(two, sent=two.start(0.0))
    assert bus.run(switch_selective(OTHER)) is True
    assert bus.run(inquire_address()) == OTHER
    assert bus.run(inquire_node()) == 6
    bus.run(switch_global(LssState.WAITING))
    assert bus.run(switch_selective(LssAddress(1, 2, 3, 4))) is False
    with pytest.raises(NoAnswer, match="no device in the LSS state configuration"):
        bus.run(inquire_node())
    assert node.lss is not None
    assert node.lss.state is LssState.WAITING


def test_parts_of_an_address_are_accepted_in_order_only() -> None:
    slave = LssSlave(ADDRESS, 5)
    parts = [LssMessage(0x40 + part, number.to_bytes(4, "little")).encode() for part, number in enumerate(ADDRESS)]
    for order in ((0, 1, 3), (1, 2, 3), (0, 2, 1, 3), (0, 1, 2, 0, 3)):
        assert [slave.feed(parts[part], 0.0) for part in order] == [[]] * len(order), order
    assert [len(slave.feed(parts[part], 0.0)) for part in (0, 0, 1, 2, 3)] == [0, 0, 0, 0, 1]


def test_identify_within_limits(stored: list[tuple[int | None, int | None]]) -> None:
    bus, _ = with_device(5, stored)
    two = device(6, OTHER, stored=stored)
    bus.add(two, latency=0.004, sent=two.start(0.0))
    assert bus.run(identify_slaves(0x360, 0x10203)) == 2
    assert bus.run(identify_slaves(0x360, 0x10203, serials=(2, 0xFFFFFFFF))) == 1
    assert bus.run(identify_slaves(0x360, 0x10203, revisions=(0, 0x20000))) == 0
    assert bus.run(identify_slaves(0x361, 0x10203)) == 0


def test_refused_services_raise() -> None:
    bus = VirtualBus()
    node = LocalNode(5, ObjectDictionary(), lss=LssSlave(ADDRESS, rates=frozenset({4})))
    bus.add(node, sent=node.start(0.0))
    bus.run(switch_global(LssState.CONFIGURATION))
    with pytest.raises(LssRefused, match="store: not supported"):
        bus.run(store_configuration())
    with pytest.raises(LssRefused, match="configure bit timing: out of range"):
        bus.run(configure_bit_timing(3))
    with pytest.raises(LssRefused):
        bus.run(configure_bit_timing(4, table=1))
    with pytest.raises(EncodeError):
        bus.run(configure_node(0))
    bus.inject("7E5#11C8000000000000", bus.now)
    assert bus.pass_time(0.1)[-1] == "7E4#1101000000000000"


def test_a_failed_store_is_answered_with_code_2() -> None:
    slave = LssSlave(ADDRESS, 5, store=lambda node, rate: False)
    slave.state = LssState.CONFIGURATION
    assert str(slave.feed(LssMessage(LssService.STORE).encode(), 0.0)[0]) == "7E4#1702000000000000"


def test_the_device_is_silent_while_the_bit_rate_changes() -> None:
    changes: list[tuple[int | None, float]] = []
    slave = LssSlave(ADDRESS, on_bit_timing=lambda entry, delay: changes.append((entry, delay)))
    bus, node = VirtualBus(), LocalNode(5, ObjectDictionary(standard_objects(ADDRESS, heartbeat=100)), lss=slave)
    bus.add(node, sent=node.start(0.0))
    bus.run(switch_global(LssState.CONFIGURATION))
    bus.run(configure_bit_timing(4))
    start = bus.now
    again = bus.run(activate_bit_timing(0.5))
    assert again == pytest.approx(start + 1.0)
    bus.pass_time(0.001)
    assert changes == [(4, 0.5)]
    assert bus.pass_time(again - bus.now - 0.01) == []
    assert bus.pass_time(0.1)[0] == "705#7F"
    with pytest.raises(EncodeError):
        bus.run(activate_bit_timing(70.0))
