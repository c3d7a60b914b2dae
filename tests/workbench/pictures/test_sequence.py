"""Sequence diagrams: of Modbus exchanges, of CAN recordings, of very long logs."""

from __future__ import annotations

from itertools import repeat

import pytest
from hypothesis import given, settings, strategies as st

from barewire.canopen import CanFrame
from barewire_workbench import explain
from barewire_workbench.monitor.recording import read_recording
from barewire_workbench.pictures.picture import as_html, as_svg
from barewire_workbench.pictures.recordings import (
    can_messages,
    can_stations,
    explained_message,
    modbus_messages,
)
from barewire_workbench.pictures.sequence import MESSAGES_DRAWN, SequenceMessage, SequencePicture
from barewire_workbench.recordings.modbus_replay import replay
from barewire_workbench.recordings.model import Recorded
from tests.workbench.pictures.checks import check, svg_texts

LINE = b"""\
1.000000 01 03 00 00 00 01 84 0A
1.012300 01 03 02 00 17 F8 4A
1.100000 02 03 00 00 00 01 84 39
4.200000 01 03 0F A0 00 02 C7 3D
4.210000 01 83 02 C0 F1
4.300000 FF 12 13
"""
BUS = b"""\
(1.000000) can0 705#00
(1.100000) can0 605#4041600000000000
(1.101200) can0 585#4B41600050020000
(1.200000) can0 000#0105
(1.400000) can0 080#
what is this
(3.600000) can0 123#00
"""


def line_picture() -> SequencePicture:
    return SequencePicture("a line", modbus_messages(replay(LINE)), ["client"])


def test_exchanges_of_a_line() -> None:
    picture = line_picture()
    assert picture.stations == ("client", "unit 1", "unit 2")
    ways = [(message.source, message.target, message.wrong) for message in picture.messages]
    assert ways == [
        ("client", "unit 1", False),
        ("unit 1", "client", False),
        ("client", "unit 2", False),
        ("unit 2", "", True),
        ("client", "unit 1", False),
        ("unit 1", "client", True),
        ("client", "", True),
    ]
    texts = svg_texts(picture)
    for part in ("1.000000", "03 00 00 00 01", "✗ no answer", "✗ noise: 3 bytes, then silence", "03 02 00 17"):
        assert part in texts
    assert any("after 12.3 ms" in message.text for message in picture.messages)
    check(picture)


def test_frames_of_a_can_bus() -> None:
    picture = SequencePicture("a bus", can_messages(read_recording(BUS)), ["master"])
    assert picture.stations == ("master", "node 5", "all nodes")
    assert [message.target for message in picture.messages] == [
        "master",
        "node 5",
        "master",
        "node 5",
        "all nodes",
        "",
        "",
    ]
    assert picture.messages[5].text.startswith("line 6 cannot be read")
    check(picture)


def test_only_one_bus() -> None:
    items = [Recorded(0.0, "can0", CanFrame(0x705, b"\x05")), Recorded(0.0, "can1", CanFrame(0x706, b"\x05"))]
    assert [message.source for message in can_messages(items, "can1")] == ["node 6"]


@pytest.mark.parametrize(
    ("frame", "stations"),
    [
        ("000#0100", ("master", "all nodes")),
        ("000#", ("master", "all nodes")),
        ("605#40", ("master", "node 5")),
        ("085#", ("node 5", "master")),
        ("7E5#04", ("master", "all nodes")),
        ("7E4#04", ("all nodes", "master")),
        ("123#", ("master", "")),
    ],
)
def test_who_sends_a_can_frame(frame: str, stations: tuple[str, str]) -> None:
    assert can_stations(CanFrame.parse(frame)) == stations


def test_explained_frames_have_no_times() -> None:
    frame = explain("rtu", bytes.fromhex("01 03 00 00 00 02 C4 0B"))
    picture = SequencePicture("a vector", [explained_message("client", "unit 1", frame)])
    assert "times are not known" in picture.caption
    assert picture.messages[0].data == bytes.fromhex("01 03 00 00 00 02 C4 0B")
    check(picture)


def test_a_long_log_says_what_is_left_out() -> None:
    message = SequenceMessage("client", "unit 1", "read", b"\x03", 1.0)
    picture = SequencePicture("long", repeat(message, 100_000))
    left = f"The first {MESSAGES_DRAWN} of 100000 messages are drawn; {100_000 - MESSAGES_DRAWN} are left out."
    assert left in picture.caption
    assert picture.lines()[-1] == left
    assert len(as_svg(picture)) < 100_000
    assert len(as_html(picture)) < 200_000
    assert picture.as_dict()["left_out"] == 100_000 - MESSAGES_DRAWN


def test_many_stations_share_the_last_line() -> None:
    messages = [SequenceMessage("client", f"unit {number}", "read") for number in range(1, 30)]
    picture = SequencePicture("many", messages)
    assert picture.stations[-1] == "others"
    assert len(picture.stations) == 7
    check(picture)


def test_a_pause_is_a_dashed_piece_of_the_axis() -> None:
    times = [0.0, 0.01, 0.02, 2.02, 2.03]
    picture = SequencePicture("pause", [SequenceMessage("client", "unit 1", "read", at=at) for at in times])
    assert svg_texts(picture).count("2.0 s") == 1
    assert as_svg(picture).count('class="l d"') == 1


_TEXT = st.text(max_size=20)


@given(
    st.lists(
        st.builds(
            SequenceMessage,
            _TEXT,
            _TEXT,
            _TEXT,
            st.binary(max_size=40),
            st.none() | st.floats(0, 1e9),
            st.booleans(),
        ),
        max_size=12,
    )
)
@settings(max_examples=40)
def test_any_messages_have_a_picture(messages: list[SequenceMessage]) -> None:
    as_svg(SequencePicture("any", messages))


@given(st.binary(min_size=1, max_size=60))
@settings(max_examples=30)
def test_any_bytes_on_a_line_have_a_picture(data: bytes) -> None:
    check(SequencePicture("any", modbus_messages(replay(b"1.0 " + data.hex(" ").encode() + b"\n1.1 00\n")), ["client"]))
