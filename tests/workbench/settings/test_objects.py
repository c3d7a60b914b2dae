"""The settings of an EDS: which objects are storable, and settings as a DCF and back."""

from __future__ import annotations

import pytest

from barewire import load
from barewire.canopen import eds
from barewire.canopen.configuration.settings import object_text
from barewire.errors import EncodeError
from barewire_workbench.eds.export import export
from barewire_workbench.settings.compare import differences
from barewire_workbench.settings.objects import dcf_of, saved_dcf, storable
from barewire_workbench.settings.saved import SavedSettings, SavedValue


def described(*objects: str) -> eds.Eds:
    """Return an EDS of variables, given as 'index name type-code access' and further keys."""
    lines = []
    for text in objects:
        index, name, code, access, *more = text.split()
        lines += [
            f"[{index}]",
            f"ParameterName={name}",
            "ObjectType=7",
            f"DataType={code}",
            f"AccessType={access}",
            *more,
        ]
    return eds.parse("\r\n".join([*lines, ""]).encode())


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
    assert storable(described(drive, "6040 word 6 rw", "60FF target 4 rw", "6083 ramp 7 rw"), 1)[0].index == 0x6083
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
    assert [entry.index for entry in storable(document, 1)] == [0x2001]


def test_settings_as_a_dcf_and_back() -> None:
    document = export(load("az3"))
    names = {(entry.index, entry.sub): object_text(entry) for entry in storable(document, 5)}
    saved = SavedSettings(
        "az3.eds",
        title=load("az3").title,
        settings={names[0x6083, 0]: SavedValue(2500), names[0x202C, 0]: SavedValue(0.7)},
        communication={names[0x1800, 1]: SavedValue(0x185), names[0x1801, 1]: SavedValue(0x333)},
    )
    dcf = dcf_of(saved, document, 5)
    assert (dcf.get("6083", "ParameterValue"), dcf.node_id) == ("2500", 5)
    # The COB-ID that is the default for this node remains one that suits every node.
    assert dcf.get("1800sub1", "ParameterValue") == "$NODEID+0x180"
    assert dcf.get("1801sub1", "ParameterValue") == str(0x333)
    assert list(differences(saved, saved_dcf(eds.parse(dcf.encode()), "k.dcf"))) == []
    assert dcf_of(saved, document, 5, communication=False).get("1800sub1", "ParameterValue") is None


def test_a_setting_without_an_address_or_an_object_is_an_error() -> None:
    document = export(load("az3"))
    for name, message in (("gain", "expected an address such as 1017h:00"), ("2FFFh:00 gain", "2FFFh")):
        with pytest.raises(EncodeError, match=message):
            dcf_of(SavedSettings("az3.eds", settings={name: SavedValue(1)}), document, 5)
