"""The SDO server: dialogues with an object dictionary, and clients that break the protocol, fall silent, or ask for
more than there is.
"""

from __future__ import annotations

import pytest

from barewire.canopen import (
    STANDARD,
    AbortCode,
    BlockSettings,
    CanFrame,
    Entry,
    LocalNode,
    ObjectDictionary,
    SdoAbort,
    SdoDialect,
    SdoServer,
    download,
    upload,
)
from barewire.canopen.sdo.stream import LIMIT
from barewire.codecs import Value
from barewire.conversation import Conversation, play
from barewire.devices.sdo_dialects import AZ3
from barewire.errors import EncodeError
from tests.canopen.sdo.sdo_bus import NAME, Bus, Store, objects
from tests.helpers import every_case


def refusing_objects() -> ObjectDictionary:
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


@every_case(
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
    assert dialogue(SdoServer(5, refusing_objects()), request_) == answer


def test_a_written_value_is_read_back() -> None:
    server = SdoServer(5, refusing_objects())
    dialogue(server, "22 17 10 00 D0 07 FF FF")
    assert dialogue(server, "40 17 10 00 00 00 00 00") == "4B 17 10 00 D0 07 00 00"


@pytest.mark.parametrize(
    "text", ["606#4017100000000000", "00000605#4017100000000000", "605#R8", "585#4B17100000000000", "000#0105"]
)
def test_frames_for_others_are_ignored(text: str) -> None:
    server = SdoServer(5, refusing_objects())
    assert server.feed(CanFrame.parse(text), 0.0) == []
    assert server.counters.requests == 0


def test_counters() -> None:
    server = SdoServer(5, refusing_objects())
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
    assert dialogue(SdoServer(5, refusing_objects(), AZ3), request_) == answer


@pytest.mark.parametrize("dialect", [STANDARD, AZ3])
def test_client_and_server_in_each_dialect(dialect: SdoDialect) -> None:
    server = SdoServer(5, refusing_objects(), dialect)

    def peer(frame: CanFrame, now: float) -> list[tuple[float, CanFrame]]:
        return [(now + 0.002, answer) for answer in server.feed(frame, now)]

    for index, value in ((0x2001, "0B"), (0x6040, "0F00"), (0x6071, "FBFF")):
        play(download(5, index, 0, bytes.fromhex(value), dialect=dialect), peer)
        data, _ = play(upload(5, index, size=len(value) // 2, dialect=dialect), peer)
        assert data == bytes.fromhex(value)
    with pytest.raises(SdoAbort, match="object does not exist"):
        play(download(5, 0x60FF, 0, bytes(4), dialect=dialect), peer)


def exchange(server: SdoServer | LocalNode, *texts: str, now: float = 0.0) -> list[str]:
    """Return the frames of the server in response, without trailing zeros."""
    responses = []
    for text in texts:
        for frame in server.feed(CanFrame(0x605, bytes.fromhex(text).ljust(8, b"\0")), now):
            assert len(frame.data) == 8
            responses.append(frame.data.hex(" ").upper())
    return responses


def full(*texts: str) -> list[str]:
    return [bytes.fromhex(text).ljust(8, b"\0").hex(" ").upper() for text in texts]


def elapse(server: SdoServer) -> list[str]:
    """Return the frames of the server at its deadline, if no frame arrives before."""
    assert server.deadline is not None
    return [frame.data.hex(" ").upper() for frame in server.feed(None, server.deadline)]


TEN = ("01 30 31 32 33 34 35 36", "82 37 38 39")


def test_a_lost_first_segment() -> None:
    server = SdoServer(5, objects())
    assert exchange(server, "C6 00 21 00 0A", TEN[1]) == full("A4 00 21 00 7F")
    assert elapse(server) == full("A2 00 7F")
    assert exchange(server, *TEN, "D1 58 9C", now=0.8) == full("A2 02 7F", "A1")
    assert server.objects.read(0x2100, 0) == b"0123456789"


def test_a_lost_last_segment() -> None:
    server = SdoServer(5, objects())
    exchange(server, "C6 00 21 00 0A", TEN[0], now=10.0)
    assert server.deadline == pytest.approx(10.7)
    assert elapse(server) == full("A2 01 7F")
    assert exchange(server, "81 37 38 39", "D1 58 9C", now=10.8) == full("A2 01 7F", "A1")
    assert server.objects.read(0x2100, 0) == b"0123456789"


def test_a_wrong_crc() -> None:
    server = SdoServer(5, objects())
    assert exchange(server, "C6 00 21 00 0A", *TEN, "D1") == full(
        "A4 00 21 00 7F", "A2 02 7F", "80 00 21 00 04 00 04 05"
    )
    assert server.objects.read(0x2100, 0) == b""


@every_case(
    ("frames", "answer"),
    [
        (("40 08 10", "70"), "80 08 10 00 00 00 03 05"),  # wrong first toggle
        (("40 08 10", "60", "60"), "80 08 10 00 00 00 03 05"),
        (("21 00 21 00 0A", "10"), "80 00 21 00 00 00 03 05"),
        (("21 00 21 00 03", "01 01 02 03 04 05 06 07"), "80 00 21 00 12 00 07 06"),
        (("21 00 21 00 0A", "01 01 02 03 04 05 06 07"), "80 00 21 00 13 00 07 06"),
        (("C6 00 21 00 03", *TEN, "D1 58 9C"), "80 00 21 00 12 00 07 06"),
        (("C6 00 21 00 0B", *TEN, "D1 58 9C"), "80 00 21 00 13 00 07 06"),
        (("C6 00 21 00 FF FF FF FF",), "80 00 21 00 05 00 04 05"),
        (("21 00 21 00 FF FF FF FF",), "80 00 21 00 05 00 04 05"),
        (("C6 00 21 00 64", "81", "C1"), "80 00 21 00 13 00 07 06"),
        (("C2 17 10 00 03",), "80 17 10 00 12 00 07 06"),  # refused by the dictionary, before the data is sent
        (("C2 17 10 00 01",), "80 17 10 00 13 00 07 06"),
        (("21 08 10 00 03",), "80 08 10 00 02 00 01 06"),
        (("20 08 10 00",), "80 08 10 00 02 00 01 06"),
        (("C4 08 10 00",), "80 08 10 00 02 00 01 06"),
        (("21 00 21 00 65",), "80 00 21 00 12 00 07 06"),
        (("C0 17 10 00", "81", "D1"), "80 17 10 00 12 00 07 06"),  # the size was unknown
        (("C6 00 21 00 0A", "00"), "80 00 21 00 03 00 04 05"),  # there is no segment 0
        (("C6 00 21 00 0A", *TEN, "E0 00 10"), "80 00 21 00 01 00 04 05"),
        (("A4 08 10 00 14", "A3", "A2 04 14"), "80 08 10 00 03 00 04 05"),  # more than were sent
        (("A4 08 10 00 14", "A3", "A2 03 00"), "80 08 10 00 02 00 04 05"),
        (("A4 08 10 00 14", "A3", "A2 03 80"), "80 08 10 00 02 00 04 05"),
        (("A4 08 10 00 14", "A1"), "80 08 10 00 01 00 04 05"),
        (("A4 08 10 00 14", "A3", "A1"), "80 08 10 00 01 00 04 05"),
        # an unknown command during a transfer: an abort for the object of the transfer
        (("40 08 10", "E0 00 10"), "80 08 10 00 01 00 04 05"),
        (("21 00 21 00 0A", "E0 17 10"), "80 00 21 00 01 00 04 05"),
        (("A4 08 10 00 14", "A3", "E0 00 21"), "80 08 10 00 01 00 04 05"),
    ],
)
def test_the_server_aborts_at_protocol_violations(frames: tuple[str, ...], answer: str) -> None:
    server = SdoServer(5, objects())
    assert exchange(server, *frames)[-1] == answer
    assert server.deadline is None
    assert exchange(server, "40 00 10") == full("43 00 10 00 91 01 0F")


def test_segments_after_an_aborted_block_are_ignored() -> None:
    """The remaining segments 22h and 23h of such a block would be taken for commands that write."""
    server = SdoServer(5, objects(), blksize=0x20)
    exchange(server, "C6 00 21 00 64 00 00 00", TEN[0])
    assert exchange(server, "21 00 00 00 00 00 00 00") == full("80 00 21 00 03 00 04 05")
    assert exchange(server, "22 17 10 00 00 00 00 00", "23 17 10 00 00 00 00 00", "A4") == []
    assert server.counters.strays == 3
    assert server.objects.read(0x1017, 0) == b"\xe8\x03"
    assert exchange(server, "2B 17 10 00 01") == full("60 17 10")


@pytest.mark.parametrize(
    ("frames", "silences", "answer"),
    [
        (("40 08 10",), 1, "80 08 10 00 00 00 04 05"),
        (("21 00 21 00 0A", "00 01"), 1, "80 00 21 00 00 00 04 05"),
        (("A4 08 10 00 14",), 1, "80 08 10 00 00 00 04 05"),
        (("A4 08 10 00 14", "A3"), 1, "80 08 10 00 00 00 04 05"),
        (("A4 08 10 00 14", "A3", "A2 03 14"), 1, "80 08 10 00 00 00 04 05"),
        (("C6 00 21 00 0A",), 2, "80 00 21 00 00 00 04 05"),
        (("C6 00 21 00 0A", TEN[0]), 2, "80 00 21 00 00 00 04 05"),
        (("C6 00 21 00 0A", *TEN), 2, "80 00 21 00 00 00 04 05"),
    ],
)
def test_a_silent_client_times_out(frames: tuple[str, ...], silences: int, answer: str) -> None:
    server = SdoServer(5, objects(), timeout=2.0)
    exchange(server, *frames, now=1.0)
    for _ in range(silences - 1):
        assert [line[:2] for line in elapse(server)] == ["A2"]
    assert server.deadline == pytest.approx(3.0)
    assert server.feed(CanFrame(0x123), 2.9) == []
    assert elapse(server) == [answer]
    assert (server.deadline, server.counters.timed_out) == (None, 1)


READ, READ_RESPONSE = "40 00 10", "43 00 10 00 91 01 0F"


@every_case(
    "begun",
    [
        ("40 08 10",),
        ("40 08 10", "60"),
        ("21 00 21 00 0A",),
        ("21 00 21 00 0A", "00 30 31 32 33 34 35 36"),
        ("A4 08 10 00 14",),
        ("A4 08 10 00 14", "A3"),
        ("A4 08 10 00 14", "A3", "A2 03 14"),  # only the A1 is missing
        ("C6 00 21 00 0A",),  # no segment has come
        ("C6 00 21 00 0A", *TEN),  # only the end is missing
    ],
)
@every_case(
    ("request_", "response"),
    [(READ, READ_RESPONSE), ("21 17 10 00 02", "60 17 10"), ("A4 17 10 00 14", "C6 17 10 00 02")],
)
def test_a_request_for_another_transfer_replaces_the_present_one(
    begun: tuple[str, ...], request_: str, response: str
) -> None:
    """Its client has given it up, or a late request has begun a transfer that no client knows of."""
    server = SdoServer(5, objects())
    exchange(server, *begun)
    assert exchange(server, request_) == full(response)
    assert (server.counters.replaced, server.counters.aborts_sent) == (1, 0)
    assert server.objects.read(0x2100, 0) == b""


def test_inside_a_block_a_request_is_a_segment() -> None:
    server = SdoServer(5, objects())
    assert exchange(server, "C6 00 21 00 0A", TEN[0], READ)[1:] == []
    assert exchange(server, TEN[1], "D1 58 9C") == full("A2 02 7F", "A1")


def test_what_may_be_a_segment_writes_nothing() -> None:
    """Before the first segment an expedited download is not taken: it may be segment 2Bh after a loss."""
    server = SdoServer(5, objects())
    assert exchange(server, "C6 00 21 00 0A", "2B 17 10 00 01")[1:] == []
    assert server.objects.read(0x1017, 0) == b"\xe8\x03"


LAST_FRAMES = [
    ("40 08 10", "60", "70", "60"),
    ("21 00 21 00 07", "01 30 31 32 33 34 35 36"),
    ("A4 08 10 00 14", "A3", "A2 03 14", "A1"),
    ("C6 00 21 00 0A", *TEN, "D1 58 9C"),
]


@pytest.mark.parametrize("frames", LAST_FRAMES, ids=" ".join)
def test_a_repeat_of_the_frame_that_ended_a_transfer_is_ignored(frames: tuple[str, ...]) -> None:
    server = SdoServer(5, objects(), timeout=1.0)
    exchange(server, *frames)
    assert server.deadline is None
    assert exchange(server, frames[-1], frames[-1], now=0.9) == []
    assert (server.counters.strays, server.counters.aborts_sent) == (2, 0)
    assert exchange(server, READ, now=0.9) == full(READ_RESPONSE)
    assert exchange(server, frames[-1], now=1.0)[0][:2] == "80"  # after the time-out it is a frame like any other


@pytest.mark.parametrize(
    ("request_", "then"),
    [
        (READ, (READ, READ_RESPONSE)),
        ("40 08 10", ("60", "00 43 41 4E 6F 70 65 6E")),
        ("21 00 21 00 07", ("01 30 31 32 33 34 35 36", "20")),
        ("C6 00 21 00 0A", (TEN[0], "")),
        ("A4 08 10 00 14", ("A3", "01 43 41 4E 6F 70 65 6E")),
    ],
)
def test_the_end_of_a_block_upload_may_come_after_the_next_request(request_: str, then: tuple[str, str]) -> None:
    server = SdoServer(5, objects())
    exchange(server, "A4 08 10 00 14", "A3", "A2 03 14", request_)
    assert exchange(server, "A1") == []
    assert exchange(server, then[0])[:1] == full(then[1])[: bool(then[1])]


def test_an_a1_before_the_end_of_a_block_upload_is_no_repeat_of_its_own() -> None:
    server = SdoServer(5, objects())
    exchange(server, "A4 08 10 00 14", "A3", "A2 03 14", "A1")
    assert exchange(server, "A4 08 10 00 14", "A3", "A2 03 14", "A1")[-1][:2] == "D5"
    assert server.deadline is None


def test_a_server_without_block_transfer() -> None:
    server = SdoServer(5, objects(), blksize=0)
    bus = Bus(server)
    assert bus.run(upload(5, 0x1008, block=True)) == NAME.encode()
    bus.run(download(5, 0x2100, 0, iter([b"0123", b"456789"]), block=True))
    assert server.objects.read(0x2100, 0) == b"0123456789"
    for conversation in (upload(5, 0x1008, block=BlockSettings(falls_back=False)), refused_download()):
        with pytest.raises(SdoAbort) as caught:
            bus.run(conversation)
        assert caught.value.code == AbortCode.COMMAND
        assert caught.value.why == ""


def refused_download() -> Conversation[CanFrame, None]:
    return download(5, 0x2100, 0, b"0123456789", block=BlockSettings(falls_back=False))


def test_a_stopped_device_forgets_its_transfer() -> None:
    device = LocalNode(5, objects())
    device.start(0.0)
    exchange(device, "40 08 10")
    assert device.sdo.deadline == 1.0
    device.feed(CanFrame.parse("000#0205"), 0.5)
    assert device.sdo.deadline is None
    device.feed(CanFrame.parse("000#8005"), 0.6)
    assert exchange(device, "60") == full("80 00 00 00 01 00 04 05")


def test_the_server_refuses_a_value_above_its_limit() -> None:
    server = SdoServer(5, Store(), limit=20)
    bus = Bus(server)
    bus.run(download(5, 0x2100, 0, bytes(20), block=True))
    for block in (False, True):
        for indicated in (False, True):
            with pytest.raises(SdoAbort) as caught:
                bus.run(download(5, 0x2100, 0, bytes(21), indicated=indicated, block=block))
            assert caught.value.code == AbortCode.OUT_OF_MEMORY
    assert LIMIT == 16 << 20
