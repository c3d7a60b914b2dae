"""The framing of a TCP connection by the length in the header; an invalid header breaks the line; datagrams."""

from __future__ import annotations

import pytest
from hypothesis import given, strategies as st

from barewire.modbus import Adu, Noise
from barewire.tcp import DatagramLine, TcpLine, decode, encode
from tests.helpers import Chunk, accounts_for_every_byte, chunked, deliveries, feed_all, modest, spaced, unhex

SHORT = encode(1, b"\x07", 1)
READ = encode(255, unhex("03 006B 0003"), 0xABCD)
LONGEST = encode(0, b"\x03" + bytes(range(252)), 0xFFFF)
FRAMES = [pytest.param(SHORT, id="short"), pytest.param(READ, id="read"), pytest.param(LONGEST, id="longest")]


@pytest.mark.parametrize("frame", FRAMES)
def test_a_frame_is_the_same_however_it_is_delivered(frame: bytes) -> None:
    for parts in deliveries(frame):
        line = TcpLine()
        assert feed_all(line, spaced(parts, 10.0)) == [decode(frame)]
        assert (line.held, line.deadline, line.broken) == (b"", None, None)


@pytest.mark.parametrize("frame", FRAMES)
def test_frames_glued_together_are_separated(frame: bytes) -> None:
    for parts in deliveries(frame + READ + SHORT):
        assert feed_all(TcpLine(), spaced(parts, 0.0)) == [decode(frame), decode(READ), decode(SHORT)]


@pytest.mark.parametrize("parts", range(1, len(READ)))
def test_an_unfinished_frame_is_held(parts: int) -> None:
    line = TcpLine()
    assert line.feed(READ[:parts], 1.0) == []
    assert line.feed(None, 1e9) == []
    assert line.held == READ[:parts]


@pytest.mark.parametrize(
    ("noise", "reason"),
    [
        ("0001 0001 0006 01 03", "protocol"),
        ("0001 0000 0000 01 03", "length"),
        ("0001 0000 0001 01 03", "length"),
        ("0001 0000 00FF 01 03", "length"),
        ("01 03 00 00 00 01 84 0A", "length"),  # an RTU frame
        ("47 45 54 20 2F 20 48 54", "protocol"),  # an HTTP request
    ],
)
def test_an_invalid_header_breaks_the_line_permanently(noise: str, reason: str) -> None:
    for parts in deliveries(unhex(noise)):
        line = TcpLine()
        events = feed_all(line, spaced([SHORT, *parts, READ], 0.0))
        assert line.broken is not None
        assert line.broken.reason == reason
        assert events[0] == decode(SHORT)
        assert all(isinstance(event, Noise) and event.reason == reason for event in events[1:])
        assert b"".join(event.data for event in events[1:] if isinstance(event, Noise)) == unhex(noise) + READ
        assert line.held == b""


def test_the_invalid_header_is_reported() -> None:
    line = TcpLine()
    line.feed(unhex("0001 0001 0006 01 03"), 1.0)
    assert str(line.broken) == (
        "protocol identifier is 00 01, Modbus has 00 00 (protocol, at byte 2 of 00 01 00 01 00 06)"
    )


def test_transactions_count_up_and_wrap() -> None:
    line = TcpLine()
    numbers = [decode(line.request(1, b"\x07")).transaction for _ in range(0x10002)]
    assert numbers[:2] == [1, 2]
    assert numbers[0xFFFE:] == [0xFFFF, 0, 1, 2]


@pytest.mark.parametrize(
    ("adu", "right"),
    [
        (Adu(7, b"\x07\x00", 2), True),
        (Adu(7, b"\x07\x00", 1), False),
        (Adu(8, b"\x07\x00", 2), False),
        (Adu(7, b"\x07\x00", None), False),
    ],
)
def test_an_answer_has_the_last_transaction_and_the_unit(adu: Adu, right: bool) -> None:
    line = TcpLine()
    line.request(7, b"\x07")
    line.request(7, b"\x07")
    assert line.answers(adu) is right


@pytest.mark.parametrize(
    ("any_unit", "any_transaction", "adu", "fits"),
    [
        (False, False, Adu(1, b"\x07", 1), True),
        (False, False, Adu(2, b"\x07", 1), False),
        (False, False, Adu(1, b"\x07", 2), False),
        (True, False, Adu(2, b"\x07", 1), True),
        (True, False, Adu(1, b"\x07", 2), False),
        (False, True, Adu(1, b"\x07", 2), True),
        (False, True, Adu(2, b"\x07", 1), False),
    ],
)
def test_other_units_and_transactions_are_accepted_on_request_only(
    any_unit: bool, any_transaction: bool, adu: Adu, fits: bool
) -> None:
    line = TcpLine(any_unit=any_unit, any_transaction=any_transaction)
    line.request(1, b"\x07")
    assert line.answers(adu) is fits
    assert line.numbered is not (line.answers(Adu(1, b"", 99)))


def test_a_response_has_the_unit_and_transaction_of_its_request() -> None:
    assert TcpLine().response(Adu(7, b"\x07", 0xABCD), unhex("07 6D")) == encode(7, unhex("07 6D"), 0xABCD)


def test_tcp_needs_no_silence_before_sending() -> None:
    line = TcpLine()
    line.sent(5.0)
    line.feed(READ, 6.0)
    assert line.quiet_at <= 6.0


SEGMENTS = st.one_of(
    st.binary(max_size=20),
    st.sampled_from([SHORT, READ, READ[:3], READ[3:], READ[:9], READ[9:], LONGEST, SHORT + READ + LONGEST]),
)


@modest
@given(chunked(SEGMENTS, longest_pause=100.0))
def test_every_byte_is_in_a_frame_in_noise_or_held(chunks: list[Chunk]) -> None:
    accounts_for_every_byte(TcpLine(), chunks, lambda adu: encode(adu.unit, adu.pdu, adu.transaction or 0), bound=259)


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
