"""SDO messages and abort codes: every command byte of an initiate, both ways, and every way to say no."""

from __future__ import annotations

import pytest

from barewire.canopen import AbortCode, SdoAbort, abort_text, fit
from barewire.canopen.sdo import (
    AZ3,
    STANDARD,
    Abort,
    DownloadInitiated,
    ExpeditedDownload,
    ExpeditedUpload,
    InitiateDownload,
    InitiateUpload,
    UploadInitiated,
    decode_answer,
    decode_request,
)
from barewire.errors import DecodeError, EncodeError, Refused


def raw(text: str) -> bytes:
    return bytes.fromhex(text)


REQUESTS = [
    ("40 00 10 00 00 00 00 00", InitiateUpload(0x1000, 0)),
    ("2F 60 60 00 03 00 00 00", ExpeditedDownload(0x6060, 0, b"\3")),
    ("2B 40 60 00 0F 00 00 00", ExpeditedDownload(0x6040, 0, raw("0F00"))),
    ("27 00 20 01 11 22 33 00", ExpeditedDownload(0x2000, 1, raw("112233"))),
    ("23 FF 60 00 A8 61 00 00", ExpeditedDownload(0x60FF, 0, raw("A8610000"))),
    ("22 17 10 00 E8 03 00 00", ExpeditedDownload(0x1017, 0, raw("E8030000"), indicated=False)),
    ("21 17 10 00 02 00 00 00", InitiateDownload(0x1017, 0, 2)),
    ("20 17 10 00 00 00 00 00", InitiateDownload(0x1017, 0)),
    ("80 41 60 00 00 00 04 05", Abort(0x6041, 0, 0x05040000)),
]

ANSWERS = [
    ("4F 61 60 00 03 00 00 00", ExpeditedUpload(0x6061, 0, b"\3")),
    ("4B 41 60 00 37 06 00 00", ExpeditedUpload(0x6041, 0, raw("3706"))),
    ("47 00 20 01 11 22 33 00", ExpeditedUpload(0x2000, 1, raw("112233"))),
    ("43 00 10 00 91 01 0F 00", ExpeditedUpload(0x1000, 0, raw("91010F00"))),
    ("42 00 10 00 91 01 0F 00", ExpeditedUpload(0x1000, 0, raw("91010F00"), indicated=False)),
    ("41 08 10 00 10 00 00 00", UploadInitiated(0x1008, 0, 16)),
    ("40 08 10 00 00 00 00 00", UploadInitiated(0x1008, 0)),
    ("60 17 10 00 00 00 00 00", DownloadInitiated(0x1017, 0)),
    ("80 41 60 00 00 00 02 06", Abort(0x6041, 0, 0x06020000)),
]


@pytest.mark.parametrize(("text", "message"), REQUESTS)
def test_requests_both_ways(text: str, message: InitiateUpload) -> None:
    assert message.encode() == raw(text)
    assert decode_request(raw(text)) == message


@pytest.mark.parametrize(("text", "message"), ANSWERS)
def test_answers_both_ways(text: str, message: ExpeditedUpload) -> None:
    assert message.encode() == raw(text)
    assert decode_answer(raw(text)) == message


@pytest.mark.parametrize("command", ["43", "4B", "4F", "5F", "41"])
def test_reserved_bits_of_an_upload_request_are_read_over(command: str) -> None:
    assert decode_request(raw(f"{command} 40 60 00 00 00 00 00")) == InitiateUpload(0x6040, 0, int(command, 16))


@pytest.mark.parametrize("command", ["00", "60", "A0", "C0", "E0", "FF"])
def test_commands_that_start_nothing_known(command: str) -> None:
    with pytest.raises(DecodeError) as caught:
        decode_request(raw(f"{command} 40 60 00 00 00 00 00"))
    assert (caught.value.reason, caught.value.at) == ("function", 0)


@pytest.mark.parametrize("command", ["00", "20", "A0", "C0", "E0"])
def test_commands_that_answer_nothing_known(command: str) -> None:
    with pytest.raises(DecodeError) as caught:
        decode_answer(raw(f"{command} 40 60 00 00 00 00 00"))
    assert caught.value.reason == "function"


def test_trimmed_answers_are_read_as_far_as_they_need_to_go() -> None:
    assert decode_answer(raw("60 17 10 00")) == DownloadInitiated(0x1017, 0)
    assert decode_answer(raw("4B 41 60 00 37 06")) == ExpeditedUpload(0x6041, 0, raw("3706"))
    for text in ("", "4B", "4B 41 60", "4B 41 60 00 37", "42 41 60 00 37 06 00", "80 41 60 00 00 00 02", "41 08 10 00"):
        with pytest.raises(DecodeError) as caught:
            decode_answer(raw(text))
        assert caught.value.reason == "short"


def test_what_cannot_be_said() -> None:
    for data in (b"", bytes(5)):
        with pytest.raises(EncodeError, match="carries 1 to 4"):
            ExpeditedDownload(0x1017, 0, data).encode()
    with pytest.raises(EncodeError, match="give 4"):
        ExpeditedUpload(0x1017, 0, b"12", indicated=False).encode()
    with pytest.raises(EncodeError, match="index"):
        InitiateUpload(0x10000, 0).encode()
    with pytest.raises(EncodeError, match="sub"):
        InitiateUpload(0x1000, 256).encode()
    with pytest.raises(EncodeError, match="does not ask for an upload"):
        InitiateUpload(0x1000, 0, 0x23).encode()


def test_there_are_31_abort_codes_and_each_survives_the_wire() -> None:
    assert len(AbortCode) == 31
    assert len({code.text for code in AbortCode}) == 31
    for code in AbortCode:
        said = decode_answer(Abort(0x6041, 2, code).encode())
        assert said == Abort(0x6041, 2, code)
        refusal = SdoAbort(code, 0x6041, 2)
        assert isinstance(refusal, Refused)
        assert str(refusal) == f"6041h:02: {code >> 16:04X} {code & 0xFFFF:04X}h {code.text}"


def test_an_unknown_code_keeps_its_number() -> None:
    assert abort_text(0xDEADBEEF) == "DEAD BEEFh unknown abort code"
    assert SdoAbort(0xDEADBEEF, 0x1000, 0).code == 0xDEADBEEF
    assert decode_answer(Abort(0x1000, 0, 0xDEADBEEF).encode()) == Abort(0x1000, 0, 0xDEADBEEF)


def test_an_abort_about_another_object_says_so() -> None:
    refusal = SdoAbort(0x05040001, 0x1017, 0, (0x1000, 4))
    assert str(refusal).endswith("unknown (the abort names 1000h:04)")
    assert refusal.said == (0x1000, 4)


def test_dialects_ask_in_their_own_way() -> None:
    assert [STANDARD.read_command(size) for size in (1, 2, 3, 4, 8, None)] == [0x40] * 6
    assert [AZ3.read_command(size) for size in (1, 2, 4, None)] == [0x4F, 0x4B, 0x43, 0x43]
    with pytest.raises(EncodeError, match="cannot ask for 3 bytes"):
        AZ3.read_command(3)


@pytest.mark.parametrize(
    ("data", "size", "value"),
    [("06000000", 2, "0600"), ("FBFFFFFF", 2, "FBFF"), ("3706", 2, "3706"), ("0F000000", 1, "0F")],
)
def test_fit_cuts_what_is_nothing(data: str, size: int, value: str) -> None:
    assert fit(raw(data), size) == raw(value)


@pytest.mark.parametrize(
    ("data", "size", "reason"),
    [("06000100", 2, "long"), ("0600FFFF", 2, "long"), ("06", 2, "short"), ("06", 0, "length")],
)
def test_fit_never_changes_a_value(data: str, size: int, reason: str) -> None:
    with pytest.raises(DecodeError) as caught:
        fit(raw(data), size)
    assert caught.value.reason == reason
