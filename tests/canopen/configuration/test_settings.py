"""The settings, the identity and the date of a DCF."""

from __future__ import annotations

from collections.abc import Iterable

import pytest

from barewire.canopen import DeviceConfiguration, Setting, device_configuration, eds
from barewire.errors import EncodeError
from tests.canopen.configuration.plant import DATE, dcf, described
from tests.helpers import every_case


def texts(settings: Iterable[Setting]) -> list[str]:
    return [str(setting) for setting in settings]


def test_settings_are_the_parameter_values_of_writable_objects() -> None:
    configuration = device_configuration(
        dcf({"Heartbeat": 500, "Device type": 0x191, "COB-ID EMCY": eds.Formula(0x80)}, 9)
    )
    assert configuration.node == 9
    assert texts(configuration.settings) == [
        "<Setting 1014h:00 COB-ID EMCY = 00000089h>",
        "<Setting 1017h:00 Heartbeat = 500>",
    ]
    assert [setting.data for setting in configuration.settings] == [b"\x89\0\0\0", b"\xf4\x01"]
    assert [setting.place for setting in configuration.identity] == [(0x1000, 0), (0x1018, 1), (0x1018, 2)]
    assert device_configuration(dcf({"COB-ID EMCY": eds.Formula(0x80)}), 10).settings[0].value == 0x8A


def test_commands_and_unused_mapping_entries_are_left_out() -> None:
    document = dcf({(0x1010, 1): 0x65766173, (0x1A00, 1): 0x60410010, (0x1A00, 2): 0x60640020, "Heartbeat": 1})
    document.set(0x1017, 0, "ObjFlags", "1")
    configuration = device_configuration(document)
    assert texts(configuration.settings)[1:] == ["<Setting 1A00h:01 mapping 1800.entry 1 = 60410010h>"]
    assert configuration.left_out == (
        "1010h:01 Store.Store all: writing it is a command",
        "1017h:00 Heartbeat: ObjFlags=1 excludes it",
    )


@pytest.mark.parametrize(("value", "rule"), [("70000", "out-of-range"), ("zzz", "bad-number")])
@pytest.mark.parametrize("is_alone", [True, False])
def test_a_file_with_a_value_that_cannot_be_read_is_refused(value: str, rule: str, is_alone: bool) -> None:
    """Such a value would not be written, and a device that lacks it would be called right."""
    document = dcf({"Heartbeat": 1} if is_alone else {"Heartbeat": 1, "Cycle": 5})
    document.put("1017", "ParameterValue", value)
    with pytest.raises(EncodeError, match=rf"^line \d+: {rule}: \[1017\] ParameterValue = {value}"):
        device_configuration(document)


def test_a_value_with_blanks_in_its_line_is_a_value() -> None:
    document = eds.parse(b"[1017]\nParameterName=Heartbeat\nDataType=6\nAccessType=rw\nParameterValue = 500\n")
    assert texts(device_configuration(document, 5).settings) == ["<Setting 1017h:00 Heartbeat = 500>"]


def test_a_wrong_node_id_of_the_file_is_named() -> None:
    lines = "[DeviceComissioning]", "NodeID=300", "[1017]", "ParameterName=H", "DataType=6", "ParameterValue=5"
    with pytest.raises(EncodeError, match=r"the DCF has no node-ID: .*NodeID"):
        device_configuration(eds.parse("\n".join(lines).encode()))


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
    assert [setting.value for setting in device_configuration(document).date] == [days, milliseconds]


def test_the_value_of_1020h_is_taken_before_the_date_of_the_file_and_that_of_its_making_after_it() -> None:
    stated = dcf({(0x1020, 1): 5, (0x1020, 2): 6})
    assert [setting.value for setting in device_configuration(stated).date] == [5, 6]
    document = dcf({"Heartbeat": 1})
    document.put("FileInfo", "ModificationDate", "13-45-2026")
    assert device_configuration(document).date == ()
    document.put("FileInfo", "CreationDate", "01-03-1984")
    assert [setting.value for setting in device_configuration(document).date] == [2, 0]


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


def one_object(place: str, code: int, value: str, *others: str) -> eds.Eds:
    """Return a DCF of node 5 with one object, `place` such as 1800sub1, and further lines."""
    head = f"[{place[:4]}]\nParameterName=record\nObjectType=9\n" if "sub" in place else ""
    text = f"{head}[{place}]\nParameterName=value\nDataType={code}\nAccessType=rw\nParameterValue={value}\n"
    return eds.parse(("[DeviceComissioning]\nNodeID=5\n" + text + "\n".join(others)).encode())


BOOLEAN, I8, I32, U8, U16, U32, REAL32, STRING, OCTETS, DOMAIN, U64 = 1, 2, 4, 5, 6, 7, 8, 9, 10, 15, 27


@every_case(
    ("place", "code", "value", "expected"),
    [
        ("1800sub1", STRING, "abc", "1800h:01 record.value is string: expected u32"),
        ("1800sub1", DOMAIN, "00", "1800h:01 record.value is domain: expected u32"),
        ("1800sub1", REAL32, "1.5", "1800h:01 record.value is f32: expected u32"),
        ("1800sub1", I8, "-5", "1800h:01 record.value is i8: expected u32"),
        ("1800sub2", U32, "99999", "1800h:02 record.value is u32: expected u8"),
        ("1800sub2", BOOLEAN, "1", "1800h:02 record.value is bool: expected u8"),
        ("1405sub5", U32, "5", "1405h:05 record.value is u32: expected u16"),
        ("1A00sub0", STRING, "x", "1A00h:00 record.value is string: expected u8"),
        ("1A00sub0", U8, "100", r"1A00h:00 record.value = 100: expected 0..64, FEh or FFh"),
        ("1005", I32, "-1", r"1005h:00 value = -1: expected 0..FFFFFFFFh"),
        ("1006", STRING, "abc", "1006h:00 value is string: expected u32"),
        ("1014", U64, "0x8000000012345678", "1014h:00 value is u64: expected u32"),
        ("1016sub1", STRING, "abc", "1016h:01 record.value is string: expected u32"),
        ("1019", U32, "5", "1019h:00 value is u32: expected u8"),
        ("1201sub2", U8, "5", "1201h:02 record.value is u8: expected u32"),
        ("1201sub3", OCTETS, "5", "1201h:03 record.value is octets: expected u8"),
    ],
)
def test_a_communication_object_of_a_wrong_type_or_value(place: str, code: int, value: str, expected: str) -> None:
    with pytest.raises(EncodeError, match=f"^{expected}"):
        device_configuration(one_object(place, code, value))


def test_identity_and_date_of_a_wrong_type() -> None:
    sub = "[{0}sub{1}]", "ParameterName=value", "DataType={2}", "AccessType={3}", "{4}=abc"
    for index, access, key in (("1018", "ro", "DefaultValue"), ("1020", "rw", "ParameterValue")):
        record = [f"[{index}]", "ParameterName=record", "ObjectType=9"]
        lines = [line.format(index, number, STRING, access, key) for number in (1, 2) for line in sub]
        with pytest.raises(EncodeError, match=f"{index}h:01 record.value is string: expected u32"):
            device_configuration(one_object("1017", U16, "5", *record, *lines))


def test_values_that_are_given_in_a_program_are_checked_too() -> None:
    label, cob_id = described().dictionary(5).find("Label"), described().dictionary(5).entry(0x1800, 1)
    for setting, text in ((Setting(label, 5), "2001h:00 Label: 5 is "), (Setting(cob_id, "x"), "1800h:01 .* 'x'")):
        with pytest.raises(EncodeError, match=text):
            DeviceConfiguration(5, (setting,))


def test_a_mapping_of_more_than_64_bits() -> None:
    with pytest.raises(EncodeError, match=r"TPDO1: 1A00h maps 65 bits: expected at most 64"):
        device_configuration(dcf({(0x1A00, 0): 2, (0x1A00, 1): 0x60640020, (0x1A00, 2): 0x60640021}))
    configuration = device_configuration(dcf({(0x1A00, 0): 1, (0x1A00, 1): 0x60640020, (0x1A00, 2): 0x60640021}))
    assert len(configuration.settings) == 2, "the second one is not mapped"


def test_configured_entries_configure_their_number() -> None:
    configuration = device_configuration(dcf({(0x1A00, 1): 0x60640020}))
    assert texts(configuration.settings) == [
        "<Setting 1A00h:00 mapping 1800.mapped objects = 1>",
        "<Setting 1A00h:01 mapping 1800.entry 1 = 60640020h>",
    ]


def test_a_mapping_without_a_number_in_the_file() -> None:
    configuration = device_configuration(one_object("1A00sub1", U32, "0x60640020"))
    assert [setting.place for setting in configuration.settings] == [(0x1A00, 1)]
