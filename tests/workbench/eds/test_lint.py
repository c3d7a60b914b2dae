"""Lint: a file without fault, and one fault at a time."""

from __future__ import annotations

import pytest

from barewire.canopen import eds
from barewire.canopen.eds.diagnostics import LINT_RULES
from barewire_workbench.eds.lint import lint
from tests.helpers import every_case

FINE = """\
[FileInfo]
FileName=fine.eds
FileVersion=1
FileRevision=1
EDSVersion=4.0
Description=without fault
CreationTime=09:30AM
CreationDate=01-31-2026
CreatedBy=me
ModificationTime=12:59PM
ModificationDate=12-31-2026
ModifiedBy=me
[DeviceInfo]
VendorName=Nobody
VendorNumber=0x51
ProductName=Nothing
ProductNumber=0
RevisionNumber=0
OrderCode=N-1
BaudRate_10=0
BaudRate_20=0
BaudRate_50=0
BaudRate_125=1
BaudRate_250=0
BaudRate_500=1
BaudRate_800=0
BaudRate_1000=0
SimpleBootUpMaster=0
SimpleBootUpSlave=1
Granularity=8
DynamicChannelsSupported=0
GroupMessaging=0
NrOfRXPDO=1
NrOfTXPDO=0
LSS_Supported=0
[DummyUsage]
Dummy0005=1
[Comments]
Lines=1
Line1=hello
[MandatoryObjects]
SupportedObjects=3
1=0x1000
2=0x1001
3=0x1018
[1000]
ParameterName=Device type
ObjectType=0x7
DataType=0x0007
AccessType=ro
DefaultValue=0
[1001]
ParameterName=Error register
ObjectType=0x7
DataType=0x0005
AccessType=ro
DefaultValue=0
[1018]
ParameterName=Identity
ObjectType=0x9
SubNumber=2
[1018sub0]
ParameterName=Highest
ObjectType=0x7
DataType=0x0005
AccessType=const
DefaultValue=1
[1018sub1]
ParameterName=Vendor-ID
ObjectType=0x7
DataType=0x0007
AccessType=ro
DefaultValue=0x51
[OptionalObjects]
SupportedObjects=2
1=0x1400
2=0x1600
[1400]
ParameterName=RPDO1
ObjectType=0x9
SubNumber=2
[1400sub0]
ParameterName=Highest
ObjectType=0x7
DataType=0x0005
AccessType=const
DefaultValue=1
[1400sub1]
ParameterName=COB-ID
ObjectType=0x7
DataType=0x0007
AccessType=rw
DefaultValue=0x201
[1600]
ParameterName=RPDO1 mapping
ObjectType=0x9
SubNumber=3
[1600sub0]
ParameterName=Entries
ObjectType=0x7
DataType=0x0005
AccessType=rw
DefaultValue=2
[1600sub1]
ParameterName=1
ObjectType=0x7
DataType=0x0007
AccessType=rw
DefaultValue=0x00050008
[1600sub2]
ParameterName=2
ObjectType=0x7
DataType=0x0007
AccessType=rw
DefaultValue=0x20000010
[ManufacturerObjects]
SupportedObjects=1
1=0x2000
[2000]
ParameterName=Speed
ObjectType=0x7
DataType=0x0006
AccessType=rw
LowLimit=0
HighLimit=100
DefaultValue=5
PDOMapping=1
"""

# (the old text, the new text, the line of the finding or the text of that line, the rule)
FAULTS = [
    ("[Comments]", "[Remarks]", "[Remarks]", "unknown-section"),
    ("[FileInfo]", "[FileData]", 0, "missing-section"),
    ("OrderCode=N-1\n", "", "[DeviceInfo]", "missing-key"),
    ("SupportedObjects=1\n", "", "[ManufacturerObjects]", "missing-key"),
    ("[1001]", "[1002]", 0, "missing-object"),
    ("DefaultValue=5\n", "DefaultValue=5\nUnit=rpm\n", "Unit=rpm", "unknown-key"),
    ("SupportedObjects=1\n", "SupportedObjects=1\nHint=x\n", "Hint=x", "unknown-key"),
    ("without fault", "x" * 250, "Description=" + "x" * 250, "long-line"),
    ("01-31-2026", "2026-01-31", "CreationDate=2026-01-31", "date-form"),
    ("12-31-2026", "12-32-2026", "ModificationDate=12-32-2026", "date-form"),
    ("09:30AM", "9:30", "CreationTime=9:30", "time-form"),
    ("EDSVersion=4.0", "EDSVersion=4", "EDSVersion=4", "version-form"),
    ("EDSVersion=4.0", "EDSVersion=4.04", "EDSVersion=4.04", "version-form"),
    ("FileVersion=1", "FileVersion=1.2", "FileVersion=1.2", "version-form"),
    ("FileRevision=1", "FileRevision=256", "FileRevision=256", "version-form"),
    ("[1018]", "[1018]\nPDOMapping=0", "PDOMapping=0", "key-not-here"),
    ("[1018sub1]", "[1018Sub1]", "[1018Sub1]", "capitals"),
    ("BaudRate_10=", "Baudrate_10=", "Baudrate_10=0", "capitals"),
    ("Line1=", "line1=", "line1=hello", "capitals"),
    ("12:59PM", "13:00PM", "ModificationTime=13:00PM", "time-form"),
    ("1=0x2000", "1=0x1400", "1=0x1400", "wrong-list"),
    ("2=0x1600", "2=0x2000", "2=0x2000", "wrong-list"),
    ("SupportedObjects=1", "SupportedObjects=2", "SupportedObjects=2", "list-count"),
    ("Lines=1", "Lines=3", "Lines=3", "list-count"),
    ("1=0x2000", "2=0x2000", "[ManufacturerObjects]", "list-gap"),
    ("Identity\nObjectType=0x9\nSubNumber=2", "Identity\nObjectType=0x9\nSubNumber=1", "SubNumber=1", "sub-number"),
    ("Identity\nObjectType=0x9\nSubNumber=2\n", "Identity\nObjectType=0x9\n", "[1018]", "sub-number"),
    (
        "Entries\nObjectType=0x7\nDataType=0x0005",
        "Entries\nObjectType=0x7\nDataType=0x06",
        "DataType=0x06",
        "sub0-type",
    ),
    ("const\nDefaultValue=1\n[1018sub1]", "const\nDefaultValue=4\n[1018sub1]", "DefaultValue=4", "sub0-value"),
    ("HighLimit=100", "HighLimit=4", "DefaultValue=5", "default-outside"),
    ("DefaultValue=5\n", "DefaultValue=5\nParameterValue=101\n", "ParameterValue=101", "default-outside"),
    ("DefaultValue=5\n", "DefaultValue=5\nObjFlags=4\n", "ObjFlags=4", "flags"),
    ("VendorNumber=0x51", "VendorNumber=0x52", "VendorNumber=0x52", "identity"),
    ("Granularity=8", "Granularity=65", "Granularity=65", "granularity"),
    ("NrOfRXPDO=1", "NrOfRXPDO=4", "NrOfRXPDO=4", "pdo-count"),
    ("NrOfTXPDO=0", "NrOfTXPDO=1", "NrOfTXPDO=1", "pdo-count"),
    ("[1600]", "[1601]", "[1601]", "pdo-pair"),
    ("0x20000010", "0x20010010", "DefaultValue=0x20010010", "pdo-mapping"),
    ("0x20000010", "0x20000008", "DefaultValue=0x20000008", "pdo-mapping"),
    ("PDOMapping=1", "PDOMapping=0", "DefaultValue=0x20000010", "pdo-mapping"),
    ("Dummy0005=1", "Dummy0005=0", "DefaultValue=0x00050008", "pdo-mapping"),
    ("0x00050008", "0x00050040", "[1600]", "pdo-bits"),
    ("DefaultValue=0x201", "DefaultValue=0x601", "DefaultValue=0x601", "cob-id"),
    (
        "[DummyUsage]",
        "[DeviceComissioning]\nNodeName=a\nBaudrate=500\n[DummyUsage]",
        "[DeviceComissioning]",
        "missing-key",
    ),
    (
        "[DummyUsage]",
        "[DeviceComissioning]\nNodeID=128\nNodeName=a\nBaudrate=500\n[DummyUsage]",
        "NodeID=128",
        "commissioning",
    ),
    (
        "[DummyUsage]",
        "[DeviceComissioning]\nNodeID=5\nNodeName=a\nBaudrate=250\n[DummyUsage]",
        "Baudrate=250",
        "commissioning",
    ),
]


def test_a_file_without_fault_has_no_findings() -> None:
    assert lint(eds.parse(FINE.encode())) == ()


@every_case(("old", "new", "place", "rule"), FAULTS)
def test_one_fault_is_found_at_its_line(old: str, new: str, place: str | int, rule: str) -> None:
    assert old in FINE
    text = FINE.replace(old, new, 1)
    lines = text.splitlines()
    line = place if isinstance(place, int) else max(number for number, shown in enumerate(lines, 1) if shown == place)
    findings = lint(eds.parse(text.encode()))
    assert (line, rule) in [(diagnostic.line, diagnostic.rule) for diagnostic in findings]


def test_every_rule_has_a_fault() -> None:
    assert {rule for *_, rule in FAULTS} == set(LINT_RULES)


@every_case(
    ("old", "new"),
    [
        ("DefaultValue=0x201", "DefaultValue=$NODEID+0x200"),
        ("DefaultValue=0x201", "DefaultValue=0x80000601"),  # not in use
        ("DefaultValue=0x201", "DefaultValue=0x20000601"),  # 29 bits
        ("VendorNumber=0x51", "VendorNumber=81"),
        ("NrOfRXPDO", "NrOfRxPDO"),  # the standard writes it both ways
        ("LSS_Supported=0", "LSS_Supported=0\nLMT_ProductName=old"),
        ("FileVersion=1", "FileVersion=0x01"),
        ("ParameterName=Speed\nObjectType=0x7\n", "ParameterName=Speed\n"),  # then it is 7 [CiA 306 4.6.3.2]
        ("EDSVersion=4.0\n", ""),  # then it is 3.0 [CiA 306 4.4]
        (
            "[1018sub1]",  # FFh describes the type, and is not counted
            "[1018subFF]\nParameterName=t\nObjectType=7\nDataType=7\nAccessType=ro\n[1018sub1]",
        ),
        ("VendorNumber=0x51", "VendorNumber=0"),  # unknown
        ("Line1=hello", "Line1=hello ; you"),
        ("HighLimit=100", "HighLimit=$NODEID+1"),
        ("[DummyUsage]", "[SupportedModules]\nNrOfEntries=0\n[M1ModuleInfo]\nProductName=x\n[DummyUsage]"),
        ("[DummyUsage]", "[1000ObjectLinks]\nObjectLinks=1\n1=0x2000\n[DummyUsage]"),
    ],
)
def test_correct_variants_have_no_findings(old: str, new: str) -> None:
    assert old in FINE
    assert lint(eds.parse(FINE.replace(old, new, 1).encode())) == ()


@pytest.mark.parametrize(
    ("new", "message"), [("SubNumber=3", "[1018] SubNumber=3, there are 2"), ("", "[1018] no SubNumber, there are 2")]
)
def test_a_wrong_count_is_reported_with_the_right_one(new: str, message: str) -> None:
    """The count in the message helps the reader: 528 public files had 804 of these findings."""
    findings = lint(eds.parse(FINE.replace("SubNumber=2", new, 1).encode()))
    assert [str(diagnostic).split(": ")[1:3] for diagnostic in findings] == [["sub-number", message]]


def test_lint_includes_the_diagnostics_in_the_order_of_lines() -> None:
    findings = lint(eds.parse(FINE.replace("SubNumber=2", "SubNumber=2h", 1).replace("09:30AM", "0930").encode()))
    assert [diagnostic.rule for diagnostic in findings] == ["time-form", "number-form"]
    assert str(findings[0]) == "7: time-form: CreationTime=0930: expected hh:mm with AM or PM"
