"""A manager boots 127 nodes, configures each from its DCF and lets them run with SYNC at 100 Hz, in virtual time."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from functools import cache
from typing import Any

import pytest

from barewire.canopen import (
    BootEvent,
    CanFrame,
    LocalNode,
    NetworkList,
    NmtState,
    NodeGroup,
    SyncProducer,
    boot_network,
    device_configuration,
    pdos_of,
    slave_of,
)
from barewire.canopen.eds.value_syntax import Expression
from tests.canopen.configuration.plant import MODIFIED, dcf, described
from tests.canopen.virtual_bus import VirtualBus
from tests.helpers import part_or_whole

pytestmark = pytest.mark.long

NODES = range(1, 128)
SOME = range(60, 90)
PERIOD = 0.01
HEARTBEAT = 500


@cache
def planned(numbers: range) -> NetworkList:
    """Return the nodes as their DCFs describe them: a heartbeat, a TPDO of 6 bytes at each SYNC, an RPDO."""
    slaves = []
    for number in numbers:
        values: dict[tuple[int, int] | str, Expression] = {
            (0x1017, 0): HEARTBEAT,
            (0x1800, 2): 1,
            (0x1801, 1): 0x8000_0280 + number,
            (0x1400, 2): 1,
        }
        values |= {(0x1A00, 0): 2, (0x1A00, 1): 0x6041_0010, (0x1A00, 2): 0x6064_0020}
        configuration = device_configuration(dcf(values, number))
        slaves.append(slave_of(configuration, mandatory=True, heartbeat=2 * HEARTBEAT / 1000))
    return NetworkList(slaves, start_all=True, boot_time=60)


class Plant:
    """Nodes as they leave the factory, on a bus."""

    def __init__(self, numbers: range) -> None:
        factory = described()
        nodes = []
        for number in numbers:
            objects = factory.dictionary(number)
            nodes.append(LocalNode(number, objects, pdos_of(objects, number)))
            nodes[-1].objects.set(0x6064, 0, 1000 * number)
        self.group = NodeGroup(nodes)
        self.bus = VirtualBus()
        self.bus.add(self.group, sent=self.group.start(0.0))
        self.bus.pass_time(0.01)
        self.events: Counter[str] = Counter()

    def tell(self, event: BootEvent) -> None:
        self.events[event.kind] += 1


@pytest.mark.parametrize("numbers", part_or_whole(SOME, NODES))
def test_all_nodes_boot_with_their_dcfs_and_run_with_sync_at_100_hz(numbers: range) -> None:
    plant = Plant(numbers)
    bus, group = plant.bus, plant.group
    result = bus.run(boot_network(planned(numbers), on_event=plant.tell))
    assert result.ready, str(result)
    assert plant.events == {"booted": len(numbers), "ready": 1, "started": 1}
    assert all(node.configured for node in result.results)
    bus.pass_time(0.01)
    assert {device.state for device in group.nodes} == {NmtState.OPERATIONAL}
    assert {device.objects.get(0x1020, 1) for device in group.nodes} == {15519}, MODIFIED

    bus.log.clear()
    for number in numbers:
        bus.inject(str(CanFrame(0x200 + number, (number << 4).to_bytes(2, "little"))), bus.now)
    producer: Any = SyncProducer(PERIOD)
    producer.start(bus.now)
    bus.add(producer, latency=0.0)
    begun = bus.now
    bus.pass_time(1.0 + PERIOD / 2)
    sent = Counter(text.partition("#")[0] for _, text in bus.log)
    assert sent["080"] == 100
    assert {sent[f"{0x180 + number:03X}"] for number in numbers} == {100}
    assert {sent[f"{0x700 + number:03X}"] for number in numbers} == {2}
    assert set(sent) <= {"080"} | {f"{base + number:03X}" for number in numbers for base in (0x180, 0x200, 0x700)}
    expected = {f"{0x180 + number:03X}#3700{(1000 * number).to_bytes(4, 'little').hex().upper()}" for number in numbers}
    assert {text for _, text in bus.log if 0x180 < int(text[:3], 16) < 0x200} == expected
    assert [device.objects.get(0x6040, 0) for device in group.nodes] == [number << 4 for number in numbers]
    syncs = [at for at, text in bus.log if text.startswith("080")]
    assert all(abs(at - begun - PERIOD * (place + 1)) < 1e-6 for place, at in enumerate(syncs))


def test_the_next_boot_writes_nothing_because_all_nodes_have_the_date() -> None:
    plant = Plant(SOME)
    plan = planned(SOME)
    plant.bus.run(boot_network(plan))
    for device in plant.group.nodes:
        for sub in (1, 2):
            device.stored.values[0x1020, sub] = device.objects.get(0x1020, sub)
        device.stored.values[0x1017, 0] = HEARTBEAT
    plant.bus.log.clear()
    result = plant.bus.run(boot_network(plan, on_event=plant.tell))
    assert (result.ready, plant.events["booted"]) == (True, len(SOME))
    assert not any(node.configured for node in result.results)
    commands = {text[4:6] for _, text in plant.bus.log if 0x600 < int(text[:3], 16) < 0x680}
    assert commands == {"40"}  # only reads


def test_a_node_that_fails_does_not_hold_up_the_others() -> None:
    plant = Plant(SOME)
    objects = plant.group.node(77).objects
    objects.replace(replace(objects.entry(0x1018, 2), default=8))
    result = plant.bus.run(boot_network(planned(SOME), on_event=plant.tell))
    assert not result.ready
    (failed,) = [node for node in result.results if not node.ok]
    assert str(failed) == (
        "node 77: M: another product code (1018h:02) than expected (1F86h): read 00000008h, expected 00000007h"
    )
    assert plant.events["booted"] == len(SOME) - 1
