"""Many faults at once: a bus that loses, doubles and delays frames at random, for transfer after transfer.

CAN frames do not overtake each other, so a late frame delays all frames after it. In all cases: an uploaded value is
the one of the server, a confirmed download is written, every transfer ends, and the next one without faults works.
"""

from __future__ import annotations

import random
from collections.abc import Generator
from typing import Any

import pytest

from barewire.canopen import BlockSettings, CanFrame, Channel, SdoAbort, SdoServer, download, upload
from barewire.canopen.sdo.client import BlockMode
from barewire.errors import NoAnswer
from tests.canopen.sdo.sdo_bus import Bus, RefusingServer, Store
from tests.helpers import part_or_whole

LENGTHS = (0, 1, 2, 4, 5, 7, 8, 14, 20, 21, 22, 50, 100)


class RandomFaults:
    """Loses, doubles or delays a frame with probability `rate`."""

    def __init__(self, rng: random.Random, rate: float) -> None:
        self.rng = rng
        self.rate = rate
        self.bus: Bus | None = None
        self._held_until = 0.0

    def __call__(self, number: int, frame: CanFrame) -> list[tuple[float, CanFrame]]:
        assert self.bus is not None
        now, times = self.bus.now, 1
        if self.rng.random() < self.rate:
            times = self.rng.choice((0, 1, 2))
            if times == 1:
                self._held_until = max(self._held_until, now + self.rng.random() * 0.25)
        return [(max(0.0, self._held_until - now), frame)] * times


def tried(conversation: Generator[Any, Any, Any]) -> Generator[Any, Any, Any]:
    """Return the result, or the exception."""
    try:
        return (yield from conversation)
    except (SdoAbort, NoAnswer) as error:
        return error


def count_successes(seed: int) -> int:
    """Run ten transfers under random faults. Return how many succeeded."""
    rng = random.Random(seed)
    store, worked = Store(), 0
    server = SdoServer(5, store, blksize=rng.choice((0, 1, 2, 3, 5, 127)))
    faults = RandomFaults(rng, rng.choice((0.0, 0.02, 0.1, 0.3)))
    bus = faults.bus = Bus(server, fault=faults)
    channel = Channel(5)
    known = {store.objects[0x2100, 0]}
    for _ in range(10):
        block: BlockMode = rng.choice(
            (False, True, "auto", BlockSettings(size=rng.choice((1, 2, 3)), switch=rng.choice((0, 30))))
        )
        timeout = rng.choice((0.3, 1.0))
        if rng.random() < 0.5:
            value = rng.randbytes(rng.choice(LENGTHS))
            known.add(value)
            data = value if rng.random() < 0.5 else [value[:3], value[3:]]
            result = bus.run(tried(download(channel, 0x2100, 0, data, block=block, timeout=timeout)))
            assert isinstance(result, Exception) or store.objects[0x2100, 0] == value
        else:
            result = bus.run(tried(upload(channel, 0x2100, block=block, timeout=timeout)))
            assert isinstance(result, Exception) or result == store.objects[0x2100, 0]
        assert store.objects[0x2100, 0] in known
        worked += not isinstance(result, Exception)
    bus.fault = None
    bus.rest(5.0)
    assert server.deadline is None
    for block in (False, True):
        bus.run(download(channel, 0x2100, 0, b"the next one", block=block))
        assert bus.run(upload(channel, 0x2100, block=block)) == b"the next one"
    return worked


@pytest.mark.long
@pytest.mark.parametrize("runs", part_or_whole(150, 1000))
def test_no_false_success_under_random_faults(runs: int) -> None:
    worked = sum(count_successes(seed) for seed in range(runs))
    assert 6 * runs < worked < 9.5 * runs  # there were enough faults, and enough successes


@pytest.mark.parametrize("late", [0.0, 0.00005, 0.0001, 0.00015, 0.0002, 0.0003, 0.0005, 0.05])
def test_a_late_response_after_an_abort_confirms_nothing(late: float) -> None:
    """The request arrives twice during another transfer: the server refuses the first and accepts the second."""

    def twice(number: int, frame: CanFrame) -> list[tuple[float, CanFrame]]:
        return [(0.0, frame), (late, frame)] if number == 0 else [(0.0, frame)]

    store = Store()
    server = RefusingServer(5, store)
    server.feed(CanFrame.parse("605#4000210000000000"), 0.0)  # a transfer that its client never continues
    bus = Bus(server, fault=twice)
    channel = Channel(5)
    with pytest.raises(SdoAbort, match="0504 0001h"):
        bus.run(download(channel, 0x2100, 0, [b"ab", b"cd"]))
    result = bus.run(tried(download(channel, 0x2100, 0, b"next")))
    assert isinstance(result, Exception) or store.objects[0x2100, 0] == b"next"
    bus.run(download(channel, 0x2100, 0, b"more"))
    assert store.objects[0x2100, 0] == b"more"
