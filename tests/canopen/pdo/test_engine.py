"""The PDO engine: remote requests, event timers of RPDOs, identifiers, PDOs between two devices."""

from __future__ import annotations

import pytest

from barewire.canopen import CanFrame, Entry, LocalNode, ObjectDictionary, PdoConfig, standard_objects
from barewire.canopen.datatypes import DAY
from barewire.errors import EncodeError
from tests.canopen.virtual_bus import VirtualBus


def device_with(*pdos: PdoConfig) -> LocalNode:
    objects = [
        *standard_objects(),
        Entry(0x6040, 0, "controlword", "u16", "rw", 0),
        Entry(0x6041, 0, "statusword", "u16", "ro", 0x0637),
        Entry(0x6042, 0, "for TPDOs only", "u16", "rw", 0, mappable=("TPDO",)),
    ]
    device = LocalNode(5, ObjectDictionary(objects), pdos)
    device.start(0.0)
    feed(device, "000#0105")
    return device


def feed(device: LocalNode, text: str | None, now: float = 0.0) -> list[str]:
    return [str(frame) for frame in device.feed(None if text is None else CanFrame.parse(text), now)]


def test_type_253_is_sampled_at_the_request() -> None:
    device = device_with(PdoConfig("TPDO", 1, (0x60410010,), type=253))
    assert feed(device, None, 100.0) == feed(device, "080#", 100.0) == []
    assert feed(device, "185#R2", 100.0) == ["185#3706"]
    device.objects.set(0x6041, 0, 1)
    assert feed(device, None, 101.0) == []
    assert feed(device, "185#R2", 102.0) == ["185#0100"]


def test_type_252_is_sampled_at_sync() -> None:
    device = device_with(PdoConfig("TPDO", 1, (0x60410010,), type=252))
    assert feed(device, "185#R2") == []  # there was no SYNC yet
    assert feed(device, "080#") == []
    device.objects.set(0x6041, 0, 1)
    assert feed(device, "185#R2") == ["185#3706"]
    feed(device, "080#")
    assert feed(device, "185#R2") == ["185#0100"]


def test_a_value_that_does_not_fit_is_counted_when_it_is_sent() -> None:
    """The engine also samples to find out whether data changed; only a frame with zeros in place of a value counts."""
    objects = ObjectDictionary([Entry(0x6043, 0, "measured", "u8", "ro", on_read=lambda: 300)])
    device = LocalNode(5, objects, [PdoConfig("TPDO", 1, (0x60430008,), type=254)])
    device.start(0.0)
    assert feed(device, "000#0105") == ["185#00"]
    for _ in range(3):
        assert (device.deadline, device.pdo.refused) == (None, 1)


@pytest.mark.parametrize("type_", [0, 1, 255])
def test_any_tpdo_is_sent_on_request_unless_bit_30_forbids_it(type_: int) -> None:
    device = device_with(PdoConfig("TPDO", 1, (0x60410010,), type=type_))
    feed(device, None, 1.0)
    assert feed(device, "185#R2", 2.0) == ["185#3706"]
    assert feed(device, "00000185#R2", 2.0) == feed(device, "205#R2", 2.0) == []
    deaf = device_with(PdoConfig("TPDO", 1, (0x60410010,), type=type_, cob_id=0x4000_0185))
    feed(deaf, None, 1.0)
    assert feed(deaf, "185#R2", 2.0) == []


@pytest.mark.parametrize("kind", ["time_of_day", "time_difference"])
@pytest.mark.parametrize("type_", [1, 255])
def test_a_time_of_24_hours_or_more_in_an_rpdo_is_refused_alone(kind: str, type_: int) -> None:
    objects = ObjectDictionary(
        [Entry(0x2000, 0, "clock", kind), Entry(0x2001, 0, "a", "u16"), Entry(0x2002, 0, "b", "u16")]
    )
    pdos = [
        PdoConfig("RPDO", 1, (0x20000030, 0x20010010), type=type_),
        PdoConfig("RPDO", 2, (0x20020010,), type=type_),
        PdoConfig("TPDO", 1, (0x20010010,), type=1),
    ]
    device = LocalNode(5, objects, pdos)
    device.start(0.0)
    for text in ("000#0105", "205#00000000020001AA", "205#FFFFFF0F01003412", "305#7856"):
        assert feed(device, text) == []
    assert feed(device, "080#") == ["185#3412"]
    # Of two synchronous RPDOs before one SYNC the later one counts.
    assert [objects.get(index) for index in (0x2000, 0x2001, 0x2002)] == [2 * DAY * (type_ > 1), 0x1234, 0x5678]
    assert device.pdo.refused == 1


def test_a_missing_rpdo_is_reported_as_8250h() -> None:
    device = device_with(PdoConfig("RPDO", 1, (0x60400010,), event_timer=100))
    assert feed(device, None, 50.0) == []  # the event timer starts with the first RPDO
    feed(device, "205#0100", 60.0)
    assert device.deadline == pytest.approx(60.1)
    feed(device, "205#0200", 60.05)
    assert feed(device, None, 60.1) == []
    assert feed(device, None, 60.15) == ["085#5082110014000000"]
    assert feed(device, None, 70.0) == []
    assert feed(device, "205#0200", 71.0) == ["085#0000000000000000"]


def test_base_and_extended_identifiers_are_distinguished() -> None:
    device = device_with(
        PdoConfig("RPDO", 1, (0x60400010,), cob_id=0x2000_0205),
        PdoConfig("TPDO", 1, (0x60410010,), type=1, cob_id=0x2000_0185),
    )
    feed(device, "205#0100")
    assert device.objects.get(0x6040) == 0
    feed(device, "00000205#0100")
    assert device.objects.get(0x6040) == 1
    assert feed(device, "080#") == ["00000185#3706"]


def test_invalid_configurations_raise() -> None:
    for pdo in (
        PdoConfig("RPDO", 1, (), type=252),
        PdoConfig("TPDO", 1, (), type=241),
        PdoConfig("TPDO", 1, (), type=256),
    ):
        with pytest.raises(EncodeError, match="does not exist"):
            device_with(pdo)
    with pytest.raises(EncodeError, match="cannot be mapped to an RPDO"):
        device_with(PdoConfig("RPDO", 1, (0x60420010,)))


def test_the_tpdo_of_one_device_is_the_rpdo_of_another() -> None:
    """The TPDO of node 5 is the RPDO of node 6; a third node produces SYNC."""
    bus = VirtualBus()
    sender = device_with(PdoConfig("TPDO", 1, (0x60410010,), type=2))
    objects = ObjectDictionary([Entry(0x6040, 0, "controlword", "u16", "rw", 0)])
    receiver = LocalNode(6, objects, [PdoConfig("RPDO", 1, (0x60400010,), type=1, cob_id=0x185)])
    receiver.start(0.0)
    beat = LocalNode(7, ObjectDictionary(standard_objects()))
    beat.start(0.0)
    beat.objects.set(0x1006, 0, 10_000)
    beat.objects.set(0x1005, 0, 0x4000_0080)
    for device in (sender, receiver, beat):
        bus.add(device)
    bus.inject("000#0100", 0.0)
    bus.pass_time(0.026)
    assert objects.get(0x6040) == 0  # received after the second SYNC, stored at the third
    bus.pass_time(0.01)
    assert objects.get(0x6040) == 0x0637
