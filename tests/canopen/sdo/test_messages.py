"""SDO messages and abort codes: every command byte of an initiate message, and every abort code."""

from __future__ import annotations

import pytest

from barewire.canopen import AbortCode, SdoAbort, abort_text, fit
from barewire.canopen.sdo import (
    STANDARD,
    Abort,
    BlockAck,
    BlockDownloadInitiated,
    BlockEnd,
    BlockEnded,
    BlockSegment,
    BlockUploadInitiated,
    DownloadInitiated,
    ExpeditedDownload,
    ExpeditedUpload,
    InitiateBlockDownload,
    InitiateBlockUpload,
    InitiateDownload,
    InitiateUpload,
    NextSegment,
    SdoSegment,
    SegmentTaken,
    StartBlockUpload,
    UploadInitiated,
    decode_sdo_request,
    decode_sdo_response,
)
from barewire.canopen.sdo.messages import SdoMessage, decode_one_of
from barewire.devices.sdo_dialects import AZ3
from barewire.errors import DecodeError, EncodeError, Refused
from tests.helpers import every_case


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
def test_requests_encode_and_decode(text: str, message: InitiateUpload) -> None:
    assert message.encode() == raw(text)
    assert decode_sdo_request(raw(text)) == message


@pytest.mark.parametrize(("text", "message"), ANSWERS)
def test_responses_encode_and_decode(text: str, message: ExpeditedUpload) -> None:
    assert message.encode() == raw(text)
    assert decode_sdo_response(raw(text)) == message


SEGMENTS = [
    ("00 43 41 4E 6F 70 65 6E", SdoSegment(0, b"CANopen")),
    ("10 44 65 6D 6F 50 49 43", SdoSegment(1, b"DemoPIC")),
    ("0B 33 32 00 00 00 00 00", SdoSegment(0, b"32", last=True)),
    ("0F 00 00 00 00 00 00 00", SdoSegment(0, b"", last=True)),
    ("1D 33 00 00 00 00 00 00", SdoSegment(1, b"3", last=True)),
    ("60 00 00 00 00 00 00 00", NextSegment(0)),
    ("70 00 00 00 00 00 00 00", NextSegment(1)),
    ("20 00 00 00 00 00 00 00", SegmentTaken(0)),
    ("30 00 00 00 00 00 00 00", SegmentTaken(1)),
]

BLOCKS = [
    ("C6 00 21 00 0A 00 00 00", InitiateBlockDownload(0x2100, 0, 10)),
    ("C4 00 21 00 00 00 00 00", InitiateBlockDownload(0x2100, 0)),
    ("C2 00 21 00 0A 00 00 00", InitiateBlockDownload(0x2100, 0, 10, crc=False)),
    ("C0 00 21 00 00 00 00 00", InitiateBlockDownload(0x2100, 0, crc=False)),
    ("C6 08 10 00 10 00 00 00", BlockUploadInitiated(0x1008, 0, 16)),
    ("C0 08 10 00 00 00 00 00", BlockUploadInitiated(0x1008, 0, crc=False)),
    ("A4 00 21 00 7F 00 00 00", BlockDownloadInitiated(0x2100, 0, 127)),
    ("A0 00 21 00 01 00 00 00", BlockDownloadInitiated(0x2100, 0, 1, crc=False)),
    ("A4 08 10 00 14 00 00 00", InitiateBlockUpload(0x1008, 0, 20)),
    ("A0 08 10 00 14 FF 00 00", InitiateBlockUpload(0x1008, 0, 20, 255, crc=False)),
    ("A3 00 00 00 00 00 00 00", StartBlockUpload()),
    ("01 43 41 4E 6F 70 65 6E", BlockSegment(1, b"CANopen")),
    ("FF 33 32 31 30 2F 2E 2D", BlockSegment(127, b"3210/.-", last=True)),
    ("A2 03 14 00 00 00 00 00", BlockAck(3, 20)),
    ("C1 00 00 00 00 00 00 00", BlockEnd(0)),
    ("D5 F3 43 00 00 00 00 00", BlockEnd(5, 0x43F3)),
    ("DD 00 00 00 00 00 00 00", BlockEnd(7)),
    ("A1 00 00 00 00 00 00 00", BlockEnded()),
]


@every_case(("text", "message"), SEGMENTS + BLOCKS)
def test_segment_and_block_messages_encode_and_decode(text: str, message: SdoMessage) -> None:
    assert message.encode() == raw(text)
    assert decode_one_of(raw(text), (type(message),)) == message


def test_the_state_of_the_transfer_determines_the_message() -> None:
    data = raw("C1 F3 43 00 00 00 00 00")
    assert decode_one_of(data, (BlockEnd,)) == BlockEnd(0, 0x43F3)
    assert decode_one_of(data, (BlockSegment,)) == BlockSegment(0x41, data[1:], last=True)
    with pytest.raises(DecodeError, match="not possible here"):
        decode_sdo_request(data)


@pytest.mark.parametrize(
    ("kind", "text"),
    [
        (SdoSegment, "09 33 32"),
        (InitiateBlockUpload, "A4 08 10 00 14"),
        (BlockDownloadInitiated, "A4 08 10 00"),
        (BlockUploadInitiated, "C6 08 10 00 10"),
        (BlockSegment, "01 43"),
        (BlockAck, "A2 03"),
        (BlockEnd, "D5 F3"),
    ],
)
def test_missing_bytes_raise_short(kind: type[SdoMessage], text: str) -> None:
    with pytest.raises(DecodeError) as caught:
        decode_one_of(raw(text), (kind,))
    assert caught.value.reason == "short"


@pytest.mark.parametrize("text", ["00 43 41 4E 6F 70 65 6E", "80 43 41 4E 6F 70 65 6E"])
def test_there_is_no_segment_0(text: str) -> None:
    with pytest.raises(DecodeError, match="no segment 0"):
        BlockSegment.decode(raw(text))


@pytest.mark.parametrize(
    "message",
    [
        SdoSegment(2, b""),
        SdoSegment(0, bytes(8)),
        NextSegment(2),
        BlockSegment(0, bytes(7)),
        BlockSegment(128, bytes(7)),
        BlockSegment(1, bytes(6)),
        BlockSegment(1, bytes(8), last=True),
        BlockAck(1, 0),
        BlockAck(256, 1),
        BlockEnd(8),
        BlockEnd(0, 1 << 16),
        InitiateBlockUpload(0x1008, 0, 128),
        BlockDownloadInitiated(0x1008, 0, 0),
    ],
)
def test_invalid_segment_and_block_messages_do_not_encode(message: SdoMessage) -> None:
    with pytest.raises(EncodeError):
        message.encode()


@pytest.mark.parametrize("command", ["43", "4B", "4F", "5F", "41"])
def test_reserved_bits_of_an_upload_request_are_ignored(command: str) -> None:
    assert decode_sdo_request(raw(f"{command} 40 60 00 00 00 00 00")) == InitiateUpload(0x6040, 0, int(command, 16))


@pytest.mark.parametrize("command", ["00", "60", "81", "A1", "A3", "C1", "E0", "FF"])
def test_unknown_request_commands(command: str) -> None:
    with pytest.raises(DecodeError) as caught:
        decode_sdo_request(raw(f"{command} 40 60 00 00 00 00 00"))
    assert (caught.value.reason, caught.value.at) == ("function", 0)


@pytest.mark.parametrize("command", ["00", "20", "81", "A1", "A2", "C1", "E0"])
def test_unknown_response_commands(command: str) -> None:
    with pytest.raises(DecodeError) as caught:
        decode_sdo_response(raw(f"{command} 40 60 00 00 00 00 00"))
    assert caught.value.reason == "function"


def test_responses_without_trailing_bytes_decode() -> None:
    assert decode_sdo_response(raw("60 17 10 00")) == DownloadInitiated(0x1017, 0)
    assert decode_sdo_response(raw("4B 41 60 00 37 06")) == ExpeditedUpload(0x6041, 0, raw("3706"))
    for text in ("", "4B", "4B 41 60", "4B 41 60 00 37", "42 41 60 00 37 06 00", "80 41 60 00 00 00 02", "41 08 10 00"):
        with pytest.raises(DecodeError) as caught:
            decode_sdo_response(raw(text))
        assert caught.value.reason == "short"


def test_invalid_initiate_messages_do_not_encode() -> None:
    for data in (b"", bytes(5)):
        with pytest.raises(EncodeError, match="carries 1 to 4"):
            ExpeditedDownload(0x1017, 0, data).encode()
    with pytest.raises(EncodeError, match="expected 4"):
        ExpeditedUpload(0x1017, 0, b"12", indicated=False).encode()
    with pytest.raises(EncodeError, match="index"):
        InitiateUpload(0x10000, 0).encode()
    with pytest.raises(EncodeError, match="sub"):
        InitiateUpload(0x1000, 256).encode()
    with pytest.raises(EncodeError, match="does not request an upload"):
        InitiateUpload(0x1000, 0, 0x23).encode()


def test_each_of_31_abort_codes_encodes_and_decodes() -> None:
    assert len(AbortCode) == 31
    assert len({code.text for code in AbortCode}) == 31
    for code in AbortCode:
        said = decode_sdo_response(Abort(0x6041, 2, code).encode())
        assert said == Abort(0x6041, 2, code)
        refusal = SdoAbort(code, 0x6041, 2)
        assert isinstance(refusal, Refused)
        assert str(refusal) == f"6041h:02: {code >> 16:04X} {code & 0xFFFF:04X}h {code.text}"


def test_an_unknown_code_keeps_its_number() -> None:
    assert abort_text(0xDEADBEEF) == "DEAD BEEFh unknown abort code"
    assert SdoAbort(0xDEADBEEF, 0x1000, 0).code == 0xDEADBEEF
    assert decode_sdo_response(Abort(0x1000, 0, 0xDEADBEEF).encode()) == Abort(0x1000, 0, 0xDEADBEEF)


def test_an_abort_for_another_object_names_it() -> None:
    refusal = SdoAbort(0x05040001, 0x1017, 0, (0x1000, 4))
    assert str(refusal).endswith("unknown (the abort names 1000h:04)")
    assert refusal.named == (0x1000, 4)


def test_read_commands_of_the_dialects() -> None:
    assert [STANDARD.read_command(size) for size in (1, 2, 3, 4, 8, None)] == [0x40] * 6
    assert [AZ3.read_command(size) for size in (1, 2, 4, None)] == [0x4F, 0x4B, 0x43, 0x43]
    with pytest.raises(EncodeError, match="cannot ask for 3 bytes"):
        AZ3.read_command(3)


@pytest.mark.parametrize(
    ("data", "size", "value"),
    [("06000000", 2, "0600"), ("FBFFFFFF", 2, "FBFF"), ("3706", 2, "3706"), ("0F000000", 1, "0F")],
)
def test_fit_removes_padding_and_sign_extension(data: str, size: int, value: str) -> None:
    assert fit(raw(data), size) == raw(value)


@pytest.mark.parametrize(
    ("data", "size", "reason"),
    [("06000100", 2, "long"), ("0600FFFF", 2, "long"), ("06", 2, "short"), ("06", 0, "length")],
)
def test_fit_never_changes_a_value(data: str, size: int, reason: str) -> None:
    with pytest.raises(DecodeError) as caught:
        fit(raw(data), size)
    assert caught.value.reason == reason
