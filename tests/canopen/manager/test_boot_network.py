"""The boot-up of a network by its manager, and its error control, with many nodes in virtual time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from barewire.canopen import (
    BootError,
    BootEvent,
    BootManager,
    BootSlave,
    CanFrame,
    ConciseValue,
    Entry,
    LocalNode,
    NetworkList,
    NmtState,
    boot_network,
    check_network,
    device_configuration,
    pdos_of,
    slave_of,
)
from barewire.errors import EncodeError
from tests.canopen.configuration.plant import bus_with, dcf, described, writes
from tests.canopen.virtual_bus import VirtualBus, never


class Network:
    """Nodes with a heartbeat of 50 ms on a virtual bus, and a manager whose events are kept as text."""

    def __init__(self, *nodes: int, lose: Callable[[int, CanFrame], bool] = never) -> None:
        self.bus = VirtualBus(lose=lose)
        self.nodes = {number: node(number) for number in nodes}
        self.off: set[int] = set()
        for number, device in self.nodes.items():
            self.bus.add(Switched(device, number, self.off), sent=device.start(0.0))
        self.bus.pass_time(0.01)
        self.bus.log.clear()
        self.events: list[str] = []

    def boot(self, network: NetworkList, **options: Any) -> list[str]:
        """Boot the network and return the events."""
        self.result = self.bus.run(boot_network(network, on_event=self.tell, timeout=0.1, **options))
        return self.events

    def tell(self, event: BootEvent) -> None:
        self.events.append(f"{event.node} {event.kind}")

    def run(self, network: NetworkList, seconds: float) -> list[str]:
        """Let a manager run on the bus, and return its new events."""
        if not hasattr(self, "manager"):
            self.manager = BootManager(network, timeout=0.1)
            self.bus.add(Adapter(self.manager, self.tell))
        before = len(self.events)
        self.bus.pass_time(seconds)
        return self.events[before:]

    def sent(self, text: str) -> int:
        return sum(frame.startswith(text) for _, frame in self.bus.log)


class Switched:
    """A device that neither receives nor sends while its node-ID is in `off`."""

    def __init__(self, device: LocalNode, number: int, off: set[int]) -> None:
        self.device, self.number, self.off = device, number, off

    @property
    def deadline(self) -> float | None:
        return None if self.number in self.off else self.device.deadline

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        return [] if self.number in self.off else self.device.feed(frame, now)


class Adapter:
    """A manager as a participant of a bus."""

    def __init__(self, manager: BootManager, tell: Callable[[BootEvent], None]) -> None:
        self.manager, self.tell = manager, tell

    @property
    def deadline(self) -> float | None:
        return self.manager.deadline

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        frames = []
        for item in self.manager.feed(frame, now):
            if isinstance(item, CanFrame):
                frames.append(item)
            else:
                self.tell(item)
        return frames


def node(number: int) -> LocalNode:
    objects = described().dictionary(number)
    objects.set(0x1017, 0, 50)
    device = LocalNode(number, objects, pdos_of(objects, number))
    device.stored.values[0x1017, 0] = 50
    return device


def mandatory(number: int, **values: Any) -> BootSlave:
    return BootSlave(number, mandatory=True, heartbeat=0.2, vendor=0x360, **values)


def test_all_nodes_boot_in_parallel_and_are_started_one_by_one() -> None:
    network = Network(*range(5, 15))
    events = network.boot(NetworkList([mandatory(number) for number in range(5, 15)]))
    assert [text for text in events if "ready" in text] == ["0 ready"]
    assert sorted(text for text in events if "booted" in text) == sorted(f"{n} booted" for n in range(5, 15))
    network.bus.pass_time(0.01)
    assert {device.state for device in network.nodes.values()} == {NmtState.OPERATIONAL}
    assert (network.sent("000#8200"), network.sent("000#01"), network.result.ready) == (1, 10, True)
    assert network.bus.now < 0.2  # in parallel: one of them takes 0.06 s, most of it for its heartbeat


def test_all_nodes_are_started_by_one_command() -> None:
    network = Network(5, 6)
    events = network.boot(NetworkList([mandatory(5), mandatory(6)], start_all=True))
    assert events[-2:] == ["0 ready", "0 started"]
    assert (network.sent("000#0100"), network.sent("000#01")) == (1, 1)


def test_with_start_all_a_node_that_failed_is_not_started() -> None:
    network = Network(5, 6)
    events = network.boot(NetworkList([mandatory(5), BootSlave(6, vendor=1)], start_all=True))
    network.bus.pass_time(0.01)
    assert "6 failed" in events
    assert (network.sent("000#0105"), network.sent("000#01")) == (1, 1)
    assert network.nodes[6].state is NmtState.PRE_OPERATIONAL


def test_the_application_starts_the_slaves() -> None:
    network = Network(5)
    assert network.boot(NetworkList([mandatory(5)], start_slaves=False)) == ["5 booted", "0 ready"]
    assert network.sent("000#01") == 0


def test_a_mandatory_node_that_appears_in_time() -> None:
    network = Network(5, 6)
    network.off.add(6)
    plan = NetworkList([mandatory(5), mandatory(6)], boot_time=10)
    assert network.run(plan, 3.0) == ["5 booted", "5 started", "6 waiting"]
    network.off.clear()
    assert network.run(plan, 2.0) == ["6 booted", "6 started", "0 ready"]


def test_a_mandatory_node_that_does_not_appear() -> None:
    network = Network(5)
    events = network.boot(NetworkList([mandatory(5), mandatory(6)], boot_time=3))
    assert events == ["5 booted", "5 started", "6 waiting", "6 missing"]
    assert not network.result.ready
    assert [(node.node, node.error) for node in network.result.results] == [(5, None), (6, BootError.B)]
    assert str(network.result).endswith("\nthe network is not ready")
    assert 3.0 <= network.bus.now < 3.6


def test_a_mandatory_node_of_another_type() -> None:
    network = Network(5, 6)
    events = network.boot(NetworkList([mandatory(5, product=8), mandatory(6)]))
    assert sorted(events) == ["5 failed", "6 booted", "6 started"]
    assert not network.result.ready
    assert "5: M: another product code (1018h:02) than expected (1F86h)" in str(network.result)


def test_an_optional_node_boots_when_it_appears() -> None:
    network = Network(5, 6)
    network.off.add(6)
    plan = NetworkList([mandatory(5), BootSlave(6)])
    assert network.run(plan, 3.0) == ["5 booted", "5 started", "0 ready"]
    network.off.clear()
    network.bus.inject("000#8106", network.bus.now)
    assert network.run(plan, 1.0) == ["6 booted", "6 started"]
    assert network.nodes[6].state is NmtState.OPERATIONAL


def test_nodes_that_are_kept_alive_are_not_reset() -> None:
    network = Network(5)
    network.bus.inject("000#0105", network.bus.now)
    network.bus.pass_time(0.1)
    network.bus.log.clear()
    events = network.boot(NetworkList([mandatory(5, keep_alive=True)], node=1))
    assert events == ["5 booted", "0 ready"]
    assert network.result.results[0].error is BootError.L
    assert (network.sent("000#8205"), network.sent("000#8201"), network.sent("000#82")) == (0, 0, 125)
    assert network.nodes[5].state is NmtState.OPERATIONAL


@pytest.mark.parametrize(
    ("plan", "events", "frame"),
    [
        (NetworkList([mandatory(5), mandatory(6)]), ["5 lost", "5 reset", "5 waiting"], "000#8105"),
        (NetworkList([mandatory(5), mandatory(6)], stop_all=True), ["5 lost", "0 stopped"], "000#0200"),
        (
            NetworkList([mandatory(5), mandatory(6)], reset_all=True),
            ["5 lost", "0 reset", "6 booted", "6 started", "5 waiting"],
            "000#8100",
        ),
        (NetworkList([BootSlave(5, heartbeat=0.2), mandatory(6)], stop_all=True), ["5 lost", "5 reset"], "000#8105"),
    ],
)
def test_a_node_that_is_lost(plan: NetworkList, events: list[str], frame: str) -> None:
    network = Network(5, 6)
    network.run(plan, 1.0)
    network.off.add(5)
    assert network.run(plan, 5.0) == events
    assert network.sent(frame) == 1
    stopped = NmtState.STOPPED if plan.stop_all and len(events) == 2 and events[1] == "0 stopped" else None
    assert network.nodes[6].state is (stopped or NmtState.OPERATIONAL)
    network.off.clear()
    network.bus.inject("000#8105", network.bus.now)
    assert ("5 started" in network.run(plan, 3.0)) is (stopped is None)


def test_a_node_that_reboots_is_booted_and_started_again() -> None:
    network = Network(5)
    plan = NetworkList([mandatory(5)])
    assert network.run(plan, 1.0) == ["5 booted", "5 started", "0 ready"]
    network.bus.inject("000#8105", network.bus.now)
    assert network.run(plan, 1.0) == ["5 rebooted", "5 booted", "5 started"]


def test_a_guarded_node_that_is_lost() -> None:
    network = Network(5)
    network.nodes[5].objects.set(0x1017, 0, 0)
    network.nodes[5].stored.values.clear()
    plan = NetworkList([BootSlave(5, mandatory=True, guard_time=0.1, retry_factor=3)])
    assert network.run(plan, 1.0) == ["5 booted", "5 started", "0 ready"]
    network.off.add(5)
    assert network.run(plan, 1.0) == ["5 lost", "5 reset"]


def test_a_plant_of_10_nodes_is_booted_and_configured_from_dcfs() -> None:
    network = Network(*range(1, 11))
    plan = [
        slave_of(device_configuration(dcf({"Heartbeat": 100, (0x1800, 2): 1}, number)), mandatory=True, heartbeat=1.0)
        for number in range(1, 11)
    ]
    network.boot(NetworkList(plan, start_all=True))
    assert network.result.ready
    assert all(node.configured for node in network.result.results)
    network.bus.pass_time(0.01)
    assert {device.state for device in network.nodes.values()} == {NmtState.OPERATIONAL}
    assert {device.objects["Heartbeat"] for device in network.nodes.values()} == {100}


def test_an_event_is_a_sentence() -> None:
    network = Network(5)
    texts: list[str] = []
    network.bus.run(
        boot_network(NetworkList([mandatory(5, product=9)]), on_event=lambda event: texts.append(str(event)))
    )
    assert texts == [
        "node 5: M: another product code (1018h:02) than expected (1F86h): read 00000007h, expected 00000009h"
    ]


def test_a_node_is_once_in_the_list() -> None:
    with pytest.raises(EncodeError, match="node 5 is in the network list twice, or is the manager itself"):
        NetworkList([BootSlave(5), BootSlave(5)])
    with pytest.raises(EncodeError, match="node 5"):
        NetworkList([BootSlave(5)], node=5)
    with pytest.raises(EncodeError, match="boot time -1"):
        NetworkList([], boot_time=-1)


# The dry run: it reads, and sends neither an NMT command nor a write


def test_what_would_be_written_is_planned_and_nothing_is_sent_but_reads() -> None:
    bus, device = bus_with()
    slave = slave_of(device_configuration(dcf({(0x1017, 0): 500})), mandatory=True, heartbeat=1.0)
    result = bus.run(check_network(NetworkList([slave, BootSlave(6)]), timeout=0.1))
    assert result.ready  # the optional node is missing
    assert str(result.results[0]).startswith("node 5: 1017h:00 Heartbeat: device 0, configuration 500; 1020h:01 ")
    assert (result.results[0].ok, result.results[1].error and result.results[1].error.name) == (True, "B")
    assert writes(bus) == []
    assert {text[:3] for _, text in bus.log} == {"605", "585", "606"}
    assert {text[4:6] for _, text in bus.log if text.startswith("605")} == {"40"}
    assert bus.now < 1.0  # a node that was not reset is asked once
    assert device.objects.get(0x1017) == 0


def test_a_mandatory_node_that_is_not_the_expected_one() -> None:
    bus, _ = bus_with()
    result = bus.run(check_network(NetworkList([BootSlave(5, mandatory=True, product=8)]), timeout=0.1))
    assert not result
    assert str(result.results[0]).startswith("node 5: M: ")


def test_a_node_with_the_date_of_its_configuration_and_one_with_a_concise_dcf() -> None:
    bus, _ = bus_with(x1020_01=7, x1020_02=8)
    values = (ConciseValue(0x1017, 0, b"\1\0"), ConciseValue(0x1006, 0, bytes(4)))
    slaves = [BootSlave(5, configuration=values, date=date) for date in ((7, 8), (7, 9))]
    texts = [str(bus.run(check_network(NetworkList([slave]))).results[0]) for slave in slaves]
    assert texts == ["node 5: nothing would be written", "node 5: 2 values of the concise DCF"]
    assert writes(bus) == []


def test_a_program_that_would_be_replaced() -> None:
    bus, device = bus_with()
    device.objects.add(Entry(0x1F56, 1, "program", "u32", "ro", 0x11))
    slave = BootSlave(5, check_program=True, update_program=True, software=0x22, program=bytes(100))
    (result,) = bus.run(check_network(NetworkList([slave]))).results
    assert str(result) == "node 5: its program would be replaced, 100 bytes: read 00000011h, expected 00000022h"
