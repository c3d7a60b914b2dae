"""The settings, the identity and the date of a DCF."""

from __future__ import annotations

import pytest

from barewire.canopen import device_configuration, eds
from barewire.errors import EncodeError
from tests.canopen.configuration.plant import DATE, dcf, described


def texts(found: object) -> list[str]:
    return [str(one) for one in found]  # type: ignore[attr-defined]


def test_settings_are_the_parameter_values_of_writable_objects() -> None:
    found = device_configuration(dcf({"Heartbeat": 500, "Device type": 0x191, "COB-ID EMCY": eds.Formula(0x80)}, 9))
    assert found.node == 9
    assert texts(found.settings) == [
        "<Setting 1014h:00 COB-ID EMCY = 00000089h>",
        "<Setting 1017h:00 Heartbeat = 500>",
    ]
    assert [one.data for one in found.settings] == [b"\x89\0\0\0", b"\xf4\x01"]
    assert [one.place for one in found.identity] == [(0x1000, 0), (0x1018, 1), (0x1018, 2)]
    assert device_configuration(dcf({"COB-ID EMCY": eds.Formula(0x80)}), 10).settings[0].value == 0x8A


def test_commands_and_unused_mapping_entries_are_left_out() -> None:
    document = dcf({(0x1010, 1): 0x65766173, (0x1A00, 1): 0x60410010, (0x1A00, 2): 0x60640020, "Heartbeat": 1})
    document.set(0x1017, 0, "ObjFlags", "1")
    found = device_configuration(document)
    assert texts(found.settings) == ["<Setting 1A00h:01 mapping 1800.entry 1 = 60410010h>"]
    assert found.left_out == (
        "1010h:01 Store.Store all: writing it is a command",
        "1017h:00 Heartbeat: ObjFlags=1 excludes it",
    )


def test_a_value_that_cannot_be_read_is_told() -> None:
    document = dcf({"Heartbeat": 1, "Cycle": 5})
    document.put("1017", "ParameterValue", "70000")
    (text,) = device_configuration(document).left_out
    assert "out-of-range: [1017] ParameterValue = 70000" in text


@pytest.mark.parametrize(
    ("date", "time", "days", "milliseconds"),
    [
        ("06-28-2026", "02:05PM", DATE["Configuration.Date"], DATE["Configuration.Time"]),
        ("01-02-1984", "12:00AM", 1, 0),
        ("01-01-1984", "12:30PM", 0, 45_000_000),
        ("06-28-2026", "", DATE["Configuration.Date"], 0),
    ],
)
def test_the_date_of_the_file(date: str, time: str, days: int, milliseconds: int) -> None:
    document = dcf({"Heartbeat": 1})
    document.put("FileInfo", "ModificationDate", date)
    document.put("FileInfo", "ModificationTime", time)
    assert [one.value for one in device_configuration(document).date] == [days, milliseconds]


def test_the_value_of_1020h_is_taken_before_the_date_of_the_file_and_that_of_its_making_after_it() -> None:
    stated = dcf({(0x1020, 1): 5, (0x1020, 2): 6})
    assert [one.value for one in device_configuration(stated).date] == [5, 6]
    document = dcf({"Heartbeat": 1})
    document.put("FileInfo", "ModificationDate", "13-45-2026")
    assert device_configuration(document).date == ()
    document.put("FileInfo", "CreationDate", "01-03-1984")
    assert [one.value for one in device_configuration(document).date] == [2, 0]


def test_an_eds_is_not_a_configuration() -> None:
    for node in (5, None):
        with pytest.raises(EncodeError, match="has no ParameterValue: expected a DCF"):
            device_configuration(described(), node)


def test_a_dcf_without_a_node_id_needs_one() -> None:
    document = described()
    document.set(0x1017, 0, "ParameterValue", 5)
    assert device_configuration(document, 9).node == 9
    with pytest.raises(EncodeError, match="the DCF has no node-ID"):
        device_configuration(document)
