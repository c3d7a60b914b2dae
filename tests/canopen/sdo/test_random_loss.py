"""Many faults at once: a bus that loses, doubles and holds back frames at random, for transfer after transfer.

A CAN bus does not overtake itself, so what is late makes everything behind it late as well. Whatever happens: a value
that was read was there, a value that was confirmed is there, everything ends, and in calm weather the next works.
"""

from __future__ import annotations

import random
from collections.abc import Generator
from typing import Any

import pytest

from barewire.canopen import BlockSettings, CanFrame, Channel, SdoAbort, SdoServer, download, upload
from barewire.canopen.sdo.client.block_options import BlockMode
from barewire.errors import NoAnswer
from tests.canopen.sdo.sdo_bus import Bus, Store

LENGTHS = (0, 1, 2, 4, 5, 7, 8, 14, 20, 21, 22, 50, 100)


class Storm:
    """The weather: one frame in `1 / rate` is hit."""

    def __init__(self, dice: random.Random, rate: float) -> None:
        self.dice = dice
        self.rate = rate
        self.bus: Bus | None = None
        self._held_until = 0.0

    def __call__(self, number: int, frame: CanFrame) -> list[tuple[float, CanFrame]]:
        assert self.bus is not None
        now, times = self.bus.now, 1
        if self.dice.random() < self.rate:
            times = self.dice.choice((0, 1, 2))
            if times == 1:
                self._held_until = max(self._held_until, now + self.dice.random() * 0.25)
        return [(max(0.0, self._held_until - now), frame)] * times


def tried(conversation: Generator[Any, Any, Any]) -> Generator[Any, Any, Any]:
    """The result, or how it failed."""
    try:
        return (yield from conversation)
    except (SdoAbort, NoAnswer) as error:
        return error


def world(seed: int) -> int:
    """Ten transfers in bad weather; how many of them succeeded."""
    dice = random.Random(seed)
    store, worked = Store(), 0
    server = SdoServer(5, store, blksize=dice.choice((0, 1, 2, 3, 5, 127)))
    storm = Storm(dice, dice.choice((0.0, 0.02, 0.1, 0.3)))
    bus = storm.bus = Bus(server, weather=storm)
    channel = Channel(5)
    known = {store.objects[0x2100, 0]}
    for _ in range(10):
        block: BlockMode = dice.choice(
            (False, True, "auto", BlockSettings(size=dice.choice((1, 2, 3)), switch=dice.choice((0, 30))))
        )
        timeout = dice.choice((0.3, 1.0))
        if dice.random() < 0.5:
            value = dice.randbytes(dice.choice(LENGTHS))
            known.add(value)
            data = value if dice.random() < 0.5 else [value[:3], value[3:]]
            result = bus.run(tried(download(channel, 0x2100, 0, data, block=block, timeout=timeout)))
            assert isinstance(result, Exception) or store.objects[0x2100, 0] == value
        else:
            result = bus.run(tried(upload(channel, 0x2100, block=block, timeout=timeout)))
            assert isinstance(result, Exception) or result == store.objects[0x2100, 0]
        assert store.objects[0x2100, 0] in known
        worked += not isinstance(result, Exception)
    bus.weather = None
    bus.rest(5.0)
    assert server.deadline is None
    for block in (False, True):
        bus.run(download(channel, 0x2100, 0, b"the next one", block=block))
        assert bus.run(upload(channel, 0x2100, block=block)) == b"the next one"
    return worked


def test_nothing_false_in_a_thousand_bad_days() -> None:
    worked = sum(world(seed) for seed in range(1000))
    assert 6000 < worked < 9500  # the weather was bad, and not so bad that nothing was tested


@pytest.mark.parametrize("late", [0.0, 0.00005, 0.0001, 0.00015, 0.0002, 0.0003, 0.0005, 0.05])
def test_an_answer_after_a_refusal_confirms_nothing(late: float) -> None:
    """The request came twice, and the server was in the middle of something: it refuses one and takes the other."""

    def twice(number: int, frame: CanFrame) -> list[tuple[float, CanFrame]]:
        return [(0.0, frame), (late, frame)] if number == 0 else [(0.0, frame)]

    store = Store()
    server = SdoServer(5, store)
    server.feed(CanFrame.parse("605#4000210000000000"), 0.0)  # somebody who went away
    bus = Bus(server, weather=twice)
    channel = Channel(5)
    with pytest.raises(SdoAbort, match="0504 0001h"):
        bus.run(download(channel, 0x2100, 0, [b"ab", b"cd"]))
    result = bus.run(tried(download(channel, 0x2100, 0, b"next")))
    assert isinstance(result, Exception) or store.objects[0x2100, 0] == b"next"
    bus.run(download(channel, 0x2100, 0, b"more"))
    assert store.objects[0x2100, 0] == b"more"
