"""Several open requests on one connection, in any order and as datagrams."""

from __future__ import annotations

import random

from hypothesis import given, strategies as st

from barewire.modbus import Adu
from barewire.tcp import FanOut, encode
from tests.helpers import modest


@modest
@given(seed=st.integers(0, 10_000), cut=st.integers(1, 40), datagrams=st.booleans())
def test_each_response_reaches_its_line_in_any_order_and_chunks(seed: int, cut: int, datagrams: bool) -> None:
    dice = random.Random(seed)
    fan = FanOut(16, datagrams=datagrams)
    for _ in range(3):
        asked = [line.request(1, b"\x03\x00\x00\x00\x01") for line in fan.lines]
        order = dice.sample(range(16), 16)
        answers = [encode(1, bytes([3, 2, 0, place]), int.from_bytes(asked[place][:2], "big")) for place in order]
        stream = b"".join(answers)
        parts = answers if datagrams else [stream[start : start + cut] for start in range(0, len(stream), cut)]
        received = [pair for part in parts for pair in fan.feed(part)]
        assert [place for place, _ in received] == order
        for place, frame in received:
            (adu,) = fan.lines[place].feed(frame, 0.0)
            assert isinstance(adu, Adu)
            assert fan.lines[place].answers(adu)
            assert adu.pdu[3] == place


def test_a_response_without_request_is_counted_and_dropped() -> None:
    fan = FanOut(2)
    fan.lines[0].request(1, b"\x07")
    assert fan.feed(encode(1, b"\x07\x00", 99)) == []
    assert fan.strays == 1


def test_a_transaction_number_in_use_is_not_used_again() -> None:
    fan = FanOut(2)
    first = fan.lines[0].request(1, b"\x07")
    numbers = {fan.lines[1].request(1, b"\x07")[:2] for _ in range(0x10000)}
    assert first[:2] not in numbers
    assert len(numbers) == 0xFFFF


def test_an_invalid_header_goes_to_every_line() -> None:
    fan = FanOut(3)
    for line in fan.lines:
        line.request(1, b"\x07")
    for place, data in fan.feed(b"\x00\x01\x12\x34\x00\x03"):
        fan.lines[place].feed(data, 0.0)
    assert all(line.broken is not None for line in fan.lines)
