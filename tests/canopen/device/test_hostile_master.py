"""A master that configures a device in every way the objects allow: the device refuses, or works on."""

from __future__ import annotations

import pytest

from barewire.canopen import Entry, LocalNode, ObjectDictionary, PdoConfig, pdos_of
from barewire.canopen.communication_objects import standard_objects
from barewire.errors import EncodeError
from tests.canopen.device.test_device import feed

READ_DEVICE_TYPE, DEVICE_TYPE = "605#4000100000000000", "585#4300100000000000"

RPDO_ONTO_ITS_TYPE = (
    *("605#2300140105020080", "605#2F00160000000000", "605#2300160120010014", "605#2F00160001000000"),
    *("605#2300140105020000", "000#0105", "205#FFFFFFFF"),
)
"""RPDO1 is switched off, mapped onto 1400h:01, which is its own COB-ID, switched on, and received."""


def device_with(*entries: Entry) -> LocalNode:
    pdos = [PdoConfig("RPDO", 1, (), type=255), PdoConfig("TPDO", 1, (), type=255)]
    device = LocalNode(5, ObjectDictionary([*standard_objects(), *entries]), pdos)
    device.start(0.0)
    return device


def answers(device: LocalNode, *frames: str) -> list[str]:
    return [answer for frame in frames for answer in feed(device, frame)]


def test_communication_objects_are_not_mappable() -> None:
    device = device_with()
    assert "585#8000160141000406" in answers(device, *RPDO_ONTO_ITS_TYPE)
    assert feed(device, READ_DEVICE_TYPE) == [DEVICE_TYPE]


def test_an_rpdo_that_changes_its_own_record_does_not_end_the_device() -> None:
    # A description may say that a PDO record is mappable.
    device = device_with(Entry(0x1400, 1, "COB-ID", "u32", mappable=("RPDO",)))
    answers(device, *RPDO_ONTO_ITS_TYPE)
    assert device.objects.get(0x1400, 1) == 0xFFFF_FFFF, "received and stored"
    assert feed(device, READ_DEVICE_TYPE) == [DEVICE_TYPE]


@pytest.mark.parametrize(
    ("word", "why"),
    [
        (0x2001_00_40, "a domain"),
        (0x0005_00_10, "a dummy UNSIGNED8 of 16 bits"),
        (0x0001_00_08, "a dummy BOOLEAN of 8 bits"),
        (0x1A00_00_08, "the number of entries of a mapping"),
        (0x1017_00_10, "the heartbeat time"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_cannot_be_mapped(word: int, why: str) -> None:
    device = device_with(Entry(0x2001, 0, "program", "domain", "rw", b""))
    entry = f"605#23001601{word.to_bytes(4, 'little').hex().upper()}"
    assert answers(device, "605#2300140105020080", "605#2F00160000000000", entry)[-1] == "585#8000160141000406", why


def test_dummies_of_their_own_width_can_be_mapped() -> None:
    device = device_with()
    answers(device, "605#2300140105020080", "605#2F00160000000000")
    for index, bits in ((1, 1), (2, 8), (3, 16), (4, 32), (5, 8), (6, 16), (7, 32)):
        assert feed(device, f"605#23001601{bits:02X}00{index:02X}00") == ["585#6000160100000000"]


@pytest.mark.parametrize(
    ("index", "word", "why"),
    [
        (0x1005, 0x0000_0180, "restricted"),
        (0x1005, 0x0000_0880, "bit 11 of an identifier of 11 bits"),
        (0x1005, 0x1000_0080, "bit 28 of an identifier of 11 bits"),
        (0x1012, 0x0000_0601, "restricted, while TIME is off"),
        (0x1012, 0x0001_0100, "bit 16 of an identifier of 11 bits"),
        (0x1014, 0x8000_0880, "bit 11 of an identifier of 11 bits"),
    ],
)
def test_cob_ids_that_are_refused_while_their_service_is_off(index: int, word: int, why: str) -> None:
    device = device_with()
    place = f"{index.to_bytes(2, 'little').hex().upper()}00"
    feed(device, "605#2312100000010000")  # TIME off: identifier 100h without bits 30 and 31
    frame = f"605#23{place}{word.to_bytes(4, 'little').hex().upper()}"
    assert feed(device, frame) == [f"585#80{place}30000906"], why


def test_a_pdo_that_cannot_be_mapped_is_off_and_the_device_works() -> None:
    refused: list[str] = []
    described = [
        *(Entry(record, 1, "COB-ID", "u32", "rw", word) for record, word in ((0x1400, 0x205), (0x1800, 0x185))),
        *(Entry(record, 2, "transmission type", "u8", "rw", 255) for record in (0x1400, 0x1800)),
        *(Entry(record, 0, "entries", "u8", "rw", 1) for record in (0x1600, 0x1A00)),
        *(Entry(record, 1, "entry 1", "u32", "rw", 0x20010010) for record in (0x1600, 0x1A00)),
        Entry(0x2001, 0, "measured", "u16", "ro", 7),
    ]
    objects = ObjectDictionary([*standard_objects(), *described])
    with pytest.raises(EncodeError, match="RPDO1: 2001h:00 is ro and cannot be mapped to an RPDO"):
        LocalNode(5, objects, pdos_of(objects, 5))
    device = LocalNode(5, objects, pdos_of(objects, 5, refused=refused))
    device.start(0.0)
    assert refused == ["RPDO1: 2001h:00 is ro and cannot be mapped to an RPDO"]
    assert feed(device, "000#0105") == ["185#0700"]
    assert feed(device, "605#4000140100000000") == ["585#4300140105020080"], "bit 31: switched off"
    assert feed(device, "605#4000160000000000") == ["585#4F00160000000000"], "nothing is mapped"
