"""Store and restore: what a device comes back with."""

from __future__ import annotations

import pytest

from barewire.canopen import CanFrame, Device, Entry, ObjectDictionary, SdoAbort

SUBS = range(1, 5)


def device() -> Device:
    objects = ObjectDictionary(
        [
            *(Entry(0x1010, sub, f"store {sub}", "u32", "rw") for sub in SUBS),
            *(Entry(0x1011, sub, f"restore {sub}", "u32", "rw") for sub in SUBS),
            Entry(0x1017, 0, "heartbeat", "u16", "rw", 0),
            Entry(0x2000, 0, "own", "u16", "rw", 1),
            Entry(0x6000, 0, "profile's", "u16", "rw", 2),
            Entry(0x6001, 0, "measured", "u16", "ro", 3),
        ]
    )
    device = Device(5, objects)
    device.start(0.0)
    return device


def values(device: Device) -> list[int]:
    return [int(device.objects.get(index)) for index in (0x1017, 0x2000, 0x6000, 0x6001)]


def change(device: Device, by: int) -> None:
    for index in (0x1017, 0x2000, 0x6000, 0x6001):
        device.objects.set(index, 0, int(device.objects.get(index)) + by)


def reset(device: Device, command: str) -> list[int]:
    device.feed(CanFrame.parse(f"000#{command}05"), 1.0)
    return values(device)


@pytest.mark.parametrize(
    ("sub", "after_node", "after_communication"),
    [
        (1, [10, 11, 12, 3], [10, 111, 112, 113]),
        (2, [10, 1, 2, 3], [10, 111, 112, 113]),
        (3, [0, 1, 12, 3], [0, 111, 112, 113]),
        (4, [0, 11, 2, 3], [0, 111, 112, 113]),
    ],
)
def test_areas(sub: int, after_node: list[int], after_communication: list[int]) -> None:
    one = device()
    change(one, 10)
    one.objects.write(0x1010, sub, b"save")
    change(one, 100)
    assert reset(one, "82") == after_communication
    assert reset(one, "81") == after_node


def test_load_is_effective_at_the_reset() -> None:
    one = device()
    change(one, 10)
    one.objects.write(0x1010, 1, b"save")
    one.objects.write(0x1011, 1, b"load")
    assert values(one) == [10, 11, 12, 13]
    assert reset(one, "81") == [0, 1, 2, 3]


def test_only_the_signature_stores() -> None:
    one = device()
    for index in (0x1010, 0x1011):
        assert one.objects.read(index, 1) == b"\1\0\0\0"
        for wrong in (bytes(4), b"evas", b"\1\0\0\0"):
            with pytest.raises(SdoAbort, match="0800 0020h"):
                one.objects.write(index, 1, wrong)
    assert one.stored.values == {}
