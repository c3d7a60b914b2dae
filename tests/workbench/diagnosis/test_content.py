"""Frames whose checksum or header is intact, and whose content is wrong: what the sender did."""

from __future__ import annotations

import pytest

from barewire import rtu
from barewire.rtu.crc import crc16
from barewire_workbench import explain


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
