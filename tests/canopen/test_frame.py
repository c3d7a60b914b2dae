"""A CAN frame: its limits, its key, its text."""

from __future__ import annotations

import pytest
from hypothesis import given, settings, strategies as st

from barewire.canopen import CanFrame, ErrorFrame, FdFrame
from barewire.errors import REASONS, DecodeError, EncodeError
from tests.helpers import every_case


@pytest.mark.parametrize(
    ("text", "frame"),
    [
        ("605#4000100000000000", CanFrame(0x605, bytes.fromhex("4000100000000000"))),
        ("000#0105", CanFrame(0, b"\1\5")),
        ("080#", CanFrame(0x80)),
        ("705#R", CanFrame(0x705, remote=True)),
        ("705#R1", CanFrame(0x705, remote=True, requested=1)),
        ("00000605#40", CanFrame(0x605, b"\x40", extended=True)),
        ("1FFFFFFF#R8", CanFrame(0x1FFFFFFF, extended=True, remote=True, requested=8)),
    ],
)
def test_str_and_parse(text: str, frame: CanFrame) -> None:
    assert CanFrame.parse(text) == frame
    assert str(frame) == text


def test_text_is_read_tolerantly() -> None:
    assert CanFrame.parse(" 05f#\n") == CanFrame(0x5F)
    assert CanFrame.parse("585#4b.41.60.00") == CanFrame(0x585, bytes.fromhex("4B416000"))


@every_case(
    ("text", "reason"),
    [
        ("", "delimiter"),
        ("605", "delimiter"),
        ("605##1112233", "value"),
        ("60#40", "length"),
        ("0605#40", "length"),
        ("800#", "value"),
        ("20000005#00", "value"),
        ("6G5#40", "character"),
        ("+05#40", "character"),
        ("605#4", "length"),
        ("605#4x", "character"),
        ("605#112233445566778899", "long"),
        ("705#R9", "value"),
        ("705#R11", "value"),
        ("605#ÄÖ", "character"),
    ],
)
def test_invalid_text_raises(text: str, reason: str) -> None:
    with pytest.raises(DecodeError) as caught:
        CanFrame.parse(text)
    assert caught.value.reason == reason


def test_base_and_extended_identifiers_differ() -> None:
    base, extended = CanFrame(0x605), CanFrame(0x605, extended=True)
    assert base.key != extended.key
    assert base != extended


def test_checked_refuses_impossible_frames() -> None:
    assert CanFrame.checked(0x7FF, bytes(8)).dlc == 8
    assert CanFrame.checked(0x705, remote=True, requested=1).dlc == 1
    with pytest.raises(EncodeError, match=r"800h: expected 0\.\.7FFh for a base frame"):
        CanFrame.checked(0x800)
    with pytest.raises(EncodeError, match="an extended frame"):
        CanFrame.checked(0x2000_0000, extended=True)
    with pytest.raises(EncodeError, match="at most 8"):
        CanFrame.checked(1, bytes(9))
    with pytest.raises(EncodeError, match="carries no data"):
        CanFrame.checked(1, b"1", remote=True)
    with pytest.raises(EncodeError, match="requested"):
        CanFrame.checked(1, requested=1)


@settings(max_examples=60)
@given(st.one_of(st.text(max_size=24), st.text("#R08abcdef", max_size=12)))
def test_any_text_is_a_frame_or_a_decode_error(text: str) -> None:
    try:
        frame = CanFrame.parse(text)
    except DecodeError as error:
        refusal: DecodeError = error
    else:
        assert CanFrame.parse(str(frame)) == frame
        return
    assert refusal.reason in REASONS
    assert 0 <= refusal.at <= len(refusal.data)


@settings(max_examples=60)
@given(st.from_regex(r"([0-7][0-9a-fA-F]{2}|[01][0-9a-fA-F]{7})#(R[0-8]?|([0-9a-fA-F]{2}){0,8})", fullmatch=True))
def test_a_frame_written_as_text_is_the_same_frame(text: str) -> None:
    frame = CanFrame.parse(text)
    assert CanFrame.parse(str(frame)) == frame
    assert text.upper().startswith(str(frame).partition("#")[0])


def test_fd_and_error_frames() -> None:
    assert str(FdFrame(0x605, b"\1\2", flags=1)) == "605##10102"
    assert str(FdFrame(0x605, b"\1", extended=True)) == "00000605##001"
    assert ErrorFrame(0x144).text == "controller problem, bus off, controller restarted"
    assert ErrorFrame(0).text == "error class 0h"
    with pytest.raises(DecodeError, match="CAN FD"):
        CanFrame.parse("605##10102")


def test_the_counters_of_an_error_frame() -> None:
    """CAN_ERR_CNT of linux/can/error.h: byte 6 counts transmit errors, byte 7 receive errors."""
    counters = ErrorFrame(0x200, bytes.fromhex("0000000000006007"))
    assert counters.counters == (0x60, 7)
    assert counters.text == "error counters (96 transmit, 7 receive)"
    both = ErrorFrame(0x204, bytes.fromhex("0020000000008001"))
    assert both.text == "controller problem, error counters (128 transmit, 1 receive)"
    for without in (ErrorFrame(0x04, bytes.fromhex("0020000000008001")), ErrorFrame(0x200, bytes(7)), ErrorFrame(0x40)):
        assert without.counters is None
    assert ErrorFrame(0x200, bytes(7)).text == "error counters"
