"""Oddities of EDS files, one small file each: the reported rules with their lines, and the values read.

`OBJECT` is a correct object; a case changes a line of it, or adds something.
"""

from __future__ import annotations

from typing import Any, NamedTuple

LIST = "[ManufacturerObjects]\nSupportedObjects=1\n1=0x2000\n"
OBJECT = "[2000]\nParameterName=Speed\nObjectType=7\nDataType=3\nAccessType=rw\nDefaultValue=5\nPDOMapping=1\n"
GOOD = LIST + OBJECT
RECORD = LIST + (
    "[2000]\nParameterName=Ramps\nObjectType=9\nSubNumber=2\n"
    "[2000sub0]\nParameterName=Highest\nObjectType=7\nDataType=5\nAccessType=const\nDefaultValue=1\nPDOMapping=0\n"
    "[2000sub1]\nParameterName=Up\nObjectType=7\nDataType=6\nAccessType=rw\nDefaultValue=7\nPDOMapping=0\n"
)


class Oddity(NamedTuple):
    """A file, its diagnostics as "line rule", values in the dictionary of node 5, and the source of the case."""

    name: str
    file: str | bytes
    rules: tuple[str, ...]
    values: dict[tuple[int, int], Any]
    seen: str = ""


def changed(old: str, new: str, file: str = GOOD) -> str:
    assert old in file, old
    return file.replace(old, new, 1)


def typed(code: str, default: str, *more: str) -> str:
    """Return the object with another data type and default; further lines follow the default."""
    lines = "".join(f"{line}\n" for line in more)
    return changed("DataType=3", f"DataType={code}", changed("DefaultValue=5\n", f"DefaultValue={default}\n{lines}"))


DEFAULT = 9  # the line of DefaultValue in GOOD
SPEED = (0x2000, 0)


def case(name: str, file: str | bytes, rules: str, value: Any = 5) -> Oddity:
    """Return a case with the value of the object."""
    return Oddity(name, file, tuple(word.strip() for word in rules.split(",") if word.strip()), {SPEED: value})


def default(name: str, code: str, text: str, rules: str, value: Any) -> Oddity:
    """Return a case of a spelling of the default."""
    return case(name, typed(code, text), ",".join(f"{DEFAULT} {rule}" for rule in rules.split()), value)


TEXT = [
    case("nothing odd", GOOD, ""),
    case("Windows line ends", GOOD.replace("\n", "\r\n"), ""),
    case("no end of the last line", GOOD.rstrip("\n"), ""),
    case("byte order mark", b"\xef\xbb\xbf" + GOOD.encode(), "1 byte-order-mark"),
    case("UTF-16 of Windows", b"\xff\xfe" + GOOD.encode("utf-16-le"), "1 byte-order-mark"),
    case("UTF-16, the other order", b"\xfe\xff" + GOOD.encode("utf-16-be"), "1 byte-order-mark"),
    case("umlaut in UTF-8", changed("Speed", "Überlast").encode(), "5 not-ascii"),
    case("umlaut in Latin-1", changed("Speed", "Überlast").encode("latin-1"), "5 not-ascii"),
    case("quotes of Windows-1252", changed("Speed", "“Speed”").encode("cp1252"), "5 not-ascii"),
    case("a byte without a meaning in Windows-1252", GOOD.encode().replace(b"Speed", b"Sp\x81\xe9d"), "5 not-ascii"),
    case("mixed line ends", GOOD.replace("\n", "\r\n", 3), "4 line-ends"),
    case("line ends of old Macs", GOOD.replace("\n", "\r"), "1 line-ends"),
    case("line ends converted twice", GOOD.replace("\n", "\r\r\n"), "1 line-ends"),
    case("end of file of DOS", GOOD + "\x1a", "11 control-character,11 no-equals"),
    case("a zero byte in a name", changed("Speed", "Spe\0ed"), "5 control-character"),
    case("comment lines", "; made by hand\n" + GOOD, ""),
    case("comment behind a value", changed("=5", "=5 ; rpm"), "9 inline-comment"),
    case("comment right behind a number", changed("=5", "=5;rpm"), "9 inline-comment"),
    case("comment in place of a value", changed("=5", "=;none"), "9 inline-comment", 0),
    case("comment behind a section", changed("[2000]", "[2000] ; speed"), "4 inline-comment"),
    case("semicolon in a name", changed("Speed", "Speed;torque"), ""),
    case("hash comment", "# made by hand\n" + GOOD, "1 foreign-comment"),
    case("slash comment", "// made by hand\n" + GOOD, "1 foreign-comment"),
    case("blanks around the equals sign", changed("DefaultValue=", "DefaultValue = "), "9 blanks"),
    case("blank behind the equals sign of a list", changed("1=0x2000", "1= 0x2000"), ""),
    case("indented key", changed("DefaultValue", "  DefaultValue"), "9 blanks"),
    case("tab before the equals sign", changed("DefaultValue=", "DefaultValue\t="), "9 blanks"),
    case("indented section", changed("[2000]", " [2000]"), "4 blanks"),
    case("blanks in the brackets", changed("[2000]", "[ 2000 ]"), "4 blanks"),
    case("trailing blanks", changed("=5\n", "=5  \n"), ""),
    case("no closing bracket", changed("[2000]", "[2000"), "4 section-open"),
    case("text behind a section", changed("[2000]", "[2000] Speed"), "4 behind-section"),
    case("a line of text", GOOD + "to be done\n", "11 no-equals"),
    case("a colon", changed("DefaultValue=5", "DefaultValue: 5"), "9 colon"),
    case("no key", GOOD + "=5\n", "11 no-key"),
    case("a key before the first section", "Author=me\n" + GOOD, "1 no-section"),
]

NAMES = [
    case("section in capitals", changed("[ManufacturerObjects]", "[MANUFACTUREROBJECTS]"), ""),
    case("section in small letters", changed("[ManufacturerObjects]", "[manufacturerobjects]"), ""),
    case("key in small letters", changed("DefaultValue", "defaultvalue"), ""),
    case("key in other capitals", changed("DataType", "Datatype"), ""),
    case("prefix in a section", changed("[2000]", "[0x2000]"), "4 section-form"),
    case("suffix in a section", changed("[2000]", "[2000h]"), "4 section-form"),
    case("commissioning with a double m", GOOD + "[DeviceCommissioning]\nNodeID=3\n", "11 section-form"),
    case("padded number in a list", changed("1=0x2000", "01=0x2000"), "3 key-form"),
    case("line of a comment in small letters", GOOD + "[Comments]\nLines=1\nline1=hello\n", ""),
    case("an index of five digits", GOOD + "[12345]\nParameterName=far\n", "11 sub-range"),
    case("section twice", GOOD + "[2000]\nDenotation=again\n", "11 duplicate-section"),
    case("section twice, other value", GOOD + "[2000]\nDefaultValue=6\n", "11 duplicate-section,12 duplicate-key"),
    case("list twice", LIST + GOOD, "4 duplicate-section,5 duplicate-key,6 duplicate-key"),
    case("a key of a superscript digit", changed("1=0x2000", "1=0x2000\n\u00b2=x").encode(), "4 not-ascii"),
    case("a key of thousands of digits", changed("1=0x2000", "1=0x2000\n" + "9" * 5000 + "=x"), ""),
    case("key twice", changed("=5\n", "=5\nDefaultValue=6\n"), "10 duplicate-key"),
    case("key twice in other capitals", changed("=5\n", "=5\ndefaultvalue=6\n"), "10 duplicate-key"),
    case("key of another tool", changed("=5\n", "=5\nUnit=rpm\n"), ""),
    case("section of another tool", GOOD + "[MyTool]\nColour=red\n", ""),
    case(
        "modules",
        GOOD + "[SupportedModules]\nNrOfEntries=1\n[M1ModuleInfo]\nProductName=IO\n[M1SubExt6000]\nCount=0;4\n",
        "",
    ),
    case("vendor with leading zeros", GOOD + "[DeviceInfo]\nVendorNumber=001\nOrderCode=001\n", ""),
    case("an empty vendor", GOOD + "[DeviceInfo]\nVendorName=\nVendorNumber=\n", "13 empty"),
    case("a bit rate in words", GOOD + "[DeviceInfo]\nBaudRate_125=yes\n", "12 number-form"),
    case("granularity that is not a number", GOOD + "[DeviceInfo]\nGranularity=byte\n", "12 bad-number"),
    case("node in hexadecimal", GOOD + "[DeviceComissioning]\nNodeID=0x05\nNodeName=007\n", ""),
    case("node with leading zeros", GOOD + "[DeviceComissioning]\nNodeID=08\n", "12 leading-zeros"),
    case("dummies in words", GOOD + "[DummyUsage]\nDummy0005=on\nDummy0006=true\n", "12 bad-number,13 number-form"),
    case("lines of comments with leading zeros", GOOD + "[Comments]\nLines=00\n", ""),
    case("number of PDOs in both spellings of the standard", GOOD + "[DeviceInfo]\nNrOfRXPDO=0\nNrOfTxPDO=0\n", ""),
]

NUMBERS = [
    default("hexadecimal", "0x0003", "0x10", "", 16),
    default("capital prefix", "3", "0X10", "", 16),
    default("leading zeros", "3", "001", "", 1),
    default("octal", "3", "010", "leading-zeros", 8),
    default("leading zero before a digit that octal does not have", "3", "08", "leading-zeros", 8),
    default("no value", "3", "", "", 0),
    default("plus sign", "3", "+5", "number-form", 5),
    default("negative", "3", "-5", "", -5),
    default("negative hexadecimal", "3", "-0x10", "number-form", -16),
    default("suffix h", "3", "1Fh", "number-form", 31),
    default("hexadecimal without a prefix", "3", "1F", "number-form", 31),
    default("suffix of C", "6", "0x10UL", "number-form", 16),
    default("suffix of C, decimal", "7", "10u", "number-form", 10),
    default("a point in an integer", "7", "0.0", "real-for-integer", 0),
    default("an exponent in an integer", "7", "1e3", "bad-number", 0),
    default("a comma in an integer", "7", "5,0", "decimal-comma", 5),
    default("a fraction in an integer", "7", "1.5", "bad-number", 0),
    default("a fraction with a comma in an integer", "7", "1,5", "bad-number", 0),
    default("blank in a number", "7", "0x 1000", "blanks-in-number", 0x1000),
    default("groups of digits", "7", "1 000", "blanks-in-number", 1000),
    default("quotes around a number", "7", '"10"', "quoted", 10),
    default("words for a number", "7", "not applicable", "bad-number", 0),
    default("prefix without digits", "7", "0x", "bad-number", 0),
    default("binary", "7", "0b101", "bad-number", 0),
    case("digits of another script", typed("7", "\u0661\u0662").encode(), "9 bad-number,9 not-ascii", 0),
    default("a number of a thousand digits", "7", "9" * 1000, "bad-number", 0),
    default("too large", "5", "256", "out-of-range", 0),
    default("negative for an unsigned type", "5", "-1", "out-of-range", 0),
    default("too negative", "2", "-129", "out-of-range", 0),
    default("FFFEh of an INTEGER16", "3", "0xFFFE", "", -2),
    default("65534 of an INTEGER16", "3", "65534", "unsigned-decimal", -2),
    default("80000000h of an INTEGER32", "4", "0x80000000", "", -(1 << 31)),
    default("FFFFFFh of an INTEGER24", "0x10", "0xFFFFFF", "", -1),
    default("FFFFFFFFFFh of an INTEGER40", "0x12", "0xFFFFFFFFFE", "", -2),
    default("INTEGER64", "0x15", "0xFFFFFFFFFFFFFFFF", "", -1),
    default("UNSIGNED56", "0x1A", "0xFFFFFFFFFFFFFF", "", (1 << 56) - 1),
    default("BOOLEAN", "1", "1", "", True),
    default("BOOLEAN in words", "1", "True", "number-form", True),
    default("BOOLEAN of 2", "1", "2", "out-of-range", False),
    default("REAL32", "8", "1.5", "", 1.5),
    default("REAL32 in IEEE 754", "8", "0x3FC00000", "", 1.5),
    default("REAL32 with a comma", "8", "1,5", "decimal-comma", 1.5),
    default("REAL32 with the suffix of C", "8", "1.5f", "number-form", 1.5),
    default("REAL32 as an integer", "8", "3", "", 3.0),
    default("REAL32 beyond its range", "8", "1e39", "out-of-range", 0),
    default("REAL32 with nine digits of IEEE 754", "8", "0x13FC00000", "out-of-range", 0),
    default("REAL64 in IEEE 754", "0x11", "0x3FF8000000000000", "", 1.5),
    default("REAL of a word", "8", "fast", "bad-number", 0),
    default("infinite", "8", "inf", "number-form", float("inf")),
    default("VISIBLE_STRING", "9", "AZ3 drive", "", "AZ3 drive"),
    default("VISIBLE_STRING that looks like a number", "9", "001", "", "001"),
    default("OCTET_STRING", "10", "01020A", "", b"\1\2\x0a"),
    default("OCTET_STRING with blanks", "10", "01 02 0A", "hex-form", b"\1\2\x0a"),
    default("OCTET_STRING of one digit", "10", "0", "hex-form", b"\0"),
    default("OCTET_STRING that is text", "10", "@ABCD", "bad-hex", b"@ABCD"),
    default("DOMAIN with a prefix", "15", "0xFF", "hex-form", b"\xff"),
    default("UNICODE_STRING", "11", "speed", "", "speed"),
    default("TIME_OF_DAY as a number of 48 bits", "12", "0x000100000000", "", 24 * 3600 * 1000),
    default("TIME_DIFFERENCE as days and milliseconds", "13", "365 43200000", "number-form", 31579200000),
    default("TIME_OF_DAY with a day of 25 hours", "12", "0x000005555550", "out-of-range", 0),
    default("a remark of C", "3", "5 // rpm", "foreign-comment", 5),
    default("formula", "7", "$NODEID+0x200", "", 0x205),
    default("formula the other way round", "7", "0x200+$NODEID", "formula-form", 0x205),
    default("formula with blanks", "7", "$NODEID + 0x200", "", 0x205),
    default("formula without a number", "7", "$NODEID", "", 5),
    default("formula in other capitals", "7", "$NodeID+0x200", "formula-form", 0x205),
    default("formula without its sign", "7", "NODEID+0x200", "formula-form", 0x205),
    default("formula of three terms", "7", "$NODEID+0x200+0x80000000", "", 0x80000205),
    default("formula with a difference", "7", "$NODEID-1", "bad-formula", 0),
    default("formula with a product", "7", "$NODEID*2+0x200", "bad-formula", 0),
    default("formula of two nodes", "7", "$NODEID+$NODEID", "bad-formula", 0),
    default("formula with a comment", "7", "$NODEID+0x200;RPDO1", "inline-comment", 0x205),
    default("formula of a type that is too narrow", "5", "$NODEID+0x200", "out-of-range", 0),
    default("formula beyond the type for this node", "5", "$NODEID+253", "", 0),
]

BYTES = changed("=5\n", "=05\n")
DOMAIN = changed("ObjectType=7", "ObjectType=2", BYTES).replace("DataType=3\nAccessType=rw\n", "")
OBJECTS = [
    case("missing ObjectType", changed("ObjectType=7\n", ""), ""),
    case("ObjectType with a prefix and zeros", changed("ObjectType=7", "ObjectType=0x07"), ""),
    case("ObjectType 0", changed("ObjectType=7", "ObjectType=0"), "6 bad-object-type"),
    case("ObjectType that is empty", changed("ObjectType=7", "ObjectType="), ""),
    case("an object of the type DOMAIN", DOMAIN, "", b"\5"),
    case("no DataType", changed("DataType=3\n", "", BYTES), "4 no-data-type", b"\5"),
    case("unknown DataType", changed("DataType=3", "DataType=0x40", BYTES), "7 bad-data-type", b"\5"),
    case("DataType in words", changed("DataType=3", "DataType=i16", BYTES), "7 bad-data-type,7 bad-number", b"\5"),
    case("DataType with zeros in place of a prefix", changed("DataType=3", "DataType=0003"), ""),
    case("DataType in hexadecimal without a prefix", typed("000B", "text"), "7 number-form", "text"),
    case(
        "data type of CanFestival",
        changed("DataType=3", "DataType=0xA0")
        + "[A0]\nParameterName=INTEGER16[0-10]\nObjectType=5\nSubNumber=2\n"
        + "[A0sub0]\nParameterName=Number\nObjectType=7\nDataType=5\nAccessType=ro\nDefaultValue=1\n"
        + "[A0sub1]\nParameterName=Type\nObjectType=7\nDataType=5\nAccessType=ro\nDefaultValue=0x03\n",
        "7 own-data-type,11 section-form,15 section-form,21 section-form",
    ),
    case("no AccessType", changed("AccessType=rw\n", ""), "4 no-access"),
    case("AccessType in capitals", changed("=rw", "=RW"), "8 access-form"),
    case("AccessType in full words", changed("=rw", "=read/write"), "8 access-form"),
    case("AccessType for PDOs", changed("=rw", "=rww"), ""),
    case("no ParameterName", changed("ParameterName=Speed\n", ""), "4 no-name"),
    case("an empty ParameterName", changed("=Speed", "="), "5 no-name"),
    case("PDOMapping that is empty", changed("PDOMapping=1", "PDOMapping="), ""),
    case("PDOMapping in words", changed("PDOMapping=1", "PDOMapping=yes"), "10 number-form"),
    case("no PDOMapping", changed("PDOMapping=1\n", ""), ""),
    case("limits", changed("=5\n", "=5\nLowLimit=-10\nHighLimit=10\n"), ""),
    case("limits that are empty", changed("=5\n", "=5\nLowLimit=\nHighLimit=\n"), ""),
    case("limits in two's complement", changed("=5\n", "=5\nLowLimit=0x8000\nHighLimit=0x7FFF\n"), ""),
    case("limits that are crossed", changed("=5\n", "=5\nLowLimit=10\nHighLimit=1\n"), "10 limits-crossed"),
    case("limits of a REAL in hexadecimal", typed("8", "5", "LowLimit=0xC1200000"), ""),
    case("limits of words", changed("=5\n", "=5\nLowLimit=min\n"), "10 bad-number"),
    case("not in a list", OBJECT, "1 not-listed"),
    case("listed, but missing", GOOD.replace("1=0x2000", "1=0x2000\n2=0x2001"), "4 no-object"),
    case("listed twice", GOOD.replace("1=0x2000", "1=0x2000\n2=0x2000"), "4 listed-twice"),
    case("listed without a number", GOOD.replace("1=0x2000", "1=0x2000\n2=none"), "4 bad-number"),
    case("listed in decimal", GOOD.replace("0x2000", "8192"), ""),
    Oddity("a record", RECORD, (), {(0x2000, 0): 1, (0x2000, 1): 7}),
    Oddity("SubNumber with leading zeros", changed("r=2", "r=02", RECORD), (), {(0x2000, 1): 7}),
    Oddity("Sub with a capital", changed("[2000sub1]", "[2000Sub1]", RECORD), (), {(0x2000, 1): 7}),
    Oddity("sub in decimal", changed("[2000sub1]", "[2000sub01]", RECORD), ("15 section-form",), {(0x2000, 1): 7}),
    Oddity("sub with a prefix", changed("[2000sub1]", "[2000sub0x1]", RECORD), ("15 section-form",), {(0x2000, 1): 7}),
    Oddity("sub with a blank", changed("[2000sub1]", "[2000 sub1]", RECORD), ("15 section-form",), {(0x2000, 1): 7}),
    Oddity("sub beyond FFh", RECORD + "[2000sub100]\n", ("22 sub-range",), {(0x2000, 1): 7}),
    Oddity("no object, only subs", LIST + RECORD[RECORD.index("[2000sub0]") :], ("4 no-parent",), {(0x2000, 1): 7}),
    Oddity("a record without subs", changed("ObjectType=7", "ObjectType=9"), ("6 no-subs",), {(0x2000, 0): 5}),
    Oddity("a variable with subs", changed("ObjectType=9", "ObjectType=7", RECORD), ("6 subs-of-variable",),
           {(0x2000, 0): 1, (0x2000, 1): 7}),
    Oddity("a record without a type", changed("ObjectType=9\n", "", RECORD), (), {(0x2000, 1): 7}),
    Oddity("no sub-index 0", RECORD.replace("sub0]", "sub2]"), ("4 no-sub0",), {(0x2000, 0): 2, (0x2000, 2): 1}),
]  # fmt: skip

COMPACT = changed("ObjectType=7", "ObjectType=8") + "CompactSubObj=3\n"
STORAGE = [
    Oddity("compact", COMPACT, (), {(0x2000, 0): 3, (0x2000, 1): 5, (0x2000, 3): 5}),
    Oddity("compact with names", COMPACT + "[2000Name]\nNrOfEntries=1\n2=second\n", (), {(0x2000, 2): 5}),
    Oddity("compact with values", COMPACT + "[2000Value]\nNrOfEntries=1\n2=9\n", (), {(0x2000, 1): 5, (0x2000, 2): 9}),
    Oddity("compact values as formulas", COMPACT + "[2000Value]\nNrOfEntries=1\n2=$NODEID+1\n", (), {(0x2000, 2): 6}),
    Oddity("compact value of no number", COMPACT + "[2000Value]\nNrOfEntries=1\n2=x\n", ("14 bad-number",),
           {(0x2000, 2): 5}),
    Oddity("compact name beyond the end", COMPACT + "[2000Name]\nNrOfEntries=1\n9=ninth\n", ("14 compact-entry",), {}),
    Oddity("compact name of 0", COMPACT + "[2000Name]\nNrOfEntries=1\n0=none\n", ("14 compact-entry",), {}),
    Oddity("compact and a sub of its own", COMPACT + "[2000sub2]\nParameterName=own\nObjectType=7\nDataType=3\n"
           "AccessType=ro\nDefaultValue=8\n", ("11 compact-and-subs",), {(0x2000, 1): 5, (0x2000, 2): 8}),
    Oddity("compact of 0 for a variable", GOOD + "CompactSubObj=0\n", (), {SPEED: 5}),
    Oddity("compact PDOs", "[DeviceInfo]\nNrOfRXPDO=5\nNrOfTXPDO=1\nCompactPDO=0x13\n", (),
           {(0x1400, 0): 5, (0x1400, 1): 0x205, (0x1403, 1): 0x505, (0x1404, 1): 0x80000000, (0x1800, 1): 0x185,
            (0x1600, 0): 0, (0x1A00, 64): 0}),
    Oddity("compact PDOs, none of them", "[DeviceInfo]\nNrOfRXPDO=5\nCompactPDO=0\n", (), {}),
    Oddity("compact PDOs in words", "[DeviceInfo]\nNrOfRXPDO=four\nCompactPDO=0x13\n", ("2 bad-number",), {}),
    Oddity("parameter value", changed("=5\n", "=5\nParameterValue=6\n"), (), {SPEED: 6}),
    Oddity("parameter value that cannot be", changed("=5\n", "=5\nParameterValue=66666\n"), ("10 out-of-range",),
           {SPEED: 5}),
]  # fmt: skip

MADE = [*TEXT, *NAMES, *NUMBERS, *OBJECTS, *STORAGE]
"""Invented cases. `field_files` lists those that were found in public files, and adds others from such files."""
