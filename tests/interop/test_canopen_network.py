"""Network services of two implementations on one bus: LSS, EMCY, NMT, SYNC, TIME, PDO records.

The other is the `canopen` package of PyPI, over python-can's virtual bus: real threads and real time, no hardware.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from barewire.canopen import (
    Device,
    EmcyConsumer,
    Entry,
    LssAddress,
    LssSlave,
    LssState,
    NmtCommand,
    NmtState,
    ObjectDictionary,
    Pdo,
    SyncMonitor,
    TimeConsumer,
    fastscan,
    find_all,
    inquire_address,
    read_pdo,
    scan,
    standard_objects,
    switch_global,
    switch_selective,
    tell_nmt,
)
from tests.interop.test_canopen_library import NODE, Port, dictionary_of_theirs, run

can = pytest.importorskip("can")
canopen = pytest.importorskip("canopen")

ADDRESS = LssAddress(0x00000360, 0x00010203, 0x00020001, 0xDEADBEEF)


@pytest.fixture
def network(request: pytest.FixtureRequest) -> Iterator[Any]:
    """Their side of a bus of our own, closed at the end."""
    network = canopen.Network()
    network.NOTIFIER_CYCLE = 0.05
    network.connect(interface="virtual", channel=request.node.name)
    yield network
    network.disconnect()


@pytest.fixture
def port(request: pytest.FixtureRequest) -> Iterator[Port]:
    """Our side of the same bus."""
    port = Port(request.node.name)
    yield port
    port.bus.shutdown()


class Living:
    """Our device in a thread of its own; `do` lets it say something by itself."""

    def __init__(self, port: Port, node: int | None) -> None:
        objects = [*standard_objects(ADDRESS, heartbeat=100), Entry(0x6041, 0, "statusword", "u16", "ro", 0x0637)]
        slave = LssSlave(ADDRESS, store=lambda number, rate: True)
        self.device = Device(node, ObjectDictionary(objects), [Pdo("TPDO", 1, (0x60410010,), type=1)], lss=slave)
        self.port = port
        self.stopped = threading.Event()
        self.tasks: list[Callable[[float], list[Any]]] = []
        for one in self.device.start(time.monotonic()):
            port.send(one)
        self.thread = threading.Thread(target=self._live)
        self.thread.start()

    def do(self, task: Callable[[float], list[Any]]) -> None:
        self.tasks.append(task)

    def _live(self) -> None:
        while not self.stopped.is_set():
            frame = self.port.receive(0.002)
            now = time.monotonic()
            said = self.device.feed(frame, now)
            while self.tasks:
                said += self.tasks.pop(0)(now)
            for one in said:
                self.port.send(one)

    def stop(self) -> None:
        self.stopped.set()
        self.thread.join()


@pytest.fixture
def living(port: Port) -> Iterator[Living]:
    """Our device, node 5."""
    living = Living(port, NODE)
    yield living
    living.stop()


@pytest.fixture
def bare(port: Port) -> Iterator[Living]:
    """Our device without a node-ID."""
    living = Living(port, None)
    yield living
    living.stop()


def remote(network: Any) -> Any:
    node = canopen.RemoteNode(NODE, dictionary_of_theirs())
    network.add_node(node)
    node.sdo.RESPONSE_TIMEOUT = 2.0
    return node


def test_their_lss_master_configures_our_device(network: Any, bare: Living) -> None:
    node = remote(network)
    lss = network.lss
    lss.send_switch_state_global(lss.CONFIGURATION_STATE)
    told = [lss.inquire_lss_address(service) for service in (0x5A, 0x5B, 0x5C, 0x5D)]
    assert told == list(ADDRESS)
    assert lss.inquire_node_id() == 0xFF
    lss.configure_node_id(NODE)
    lss.configure_bit_timing(4)
    lss.store_configuration()
    lss.send_switch_state_global(lss.WAITING_STATE)
    node.nmt.wait_for_heartbeat(2.0)
    assert bare.device.node == NODE


def test_their_lss_master_selects_our_device(network: Any, living: Living) -> None:
    assert network.lss.send_switch_state_selective(*ADDRESS)
    assert network.lss.inquire_node_id() == NODE


def test_their_fastscan_finds_our_device(network: Any, bare: Living) -> None:
    network.lss.RESPONSE_TIMEOUT = 0.03
    found, address = network.lss.fast_scan()
    assert (found, tuple(address)) == (True, ADDRESS)


def test_our_fastscan_in_less_than_five_seconds(request: pytest.FixtureRequest, bare: Living) -> None:
    master = Port(request.node.name)
    start = time.monotonic()
    assert run(fastscan(timeout=0.2), master) == ADDRESS
    assert time.monotonic() - start < 5.0
    run(switch_global(LssState.WAITING), master)
    (assigned,) = run(find_all([NODE], tuple(ADDRESS), timeout=0.3), master)
    assert (assigned.address, assigned.node, assigned.booted) == (ADDRESS, NODE, True)
    assert run(switch_selective(ADDRESS), master)
    assert run(inquire_address(), master) == ADDRESS
    master.bus.shutdown()


def test_they_hear_our_boot_heartbeat_and_emergencies(network: Any, living: Living) -> None:
    node = remote(network)
    node.nmt.wait_for_heartbeat(2.0)
    assert node.nmt.state == "PRE-OPERATIONAL"
    waiter = threading.Timer(0.1, living.do, [lambda now: living.device.error(0x3210, now, info=b"\1\2")])
    waiter.start()
    error = node.emcy.wait(0x3210, 2.0)
    assert (error.code, error.register, error.data) == (0x3210, 0x05, b"\1\2\0\0\0")
    node.nmt.send_command(0x82)
    node.nmt.wait_for_bootup(2.0)


def test_their_guarding_gets_our_answers(network: Any, living: Living) -> None:
    living.device.objects.set(0x1017, 0, 0)
    answers: list[int] = []
    network.subscribe(0x700 + NODE, lambda identifier, data, timestamp: answers.append(data[0]))
    node = remote(network)
    time.sleep(0.15)
    answers.clear()
    node.nmt.start_node_guarding(0.02)
    time.sleep(0.2)
    node.nmt.stop_node_guarding()
    assert answers[:4] == [0x7F, 0xFF, 0x7F, 0xFF]


def listen(port: Port, machine: Any, seconds: float) -> list[Any]:
    events: list[Any] = []
    until = time.monotonic() + seconds
    while (left := until - time.monotonic()) > 0 and not events:
        frame = port.receive(left)
        if frame is not None:
            events += machine.feed(frame, time.monotonic())
    return events


def test_we_hear_their_emergencies_syncs_and_time(network: Any, port: Port) -> None:
    local = network.create_node(NODE, dictionary_of_theirs())
    local.emcy.send(0x8130, 0x11, b"\2")
    (emergency,) = listen(port, EmcyConsumer(), 2.0)
    assert (emergency.message.code, emergency.message.node, emergency.active) == (0x8130, NODE, (0x8130,))
    network.sync.transmit(7)
    assert listen(port, SyncMonitor(), 2.0)[0].counter == 7
    network.time.transmit(1_700_000_000.5)
    assert listen(port, TimeConsumer(), 2.0)[0].stamp.unix == pytest.approx(1_700_000_000.5)


def test_we_command_and_scan_their_node(network: Any, port: Port) -> None:
    local = network.create_node(NODE, dictionary_of_theirs())
    local.nmt.start_heartbeat(50)
    run(tell_nmt(NmtCommand.START, NODE), port)
    assert local.nmt.state == "OPERATIONAL"
    found = run(scan(range(1, 20), timeout=0.2), port).nodes
    assert list(found) == [NODE]
    assert found[NODE].abort == 0x06020000  # it has no 1000h, and says so: it is there
    local.nmt.stop_heartbeat()


def test_their_pdo_tools_configure_our_device(network: Any, living: Living, request: pytest.FixtureRequest) -> None:
    objects = dictionary_of_theirs()
    for index, name in ((0x1800, "communication"), (0x1A00, "mapping")):
        record = canopen.objectdictionary.ODRecord(name, index)
        for sub in range(9):
            variable = canopen.objectdictionary.ODVariable(f"{name} {sub}", index, sub)
            wide = (index, sub) == (0x1800, 1) or (index == 0x1A00 and sub)
            variable.data_type = canopen.objectdictionary.UNSIGNED32 if wide else (
                canopen.objectdictionary.UNSIGNED16 if sub in (3, 5) else canopen.objectdictionary.UNSIGNED8
            )  # fmt: skip
            if index == 0x1A00 or sub <= 6:
                record.add_member(variable)
        objects.add_object(record)
    status = canopen.objectdictionary.ODVariable("statusword", 0x6041, 0)
    status.data_type = canopen.objectdictionary.UNSIGNED16
    objects.add_object(status)
    node = canopen.RemoteNode(NODE, objects)
    network.add_node(node)
    node.sdo.RESPONSE_TIMEOUT = 2.0
    tpdo = node.tpdo[1]
    tpdo.read()
    assert (tpdo.cob_id, tpdo.trans_type, len(tpdo)) == (0x185, 1, 1)
    tpdo.clear()
    tpdo.add_variable(0x6041)
    tpdo.trans_type, tpdo.enabled = 3, True
    tpdo.save()
    master = Port(request.node.name)
    assert run(read_pdo(NODE, "TPDO", 1), master) == Pdo("TPDO", 1, (0x60410010,), type=3, cob_id=0x185)
    assert living.device.state is NmtState.PRE_OPERATIONAL
    master.bus.shutdown()
