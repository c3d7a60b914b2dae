"""The settings of an EDS or DCF: which objects are storable, what stores them, settings as a DCF and back."""

from __future__ import annotations

import pytest

from barewire import load
from barewire.canopen import eds
from barewire.errors import EncodeError
from barewire_workbench.eds.device import configured_values, device_of_eds
from barewire_workbench.eds.export import export
from barewire_workbench.eds.storable import storable
from barewire_workbench.settings.compare import differences
from barewire_workbench.settings.dcf import dcf_of, settings_of_dcf
from barewire_workbench.settings.rules import SettingRules
from barewire_workbench.settings.saved import SavedSettings, SavedValue, saved_value, value_of
from tests.workbench.eds.described import described


@pytest.mark.parametrize(
    ("text", "is_setting"),
    [
        ("2000 gain 6 rw", True),
        ("2000 gain 6 rwr", True),
        ("2000 target 6 rww", False),
        ("2000 speed 6 ro", False),
        ("2000 maker 6 const", False),
        ("2000 key 6 wo", False),
        ("2000 program 15 rw", False),
        ("2000 not-written 6 rw ObjFlags=1", False),
        ("2000 not-read 6 rw ObjFlags=2", False),
        ("1010 store 7 rw", False),
        ("1017 heartbeat 6 rw", True),
        ("6040 word 6 rw", True),
    ],
)
def test_what_is_storable(text: str, is_setting: bool) -> None:
    assert bool(storable(described(text), 1)) is is_setting


def test_process_data_of_a_drive_and_of_rpdos_are_not_settings() -> None:
    drive = "1000 type 7 ro DefaultValue=0x20192"
    assert storable(described(drive, "6040 word 6 rw", "60FF target 4 rw", "6083 ramp 7 rw"), 1) == {(0x6083, 0)}
    mapped = ["[1600]", "ParameterName=m", "ObjectType=9", "SubNumber=2"]
    for sub, code, value in ((0, 5, "1"), (1, 7, "0x20000010")):
        mapped += [
            f"[1600sub{sub}]",
            f"ParameterName=m{sub}",
            f"DataType={code}",
            "AccessType=ro",
            f"DefaultValue={value}",
        ]
    document = eds.parse(
        "\r\n".join([described("2000 target 6 rw", "2001 gain 6 rw").encode().decode(), *mapped, ""]).encode()
    )
    assert storable(document, 1) == {(0x2001, 0)}


def test_a_device_of_an_eds_has_settings_and_what_stores_them() -> None:
    device = device_of_eds(export(load("az3")), "az3.eds", 5)
    settings = {setting.name: setting for setting in SettingRules.of(device).settings(is_can=True)}
    assert {parameter.name for parameter in device.parameters if parameter.storable} == set(settings)
    (store,) = SettingRules.of(device).store
    assert device.find("CONTROL WORD").kind == device.find(store).kind == "command"
    assert [name for name, setting in settings.items() if setting.communication] == [
        f"{direction}PDO{number} communication parameter / {direction}PDO{number} COB-ID"
        for direction in "RT"
        for number in range(1, 5)
    ]
    assert device.find(store).to_object(SettingRules.of(device).store[store]) == b"save"


def test_settings_as_a_dcf_and_back() -> None:
    document = export(load("az3"))
    device = device_of_eds(document, "az3.eds", 5)
    cob_ids = [f"TPDO{number} communication parameter / TPDO{number} COB-ID" for number in (1, 2)]
    saved = SavedSettings(
        "az3.eds",
        title=load("az3").title,
        settings={"PROFILE ACCELERATION": SavedValue(2500), "ID KP": SavedValue(0.7)},
        communication={cob_ids[0]: SavedValue(0x185), cob_ids[1]: SavedValue(0x333)},
    )
    dcf, left_out = dcf_of(saved, device, document)
    assert left_out == {}
    assert (dcf.get("6083", "ParameterValue"), dcf.node_id) == ("2500", 5)
    # The COB-ID that is the default for this node remains one that suits every node.
    assert dcf.get("1800sub1", "ParameterValue") == "$NODEID+0x180"
    assert dcf.get("1801sub1", "ParameterValue") == str(0x333)
    again = settings_of_dcf(device_of_eds(eds.parse(dcf.encode()), "k.dcf", 5))
    assert list(differences(saved, again)) == []
    with pytest.raises(EncodeError, match="no ParameterValue: expected a DCF"):
        settings_of_dcf(device)


def test_bytes_are_text_in_a_file() -> None:
    device = device_of_eds(described("2000 key 10 rw"), "key.eds", 1)
    (parameter,) = device.parameters
    saved = saved_value(parameter, bytes.fromhex("01FF"))
    assert saved.value == "01 FF"
    assert value_of(parameter, saved) == bytes.fromhex("01FF")
    with pytest.raises(EncodeError, match="expected bytes in hexadecimal"):
        value_of(parameter, SavedValue("key"))


def test_a_dcf_has_what_was_read_and_says_what_it_cannot_have() -> None:
    """The EDS is a DCF itself: it has other values. Nothing of them is left, also of settings that were not read."""
    objects = ["2000 gain 6 rw", "2001 offset 6 rw", "2002 key 10 rw", "2003 mode 6 rww"]
    texts = {"city": "K\u00f6ln", "blank": " Hall", "note": "a ;b", "line": "a\nb", "hall": "Hall 4"}
    objects += [f"{0x2004 + number:X} {name} 9 rw" for number, name in enumerate(texts)]
    old = described(*(f"{text} ParameterValue=7" for text in objects))
    device = device_of_eds(old, "old.dcf", 5)
    settings = {"gain": SavedValue(1), "key": SavedValue("")} | {name: SavedValue(text) for name, text in texts.items()}
    dcf, left_out = dcf_of(SavedSettings("old.dcf", settings=settings), device, old)
    assert left_out.keys() == {"key", "city", "blank", "note", "line"}
    assert left_out["key"] == "b'' would be read as nothing"
    assert "cannot be written in ascii" in left_out["city"]
    again = device_of_eds(eds.parse(dcf.encode()), "new.dcf", 5)
    assert dict(configured_values(again)) == {"gain": 1, "hall": "Hall 4"}
