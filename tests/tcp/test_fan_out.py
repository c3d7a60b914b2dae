"""Several open requests on one connection; other units and transactions; datagrams."""

from __future__ import annotations

import random

import pytest
from hypothesis import given, strategies as st

from barewire.modbus import Adu, Noise
from barewire.tcp import DatagramLine, FanOut, TcpLine, encode
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


@pytest.mark.parametrize(
    ("line", "adu", "fits"),
    [
        (TcpLine(), Adu(1, b"\x07", 1), True),
        (TcpLine(), Adu(2, b"\x07", 1), False),
        (TcpLine(), Adu(1, b"\x07", 2), False),
        (TcpLine(any_unit=True), Adu(2, b"\x07", 1), True),
        (TcpLine(any_unit=True), Adu(1, b"\x07", 2), False),
        (TcpLine(any_transaction=True), Adu(1, b"\x07", 2), True),
        (TcpLine(any_transaction=True), Adu(2, b"\x07", 1), False),
    ],
)
def test_other_units_and_transactions_are_accepted_on_request_only(line: TcpLine, adu: Adu, fits: bool) -> None:
    line.request(1, b"\x07")
    assert line.answers(adu) is fits
    assert line.numbered is not (line.answers(Adu(1, b"", 99)))


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (encode(1, b"\x07")[:-1], "short"),
        (encode(1, b"\x07") + b"\x00", "long"),
        (b"\x00\x01\x00\x02\x00\x02\x01\x07", "protocol"),
        (b"\x00\x01\x00\x00\x00\x00\x01\x07", "length"),
    ],
)
def test_a_datagram_is_a_frame_or_noise_and_the_next_one_begins_anew(data: bytes, reason: str) -> None:
    line = DatagramLine()
    (noise,) = line.feed(data, 0.0)
    assert isinstance(noise, Noise)
    assert (noise.data, noise.reason, line.held, line.broken) == (data, reason, b"", None)
    assert line.feed(encode(1, b"\x07", 5), 0.0) == [Adu(1, b"\x07", 5)]
