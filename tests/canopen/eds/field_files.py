"""Oddities seen in files of the field: sources for the cases of `oddities`, and further cases.

A source is a public file (project: file), an issue that reports it (project#number), or the clause of CiA 306 that
allows what tools refuse. The files of the cases are written for these tests. `LINTED` are cases that only `lint` finds.
"""

from __future__ import annotations

from typing import Any

from tests.canopen.eds.oddities import GOOD, LIST, MADE, OBJECT, RECORD, SPEED, Oddity, changed, typed

SEEN = {
    # The text
    "Windows line ends": "110 of 198 public files",
    "no end of the last line": "dbus-canopen-motordrive: curtis_e.eds",
    "umlaut in UTF-8": "CANopenDemo: demoDevice.eds, a Euro sign; canopen#137",
    "umlaut in Latin-1": "a servo drive, byte FCh, canopen-rpi#7; German names of an inverter, libedssharp#70",
    "quotes of Windows-1252": "kacanopen: 605.3150.51-V-EK-2-60.eds, actually an o umlaut of a DOS code page",
    "mixed line ends": "Eyou_Canopen_master: YiyouServo_V1.4.eds",
    "comment lines": "rows of stars in the files of a maker of motors, CANopenEditor#54",
    "hash comment": "canopen: e35.eds; kacanopen: 301.eds",
    "blank behind the equals sign of a list": "an inverter, libedssharp#70; allowed by CiA 306 4.3",
    "blanks around the equals sign": "an example in CiA 306 4.6.3.4.1 itself",
    "trailing blanks": "kacanopen: epos2_347717.eds; libedssharp#70",
    "text behind a section": "kacanopen: 301.eds, a note on how often to repeat it",
    "a line of text": "libedssharp#145; CANopen-monitor#86",
    # The names
    "key in other capitals": "kacanopen: 3301001_0.eds, Baudrate_10; allowed by CiA 306 4.2",
    "line of a comment in small letters": "CANopenNode's old editor, libedssharp#72",
    "commissioning with a double m": "CANopen-monitor: battery.dcf",
    "section twice": "CRF: master.dcf, after a merge",
    "list twice": "CRF: master.dcf, [ManufacturerObjects]",
    "key twice": "CRF: master.dcf, NrOfRxPDO",
    "key of another tool": "canopen: sample.eds, Factor and Unit; canopen#615",
    "section of another tool": "maxon_epos4_ros1_csp: CAN_M1.dcf, [ToolInfos]",
    "modules": "a bus coupler, CANopenEditor#69",
    "vendor with leading zeros": "canopen#313; octal, and the same number, in CiA 306 4.3",
    "an empty vendor": "CANopenSocket: basicDevice.eds",
    "node in hexadecimal": "lely-core: co-sdev.dcf",
    "number of PDOs in both spellings of the standard": "NrOfRxPDO in 20 public files",
    # Numbers and values
    "capital prefix": "CRF: ERB415.eds",
    "leading zeros": "canopen#313",
    "octal": "EDS-File-Viewer: 605.0141.01-O.eds, product 014101, probably meant as decimal; octal by CiA 306 4.3",
    "no value": "29 of 198 public files; CiA 306 4.3: as if the key were missing",
    "negative hexadecimal": "kacanopen: 605.3150.55-D-EK-2-60.eds, a limit",
    "suffix of C": "CANOpenRobotController: CANopenSocket.eds, LL of an UNSIGNED64",
    "a point in an integer": "0.0 of an UNSIGNED32, libedssharp#219",
    "words for a number": "kacanopen: 301.eds",
    "FFFEh of an INTEGER16": "canopen#658",
    "80000000h of an INTEGER32": "kacanopen: 402.eds, 607Bh",
    "BOOLEAN": "a drive that ros_canopen could not load, ros_canopen#256 and #332",
    "REAL32": "limits with a point, canopen#266",
    "OCTET_STRING": "gocanopen: base.eds",
    "OCTET_STRING of one digit": "CANopen-monitor: star_tracker_OD.eds",
    "OCTET_STRING that is text": "canopen: datatypes.eds",
    "TIME_DIFFERENCE as days and milliseconds": "lely-core: co-sdev.dcf",
    "formula": "canopen#1 and #49",
    "formula the other way round": "written by libedssharp; canopen#198, ros_canopen#471",
    "formula with blanks": "ros2_canopen: prbt_0_1.dcf",
    "formula in other capitals": "eRob_CANopen_Python: ZeroErr_Driver_V1.5.eds; CANopenEditor#57",
    "formula of three terms": "the grammar of CiA 306 4.3",
    # Objects
    "missing ObjectType": "40 of 198 public files; canopen#91",
    "an object of the type DOMAIN": "canopen#113",
    "no DataType": "CRF: master.dcf",
    "unknown DataType": "canopen: sample.eds, 40h",
    "data type of CanFestival": "canopen#8",
    "no AccessType": "CRF: master.dcf",
    "AccessType in capitals": "a servo amplifier, canopen#1; emec-drv-canopen-tester",
    "AccessType for PDOs": "CANopenEditor#78",
    "an empty ParameterName": "CANopen-monitor: GPS_OD.eds; libedssharp#156",
    "PDOMapping that is empty": "a port CANopen Design Tool, canopen#385; as if missing",
    "limits in two's complement": "canopen#658",
    "limits that are crossed": "kacanopen: 605.3150.60-B-EK-2-60.eds, 6061h from 00h to FFh, an INTEGER8",
    "not in a list": "canopen: e35.eds, 2FFFh",
    "listed, but missing": "canopen: e35.eds, 6505h",
    "listed twice": "gocanopen: base.eds, 1019h",
    "Sub with a capital": "canopen: sample.eds; allowed by CiA 306 4.2",
    "sub in decimal": "kacanopen: 301.eds, [1003sub00]",
    "no object, only subs": "a digital drive, libedssharp#161",
    "a record without subs": "canopen: sample.eds, 3003h",
    "no sub-index 0": "ros2_canopen: prbt_0_1.dcf, 20A0h; dbus-canopen-motordrive: sevcon_gen4.eds",
    # Compact storage
    "compact": "lely-core: co-emcy.dcf",
    "compact with names": "canopen: sample.eds, [3004Name]",
    "compact with values": "ros2_canopen: master.dcf, [1016Value]",
    "compact and a sub of its own": "eds-dcf-net: sample_device.eds",
    "compact PDOs": "CiA 306 4.6.3.4.1",
    "parameter value": "50 of 198 public files",
}
"""Where cases of `MADE` were seen, by their name."""


def field(name: str, file: str | bytes, rules: str, seen: str, value: Any = 5) -> Oddity:
    """Return a case with the value of the object."""
    return Oddity(name, file, tuple(word.strip() for word in rules.split(",") if word.strip()), {SPEED: value}, seen)


MERGED = changed("=5\n", "=5\n<<<<<<< HEAD\nDenotation=a\n=======\nDenotation=b\n>>>>>>> 3f2a91c\n")
NAMED = typed("9", '"Simulator"')
LIMITS = "LowLimit=$NODEID+1536", "HighLimit=$NODEID+1536"
FIELD = [
    field("marks of a merge", MERGED, "10 conflict, 12 conflict, 13 duplicate-key, 14 conflict", "CRF: master.dcf"),
    field("blank inside a key", changed("SupportedO", "Supported O"), "2 key-form", "libedssharp#110"),
    field("ObjectType with a remark", changed("=7\n", "=0x07 # VAR\n"), "6 foreign-comment", "kacanopen: 301.eds"),
    field("DataType with a remark", changed("=3\n", "=3 # INTEGER16\n"), "7 foreign-comment", "kacanopen: 301.eds"),
    field("AccessType with a remark", changed("=rw", "=rw # ro;"), "8 foreign-comment", "kacanopen: 301.eds"),
    field("a word for no number", typed("1", "No"), "9 number-form", "kacanopen: 301.eds", False),
    field("AccessType R", changed("=rw", "=R"), "8 access-form", "can2mqtt: esphome.eds"),
    field("AccessType W", changed("=rw", "=W"), "8 access-form", "can2mqtt: esphome.eds"),
    field("AccessType Const", changed("=rw", "=Const"), "8 access-form", "4 entries in public files"),
    field("AccessType CONST", changed("=rw", "=CONST"), "8 access-form", "13 entries in public files"),
    field("AccessType RWW", changed("=rw", "=RWW"), "8 access-form", "125 entries in public files"),
    field("no ObjectType", changed("ObjectType=7\n", ""), "", "133 of 528 public files; CiA 306 4.6.3.2"),
    field("no DataType, and a number of a prefix", changed("DataType=3\n", "").replace("=5\n", "=0x05\n"),
          "4 no-data-type", "canopen-rpi: node.eds", b"\5"),
    field("a sentence for a number", typed("7", "0 or profile-specific"), "9 bad-number", "kacanopen: 301.eds", 0),
    field("AccessType UNKNOWN", changed("=rw", "=UNKNOWN"), "8 bad-access", "CANopen-tools-suite"),
    field("text in quotes", NAMED, "9 quoted", "dbus-canopen-motordrive: curtis_f.eds", "Simulator"),
    field("text of UTF-8", typed("9", "5 €").encode(), "9 bad-text, 9 not-ascii", "CANopenDemo: demoDevice.eds",
          "5 €".encode().decode("latin-1")),
    field("a DOMAIN of text", changed("=7", "=2", typed("9", "id")), "", "EDS-File-Viewer: 605.0141.01-O.eds", "id"),
    field("a DOMAIN of its own type", changed("=7", "=2", typed("0x000F", "05")), "", "canopen#113", b"\5"),
    field("octets without a blank", typed("10", "0" * 20), "", "CiA 306 4.3; gocanopen: base.eds", bytes(10)),
    field("64 bits with the suffix of C", typed("0x1B", "0x10LL"), "9 number-form", "CANopenSocket.eds", 16),
    field("DataType in small letters", typed("0x000a", "05"), "", "ros2_canopen: prbt_0_1.dcf", b"\5"),
    field("an equals sign in a name", changed("=Speed", "=Mask [Bit0=Left]"), "", "EDS-File-Viewer: 605.0141.01-O.eds"),
    field("a per cent sign in a name", changed("=Speed", "=Valve % open"), "", "canopen: sample.eds; canopen#56"),
    field("formula with the bit of RTR", typed("7", "$NODEID+0x40000180"), "", "78 of 198 public files", 0x40000185),
    field("formula with a decimal", typed("7", "$NODEID+512"), "", "canopen: sample.eds", 517),
    field("decimal with the node behind", typed("7", "1280+$NODEID"), "9 formula-form", "canopen: sample.eds", 1285),
    field("blanks and capitals", typed("7", "$NodeID + 0x80"), "9 formula-form", "ros2_canopen: prbt_0_1.dcf", 133),
    field("formulas as limits", typed("7", "$NODEID+1536", *LIMITS), "", "a servo amplifier, canopen#1", 1541),
    field("formula as a ParameterValue", typed("7", "0", "ParameterValue=$NODEID"), "", "prbt_0_1.dcf", 5),
    field("an identifier that is switched off", typed("7", "0x80000000"), "", "node-canopen#46", 1 << 31),
    field("HighLimit 65536 of 16 bits", typed("6", "5", "HighLimit=65536"), "10 out-of-range", "YiyouServo_V1.4.eds"),
    field("keys as comments", changed("=5\n", "=5\n;StorageLocation=RAM\n"), "", "libedssharp#51"),
    field("a remark in quotes", changed("=5\n", '=5\nDescription="of x"\n'), "", "CANopenLinux#1"),
    field("files of a DOMAIN", changed("=5\n", "=5\nUploadFile=a.bin\nDownloadFile=b.bin\n"), "", "lely-core"),
    field("a Denotation", changed("=5\n", "=5\nDenotation=left\n"), "", "CANopen-monitor: c3.dcf"),
    field("SubNumber=0 of a variable", changed("=5\n", "=5\nSubNumber=0\n"), "", "59 of 198 public files"),
    field("SubNumber of nothing", changed("=5\n", "=5\nSubNumber=\n"), "", "CiA 306 4.6.3.2"),
    field("ObjFlags", changed("=5\n", "=5\nObjFlags=1\n"), "", "70 of 198 public files"),
    field("more dummies", GOOD + "[DummyUsage]\nDummy001B=1\n", "", "18 of 198 public files; up to 1Bh"),
    field("channels", GOOD + "[DynamicChannels]\nNrOfSeg=1\nType1=0x0000\nDir1=RO\n", "", "YiyouServo_V1.4.eds"),
    field("reserved keys", GOOD + "[DeviceInfo]\nLMT_ProductName=x\nProductVersion=a\n", "", "CiA 306 4.5"),
    Oddity("an index in small letters", GOOD.replace("2000", "200a"), (), {(0x200A, 0): 5}, "BK5120.eds; m150c.dcf"),
    Oddity("a sub-index of the type ARRAY", changed("7\nDataType=6", "8\nDataType=6", RECORD), ("17 sub-type",),
           {(0x2000, 1): 7}, "CANopenLinux#1"),
    Oddity("CompactSubObj of a variable", GOOD + "CompactSubObj=2\n", ("11 compact-variable",),
           {(0x2000, 0): 2, (0x2000, 2): 5}, "can2mqtt: esphome.eds"),
    Oddity("compact with FEh entries", changed("Type=7", "Type=8") + "CompactSubObj=254\n", (),
           {(0x2000, 0xFE): 5}, "lely-core and dcfgen: 1003h, 1029h"),
    Oddity("a gap in the sub-indices", changed("sub1]", "sub5]", RECORD), (), {(0x2000, 5): 7}, "libedssharp#71"),
    Oddity("sub-index FFh", RECORD + RECORD[RECORD.index("[2000sub1]"):].replace("sub1", "subFF"), (),
           {(0x2000, 0xFF): 7}, "eds-dcf-net: max_subnumber.eds; CiA 306 4.6.3.2"),
]  # fmt: skip


def linted(name: str, file: str, rules: str, seen: str, place: tuple[int, int] = SPEED, value: Any = 5) -> Oddity:
    """Return a case that is read without doubt, but has findings of lint: their lines and rules."""
    return Oddity(name, file, tuple(word.strip() for word in rules.split(",")), {place: value}, seen)


def information(key: str, value: str) -> str:
    return f"{GOOD}[FileInfo]\n{key}={value}\n"


def pdo(mapped: str, cob_id: str = "$NODEID+0x180") -> str:
    """Return the object, and a TPDO that maps it."""
    sub = "ParameterName={}\nObjectType=7\nDataType={}\nAccessType=rw\nDefaultValue={}\n"
    return changed(
        LIST,
        LIST
        + "[OptionalObjects]\nSupportedObjects=2\n1=0x1800\n2=0x1A00\n"
        + "[1800]\nParameterName=TPDO1\nObjectType=9\nSubNumber=2\n[1800sub0]\n"
        + sub.format("n", 5, 1)
        + "[1800sub1]\n"
        + sub.format("COB-ID", 7, cob_id)
        + "[1A00]\nParameterName=Mapping\nObjectType=9\nSubNumber=2\n[1A00sub0]\n"
        + sub.format("n", 5, 1)
        + "[1A00sub1]\n"
        + sub.format("1", 7, mapped),
    )


LINTED = [
    linted("capitals of a section", changed("[2000sub1]", "[2000Sub1]", RECORD), "15 capitals", "canopen: sample.eds",
           (0x2000, 1), 7),
    linted("capitals of a key", GOOD + "[DeviceInfo]\nBaudrate_10=1\n", "12 capitals", "kacanopen: 3301001_0.eds"),
    linted("sub-index 0Ah written as 10", changed("sub1]", "sub10]", RECORD), "13 sub0-value",
           "an old editor, libedssharp#51", (0x2000, 0x10), 7),
    linted("SubNumber that is wrong", changed("r=2", "r=8", RECORD), "7 sub-number", "prbt_0_1.dcf", (0x2000, 1), 7),
    linted("sub-index 0 of 32 bits", changed("DataType=5", "DataType=7", RECORD), "11 sub0-type",
           "emec-drv-canopen-tester: emecdrv5_07.eds", (0x2000, 0), 1),
    linted("DataType of a record", changed("r=2", "r=2\nDataType=0x0023", RECORD), "8 key-not-here",
           "canopen-rpi: node.eds; libedssharp#156", (0x2000, 1), 7),
    linted("a date of ISO 8601", information("CreationDate", "2016-03-25"), "12 date-form", "libedssharp#72"),
    linted("a month by its name", information("CreationDate", "07-Feb-2016"), "12 date-form", "kacanopen: 401.eds"),
    linted("a time of 24 hours", information("CreationTime", "17:24:43"), "12 time-form", "libedssharp#72"),
    linted("an hour of one digit", information("ModificationTime", "7:31PM"), "12 time-form", "CANopenDemo"),
    linted("an hour of 0", information("ModificationTime", "00:00PM"), "12 time-form", "ros2_canopen: prbt_0_1.dcf"),
    linted("EDSVersion of one digit", information("EDSVersion", "4"), "12 version-form", "BK5120.eds"),
    linted("EDSVersion of three digits", information("EDSVersion", "4.04"), "12 version-form", "3301001_0.eds"),
    linted("FileVersion of a dash", information("FileVersion", "-"), "12 version-form", "libedssharp#72"),
    linted("a line of 300 characters", information("Description", "x" * 290), "12 long-line", "CiA301Base.eds"),
    linted("a bit rate of 100", GOOD + "[DeviceInfo]\nBaudRate_100=1\n", "12 unknown-key", "605.3150.55-D-EK-2-60.eds"),
    linted("guarding in the head", GOOD + "[DeviceInfo]\nNG_Slave=0\n", "12 unknown-key", "demoDevice.eds"),
    linted("PDOs that are not there", GOOD + "[DeviceInfo]\nNrOfRXPDO=4\n", "12 pdo-count", "sevcon_gen4.eds"),
    linted("a list that counts wrongly", changed("Objects=1", "Objects=3"), "2 list-count", "kacanopen: 402.eds"),
    linted("1008h as mandatory", GOOD.replace("2000", "1008").replace("Manufacturer", "Mandatory"), "3 wrong-list",
           "gocanopen: base.eds", (0x1008, 0)),
    linted("no bit rate", GOOD + "[DeviceComissioning]\nBaudrate=0\n", "12 commissioning", "battery.dcf"),
    linted("node 255", GOOD + "[DeviceComissioning]\nNodeID=255\n", "12 commissioning", "co-gw_txt-slave.dcf"),
    linted("the vendor twice, and not the same", GOOD.replace("[M", "[DeviceInfo]\nVendorNumber=101\n[M", 1)
           + RECORD[len(LIST):].replace("2000", "1018").replace("=7\nP", "=255\nP"),
           "2 identity", "canopen: e35.eds"),
    linted("an identifier without its node", pdo("0x20000010", "0x180"), "23 cob-id", "CanOpenSTM32#53"),
    linted("no [FileInfo]", LIST + OBJECT, "0 missing-section", "lely-core: its DCFs"),
    linted("no OrderCode", GOOD + "[DeviceInfo]\nVendorName=x\n", "11 missing-key", "CANopenSocket: basicDevice.eds"),
    linted("nothing at 1000h", GOOD, "0 missing-object", "canopen: datatypes.eds"),
    linted("sub-index 0 that is too low", changed("1\nPDOMapping=0\n[2000sub1]", "0\nPDOMapping=0\n[2000sub1]", RECORD),
           "13 sub0-value", "gocanopen: base.eds", (0x2000, 0), 0),
    linted("a section of a tool", GOOD + "[ToolInfos]\nItems=1\n", "11 unknown-section", "CAN_M1.dcf"),
    linted("a key of a tool", changed("=5\n", "=5\nFactor=0.1\n"), "10 unknown-key", "canopen: sample.eds"),
    linted("a key of the object among values", GOOD.replace("ObjectType=7", "ObjectType=8") + "CompactSubObj=2\n"
           "[2000Value]\nCompactSubObj=2\n", "13 unknown-key", "CRF: master.dcf", (0x2000, 2)),
    linted("NodeId and BaudRate", GOOD + "[DeviceComissioning]\nNodeId=5\nBaudRate=500\n", "12 capitals, 13 capitals",
           "CANopen-monitor: battery.dcf"),
    linted("NrOfRxPdo", GOOD + "[DeviceInfo]\nNrOfRxPdo=0\n", "12 capitals", "canopen-rpi: node.eds"),
    linted("line5", GOOD + "[Comments]\nLines=1\nline1=x\n", "13 capitals", "libedssharp#72"),
    linted("1017h as mandatory", GOOD.replace("2000", "1017").replace("Manufacturer", "Mandatory"), "3 wrong-list",
           "canopen-rpi: node.eds", (0x1017, 0)),
    linted("an object of the maker as optional", GOOD.replace("Manufacturer", "Optional"), "3 wrong-list",
           "ros2_canopen: prbt_0_1.dcf"),
    linted("a BOOLEAN mapped as 8 bits",
           changed("DataType=3", "DataType=1", pdo("0x20000008")).replace("=5\nP", "=1\nP"), "39 pdo-mapping",
           "CANopen-monitor: dxwifi.dcf", SPEED, True),
    linted("128 bits in a PDO", pdo("0x20000080"), "24 pdo-bits", "CANopen-monitor: c3.dcf"),
    linted("one record of a PDO", pdo("0x20000010").replace("[1A00", "[1A01"), "8 pdo-pair", "full_features.dcf"),
    linted("more bits than the object has", pdo("0x20000020"), "39 pdo-mapping", "CANopen-monitor: dxwifi.dcf"),
    linted("mapped, and there is no such object", pdo("0x60400010"), "39 pdo-mapping", "canopen: sample.eds"),
    linted("mapped, and not to be", pdo("0x20000010").replace("PDOMapping=1", "PDOMapping=0"), "39 pdo-mapping",
           "CANopen-Bench: DemoDevice.eds"),
]  # fmt: skip

ODDITIES = [*(oddity._replace(seen=SEEN.get(oddity.name, "")) for oddity in MADE), *FIELD]
