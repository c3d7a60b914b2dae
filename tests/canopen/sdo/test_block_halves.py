"""The sender and the receiver of a block transfer, each alone."""

from __future__ import annotations

from binascii import crc_hqx
from collections.abc import Callable, Iterator

import pytest

from barewire.canopen import AbortCode
from barewire.canopen.abort_codes import ProtocolViolation
from barewire.canopen.sdo import BlockAck, BlockEnd, BlockEnded
from barewire.canopen.sdo.block_transfer import FUTILE_MAX, STRAYS_MAX, BlockReceiver, BlockSender
from barewire.canopen.sdo.messages import LAST
from barewire.canopen.sdo.stream import Incoming, Outgoing
from tests.canopen.sdo.test_block import counting


def sender(length: int, blksize: int, burst: int = 99) -> BlockSender:
    return BlockSender(Outgoing([counting(length)], length), blksize, crc=True, timeout=1.0, burst=burst, now=0.0)


def numbers(frames: list[bytes]) -> list[str]:
    """Return command byte and first byte of data of each frame."""
    return [frame[:2].hex() for frame in frames]


def test_a_sender_listens_after_each_burst() -> None:
    half = sender(50, 6, burst=4)
    assert numbers(half.feed(None, 0.0)) == ["0100", "0207", "030e", "0415"]
    assert half.deadline == 0.0
    assert numbers(half.feed(None, 0.1)) == ["051c", "0623"]
    assert half.deadline == 1.1
    assert half.feed(None, 0.5) == []
    assert numbers(half.feed(BlockAck(6, 6), 0.6)) == ["012a", "8231"]
    assert numbers(half.feed(BlockAck(2, 6), 0.7)) == ["d9" + f"{crc_hqx(counting(50), 0) & 0xFF:02x}"]
    assert half.feed(BlockAck(2, 6), 0.8) == []  # a repeated acknowledgement
    assert half.feed(BlockEnded(), 0.9) == []
    assert half.over


def test_a_sender_accepts_an_early_acknowledgement() -> None:
    half = sender(50, 6, burst=1)
    assert numbers(half.feed(None, 0.0) + half.feed(None, 0.0) + half.feed(None, 0.0)) == ["0100", "0207", "030e"]
    assert numbers(half.feed(BlockAck(1, 2), 0.0) + half.feed(None, 0.0)) == ["0107", "020e"]
    assert numbers(half.feed(BlockAck(2, 127), 0.0) + half.feed(None, 0.0)) == ["0115", "021c"]


def test_a_sender_recognises_a_repeated_acknowledgement() -> None:
    half = sender(50, 6)
    half.feed(None, 0.0)
    half.feed(BlockAck(6, 6), 0.0)
    assert numbers(half.feed(BlockAck(6, 6), 0.7)) == ["012a", "8231"]
    with pytest.raises(ProtocolViolation, match="segment 5 was acknowledged, but only 2 were sent"):
        half.feed(BlockAck(5, 6), 0.8)


def test_a_sender_limits_how_often_it_starts_over() -> None:
    half = sender(50, 6)
    half.feed(None, 0.0)
    for _ in range(FUTILE_MAX):
        assert len(half.feed(BlockAck(0, 6), 0.5)) == 6
    with pytest.raises(ProtocolViolation, match="5 times no segment of a block was acknowledged"):
        half.feed(BlockAck(0, 6), 0.5)


def test_a_sender_times_out() -> None:
    half = sender(5, 6)
    half.feed(None, 0.0)
    assert half.feed(None, 0.9) == []
    with pytest.raises(ProtocolViolation) as caught:
        half.feed(None, 1.0)
    assert caught.value.code == AbortCode.TIMED_OUT


def receiver(blksize: int = 4) -> tuple[BlockReceiver, bytearray]:
    parts = bytearray()
    return BlockReceiver(Incoming(parts.extend, None), blksize, crc=True, timeout=1.0, now=0.0), parts


def segment(number: int, fill: int) -> bytes:
    return bytes([number]) + bytes([fill]) * 7


def test_a_receiver_ignores_segments_out_of_order() -> None:
    half, parts = receiver()
    for frame in (segment(2, 9), segment(4, 9), segment(1, 1), segment(1, 1), segment(3, 9), segment(2, 2)):
        assert half.feed(frame, 0.0) == []
    assert half.feed(segment(4, 9), 0.0) == [bytes.fromhex("A202040000000000")]
    assert parts == b"\1" * 7 + b"\2" * 7


def test_a_receiver_refuses_a_repeated_segment_with_different_data() -> None:
    half, _ = receiver()
    half.feed(segment(1, 1), 0.0)
    with pytest.raises(ProtocolViolation, match="segment 1 came again with different data"):
        half.feed(segment(1, 2), 0.0)


def test_a_receiver_acknowledges_after_silence() -> None:
    half, _ = receiver(2)
    half.feed(segment(1, 1), 0.0)
    half.feed(segment(2, 2), 1.0)  # acknowledged; nothing of the next block arrives: the acknowledgement may be lost
    assert half.deadline == pytest.approx(1.7)
    assert half.feed(None, 1.6) == []
    assert half.feed(None, 1.7) == [bytes.fromhex("A202020000000000")]
    assert half.feed(segment(2, 4), 2.0) == []  # its first segment was lost
    assert half.feed(None, 2.7) == [bytes.fromhex("A200020000000000")]
    assert half.feed(segment(1, 3), 2.8) == []
    assert half.feed(None, 3.5) == [bytes.fromhex("A201020000000000")]
    with pytest.raises(ProtocolViolation, match="no segment and no end within 1 s"):
        half.feed(None, 3.8)


def test_a_receiver_to_which_nothing_was_sent_acknowledges_nothing() -> None:
    half, _ = receiver()
    assert half.untouched
    assert half.feed(None, 0.7) == [bytes.fromhex("A200040000000000")]


def test_a_receiver_does_not_repeat_an_ambiguous_acknowledgement() -> None:
    """With one segment in a block, the acknowledgement or the next block may have been lost."""
    half, _ = receiver(1)
    assert half.feed(segment(1, 1), 0.0) == [bytes.fromhex("A201010000000000")]
    assert half.feed(None, 0.7) == []
    assert half.deadline == 1.0


def test_a_receiver_limits_segments_out_of_order() -> None:
    half, _ = receiver()
    for _ in range(STRAYS_MAX):
        assert half.feed(segment(3, 3), 0.0) == []
    with pytest.raises(ProtocolViolation, match="segments came out of order") as caught:
        half.feed(segment(3, 3), 0.0)
    assert caught.value.code == AbortCode.SEQUENCE_NUMBER


def test_a_receiver_limits_repeats_of_the_last_segment() -> None:
    half, _ = receiver()
    repeated = segment(1 | LAST, 1)
    half.feed(repeated, 0.0)
    for _ in range(STRAYS_MAX):
        assert half.feed(repeated, 0.0) == []
    with pytest.raises(ProtocolViolation, match="segments came out of order"):
        half.feed(repeated, 0.0)


# The rules, one by one.


def test_a_sender_counts_futile_blocks_from_its_last_progress() -> None:
    half = sender(500, 6)
    half.feed(None, 0.0)
    for _ in range(2):
        for _ in range(FUTILE_MAX):
            assert len(half.feed(BlockAck(0, 6), 0.5)) == 6
        assert len(half.feed(BlockAck(6, 6), 0.5)) == 6
    for _ in range(FUTILE_MAX):
        half.feed(BlockAck(0, 6), 0.5)
    with pytest.raises(ProtocolViolation) as caught:
        half.feed(BlockAck(0, 6), 0.5)
    assert caught.value.code == AbortCode.TIMED_OUT


def filled(*fills: int, last: bool = False) -> BlockReceiver:
    """Return a receiver of blocks of 4 that has these segments."""
    half, _ = receiver()
    for number, fill in enumerate(fills, 1):
        half.feed(segment(number | (LAST if last and number == len(fills) else 0), fill), 0.0)
    return half


@pytest.mark.parametrize(
    ("half", "frame", "code", "text"),
    [
        (lambda: filled(), segment(5, 1), AbortCode.SEQUENCE_NUMBER, "segment 5 came: expected 1..4"),
        (lambda: filled(), segment(0, 1), AbortCode.SEQUENCE_NUMBER, "segment 0 came: expected 1..4"),
        (lambda: filled(1, 2), segment(1, 2), AbortCode.SEQUENCE_NUMBER, "segment 1 came again with different data"),
        (lambda: filled(1, 2), segment(2, 1), AbortCode.SEQUENCE_NUMBER, "segment 2 came again with different data"),
        (
            lambda: filled(1, 2, last=True),
            segment(1, 2),
            AbortCode.COMMAND,
            "command 01h came instead of the end of the transfer",
        ),
        (
            lambda: filled(1, 2, last=True),
            segment(3, 2),
            AbortCode.COMMAND,
            "command 03h came instead of the end of the transfer",
        ),
        (
            lambda: filled(1, last=True),
            b"\xc1\x00",
            AbortCode.COMMAND,
            "command C1h came instead of the end of the transfer",
        ),
        (
            lambda: filled(1, last=True),
            bytes.fromhex("C1 34 12 00 00 00 00 00"),
            AbortCode.CRC,
            f"the CRC is 1234h, that of the received data {crc_hqx(bytes([1] * 7), 0):04X}h",
        ),
    ],
)
def test_a_receiver_refuses(half: Callable[[], BlockReceiver], frame: bytes, code: AbortCode, text: str) -> None:
    with pytest.raises(ProtocolViolation) as caught:
        half().feed(frame, 0.5)
    assert (caught.value.code, caught.value.why) == (code, text)


@pytest.mark.parametrize("last", [False, True])
def test_a_receiver_ignores_a_repeated_segment_with_the_same_data(last: bool) -> None:
    half = filled(1, 2, 3, last=last)
    for number in (1, 2, 3, 3 | LAST):
        assert half.feed(segment(number, number & ~LAST), 0.1) == []
    assert half.next_segment == (0 if last else 4)


def test_a_receiver_accepts_an_end_of_three_bytes() -> None:
    half = filled(1, last=True)
    assert half.feed(BlockEnd(0, crc_hqx(bytes([1] * 7), 0)).encode()[:3], 0.5) == [BlockEnded().encode()]
    assert half.over


@pytest.mark.parametrize(
    ("frame", "acknowledged"),
    [
        (segment(3, 0x80), False),
        (segment(3 | LAST, 0), True),  # the last segment, after a gap: nothing else will come
        (segment(4, 0), True),  # the end of the block
    ],
)
def test_a_receiver_acknowledges_what_it_has_when_the_block_ends_after_a_gap(frame: bytes, acknowledged: bool) -> None:
    assert filled(1).feed(frame, 0.1) == [BlockAck(1, 4).encode()] * acknowledged
    assert filled().feed(frame, 0.1) == []


@pytest.mark.parametrize(("blksize", "is_valid"), [(0, False), (1, True), (127, True), (128, False)])
def test_a_block_has_1_to_127_segments(blksize: int, is_valid: bool) -> None:
    if is_valid:
        assert len(sender(2000, blksize, burst=999).feed(None, 0.0)) == blksize
        return
    with pytest.raises(ProtocolViolation) as caught:
        sender(2000, blksize)
    assert caught.value.code == AbortCode.BLOCK_SIZE
    assert caught.value.why == f"a block of {blksize} segments was requested: expected 1..127"


def test_a_sender_takes_no_more_of_the_value_than_it_can_send_in_one_block() -> None:
    taken = 0

    def pieces() -> Iterator[bytes]:
        nonlocal taken
        for _ in range(100):
            taken += 7
            yield bytes(7)

    half = BlockSender(Outgoing(pieces(), None), 4, crc=True, timeout=1.0, burst=99, now=0.0)
    for acknowledged in range(8):
        assert 7 * (acknowledged + 4) <= taken <= 7 * (acknowledged + 5)
        half.feed(None, 0.0)
        half.feed(BlockAck(1, 4), 0.0)


def test_a_sender_says_what_was_not_acknowledged_or_came_too_early() -> None:
    half = sender(5, 6)
    half.feed(None, 0.0)
    with pytest.raises(ProtocolViolation) as early:
        half.feed(BlockEnded(), 0.1)
    assert (early.value.code, early.value.why) == (
        AbortCode.COMMAND,
        "the receiver ended the transfer before its end",
    )
    with pytest.raises(ProtocolViolation) as block:
        half.feed(None, 1.0)
    assert block.value.why == "no acknowledgement of the block within 1 s"
    assert len(half.feed(BlockAck(1, 6), 1.0)) == 1
    with pytest.raises(ProtocolViolation) as end:
        half.feed(None, 2.0)
    assert end.value.why == "no acknowledgement of the end within 1 s"


def test_a_sender_refuses_the_acknowledgement_of_a_segment_that_was_not_sent() -> None:
    half = sender(50, 6, burst=2)
    half.feed(None, 0.0)
    with pytest.raises(ProtocolViolation) as caught:
        half.feed(BlockAck(3, 6), 0.1)
    assert caught.value.code == AbortCode.SEQUENCE_NUMBER
    assert caught.value.why == "segment 3 was acknowledged, but only 2 were sent"


def test_a_receiver_moves_its_deadline_at_most_64_times_in_a_time_out() -> None:
    half, _ = receiver(8)
    for number, (now, deadline) in enumerate(
        [(1 / 128, 0.7), (1 / 64, 0.7 + 1 / 64), (3 / 128, 0.7 + 1 / 64), (1 / 32, 0.7 + 1 / 32)], 1
    ):
        assert half.accept(segment(number, number), now)
        assert half.deadline == deadline
    assert not half.accept(segment(4, 4), 0.5), "not the next one, so it is for `feed`"
    for now, deadline in ((5 / 128, 0.7 + 1 / 32), (3 / 64, 0.7 + 3 / 64)):
        half.feed(segment(4, 4), now)
        assert half.deadline == deadline
