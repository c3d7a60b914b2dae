"""Changing and composing EDS files: a change affects only its lines, and is read back."""

from __future__ import annotations

from datetime import datetime
from typing import Any

import pytest
from hypothesis import assume, given, strategies as st

from barewire.canopen import eds
from barewire.canopen.datatypes import TimeOfDay
from barewire.canopen.eds.objects import RECORD as RECORD_TYPE
from barewire.errors import EncodeError
from barewire_workbench.eds.lint import lint
from tests.canopen.eds.field_files import ODDITIES
from tests.canopen.eds.oddities import COMPACT, GOOD, RECORD, typed
from tests.helpers import modest


def lines_that_differ(before: bytes, after: bytes) -> list[tuple[bytes, bytes]]:
    old, new = before.splitlines(keepends=True), after.splitlines(keepends=True)
    assert len(old) == len(new)
    return [(was, now) for was, now in zip(old, new) if was != now]


def test_a_change_affects_one_line_and_keeps_its_form() -> None:
    file = GOOD.replace("DefaultValue=5", "  defaultvalue =\t0x0005   ; rpm").encode()
    document = eds.parse(file)
    document.set(0x2000, 0, "DefaultValue", -2)
    assert lines_that_differ(file, document.encode()) == [
        (b"  defaultvalue =\t0x0005   ; rpm\n", b"  defaultvalue =\t0xFFFE   ; rpm\n")
    ]
    assert document.dictionary().get(0x2000) == -2


@pytest.mark.parametrize(
    ("code", "old", "value", "written"),
    [
        ("6", "5", 1000, "1000"),
        ("6", "0x05", 1000, "0x3E8"),
        ("3", "0x05", -1, "0xFFFF"),
        ("1", "0", True, "1"),
        ("8", "1.5", 2.25, "2.25"),
        ("8", "0x3FC00000", 2.25, "0x40100000"),
        ("9", "old", "new", "new"),
        ("9", "old", b"new", "new"),
        ("11", "old", "new", "new"),
        ("10", "01", b"\1\xff", "01FF"),
        ("12", "0", TimeOfDay.of(datetime(1984, 1, 2)), "0x000100000000"),
        ("7", "0x200", eds.Formula(0x180), "$NODEID+0x180"),
        ("7", "0x200", eds.Formula(0), "$NODEID+0x0"),
        ("7", "0x200", "$NODEID+1", "$NODEID+1"),
    ],
)
def test_values_are_written_in_the_form_of_the_old_one(code: str, old: str, value: Any, written: str) -> None:
    document = eds.parse(typed(code, old).encode())
    document.set(0x2000, 0, "DefaultValue", value)
    assert document.get("2000", "DefaultValue") == written
    given = value.at(5) if isinstance(value, eds.Formula) else value
    if not isinstance(value, (str, bytes)) or code == "10":
        assert document.dictionary(5).get(0x2000) == given


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("DefaultValue", 40000, "does not fit i16"),
        ("DefaultValue", b"x", "not a whole number"),
        ("DefaultValue", eds.Formula(40000), "does not fit i16"),
        ("ObjFlags", 1.5, "expected text or a whole number"),
        ("ParameterName", "two\nlines", "would not be read back"),
        ("ParameterName", " blank", "would not be read back"),
        ("ParameterName", "name ; comment", "would not be read back"),
        ("ParameterName", "Überlast", "cannot be written in ascii"),
        ("Bad=Key", "x", "would not be read back"),
    ],
)
def test_a_refused_value_leaves_the_file_unchanged(key: str, value: Any, message: str) -> None:
    document = eds.parse(GOOD.encode())
    with pytest.raises(EncodeError, match=message):
        document.set(0x2000, 0, key, value)
    assert document.encode() == GOOD.encode()


def test_a_text_in_quotes_is_refused() -> None:
    document = eds.parse(typed("9", '"old"').encode())
    assert document.dictionary().get(0x2000) == "old"
    with pytest.raises(EncodeError, match="would be read back without its quotes"):
        document.set(0x2000, 0, "ParameterValue", b'"new"')
    document.set(0x2000, 0, "DefaultValue", b"new")
    assert document.dictionary().get(0x2000) == "new"


def test_unknown_objects_are_refused() -> None:
    document = eds.parse(GOOD.encode())
    with pytest.raises(EncodeError, match="no object 3000h"):
        document.set(0x3000, 0, "DefaultValue", 1)
    with pytest.raises(EncodeError, match="no sub-index 01h"):
        document.set(0x2000, 1, "DefaultValue", 1)
    with pytest.raises(EncodeError, match="would not be read back"):
        document.put("two]sections", "key", "value")
    assert document.encode() == GOOD.encode()


def test_new_keys_and_sections_use_the_line_end_of_the_file() -> None:
    file = GOOD.replace("\n", "\r\n").removesuffix("\r\n")
    document = eds.parse(file.encode())
    document.set(0x2000, 0, "parametervalue", 6)
    document.put("Tool", "Colour", "red")
    assert document.encode().decode() == f"{file}\r\nParameterValue=6\r\n\r\n[Tool]\r\nColour=red\r\n"
    empty = eds.parse(b"")
    empty.put("FileInfo", "FileName", "a.eds")
    assert empty.encode() == b"[FileInfo]\r\nFileName=a.eds\r\n"


def test_a_new_key_follows_the_last_one_of_its_section() -> None:
    document = eds.parse(b"[FileInfo]\nFileName=a\n; end of it\n\n[DeviceInfo]\n")
    document.put("FileInfo", "FileVersion", "1")
    document.put("DeviceInfo", "VendorName", "me")
    assert document.encode() == b"[FileInfo]\nFileName=a\nFileVersion=1\n; end of it\n\n[DeviceInfo]\nVendorName=me\n"


def test_none_removes_every_line_of_a_key() -> None:
    document = eds.parse(GOOD.replace("=5\n", "=5\ndefaultvalue=6\n").encode())
    document.set(0x2000, 0, "DefaultValue", None)
    document.set(0x2000, 0, "Denotation", None)
    document.put("Nowhere", "key", None)
    assert document.encode() == GOOD.replace("DefaultValue=5\n", "").encode()


def test_a_value_before_a_comment() -> None:
    document = eds.parse(GOOD.replace("=5", "=;none").encode())
    document.set(0x2000, 0, "DefaultValue", 7)
    assert document.get("2000", "DefaultValue") == "7"
    assert b"DefaultValue=7 ;none\n" in document.encode()


def test_compact_storage_writes_values_to_their_own_section() -> None:
    document = eds.parse(COMPACT.encode())
    document.set(0x2000, 2, "ParameterValue", 9)
    document.set(0x2000, 1, "ParameterValue", 8)
    document.set(0x2000, 2, "ParameterName", "second")
    document.set(0x2000, 2, "Denotation", "left")
    text = document.encode().decode()
    assert text.startswith(COMPACT)
    assert "[2000Value]\nNrOfEntries=2\n2=9\n1=8\n" in text
    assert [document.dictionary().get(0x2000, sub) for sub in range(4)] == [3, 8, 9, 5]
    item = document.objects[0x2000].item(2)
    assert (item.name, item.denotation, item.value) == ("second", "left", 9)
    for sub, key in ((1, "DefaultValue"), (0, "ParameterName")):
        with pytest.raises(EncodeError, match="made by CompactSubObj"):
            document.set(0x2000, sub, key, 1)


def test_an_implied_record_is_written_out() -> None:
    document = eds.parse(b"[DeviceInfo]\nNrOfRXPDO=0\nNrOfTXPDO=1\nCompactPDO=0x13\n")
    document.set(0x1800, 2, "ParameterValue", 255)
    assert document.get("1800", "SubNumber") == "4"
    assert document.get("1800sub1", "DefaultValue") == "$NODEID+0x180"
    assert document.get("OptionalObjects", "1") == "0x1800"
    assert document.diagnostics == ()
    assert document.dictionary(1).get(0x1800, 2) == 255
    assert document.objects[0x1A00].line == 0
    with pytest.raises(EncodeError, match="exists already"):
        eds.add_object(document, document.objects[0x1800])


EDITABLE = [oddity for oddity in ODDITIES if isinstance(oddity.file, str) and "5" in oddity.file]


@modest
@given(st.sampled_from(EDITABLE), st.integers(0, 100), st.data())
def test_a_written_value_is_read_back(oddity: Any, value: int, data: st.DataObject) -> None:
    """In every odd file, a written value is read back, and no other line changes."""
    before = oddity.file.encode("ascii")
    document = eds.parse(before)
    written = [described for described in document.objects.values() if described.line]
    places = [(described.index, item) for described in written for item in described.items]
    numbers = [(index, item) for index, item in places if item.type[0] in "ui" and item.type != "unicode"]
    assume(numbers)
    index, item = data.draw(st.sampled_from(numbers))
    assume(not document.objects[index].compact or f"{index:04x}sub{item.sub:x}" in document.sections)
    section = f"{index:04X}sub{item.sub:X}" if f"{index:04x}sub{item.sub:x}" in document.sections else f"{index:04X}"
    is_new = document.get(section, "DefaultValue") is None
    document.set(index, item.sub, "DefaultValue", value)
    again = eds.parse(document.encode())
    assert again.objects[index].item(item.sub).default == value
    assert again.encode() == document.encode()
    old, new = (eds.parse(text).lines for text in (before, document.encode()))
    if is_new:
        added = [line for line in new if line not in old]
        assert len(new) == len(old) + 1
        assert len(added) <= 2  # the last line may have had no end
    else:
        assert sum(was != now for was, now in zip(old, new, strict=True)) <= 1


# From scratch


def test_a_composed_file_has_no_findings() -> None:
    ramps = eds.EdsObject(
        0x2000,
        "Ramps",
        RECORD_TYPE,
        (
            eds.EdsItem(0, "Highest sub-index", "u8", "const", 2),
            eds.EdsItem(1, "Up", "u16", "rw", 7, low=1, high=1000, pdo=True, flags=1),
            eds.EdsItem(2, "Name", "string", "ro", "ramp", value="up", denotation="left"),
        ),
    )
    basic = [
        eds.EdsObject(0x1000, "Device type", 7, (eds.EdsItem(0, "Device type", "u32", "ro", 0),)),
        eds.EdsObject(0x1001, "Error register", 7, (eds.EdsItem(0, "Error register", "u8", "ro", 0),)),
        eds.EdsObject(0x1014, "COB-ID EMCY", 7, (eds.EdsItem(0, "COB-ID EMCY", "u32", "rw", eds.Formula(0x80)),)),
        eds.EdsObject(
            0x1018, "Identity", 9, (eds.EdsItem(0, "n", "u8", "ro", 1), eds.EdsItem(1, "Vendor-ID", "u32", "ro", 0))
        ),
    ]
    times = {"CreationTime": "09:30AM", "CreationDate": "01-31-2026"}
    times |= {"ModificationTime": "12:59PM", "ModificationDate": "12-31-2026"}
    document = eds.compose([ramps, *basic], times, {"VendorName": "Nobody"}, comments=["hello ; you"], dummies=[5])
    assert lint(document) == ()
    again = eds.parse(document.encode(), strict=True)
    assert [(item.name, item.type, item.default, item.low, item.pdo) for item in again.objects[0x2000].items] == [
        ("Highest sub-index", "u8", 2, None, False),
        ("Up", "u16", 7, 1, True),
        ("Name", "string", "ramp", None, False),
    ]
    assert again.objects[0x2000].item(2).denotation == "left"
    assert again.get("Comments", "line1") == "hello ; you"
    assert again.dummies == {5}
    assert repr(again) == f"<Eds: {len(again.lines)} lines, 5 objects>"
    assert eds.parse(again.encode()).encode() == again.encode()


def test_names_that_cannot_be_written_are_refused() -> None:
    bad = eds.EdsObject(0x2000, "x", 7, (eds.EdsItem(0, "a ; b", "u8"),))
    with pytest.raises(EncodeError, match="would not be read back"):
        eds.compose([bad])
    with pytest.raises(EncodeError, match="'Ü' cannot be written in ascii"):
        eds.compose([], {"Description": "Ü"})
    assert eds.compose([], {"Description": "Ü"}, encoding="latin-1").encoding == "latin-1"


# DCF


def test_a_dcf_is_made_of_an_eds() -> None:
    before = ("[FileInfo]\nFileName=a.eds\n" + RECORD).encode()
    document = eds.parse(before)
    dcf = eds.to_dcf(document, 5, {(0x2000, 1): 9}, name="left wheel", bitrate=500_000)
    assert document.encode() == before
    assert dcf.get("FileInfo", "LastEDS") == "a.eds"
    assert dcf.get("DeviceComissioning", "NodeID") == "5"
    assert dcf.get("DeviceComissioning", "NodeName") == "left wheel"
    assert dcf.get("DeviceComissioning", "Baudrate") == "500"
    assert dcf.dictionary().get(0x2000, 1) == 9
    assert dcf.dictionary().entry(0x2000, 1).default == 7
    assert eds.parse(dcf.encode(), strict=True).get("DeviceComissioning", "CANopenManager") == "0"
    again = eds.to_dcf(dcf, 6, {"ramps.up": 10})
    assert (again.get("DeviceComissioning", "NodeID"), again.dictionary().get(0x2000, 1)) == ("6", 10)
    assert again.get("DeviceComissioning", "NodeName") == "left wheel"


def test_lines_that_are_added_leave_the_positions_of_all_others_right() -> None:
    """Sections and diagnostics are those that a parser of the changed text finds."""
    twice = (
        "stray=1\n[2000]\nParameterName=x\nwhat = 1\nDataType=5\n[2001]\nDataType=6\nDataType=7\n[2000]\nwhy=2\n[Old]\n"
    )
    document = eds.parse(twice.encode())
    for section, key in (("2001", "ParameterName"), ("Old", "first"), ("2000", "AccessType"), ("2001", "odd key")):
        assert len(document.diagnostics) > 4
        document.put(section, key, "7")
        parsed = eds.parse(document.encode())
        assert (dict(document.sections), document.diagnostics) == (dict(parsed.sections), parsed.diagnostics)
        assert document.get(section, key) == "7"
        assert list(document.objects) == list(parsed.objects)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({(0x2000, 0): 11}, r"2000h:00 Speed = 11: expected -10..10"),
        ({(0x2000, 0): -11}, "expected -10..10"),
        ({(0x2000, 1): 1}, "no object 2000h:01"),
        ({"Nothing": 1}, "no object is called 'Nothing'"),
        ({(0x2000, 0): "text"}, "^2000h:00 Speed = 'text': expected a value of i16$"),
        ({(0x2000, 0): ""}, "^2000h:00 Speed = '': expected a value of i16$"),
        ({(0x2000, 0): "0x0B"}, r"^2000h:00 Speed = 11: expected -10..10$"),
        ({0x2000: 1.5}, "^1.5 is not a whole number for i16; 2000h:00 Speed$"),
        ({0x2000: None}, "^2000h:00 Speed = None: expected a value of i16$"),
        ({0x2001: 1}, "^there is no object 2001h:00$"),
        ({(0x2000,): 1}, r"^\(8192,\): expected the name of an object, its index, or \(index, sub-index\)$"),
        ([5], r"^to_dcf: values \[5\]: expected a mapping, such as \{\(0x1017, 0\): 500\}$"),
    ],
)
def test_a_dcf_refuses_values_outside_of_their_type_or_limits(values: Any, message: str) -> None:
    document = eds.parse(GOOD.replace("=5\n", "=5\nLowLimit=-10\nHighLimit=10\n").encode())
    with pytest.raises(EncodeError, match=message):
        eds.to_dcf(document, 5, values)
    assert eds.to_dcf(document, 5, {(0x2000, 0): "0x0A"}).dictionary().get(0x2000) == 10
    for node in ("5", 5.0, None, True, 0, 128):
        with pytest.raises(EncodeError, match=rf"^node {node!r}: expected 1..127$"):
            eds.to_dcf(document, node)  # type: ignore[arg-type]
    with pytest.raises(EncodeError, match=r"^to_dcf: 'a.eds': expected an EDS, such as eds.parse returns$"):
        eds.to_dcf("a.eds", 5)  # type: ignore[arg-type]
    with pytest.raises(EncodeError, match="expected one of 10, 20"):
        eds.to_dcf(document, 5, bitrate=33_000)
