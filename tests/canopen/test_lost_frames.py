"""Retries on a bus that loses frames: uploads and writes of settings are repeated, other downloads never."""

from __future__ import annotations

from random import Random

import pytest

from barewire.canopen import (
    CanFrame,
    Channel,
    SdoAbort,
    compare_device,
    configure_device,
    device_configuration,
    download,
    upload,
)
from barewire.canopen.sdo.client import write_setting
from barewire.canopen.sdo.plain import PlainUpload
from barewire.errors import NoAnswer
from tests.canopen.configuration.plant import bus_with, dcf
from tests.canopen.virtual_bus import VirtualBus
from tests.helpers import part_or_whole

RUNS = 20
VALUES: dict[tuple[int, int] | str, int | str] = {
    (0x1800, 1): 0x185, (0x1800, 2): 1, (0x1A00, 0): 2, (0x1A00, 1): 0x60640020, (0x1A00, 2): 0x60410010,
    (0x1801, 1): 0x80000285, (0x1016, 1): 0x700FA, "Heartbeat": 500, "Label": "a pump with a long name", "Password": 7,
}  # fmt: skip


def channel(retries: int) -> Channel:
    made = Channel(5)
    made.retries = retries
    return made


def losing(seed: int, share: float = 0.05) -> VirtualBus:
    bus, _ = bus_with()
    random = Random(seed)
    bus.lose = lambda number, frame: random.random() < share
    return bus


def configured(seed: int, retries: int) -> bool:
    """Return whether a device was configured on a bus that loses 5 % of the frames; if it was, it has all values."""
    bus, wanted, node = losing(seed), device_configuration(dcf(dict(VALUES))), channel(retries)
    try:
        bus.run(configure_device(node, wanted, store=True, timeout=0.1))
    except (NoAnswer, SdoAbort):
        return False
    differences = bus.run(compare_device(node, wanted, timeout=0.1))
    assert [difference.entry.name for difference in differences] == ["Password"]  # write-only: it cannot be compared
    return True


@pytest.mark.parametrize("runs", part_or_whole(6, RUNS))
def test_a_configuration_ends_right_although_frames_are_lost(runs: int) -> None:
    assert sum(configured(seed, retries=5) for seed in range(runs)) == runs
    assert sum(configured(seed, retries=0) for seed in range(15)) <= 2


@pytest.mark.parametrize("place", [(0x6041, 0), (0x2001, 0)])  # expedited, and in segments
def test_an_upload_is_repeated_as_often_as_the_channel_says(place: tuple[int, int]) -> None:
    requests: list[str] = []

    def lose(number: int, frame: CanFrame) -> bool:
        requests.extend([str(frame)] * (frame.id == 0x605 and frame.data[0] == 0x40))
        return frame.id == 0x585

    bus, device = bus_with()
    device.objects.set(0x2001, 0, "a pump with a long name")
    bus.lose = lose
    with pytest.raises(NoAnswer):
        bus.run(upload(channel(3), *place, timeout=0.1))
    assert len(requests) == 4
    requests.clear()
    with pytest.raises(NoAnswer):
        bus.run(upload(channel(0), *place, timeout=0.1))
    assert len(requests) == 1


def test_a_refused_upload_is_not_repeated() -> None:
    bus, _ = bus_with()
    with pytest.raises(SdoAbort):
        bus.run(upload(channel(3), 0x7777, timeout=0.1))
    assert [text for _, text in bus.log] == ["605#4077770000000000", "585#8077770000000206"]


def test_the_rest_of_a_plain_upload_is_repeated_too() -> None:
    bus, _ = bus_with()
    node = channel(2)
    node.own_frames = False
    plain = PlainUpload(node, 0x6041, 0, 0.1, 2, None, bytes)
    assert plain.begin() is not None  # its request is lost
    assert bus.run(plain.rest(bus.now)) == b"\x37\0"
    assert bus.now >= 0.1


def test_a_download_is_never_repeated() -> None:
    bus, _ = bus_with()
    bus.lose = lambda number, frame: frame.id == 0x585
    with pytest.raises(NoAnswer):
        bus.run(download(channel(3), 0x1017, 0, b"\xf4\1", timeout=0.1))
    assert sum(text.startswith("605#2B") for _, text in bus.log) == 1


def test_a_setting_that_has_arrived_is_not_written_again() -> None:
    bus, device = bus_with()
    bus.lose = lambda number, frame: frame.id == 0x585 and frame.data[0] == 0x60
    bus.run(write_setting(channel(3), 0x1017, 0, b"\xf4\1", timeout=0.1))
    assert (device.objects["Heartbeat"], sum(text.startswith("605#2B") for _, text in bus.log)) == (500, 1)


def test_a_setting_that_has_not_arrived_is_written_again() -> None:
    bus, device = bus_with()
    lost: list[CanFrame] = []

    def lose(number: int, frame: CanFrame) -> bool:
        if frame.id == 0x605 and frame.data[0] == 0x2B and len(lost) < 2:
            lost.append(frame)
            return True
        return False

    bus.lose = lose
    bus.run(write_setting(channel(3), 0x1017, 0, b"\xf4\1", timeout=0.1))
    assert (device.objects["Heartbeat"], len(lost)) == (500, 2)
    lost.clear()
    with pytest.raises(NoAnswer):
        bus.run(write_setting(channel(0), 0x1017, 0, b"\xf5\1", timeout=0.1))
