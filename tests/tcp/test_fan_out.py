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


def test_a_response_without_request_is_counted_reported_and_dropped() -> None:
    fan, reported = FanOut(2), list[bytes]()
    fan.lines[0].request(1, b"\x07")
    assert fan.feed(encode(1, b"\x07\x00", 99)) == []
    fan.on_stray = reported.append
    assert fan.feed(encode(1, b"\x07\x00", 98)) == []
    assert fan.strays == 2
    assert reported == [encode(1, b"\x07\x00", 98)]


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


def test_transaction_numbers_begin_with_1_and_ascend_over_all_lines() -> None:
    fan = FanOut(2)
    numbers = [fan.lines[place].request(1, b"\x07")[:2].hex() for place in (0, 1, 0, 1)]
    assert numbers == ["0001", "0002", "0003", "0004"]


def test_both_bytes_of_a_transaction_number_decide() -> None:
    fan = FanOut(2)
    for _ in range(0x101):
        fan.lines[0].request(1, b"\x07")
    fan.lines[1].request(1, b"\x07")  # 0102h
    frame = encode(1, b"\x07\x00", 0x0102)
    assert fan.feed(encode(1, b"\x07\x00", 0x0202) + encode(1, b"\x07\x00", 0x0002) + frame) == [(1, frame)]
    assert fan.strays == 2


def test_an_answered_number_of_a_line_is_forgotten_with_its_next_request() -> None:
    fan = FanOut(1)
    fan.lines[0].request(1, b"\x07")
    fan.lines[0].request(1, b"\x07")
    assert fan.feed(encode(1, b"\x07\x00", 1)) == []
    assert fan.strays == 1


def test_frames_before_an_invalid_header_arrive_and_no_byte_is_kept_after_it() -> None:
    fan = FanOut(2)
    fan.lines[1].request(1, b"\x07")
    good, broken = encode(1, b"\x07\x00", 1), bytes.fromhex("0001 1234 0003 0107 00")
    assert fan.feed(good + broken) == [(1, good), (0, broken), (1, broken)]
    assert fan.feed(good) == [(1, good)]


def test_a_length_of_the_header_outside_2_to_254_is_invalid() -> None:
    for length, is_valid in ((1, False), (2, True), (254, True), (255, False)):
        fan = FanOut(1)
        fan.feed(bytes.fromhex("0001 0000") + length.to_bytes(2, "big") + bytes(length))
        assert fan.strays == is_valid, length


def test_datagrams_are_not_joined_and_their_lines_never_break() -> None:
    fan = FanOut(2, datagrams=True)
    fan.lines[0].request(1, b"\x07")
    good = encode(1, b"\x07\x00", 1)
    assert fan.feed(b"") == []
    assert fan.strays == 0
    assert fan.feed(good[:6]) == []
    assert fan.strays == 1
    assert fan.feed(good[:7]) == [(0, good[:7])]
    assert fan.feed(bytes.fromhex("0001 1234 0003 010700")) == [(0, bytes.fromhex("0001 1234 0003 010700"))]
    fan.lines[0].feed(bytes.fromhex("0001 1234 0003 010700"), 0.0)
    assert fan.lines[0].broken is None


def test_lines_take_answers_of_any_unit_on_request() -> None:
    for any_unit in (False, True):
        fan = FanOut(1, any_unit=any_unit)
        fan.lines[0].request(1, b"\x07")
        assert fan.lines[0].answers(Adu(2, b"\x07\x00", 1)) is any_unit
    by_default = FanOut(1)
    by_default.lines[0].request(1, b"\x07")
    assert not by_default.lines[0].answers(Adu(2, b"\x07\x00", 1))


def test_the_first_request_of_a_line_leaves_number_0_to_the_line_that_has_it() -> None:
    fan = FanOut(2)
    for _ in range(65536):
        last = fan.lines[0].request(1, b"\x07")
    assert last[:2] == b"\0\0"
    fan.lines[1].request(1, b"\x07")
    answer = encode(1, b"\x07\x6d", 0)
    assert fan.feed(answer) == [(0, answer)]


def test_the_first_transaction_number_can_be_chosen() -> None:
    fan = FanOut(2, first_number=0xFFFF)
    assert [line.request(1, b"\x07")[:2].hex() for line in fan.lines] == ["ffff", "0000"]
