"""The network list in the object dictionary of a manager, and the slave of a DCF."""

from __future__ import annotations

from typing import Any

import pytest

from barewire.canopen import (
    BootManager,
    BootSlave,
    ConciseValue,
    DeviceConfiguration,
    Entry,
    NetworkBoot,
    NetworkList,
    ObjectDictionary,
    device_configuration,
    encode_concise_dcf,
    network_list,
    slave_of,
)
from barewire.codecs import Value
from barewire.errors import DecodeError, EncodeError
from tests.canopen.configuration.plant import DATE, dcf

CONCISE = encode_concise_dcf([ConciseValue(0x1017, 0, b"\x01\x00")])


def manager(startup: int, **values: Value) -> ObjectDictionary:
    """Return a manager's dictionary; `values` are objects such as x1F81_05=0xD."""
    entries = [Entry(0x1F80, 0, "startup", "u32", default=startup)]
    for name, value in values.items():
        index, sub = (int(part, 16) for part in name[1:].split("_"))
        entries.append(Entry(index, sub, name, "domain" if isinstance(value, bytes) else "u32", default=value))
    return ObjectDictionary(entries)


def test_every_object_of_a_node() -> None:
    identity = {"x1F84_05": 0x191, "x1F85_05": 0x360, "x1F86_05": 7, "x1F87_05": 8, "x1F88_05": 9}
    objects = manager(
        0x53, x1016_01=0x0005_03E8, x1F89_00=2500, x1F81_05=0x0064_037D, x1F81_06=0xC, x1F81_07=1,
        x1F22_05=CONCISE, x1F26_05=15519, x1F27_05=1000, x1F55_05=0x22, x1F58_05=b"program", **identity,
    )  # fmt: skip
    network = network_list(objects)
    assert network == NetworkList(
        (
            BootSlave(
                5, mandatory=True, keep_alive=True, check_program=True, update_program=True, guard_time=0.1,
                retry_factor=3, heartbeat=1.0, device_type=0x191, vendor=0x360, product=7, revision=8, serial=9,
                date=(15519, 1000), configuration=(ConciseValue(0x1017, 0, b"\x01\x00"),),
                software=0x22, program=b"program",
            ),
            BootSlave(7, boot=False),
        ),
        start_all=True, reset_all=True, stop_all=True, boot_time=2.5,
    )  # fmt: skip
    assert repr(network) == "<NetworkList: 2 nodes, 1 of them mandatory>"
    assert repr(network.slaves[0]) == "<BootSlave 5: mandatory, keep alive, check program, update program>"


def test_the_date_of_the_program() -> None:
    network = network_list(manager(1, x1F81_05=0x25, x1F53_05=15519, x1F54_05=1000))
    assert (network.slaves[0].software_date, network.slaves[0].software) == ((15519, 1000), 0)


def test_a_stored_dcf_is_the_configuration_and_stamps_the_expected_date() -> None:
    text = dcf({(0x1017, 0): 500}).encode()
    (slave,) = network_list(manager(1, x1F81_05=5, x1F20_05=text)).slaves
    assert slave.configuration == device_configuration(dcf({(0x1017, 0): 500}), 5)
    assert (slave.date, slave.concise) == ((0, 0), ())
    (slave,) = network_list(manager(1, x1F81_05=5, x1F20_05=text, x1F22_05=CONCISE, x1F26_05=7, x1F27_05=8)).slaves
    assert isinstance(slave.configuration, DeviceConfiguration)
    assert [setting.value for setting in slave.configuration.date] == [7, 8]
    assert (slave.date, slave.concise) == ((7, 8), (ConciseValue(0x1017, 0, b"\x01\x00"),))


def test_a_stored_dcf_that_cannot_be_read() -> None:
    text = dcf({(0x1017, 0): 500}).encode()
    with pytest.raises(EncodeError, match="DCF of node 5: 1F21h:05 = 1: expected 0, which is text"):
        network_list(manager(1, x1F81_05=5, x1F20_05=text, x1F21_05=1))
    with pytest.raises(EncodeError, match=r"has no ParameterValue.*DCF of node 5, 1F20h:05"):
        network_list(manager(1, x1F81_05=5, x1F20_05=b"[1017]"))


def test_the_startup_bits() -> None:
    assert network_list(manager(0x09)).start_slaves is False
    assert network_list(manager(0x01)) == NetworkList(())
    with pytest.raises(EncodeError, match="1F80h = 2h: expected bit 0"):
        network_list(manager(2))


def test_a_broken_concise_dcf_names_its_node() -> None:
    with pytest.raises(DecodeError, match="concise DCF of node 5, 1F22h:05"):
        network_list(manager(1, x1F81_05=5, x1F22_05=CONCISE[:-1]))


def test_the_slave_of_a_dcf() -> None:
    configuration = device_configuration(dcf({"Heartbeat": 500}, 9))
    assert slave_of(configuration, mandatory=True, heartbeat=1.5) == BootSlave(
        9,
        mandatory=True,
        heartbeat=1.5,
        device_type=0x191,
        vendor=0x360,
        product=7,
        date=(DATE["Configuration.Date"], DATE["Configuration.Time"]),
        configuration=configuration,
    )


@pytest.mark.parametrize("network", [[BootSlave(5)], 5, None], ids=str)
def test_something_else_than_a_network_list_is_refused(network: Any) -> None:
    with pytest.raises(EncodeError, match=r"^network = .*: expected a NetworkList, such as NetworkList\("):
        BootManager(network)


def test_a_network_list_of_something_else_than_slaves_is_refused() -> None:
    with pytest.raises(EncodeError, match=r"NetworkList: 5: expected a BootSlave, such as BootSlave\(5\)"):
        NetworkList([5])  # type: ignore[list-item]


def test_a_boot_is_true_if_the_network_is_ready() -> None:
    assert NetworkBoot(True, ())
    assert not NetworkBoot(False, ())
