"""Store parameters and restore defaults: the values after a reset."""

from __future__ import annotations

import pytest

from barewire.canopen import CanFrame, Entry, LocalNode, LssAddress, LssSlave, ObjectDictionary, PdoConfig, SdoAbort
from barewire.canopen.communication_objects import standard_objects

SUBS = range(1, 5)
INDICES = 0x1017, 0x2000, 0x6000, 0x6001, 0xA000


def device() -> LocalNode:
    objects = ObjectDictionary(
        [
            *(Entry(0x1010, sub, f"store {sub}", "u32", "rw") for sub in SUBS),
            *(Entry(0x1011, sub, f"restore {sub}", "u32", "rw") for sub in SUBS),
            Entry(0x1017, 0, "heartbeat", "u16", "rw", 0),
            Entry(0x2000, 0, "own", "u16", "rw", 1),
            Entry(0x6000, 0, "profile's", "u16", "rw", 2),
            Entry(0x6001, 0, "measured", "u16", "ro", 3),
            Entry(0xA000, 0, "network's", "u16", "rw", 4),
        ]
    )
    device = LocalNode(5, objects)
    device.start(0.0)
    return device


def values(device: LocalNode) -> list[int]:
    return [int(device.objects.get(index)) for index in INDICES]


def change(device: LocalNode, by: int) -> None:
    for index in INDICES:
        device.objects.set(index, 0, int(device.objects.get(index)) + by)


def reset(device: LocalNode, command: str) -> list[int]:
    device.feed(CanFrame.parse(f"000#{command}05"), 1.0)
    return values(device)


@pytest.mark.parametrize(
    ("sub", "after_node", "after_communication"),
    [
        (1, [10, 11, 12, 3, 114], [10, 111, 112, 113, 114]),
        (2, [10, 1, 2, 3, 114], [10, 111, 112, 113, 114]),
        (3, [0, 1, 12, 3, 114], [0, 111, 112, 113, 114]),
        (4, [0, 11, 2, 3, 114], [0, 111, 112, 113, 114]),
    ],
)
def test_areas_of_store_parameters(sub: int, after_node: list[int], after_communication: list[int]) -> None:
    node = device()
    change(node, 10)
    node.objects.write(0x1010, sub, b"save")
    change(node, 100)
    assert reset(node, "82") == after_communication
    assert reset(node, "81") == after_node


def test_everything_is_stored_also_what_a_reset_does_not_restore() -> None:
    """A reset restores up to 9FFFh; what is stored above takes effect when the power comes back."""
    node = device()
    change(node, 10)
    node.objects.write(0x1010, 1, b"save")
    change(node, 100)
    reset(node, "81")
    node.stored.apply()
    assert values(node)[-1] == 14


def test_load_takes_effect_at_the_reset() -> None:
    node = device()
    change(node, 10)
    node.objects.write(0x1010, 1, b"save")
    node.objects.write(0x1011, 1, b"load")
    assert values(node) == [10, 11, 12, 13, 14]
    assert reset(node, "81") == [0, 1, 2, 3, 14]


def test_only_the_signature_stores() -> None:
    node = device()
    for index in (0x1010, 0x1011):
        assert node.objects.read(index, 1) == b"\1\0\0\0"
        for wrong in (bytes(4), b"evas", b"\1\0\0\0"):
            with pytest.raises(SdoAbort, match="0800 0020h"):
                node.objects.write(index, 1, wrong)
    assert node.stored.values == {}


def test_a_stored_default_cob_id_follows_the_node_id() -> None:
    """A COB-ID of the predefined connection set is not stored as a number."""
    address = LssAddress(1, 2, 3, 4)
    slave = LssSlave(address, store=lambda node, rate: True)
    objects = ObjectDictionary(
        [*standard_objects(address), Entry(0x1010, 1, "store", "u32"), Entry(0x6041, 0, "statusword", "u16", "ro", 7)]
    )
    device = LocalNode(5, objects, [PdoConfig("TPDO", 1, (0x60410010,), type=1), PdoConfig("TPDO", 2, ())], lss=slave)
    device.start(0.0)
    objects.write(0x1800, 2, b"\x03")
    for word in (0x8000_0285, 0x2AB):
        objects.write(0x1801, 1, word.to_bytes(4, "little"))
    objects.write(0x1010, 1, b"save")
    for text in ("7E5#0401000000000000", "7E5#1109000000000000", "7E5#0400000000000000", "000#8105"):
        device.feed(CanFrame.parse(text), 0.0)
    assert (device.node, objects.get(0x1014), objects.get(0x1800, 1)) == (9, 0x89, 0x189)
    assert (objects.get(0x1800, 2), objects.get(0x1801, 1)) == (3, 0x2AB)


def test_a_temporary_sdo_channel_is_not_stored() -> None:
    objects = ObjectDictionary([*standard_objects(servers=3), Entry(0x1010, 1, "store", "u32")])
    node = LocalNode(5, objects)
    node.start(0.0)
    for_a_while, for_good = 1 << 30 | 0x6A0, 0x6A1
    for index, word in ((0x1201, for_a_while), (0x1202, for_good)):
        objects.write(index, 1, word.to_bytes(4, "little"))
    objects.write(0x1010, 1, b"save")
    node.feed(CanFrame.parse("000#8205"), 1.0)
    assert [objects.get(index, 1) for index in (0x1201, 0x1202)] == [1 << 31, for_good]
