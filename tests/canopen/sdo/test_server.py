"""The SDO server: dialogues with an object dictionary."""

from __future__ import annotations

import pytest

from barewire.canopen import (
    STANDARD,
    AbortCode,
    CanFrame,
    Entry,
    ObjectDictionary,
    SdoAbort,
    SdoDialect,
    SdoServer,
    download,
    upload,
)
from barewire.codecs import Value
from barewire.conversation import play
from barewire.devices.sdo_dialects import AZ3
from barewire.errors import EncodeError


def objects() -> ObjectDictionary:
    def refuse(value: Value) -> None:
        raise SdoAbort(AbortCode.LOCAL_CONTROL, 0x2005, 0)

    def fail(value: Value) -> None:
        raise EncodeError("this cannot be said")

    return ObjectDictionary(
        [
            Entry(0x1000, 0, "device type", "u32", "ro", 0x000F0191),
            Entry(0x1008, 0, "device name", "string", "const", "AZ3 servo drive"),
            Entry(0x1017, 0, "heartbeat time", "u16", "rw", 1000),
            Entry(0x2000, 1, "three bytes", "u24", "rw", 0x332211),
            Entry(0x2001, 0, "percent", "u8", "rw", 50, minimum=10, maximum=100),
            Entry(0x2002, 0, "command", "u8", "wo", 0),
            Entry(0x2003, 0, "letters", "octets", "rw", b"ab", maximum=3),
            Entry(0x2004, 0, "long number", "u64", "rw", 0),
            Entry(0x2005, 0, "refuse", "u8", "rw", 0, on_write=refuse),
            Entry(0x2006, 0, "fail", "u8", "rw", 0, on_write=fail),
            Entry(0x2007, 0, "empty", "octets", "ro", b""),
            Entry(0x2008, 0, "nobody knows", "u8", "ro", 0, on_read=lambda: 300),
            Entry(0x6040, 0, "controlword", "u16", "rw", 6),
            Entry(0x6071, 0, "target torque", "i16", "rw", -5),
        ]
    )


def dialogue(server: SdoServer, request: str) -> str:
    """Return the response as text, '' for none; requests are written without the identifier."""
    frames = server.feed(CanFrame.parse(f"605#{request.replace(' ', '')}"), 0.0)
    assert all(frame.id == 0x585 and len(frame.data) == 8 for frame in frames)
    return " ".join(frame.data.hex(" ").upper() for frame in frames)


@pytest.mark.parametrize(
    ("request_", "answer"),
    [
        # uploads of 1 to 4 bytes
        ("40 01 20 00 00 00 00 00", "4F 01 20 00 32 00 00 00"),
        ("40 17 10 00 00 00 00 00", "4B 17 10 00 E8 03 00 00"),
        ("40 00 20 01 00 00 00 00", "47 00 20 01 11 22 33 00"),
        ("40 00 10 00 00 00 00 00", "43 00 10 00 91 01 0F 00"),
        ("40 00 20 00 00 00 00 00", "4F 00 20 00 01 00 00 00"),
        # downloads of 1 to 4 bytes, and of four without an indicated size
        ("2F 01 20 00 0A 00 00 00", "60 01 20 00 00 00 00 00"),
        ("2B 17 10 00 00 00 00 00", "60 17 10 00 00 00 00 00"),
        ("27 00 20 01 01 02 03 00", "60 00 20 01 00 00 00 00"),
        ("22 17 10 00 D0 07 FF FF", "60 17 10 00 00 00 00 00"),
        # the read requests of the AZ3's guide
        ("43 00 10 00 00 00 00 00", "43 00 10 00 91 01 0F 00"),
        ("4B 17 10 00 00 00 00 00", "4B 17 10 00 E8 03 00 00"),
        # refusals
        ("40 41 60 00 00 00 00 00", "80 41 60 00 00 00 02 06"),
        ("40 17 10 01 00 00 00 00", "80 17 10 01 11 00 09 06"),
        ("40 02 20 00 00 00 00 00", "80 02 20 00 01 00 01 06"),
        ("2F 00 10 00 00 00 00 00", "80 00 10 00 02 00 01 06"),
        ("2F 01 20 00 65 00 00 00", "80 01 20 00 31 00 09 06"),
        ("2F 01 20 00 09 00 00 00", "80 01 20 00 32 00 09 06"),
        ("2F 17 10 00 01 00 00 00", "80 17 10 00 13 00 07 06"),
        ("23 17 10 00 01 00 00 00", "80 17 10 00 12 00 07 06"),
        ("23 03 20 00 61 62 63 64", "80 03 20 00 12 00 07 06"),
        ("23 04 20 00 01 00 00 00", "80 04 20 00 13 00 07 06"),
        ("2F 05 20 00 01 00 00 00", "80 05 20 00 21 00 00 08"),
        ("2F 06 20 00 01 00 00 00", "80 06 20 00 00 00 00 08"),
        ("40 08 20 00 00 00 00 00", "80 08 20 00 00 00 00 08"),
        # values in segments or blocks
        ("40 08 10 00 00 00 00 00", "41 08 10 00 0F 00 00 00"),
        ("40 07 20 00 00 00 00 00", "41 07 20 00 00 00 00 00"),
        ("21 17 10 00 02 00 00 00", "60 17 10 00 00 00 00 00"),
        ("20 17 10 00 00 00 00 00", "60 17 10 00 00 00 00 00"),
        ("21 41 60 00 02 00 00 00", "80 41 60 00 00 00 02 06"),
        ("A4 17 10 00 14 00 00 00", "C6 17 10 00 02 00 00 00"),
        ("C6 17 10 00 02 00 00 00", "A4 17 10 00 7F 00 00 00"),
        ("C6 17 10 01 02 00 00 00", "80 17 10 01 11 00 09 06"),
        ("A4 17 10 00 00 00 00 00", "80 17 10 00 02 00 04 05"),
        ("A4 17 10 00 80 00 00 00", "80 17 10 00 02 00 04 05"),
        ("A4 17 10 00 14 02 00 00", "4B 17 10 00 E8 03 00 00"),
        # unknown commands: the abort names the object of the frame
        ("E0 17 10 07 02 00 00 00", "80 17 10 07 01 00 04 05"),
        ("00 17 10 00 02 00 00 00", "80 17 10 00 01 00 04 05"),
        # an abort is never answered
        ("80 17 10 00 00 00 04 05", ""),
        # nor is a frame without 8 bytes
        ("40 17 10", ""),
        ("40 17 10 00", ""),
        ("40 17 10 00 00 00 00", ""),
        ("", ""),
    ],
)
def test_dialogues(request_: str, answer: str) -> None:
    assert dialogue(SdoServer(5, objects()), request_) == answer


def test_a_written_value_is_read_back() -> None:
    server = SdoServer(5, objects())
    dialogue(server, "22 17 10 00 D0 07 FF FF")
    assert dialogue(server, "40 17 10 00 00 00 00 00") == "4B 17 10 00 D0 07 00 00"


@pytest.mark.parametrize(
    "text", ["606#4017100000000000", "00000605#4017100000000000", "605#R8", "585#4B17100000000000", "000#0105"]
)
def test_frames_for_others_are_ignored(text: str) -> None:
    server = SdoServer(5, objects())
    assert server.feed(CanFrame.parse(text), 0.0) == []
    assert server.counters.requests == 0


def test_counters() -> None:
    server = SdoServer(5, objects())
    for request in ("40 17 10", "E0" + "00" * 7, "43 17 10 00 00 00 00 00", "80" + "00" * 7, "40" + "00" * 7):
        dialogue(server, request)
    counters = server.counters
    assert (counters.requests, counters.wrong_length, counters.unknown_command) == (4, 1, 1)
    assert (counters.reserved_bits, counters.aborts_received, counters.aborts_sent) == (1, 1, 2)
    server.reset()
    assert server.counters.requests == 0
    assert server.deadline is None


# Numbers in four bytes, as the worked examples of the AZ3's guide have them.
@pytest.mark.parametrize(
    ("request_", "answer"),
    [
        ("43 40 60 00 00 00 00 00", "43 40 60 00 06 00 00 00"),
        ("4B 40 60 00 00 00 00 00", "4B 40 60 00 06 00 00 00"),
        ("40 40 60 00 00 00 00 00", "4B 40 60 00 06 00 00 00"),
        ("23 40 60 00 0F 00 00 00", "60 40 60 00 00 00 00 00"),
        ("2B 40 60 00 0F 00 00 00", "60 40 60 00 00 00 00 00"),
        ("23 40 60 00 0F 00 01 00", "80 40 60 00 12 00 07 06"),
        ("23 41 60 00 0F 00 00 00", "80 41 60 00 00 00 02 06"),
        ("2F 40 60 00 0F 00 00 00", "80 40 60 00 13 00 07 06"),
    ],
)
def test_dialogues_of_the_dialect_with_four_byte_numbers(request_: str, answer: str) -> None:
    assert dialogue(SdoServer(5, objects(), AZ3), request_) == answer


@pytest.mark.parametrize("dialect", [STANDARD, AZ3])
def test_client_and_server_in_each_dialect(dialect: SdoDialect) -> None:
    server = SdoServer(5, objects(), dialect)

    def peer(frame: CanFrame, now: float) -> list[tuple[float, CanFrame]]:
        return [(now + 0.002, answer) for answer in server.feed(frame, now)]

    for index, value in ((0x2001, "0B"), (0x6040, "0F00"), (0x6071, "FBFF")):
        play(download(5, index, 0, bytes.fromhex(value), dialect=dialect), peer)
        data, _ = play(upload(5, index, size=len(value) // 2, dialect=dialect), peer)
        assert data == bytes.fromhex(value)
    with pytest.raises(SdoAbort, match="object does not exist"):
        play(download(5, 0x60FF, 0, bytes(4), dialect=dialect), peer)
