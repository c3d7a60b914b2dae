"""The byte count shows that the end of a frame is missing where the CRC cannot.

Where requests and responses are received, the same bytes can be two frames; which one they are is decided here.
"""

from __future__ import annotations

from random import Random

import pytest

from barewire.modbus import Adu, Noise
from barewire.modbus.framing import LineEvent
from barewire.rtu import RtuLine, Timing, crc16, decode, encode
from barewire.rtu.shape import Role, Shape
from tests.helpers import deliveries, feed_all, frames_of, silence, spaced, unhex
from tests.rtu.test_line import PATIENCE, line_of

TIMING = Timing.of(19200)


def ending_with_zero(begin: str, count: int = 1) -> bytes:
    """Return a frame that begins like this, with two more bytes chosen so that its CRC ends with `count` bytes 00."""
    for number in range(0x10000):
        frame = encode(1, unhex(begin) + number.to_bytes(2, "big"))
        if frame[-count:] == bytes(count) and frame[-1 - count]:
            return frame
    raise AssertionError("no such frame among 65536")


@pytest.mark.parametrize("strict", [False, True])
@pytest.mark.parametrize(
    ("role", "begin"),
    [("server", "06 0001"), ("server", "10 0001 0001 02"), ("client", "03 02"), ("listener", "06 0001")],
)
def test_a_frame_that_lost_the_00_at_its_end_is_noise(role: Role, begin: str, strict: bool) -> None:
    for count in (1, 2):
        frame = ending_with_zero(begin, count)
        cut = frame[:-count]
        assert crc16(cut) == 0
        line = RtuLine(TIMING, role=role, units=(1,), patience=None if strict else 0.03)
        events = line.feed(cut, 1.0) + silence(line)
        assert events == [
            Noise(cut, "short", f"{len(cut)} bytes, then silence: the last byte is missing, a 00 of the CRC")
        ]
        assert line.feed(frame, 2.0) + silence(line) == [decode(frame)]


@pytest.mark.parametrize(
    ("role", "pdu", "is_whole"),
    [
        ("server", "03 0001", True),
        ("server", "10 0001 0002 05 000A0102", True),
        ("server", "41 01", True),
        ("server", "08 0000 A5", True),
        ("server", "08 0000", True),
        ("client", "83 02", True),
        ("client", "03 02 0001", True),
        ("client", "03 04 0001", False),
        ("client", "07", False),
    ],
    ids=[
        "too short to decode with any bytes of the CRC",
        "a wrong byte count",
        "an unknown function, without a known length",
        "query data of one byte",
        "query data of no byte",
        "an exception",
        "a response",
        "two bytes short, and decodable with two of the CRC",
        "a request where a response is expected",
    ],
)
def test_is_whole_with_a_good_crc(role: Role, pdu: str, is_whole: bool) -> None:
    assert Shape(role, (1,)).is_whole(encode(1, unhex(pdu))) is is_whole


def test_a_bad_crc_is_never_whole() -> None:
    shape = Shape("server", (1,))
    frame = encode(1, unhex("03 0000 0001"))
    assert shape.is_whole(frame)
    for place in range(len(frame)):
        assert not shape.is_whole(frame[:place] + bytes([frame[place] ^ 1]) + frame[place + 1 :])
        assert not shape.is_whole(frame[:place])
    assert not shape.is_whole(bytes(300))


# Which of two frames

ONE, TWO, THREE = (encode(1, unhex(f"03 0000 000{quantity}")) for quantity in (1, 2, 3))
ILLEGAL = unhex("01 03 04 00F0 0000 FA00")
"""A response of two registers. Without its last byte it is a request for 61440 registers."""
LEGAL = unhex("01 03 04 0000 0185 3A00")
"""A response of two registers. Without its last byte it is a request for one register from 0400h."""
BEGINS_AS_RESPONSE = unhex("04 03 0200 0074 4400")
"""A request of unit 4 for 116 registers. Without its last byte it is a response of one register."""
ONE_OF_4, TWO_OF_4 = (encode(4, unhex(f"03 0000 000{quantity}")) for quantity in (1, 2))
STATUS_ASKED, STATUS = encode(1, unhex("07")), encode(1, unhex("07 41"))
"""Read Exception Status, and a response that begins with all bytes of the request."""

PARTIES: list[Role] = ["listener", "server"]  # a server receives the responses of other units


def test_the_examples_are_two_frames_each() -> None:
    for frame in (ILLEGAL, LEGAL, BEGINS_AS_RESPONSE, STATUS):
        assert crc16(frame) == crc16(frame[:-1]) == 0


def delivered(frames: list[bytes], parts_of_last: list[bytes], role: Role = "listener") -> list[LineEvent]:
    """Feed the frames whole, with silence between them, and the last one in parts."""
    line, events, now = line_of(role, units=(9,)), list[LineEvent](), 1.0
    for frame in frames:
        events += line.feed(frame, now) + silence(line)
        now += 1.0
    chunks = [(data, now + at) for data, at in spaced(parts_of_last, 0.002)]
    return events + feed_all(line, chunks) + silence(line)


@pytest.mark.parametrize("role", PARTIES)
@pytest.mark.parametrize(
    ("before", "frame"),
    [
        pytest.param([TWO], ILLEGAL, id="it answers"),
        pytest.param([TWO], LEGAL, id="it answers, and its cut is a legal request"),
        pytest.param([TWO, LEGAL, TWO], LEGAL, id="the second exchange"),
        pytest.param([], ILLEGAL, id="no request was received, but its cut is illegal"),
        pytest.param([THREE], ILLEGAL, id="it answers another request, but its cut is illegal"),
        pytest.param([], BEGINS_AS_RESPONSE, id="a request, because none is open"),
        pytest.param([TWO_OF_4], BEGINS_AS_RESPONSE, id="the open request is for two registers"),
        pytest.param([ONE], BEGINS_AS_RESPONSE, id="the open request is for another unit"),
        pytest.param([ONE_OF_4, encode(4, unhex("83 02"))], BEGINS_AS_RESPONSE, id="the request was answered"),
        pytest.param([BEGINS_AS_RESPONSE], BEGINS_AS_RESPONSE, id="a request again"),
        pytest.param([ONE_OF_4], BEGINS_AS_RESPONSE[:-1], id="it answers, and is not the beginning of a request"),
        pytest.param([STATUS_ASKED], STATUS_ASKED, id="a short request again"),
        pytest.param([encode(4, unhex("03 0000 FFFF"))], BEGINS_AS_RESPONSE, id="the open request was illegal"),
    ],
)
def test_the_frame_is_the_same_however_it_is_delivered(before: list[bytes], frame: bytes, role: Role) -> None:
    for parts in deliveries(frame):
        assert delivered(before, parts, role) == [decode(each) for each in (*before, frame)], parts


def test_a_response_without_request_that_ends_with_the_bytes_received() -> None:
    """In parts it cannot be distinguished from a request."""
    assert delivered([], [LEGAL]) == [decode(LEGAL)]
    for behind in ([], [ONE]):
        frames = [STATUS_ASKED, STATUS, *behind]
        assert delivered([STATUS_ASKED], [b"".join(frames[1:])]) == [decode(frame) for frame in frames]
    assert delivered([], [LEGAL[:-1], LEGAL[-1:]]) == [
        decode(LEGAL[:-1]),
        Noise(b"\0", "short", "1 byte, then silence"),
    ]


@pytest.mark.parametrize("before", [[], [TWO], [encode(1, unhex("03 0400 0001"))]])
def test_a_request_that_could_be_the_beginning_of_a_response(before: list[bytes]) -> None:
    """It is decided by the silence, or the next bytes: all of them belong to other frames."""
    request = LEGAL[:-1]
    assert delivered(before, [request]) == [decode(each) for each in (*before, request)]
    assert delivered(before, [request, ONE[:3], ONE[3:]]) == [decode(each) for each in (*before, request, ONE)]


def test_only_an_undecided_frame_is_late() -> None:
    """A request is waited for only if the open request may be repeated or a response to it may have begun."""
    for before, decided_by_silence in (([], False), ([THREE], False), ([TWO], True), ([LEGAL[:-1]], False)):
        line = line_of("listener")
        for frame in before:
            line.feed(frame, 1.0)
        assert line.feed(LEGAL[:-1], 1.5) == ([] if decided_by_silence else [decode(LEGAL[:-1])])
        assert line.feed(None, 1.5 + PATIENCE) == ([decode(LEGAL[:-1])] if decided_by_silence else [])


def test_an_illegal_request_is_received_as_one() -> None:
    """Also if it begins like a long response, for which the line does not wait."""
    for frame in (ILLEGAL[:-1], encode(1, unhex("03 FA00 0000"))):
        assert delivered([], [frame]) == [decode(frame)]
    line = line_of("listener")
    assert line.feed(frame, 1.0) == [decode(frame)]


def test_a_broadcast_has_no_response() -> None:
    """Nor does a 00 behind it make it one."""
    frame = encode(0, unhex("03 0400 0001"))
    assert frames_of(delivered([], [frame + b"\0"])) == [decode(frame)]


def test_a_response_with_the_length_of_a_request_is_not_open() -> None:
    """A request for 24 coils, a response that could be a request for 8 coils, and a request that could answer that."""
    before = [encode(64, unhex(pdu)) for pdu in ("01 0000 0018", "01 03 000008")]
    request = unhex("4001010305B50000")
    for parts in deliveries(request):
        assert delivered(before, parts) == [decode(frame) for frame in (*before, request)]


def test_behind_noise_too() -> None:
    for frame, before in ((ILLEGAL, []), (LEGAL, [TWO])):
        assert frames_of(delivered(before, [b"\xff\xff\xff" + frame])) == [decode(each) for each in (*before, frame)]


READS = {1: 8, 2: 8, 3: 0.5, 4: 0.5}
"""By function code: how many values are in a byte."""


def exchanges(dice: Random, count: int) -> list[bytes]:
    """Return requests and responses, in turn: reads of 1 to 5 registers, or of 1 to 80 bits."""
    frames = []
    for _ in range(count):
        function = dice.choice([1, 2, 3, 4])
        quantity = dice.randint(1, 5 if function > 2 else 80)
        size = 2 * quantity if function > 2 else (quantity + 7) // 8
        address, unit = dice.randrange(0x10000), dice.randint(1, 247)
        frames.append(encode(unit, bytes([function, *address.to_bytes(2, "big"), *quantity.to_bytes(2, "big")])))
        frames.append(encode(unit, bytes([function, size]) + dice.randbytes(size)))
    return frames


@pytest.mark.parametrize("longest", [256, 4])
def test_random_exchanges_are_received(longest: int) -> None:
    """One of two hundred responses of two registers is another frame without its last byte."""
    dice, line = Random(3), line_of("listener")
    frames, events, now = exchanges(dice, 2000), list[Adu | Noise](), 1.0
    for frame in frames:
        start = 0
        while start < len(frame):
            size = dice.randint(1, longest) if longest < 256 else 256
            events += line.feed(frame[start : start + size], now)
            start, now = start + size, now + 0.002
        events += silence(line)
        now += 0.1
    assert events == [decode(frame) for frame in frames]
