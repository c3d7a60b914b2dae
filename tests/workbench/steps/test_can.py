"""The steps of a CAN frame and of a COB-ID agree with `wire.can_bits` and with what the package receives."""

from __future__ import annotations

import re

import pytest
from hypothesis import given, settings, strategies as st

from barewire.canopen import CanFrame
from barewire.canopen.cob_ids import SERVICES, classify, cob_id, is_restricted
from barewire.errors import EncodeError
from barewire_workbench.steps import Steps, can_frame_steps, cob_id_steps, parse_cob_id
from barewire_workbench.wire import arbitrate, can_bits, longest_can_frame

thorough = settings(max_examples=40, deadline=None, derandomize=True, database=None)

FRAMES = st.one_of(
    st.builds(lambda id, data: CanFrame(id, data), st.integers(0, 0x7FF), st.binary(max_size=8)),
    st.builds(lambda id, data: CanFrame(id, data, True), st.integers(0, 0x1FFF_FFFF), st.binary(max_size=8)),
    st.builds(lambda id, size: CanFrame(id, b"", False, True, size), st.integers(0, 0x7FF), st.integers(0, 8)),
    st.builds(
        lambda id, data: CanFrame(id, data),
        st.sampled_from([0, 0x7FF, 0x78]),
        st.sampled_from([bytes(8), b"\xff" * 8, b"\xe1" * 8]),
    ),
)


def steps_of(*texts: str, bitrate: int = 125_000) -> Steps:
    return can_frame_steps([CanFrame.parse(text) for text in texts], bitrate)


@given(FRAMES)
@thorough
def test_crc_stuff_bits_and_length_are_those_of_the_wire(frame: CanFrame) -> None:
    steps, sent = can_frame_steps([frame]), can_bits(frame)
    fields, crc, stuffing, length = steps.tables
    assert [row[3].replace(" ", "") for row in fields.rows] == [field.levels for field in sent.fields]
    assert crc.rows[-1][-1] == f"{sent.crc:04X}h"
    assert int(crc.rows[-1][4].replace(" ", ""), 2) == sent.crc
    on_the_bus = "".join(re.sub(r"[][]", "", row[1]) for row in stuffing.rows)
    assert on_the_bus == sent.levels[:-10]
    assert sum(row[1].count("[") for row in stuffing.rows) == sent.stuff_count
    counts = {row[0]: int(row[1]) for row in length.rows}
    assert counts["this frame"] == len(sent.bits) == counts["fields"] + counts["stuff bits"]
    assert counts["at worst, with the silence"] == longest_can_frame(len(frame.data), extended=frame.extended) + 3
    assert steps.values["levels"] == sent.levels


def test_the_frame_of_the_issue() -> None:
    steps = steps_of("605#4041600000000000", bitrate=500_000)
    assert steps.result == "605#4041600000000000 has 121 bits, 13 of them stuff bits: 242 us at 500000 bit/s"
    assert steps.tables[3].rows[-1] == ("at worst, with the silence", "135", "270 us")


@given(st.lists(FRAMES, min_size=2, max_size=4))
@thorough
def test_arbitration_is_told_bit_by_bit(frames: list[CanFrame]) -> None:
    steps = can_frame_steps(frames)
    outcome = arbitrate([can_bits(frame) for frame in frames])
    (table,) = steps.tables
    for row in table.rows:
        levels = [cell for cell in row[2:-2] if cell != "-"]
        assert row[-2] == min(levels)
    lost = {at for at in outcome.lost_at if at is not None}
    assert {int(row[0]) for row in table.rows if "lose" in row[-1]} == lost
    assert steps.values["winner"] == (None if outcome.winner is None else str(frames[outcome.winner]))
    if outcome.winner is None:
        assert table.rows[-1][0] == str(outcome.collision)
        assert "bit error" in table.rows[-1][-1]


def test_three_nodes() -> None:
    steps = steps_of("705#05", "605#40", "685#40")
    assert [row[-1] for row in steps.tables[0].rows] == ["", "", "", "705#05 loses", "685#40 loses"]
    assert steps.result == "605#40 wins and is sent without delay"


def test_the_same_identifier_twice() -> None:
    assert steps_of("123#00", "123#01").result.startswith(
        "No frame wins: behind the arbitration field they differ at bit 28"
    )
    assert steps_of("123#00", "123#00").result.startswith("The frames are equal")


def test_what_cannot_be_sent_is_refused() -> None:
    frame = CanFrame(1)
    for frames in ([], [frame] * 9):
        with pytest.raises(EncodeError, match=r"frames: expected 1\.\.8"):
            can_frame_steps(frames)
    for bitrate in (0, 1_000_001):
        with pytest.raises(EncodeError, match="bit/s"):
            can_frame_steps([frame], bitrate)
    with pytest.raises(EncodeError, match="identifier"):
        can_frame_steps([CanFrame(0x800)])


def marked(steps: Steps) -> list[tuple[str, ...]]:
    return [row for row in steps.tables[-1].rows if row[-1] == "<--"]


def test_every_identifier_agrees_with_the_package() -> None:
    for identifier in range(0x800):
        steps = cob_id_steps(identifier)
        found = classify(CanFrame(identifier))
        listed = marked(steps)
        assert [row[3] for row in listed] == ([f"{identifier:X}h"] if found else [])
        assert [row[0] for row in listed] == ([found[0].name] if found else [])
        assert steps.values["service"] == (found[0].name if found else None)
        assert steps.values["node"] == (found[1] or None if found else None)
        assert steps.values["restricted"] == is_restricted(identifier)
        assert (" is restricted:" in " ".join(steps.lines())) == is_restricted(identifier)


@pytest.mark.parametrize("node", [1, 15, 64, 127])
def test_the_list_has_the_identifiers_of_the_node(node: int) -> None:
    rows = cob_id_steps(cob_id("SDO request", node)).tables[-1].rows
    assert [row[3] for row in rows] == [
        f"{cob_id(service.name, 0 if service.broadcast else node):X}h" for service in SERVICES
    ]
    assert [int(row[1], 2) for row in rows] == [service.function_code for service in SERVICES]


def test_the_cob_id_of_the_issue() -> None:
    steps = cob_id_steps(0x58F)
    assert steps.result == "58Fh is the SDO answer of node 15"
    assert "11 x 80h = 580h. Node-ID 0001111 = 0Fh = 15." in steps.sections[2]
    assert steps.tables[0].rows[0][1:] == tuple("10110001111")


@pytest.mark.parametrize(
    ("identifier", "result"),
    [
        (0, "0h is NMT, one identifier for all nodes"),
        (0x80, "80h is SYNC, one identifier for all nodes"),
        (0x7E5, "7E5h is LSS request, one identifier for all nodes"),
        (0x70F, "70Fh is the error control of node 15: heartbeat, boot-up, node guarding"),
        (0x201, "201h is the RPDO1 to node 1"),
        (0x700, "700h is no identifier of the predefined connection set; a device may be configured to use it"),
        (
            0x18FF1234,
            "18FF1234h is an extended identifier of 29 bits; the predefined connection set of CANopen has none",
        ),
        (0x80000185, "185h is the TPDO1 of node 5"),
    ],
)
def test_results(identifier: int, result: str) -> None:
    assert cob_id_steps(identifier).result == result


def test_the_flags_of_an_entry() -> None:
    steps = cob_id_steps(0xC0000185)
    assert [row[1] for row in steps.tables[0].rows] == ["1", "1", "0", "185h"]
    assert not any("well formed" in str(section) for section in steps.sections)
    long = cob_id_steps(0xA0001234)
    assert long.values["extended"] is True
    assert long.values["identifier"] == 0x1234
    assert any("not well formed" in str(section) for section in cob_id_steps(0x80001185).sections)


def test_eleven_bits_can_be_sent_as_29() -> None:
    assert cob_id_steps(0x185, extended=True).result.startswith("00000185h is an extended identifier")
    assert cob_id_steps(0x185).values["extended"] is False


@pytest.mark.parametrize("text", ["58Fh", "0x58F", "58f", " 0X58F ", "0000058F"])
def test_notations(text: str) -> None:
    assert parse_cob_id(text) == 0x58F


@pytest.mark.parametrize("text", ["", "5XY", "123456789", "-1", "0x", "5 8"])
def test_wrong_texts(text: str) -> None:
    with pytest.raises(EncodeError, match="expected up to 8 hexadecimal digits"):
        parse_cob_id(text)
    with pytest.raises(EncodeError, match=r"expected 0\.\.FFFFFFFFh"):
        cob_id_steps(1 << 32)
