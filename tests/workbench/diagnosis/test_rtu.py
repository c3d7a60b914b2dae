"""The trials of a frame: one change that makes it good, what is wrong although its CRC fits, nothing for a good one."""

from __future__ import annotations

import random
import time
from collections import Counter

import pytest
from hypothesis import given, settings, strategies as st

from barewire import rtu
from barewire.rtu.crc import crc16
from barewire_workbench import explain
from barewire_workbench.diagnosis.rtu import changed_bytes, extra_bytes, lost_bytes
from tests.helpers import part_or_whole
from tests.workbench.diagnosis.made_frames import made_frames

quick = settings(max_examples=30, deadline=None, derandomize=True, database=None)
FRAMES = st.builds(rtu.encode, st.integers(0, 255), st.binary(min_size=1, max_size=6))


@quick
@given(st.one_of(FRAMES, st.binary(min_size=1, max_size=9)), st.data())
def test_the_search_finds_what_trying_every_change_finds(frame: bytes, data: st.DataObject) -> None:
    at = data.draw(st.integers(0, len(frame) - 1))
    damaged = data.draw(st.sampled_from([frame, frame[:at] + frame[at + 1 :], frame[:at] + b"\x55" + frame[at:]]))
    places, values = range(len(damaged)), [bytes((value,)) for value in range(256)]
    without = {damaged[:at] + damaged[at + 1 :] for at in places}
    changed = {damaged[:at] + value + damaged[at + 1 :] for at in places for value in values} - {damaged}
    longer = {damaged[:at] + value + damaged[at:] for at in range(len(damaged) + 1) for value in values}
    assert {fit.frame for fit in extra_bytes(damaged)} == {frame for frame in without if not crc16(frame)}
    assert {fit.frame for fit in changed_bytes(damaged)} == {frame for frame in changed if not crc16(frame)}
    assert {fit.frame for fit in lost_bytes(damaged)} == {frame for frame in longer if not crc16(frame)}


@quick
@given(FRAMES, st.data())
def test_a_damaged_frame_is_found_again(frame: bytes, data: st.DataObject) -> None:
    at = data.draw(st.integers(0, len(frame) - 1))
    bit = data.draw(st.integers(0, 7))
    flipped = bytearray(frame)
    flipped[at] ^= 1 << bit
    assert (at, frame[at], frame) in list(changed_bytes(bytes(flipped)))
    assert frame in [fit.frame for fit in lost_bytes(frame[:at] + frame[at + 1 :])]
    assert frame in [fit.frame for fit in extra_bytes(frame[:at] + b"\x99" + frame[at:])]


def with_crc(data: str) -> bytes:
    return (body := bytes.fromhex(data)) + crc16(body).to_bytes(2, "little")


@pytest.mark.parametrize(
    ("body", "role", "code", "words"),
    [
        ("03 0000 000A", None, "byte-lost", "the unit is missing, also in the CRC"),
        ("01 03 0002 1781", "response", "byte-count", "the byte count has two bytes, 00 02"),
        ("01 03 0000 0000 0000 0001", "response", "byte-count", "the byte count is missing, also in the CRC"),
        ("01 03 0000 000A FF", None, "byte-extra", "1 byte behind the PDU, FF"),
        ("6A 10 0001", "response", "cut-frame", "2 bytes are to come, but the CRC fits what is there"),
        ("01 03 0A00 0A00", None, "address-byte-order", "the quantity has its low byte first"),
        ("01 05 0001 00FF", None, "address-byte-order", "the coil value has its low byte first"),
        ("01 03 08 000100020003", None, "byte-count", "the byte count is 08h (8), and 6 bytes follow"),
    ],
)
def test_the_crc_fits_and_the_content_does_not(body: str, role: str | None, code: str, words: str) -> None:
    first = explain("rtu", with_crc(body), role).diagnosis[0]
    assert (first.code, words in first.text) == (code, True), first


@pytest.mark.parametrize(
    ("frame", "code", "words"),
    [
        ("0001 0000 06 01 03 0000 000A", "byte-lost", "a byte 00 of the header is missing"),
        ("1234 000000 0006 01 03 0000 000A", "noise-before", "1 byte before the frame: 12"),
        ("0001 0000 0008 01 03 04 0001 0002 5F", "byte-extra", "1 byte behind the PDU, 5F"),
        ("0001 0000 0600 FF 01 0000 0000", "header-byte-order", "06 00; the high byte goes first"),
        ("0001 0000 0004 FF 30 31", "cut-frame", "the beginning of a frame, 1 byte to come"),
        ("0001 0000 0006 01 03 0A00 0A00", "address-byte-order", "the quantity has its low byte first"),
        ("0001 0000 0007 01 03 08 0001 0002", "byte-count", "the byte count is 08h (8), and 4 bytes follow"),
        ("0001 0001 0006 01 03 0000 000A", "mbap-header", "the protocol identifier is 00 01"),
        ("4500 0034 0000 0000 4006 0000 7F000001 7F000001" + "00" * 20 + "0001 0000 0006 01 03 0000 000A",
         "noise-before", "IP and TCP headers, 40 bytes, before the frame"),
    ],
)  # fmt: skip
def test_the_header_or_the_content_of_a_tcp_frame_is_wrong(frame: str, code: str, words: str) -> None:
    first = explain("tcp", bytes.fromhex(frame)).diagnosis[0]
    assert (first.code, words in first.text) == (code, True), first


def test_one_byte_of_the_crc_left_in_a_tcp_frame_is_told_from_any_byte() -> None:
    body = bytes.fromhex("01 03 04 0001 0002")
    crc = crc16(body) & 0xFF
    codes = {
        last: explain("tcp", bytes.fromhex("0001 0000 0008") + body + bytes((last,))).diagnosis[0].code
        for last in (crc, crc ^ 1)
    }
    assert codes == {crc: "crc-inside-mbap", crc ^ 1: "byte-extra"}


def test_two_refusals_of_functions_that_do_not_exist_are_two_frames() -> None:
    frames = rtu.encode(33, b"\x80\x01") + rtu.encode(33, b"\x8a\x01")
    assert explain("rtu", frames).diagnosis[0].code == "two-frames"


@pytest.mark.parametrize("count", part_or_whole(500, 2000))
@pytest.mark.parametrize("framing", ["rtu", "ascii", "tcp"])
def test_good_frames_have_no_findings(framing: str, count: int) -> None:
    functions = set()
    for frame, role in made_frames(framing, count, seed=20261123):
        for stated in (None, role):
            explanation = explain(framing, frame, stated)
            assert explanation.valid, explanation.lines()
            assert explanation.diagnosis == ()
        functions.add((explanation.fields[1 if framing == "rtu" else 2 if framing == "ascii" else 4].value, role))
    assert len(functions) > 30


@pytest.mark.parametrize("framing", ["rtu", "ascii", "tcp"])
def test_random_bytes_have_hardly_any_findings(framing: str) -> None:
    """A function code and a length fit by chance now and then, and then the bytes can be a cut frame."""
    dice, found = random.Random(1), Counter[str]()
    for _ in range(8 if framing == "rtu" else 100):
        data = dice.randbytes(dice.randint(4, 20))
        found.update(finding.code for finding in explain(framing, data).diagnosis[:1])
    assert sum(found.values()) <= 1, found


@pytest.mark.parametrize(
    ("framing", "data"),
    [
        ("rtu", b"\x01\x03" * 128),
        ("rtu", bytes(256)),
        ("rtu", b"\xaa" * 48),
        ("rtu", bytes.fromhex("01 03 00 00 00 0A C5 CE") * 32),
        ("rtu", b"\x01\x10\x00\x00\x00\x7b\xf6" + bytes(range(247)) + b"\x12\x34"),
        ("ascii", b":" + b"0" * 511 + b"\r\n"),
        ("ascii", b":01" * 171),
        ("tcp", bytes(260)),
        ("tcp", bytes.fromhex("00 00 00 00 00 02") * 43),
    ],
)
def test_the_longest_frames_are_diagnosed_in_a_moment(framing: str, data: bytes) -> None:
    begun = time.process_time()
    explain(framing, data)
    assert time.process_time() - begun < 1
