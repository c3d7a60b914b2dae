"""The steps of a COB-ID agree with the package for every identifier of 11 bits."""

from __future__ import annotations

import pytest

from barewire.canopen import CanFrame
from barewire.canopen.cob_ids import SERVICES, classify, cob_id, is_restricted
from barewire.errors import EncodeError
from barewire_workbench.steps import Steps, cob_id_steps, parse_cob_id


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
    assert [row[3] for row in rows] == [f"{cob_id(service.name, node):X}h" for service in SERVICES]
    assert [int(row[1], 2) for row in rows] == [service.function_code for service in SERVICES]


def test_the_example_of_the_issue() -> None:
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
