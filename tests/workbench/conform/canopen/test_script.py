"""Cases of the vectors for one device: placeholders, conditions, loops, whole transfers."""

from __future__ import annotations

from typing import Any

import pytest

from barewire.errors import EncodeError
from barewire_workbench.conform.canopen.model import NodeStep, Subject
from barewire_workbench.conform.canopen.script import Placeholders, applies, read_node_case
from barewire_workbench.live.canopen_conformance import FILES, NODE_KIND, cases
from tests.helpers import every_case
from tests.workbench.vectors.loaded import VECTORS

VALUES = {
    (0x1018, 1): bytes.fromhex("60030000"),
    (0x1018, 3): bytes.fromhex("FFFFFFFF"),
    (0x1008, 0): b"a device",
    (0x1400, 1): bytes.fromhex("05020080"),
    (0x1402, 1): bytes.fromhex("11030000"),
    (0x1602, 0): b"\1",
    (0x1602, 1): bytes.fromhex("10004060"),
    (0x1202, 1): b"",
    (0x1203, 1): b"",
    (0x1203, 2): b"",
}
DEVICE = Placeholders(Subject(5, VALUES, large=(0x2100, 3)))


def steps(*rows: dict[str, Any]) -> tuple[NodeStep, ...]:
    return read_node_case({"name": "SDO-01", "effect": "reads", "steps": rows}, DEVICE).steps


def sent(*rows: dict[str, Any]) -> list[str]:
    return [frame for step in steps(*rows) for frame in step.sends]


@every_case(
    ("text", "filled"),
    [
        ("<580+node>#..", "585#.."),
        ("<00+node><00000600+node><0+node>", "05000006055"),
        ("<00+other>", "7E"),
        ("<1018:01/4>", "60030000"),
        ("<1018:01/2><1018:01^1/2>", "60036103"),
        ("<1018:02/2>", "0000"),
        ("<1018:03+1/4>", "00000000"),
        ("<rpdo.record/2><0000+rpdo.mapping>", "02141602"),
        ("<rpdo.word|80000000/4><000+rpdo.cob>", "11030080311"),
        ("<rpdo.word&40000000|27E/4>", "7E020000"),
        ("<rpdo.mapping:01/4>", "10004060"),
        ("<00*rpdo.size><00*rpdo.size-1><..*rpdo.size>", "000000...."),
        ("<00+rpdo.toomany>", "05"),
        ("<tpdo.record/2><000+tpdo.cob>", "0018185"),
        ("<text.index/2><text.size/4><0+text.segments&1>", "0810080000000"),
        ("<large.index/2><large.sub/1>", "002103"),
        ("<0000+servers.first>h <0000+clients.first>h", "1203h 1281h"),
    ],
)
def test_a_placeholder(text: str, filled: str) -> None:
    assert DEVICE.fill(text) == filled


def test_the_other_node_is_never_the_device() -> None:
    assert Placeholders(Subject(126, {})).fill("<700+other>") == "77D"


@pytest.mark.parametrize(
    "text", ["<580+nodes>", "<node>", "<+1>", "<1 2>", "<1++2>", "<id/2>", "<12345:00/4>", "<node+/1>"]
)
def test_a_placeholder_that_cannot_be_read_is_refused(text: str) -> None:
    with pytest.raises(EncodeError, match="placeholder"):
        DEVICE.fill(text)


def test_a_loop_over_ranges_with_a_condition_inside_another() -> None:
    inner = {"each": "sub", "in": ["01-02"], "steps": [{"send": ["<00+sub><index/2>#"]}]}
    outer = {"each": "index", "in": ["1201-1203"], "if": ["<0000+index>h:01"], "steps": [inner]}
    with pytest.raises(EncodeError, match="no name"):
        sent({"each": "sub", "in": ["1"], "steps": [{"send": ["<00+index>#"]}]})
    assert sent(outer) == ["010212#", "020212#", "010312#", "020312#"]


@pytest.mark.parametrize(
    ("condition", "holds"),
    [
        ("1018h:01", True),
        ("1018h", False),
        ("no 1018h", True),
        ("no 1018h:01", False),
        ("RPDO", True),
        ("TPDO", False),
        ("LSS", False),
        ("large object", True),
        ("text of 8 bytes", True),
        ("text of at most 140 bytes", True),
        ("<00+node> is 05", True),
        ("<00+node> is not 05", False),
        ("<00+node> is 06", False),
    ],
)
def test_a_condition(condition: str, holds: bool) -> None:
    case = {"name": "SDO-01", "effect": "reads", "if": [condition], "steps": [{"if": [condition], "send": ["080#"]}]}
    assert applies(case, DEVICE) == holds
    assert len(read_node_case(case, DEVICE).steps) == holds


def test_a_text_of_more_than_one_block_of_twenty_segments() -> None:
    device = Placeholders(Subject(5, {(0x1008, 0): bytes(141)}))
    assert not applies({"if": ["text of at most 140 bytes"]}, device)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"name": "SDO-1"}, "expected letters"),
        ({"effect": "harms"}, "expected one of reads"),
        ({"needs": ["1017"]}, "expected an object such as 1017h"),
        ({"steps": [{"transfer": "copy", "of": "text"}]}, "expected upload"),
    ],
)
def test_fields_that_cannot_be_read_are_refused(change: dict[str, Any], text: str) -> None:
    with pytest.raises(EncodeError, match=text):
        read_node_case({"name": "SDO-01", "effect": "reads", "steps": [], **change}, DEVICE)


def test_times_are_microseconds_and_silence_is_expected_without_accept() -> None:
    assert steps({"wait": 20000}, {"send": ["080#"], "accept": ["185#.."], "ends": ["585#80"], "whole": True}) == (
        NodeStep((), ("",), wait=0.02),
        NodeStep(("080#",), ("185#..",), ("585#80",), full_wait=True),
    )


def test_whole_transfers() -> None:
    value = "0001020304050607"
    assert sent({"transfer": "upload", "of": "text"}) == [
        "605#4008100000000000",
        "605#6000000000000000",
        "605#7000000000000000",
    ]
    assert sent({"transfer": "download", "of": "002103", "value": value, "size": 9, "segments": 1}) == [
        "605#2100210309000000",
        "605#0000010203040506",
    ]
    assert sent({"transfer": "block upload", "of": "text", "blksize": 1, "crc": False}) == [
        "605#A008100001000000",
        "605#A300000000000000",
        "605#A201010000000000",
        "605#A201010000000000",
        "605#A100000000000000",
    ]
    assert steps({"transfer": "block segments", "of": "text", "send": ["605#A20114"], "from": 2})[0].accepts == (
        "585#8165............",
    )
    assert sent({"transfer": "block download", "of": "002103", "value": value}) == [
        "605#C600210308000000",
        "605#0100010203040506",
        "605#8207000000000000",
        "605#D9B3260000000000",
    ]


@pytest.mark.parametrize(("until", "count"), [("begun", 1), ("sent", 2), ("ended", 3)])
def test_a_block_upload_that_is_left_out_from_a_part_on(until: str, count: int) -> None:
    assert len(steps({"transfer": "block upload", "of": "text", "until": until})) == count


def test_the_cob_id_of_a_pdo_that_is_not_the_first_is_switched_off_with_its_own_value() -> None:
    (case,) = (case for case in cases(DEVICE.subject) if case.name == "COB-04")
    assert case.title.startswith("1402h:01 refuses all 797")
    assert case.steps[0].sends == ("605#2302140111030080",)
    assert len(case.steps) == 798


def test_every_file_of_the_kind_is_run() -> None:
    found = {file.name for file in VECTORS.files if file.kind == NODE_KIND}
    assert found == {f"canopen/conform-{name}" for name in FILES}
