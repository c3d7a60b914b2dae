"""The dry run of a boot-up: it reads, and sends neither an NMT command nor a write."""

from __future__ import annotations

from barewire.canopen import BootSlave, ConciseValue, Entry, NetworkList, check_network, device_configuration, slave_of
from tests.canopen.configuration.plant import bus_with, dcf, writes


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
