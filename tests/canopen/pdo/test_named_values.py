"""The PDOs of other devices as named values."""

from __future__ import annotations

import pytest

from barewire.canopen import CanFrame, Channel, Entry, ObjectDictionary, PdoConfig, SdoServer
from barewire.canopen.pdo.remote import PdoConsumer, RemotePdo, remote_pdo
from barewire.errors import EncodeError
from tests.canopen.sdo.sdo_bus import Bus, Store


def test_a_remote_pdo_with_names_of_a_dictionary() -> None:
    store = Store()
    record = {(0x1800, 1): "85010000", (0x1800, 2): "FF", (0x1800, 3): "0000", (0x1A00, 0): "02"}
    record |= {(0x1A00, 1): "10004160", (0x1A00, 2): "08000620"}
    store.objects |= {place: bytes.fromhex(text) for place, text in record.items()}
    objects = ObjectDictionary([Entry(0x6041, 0, "statusword", "u16"), Entry(0x2006, 0, "mode", "i8")])
    bus = Bus(SdoServer(5, store))
    store.objects |= {(0x1800, 5): bytes(2), (0x1800, 6): bytes(1)}
    remote = bus.run(remote_pdo(Channel(5), "TPDO", 1, objects))
    assert remote.key == (0x185, False)
    assert remote.decode(CanFrame.parse("185#3706FF")) == {"statusword": 0x0637, "mode": -1}
    listener = PdoConsumer([remote])
    assert listener.deadline is None
    (good,) = listener.feed(CanFrame.parse("185#3706FF"), 1.5)
    (bad,) = listener.feed(CanFrame.parse("185#3706"), 2.5)
    assert (good.values, good.node, good.at) == ({"statusword": 0x0637, "mode": -1}, 5, 1.5)
    assert (bad.values, bad.data, bad.why) == (None, bytes.fromhex("3706"), "3 bytes are mapped, got 2")
    assert listener.feed(CanFrame.parse("186#3706FF"), 3.0) == listener.feed(CanFrame.parse("185#R3"), 3.0) == []


def test_a_pdo_that_is_switched_off_raises() -> None:
    with pytest.raises(EncodeError, match="RPDO5 of node 5 is switched off"):
        RemotePdo.of(5, PdoConfig("RPDO", 5, (0x60400010,)))
