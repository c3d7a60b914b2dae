"""Reading EDS files: without loss, without exceptions, with a diagnostic and a defined value for every oddity."""

from __future__ import annotations

import re
from typing import Any

import pytest
from hypothesis import example, given, strategies as st

from barewire.canopen import CanFrame, LocalNode, PdoConfig, eds
from barewire.canopen.eds.diagnostics import LINT_RULES, PARSE_RULES
from barewire.canopen.object_dictionary import ObjectDictionary
from barewire.errors import EncodeError
from barewire_workbench.eds.lint import lint
from tests.canopen.eds import table as eds_table
from tests.canopen.eds.field_files import FIELD, LINTED, ODDITIES, SEEN
from tests.canopen.eds.oddities import GOOD, MADE, RECORD, Oddity
from tests.helpers import every_case, modest


def data_of(oddity: Oddity) -> bytes:
    return oddity.file if isinstance(oddity.file, bytes) else oddity.file.encode("ascii")


def present(objects: ObjectDictionary, index: int, sub: int) -> Any:
    return objects.get(index, sub)


@every_case("oddity", ODDITIES)
def test_an_oddity_is_reported_and_read(oddity: Oddity) -> None:
    document = eds.parse(data_of(oddity))
    assert [f"{diagnostic.line} {diagnostic.rule}" for diagnostic in document.diagnostics] == list(oddity.rules)
    assert document.encode() == data_of(oddity)
    objects = document.dictionary(5)
    for place, value in oddity.values.items():
        assert present(objects, *place) == value, f"{place[0]:04X}h:{place[1]:02X}"
    if oddity.rules:
        with pytest.raises(eds.EdsError, match=oddity.rules[0].split()[1]) as caught:
            eds.parse(data_of(oddity), strict=True)
        assert caught.value.diagnostics == document.diagnostics
    else:
        assert eds.parse(data_of(oddity), strict=True).encode() == data_of(oddity)


@every_case("oddity", LINTED)
def test_an_oddity_is_reported_by_lint_only(oddity: Oddity) -> None:
    document = eds.parse(data_of(oddity))
    findings = [f"{diagnostic.line} {diagnostic.rule}" for diagnostic in lint(document)]
    assert set(oddity.rules) <= set(findings)
    assert not {line.split()[1] for line in oddity.rules} & {diagnostic.rule for diagnostic in document.diagnostics}
    assert document.encode() == data_of(oddity)
    for place, value in oddity.values.items():
        assert present(document.dictionary(5), *place) == value


def test_every_rule_has_a_case() -> None:
    assert len({oddity.name for oddity in ODDITIES}) == len(ODDITIES)
    assert SEEN.keys() <= {oddity.name for oddity in MADE}
    assert all(oddity.seen for oddity in [*FIELD, *LINTED])
    assert sum(1 for oddity in [*ODDITIES, *LINTED] if oddity.seen and oddity.rules) >= 100
    seen = {line.split()[1] for oddity in ODDITIES for line in oddity.rules}
    assert seen == set(PARSE_RULES)
    assert not set(PARSE_RULES) & set(LINT_RULES)


def test_the_page_lists_every_rule() -> None:
    text = eds_table.PAGE.read_text(encoding="utf-8")
    rows = re.findall(r"^\| `([a-z0-9-]+)` \| (.*) \| (.*) \|$", text, re.MULTILINE)
    assert {rule: message for rule, message, _ in rows} == PARSE_RULES | LINT_RULES
    assert [rule for rule, _, line in rows if not line] == ["missing-section", "missing-object"]
    assert eds_table.page(text) == text, "python -m tests.canopen.eds.table"


def test_text_beyond_visible_string_is_read_as_its_bytes() -> None:
    file = GOOD.replace("DataType=3", "DataType=9").replace("=5\n", "=€\n").encode()
    document = eds.parse(file)
    assert [diagnostic.rule for diagnostic in document.diagnostics] == ["bad-text", "not-ascii"]
    entry = document.dictionary().entry(0x2000)
    assert entry.codec.encode(entry.default) == "€".encode()  # what a device with this dictionary sends


def test_the_error_counts_the_other_diagnostics() -> None:
    with pytest.raises(eds.EdsError, match=r"^line 1: byte-order-mark: .* \(and 1 more\)$"):
        eds.parse(b"\xef\xbb\xbf" + GOOD.replace("=5", "=+5").encode(), strict=True)


def test_objects_and_items_of_a_record() -> None:
    document = eds.parse(RECORD.encode())
    ramps = document.objects[0x2000]
    assert (ramps.name, ramps.is_record, ramps.line) == ("Ramps", True, 4)
    assert ramps.item(1) == eds.EdsItem(1, "Up", "u16", "rw", 7, code=6)
    with pytest.raises(Exception, match="no sub-index 05h"):
        ramps.item(5)
    entry = document.dictionary().find("ramps.UP")
    assert (entry.index, entry.sub, entry.type, entry.object_name, entry.mappable) == (0x2000, 1, "u16", "Ramps", ())


@pytest.mark.parametrize(
    ("access", "pdo", "mappable", "right"),
    [
        ("ro", 1, ("TPDO",), "ro"),
        ("const", 1, ("TPDO",), "const"),
        ("wo", 1, ("RPDO",), "wo"),
        ("rw", 1, ("RPDO", "TPDO"), "rw"),
        ("rwr", 1, ("TPDO",), "rw"),
        ("rww", 1, ("RPDO",), "rw"),
        ("rw", 0, (), "rw"),
    ],
)
def test_access_types_and_mapping(access: str, pdo: int, mappable: tuple[str, ...], right: str) -> None:
    file = GOOD.replace("=rw", f"={access}").replace("PDOMapping=1", f"PDOMapping={pdo}")
    entry = eds.parse(file.encode()).dictionary().entry(0x2000)
    assert (entry.access, entry.mappable) == (right, mappable)


def test_limits_are_read() -> None:
    file = GOOD.replace("=5\n", "=5\nLowLimit=0x8000\nHighLimit=$NODEID+10\n")
    entry = eds.parse(file.encode()).dictionary(3).entry(0x2000)
    assert (entry.minimum, entry.maximum) == (-32768, 13)


def test_a_formula_needs_a_node() -> None:
    file = GOOD.replace("=5\n", "=$NODEID+0x200\n")
    assert eds.parse(file.encode()).objects[0x2000].item().default == eds.Formula(0x200)
    with pytest.raises(Exception, match=r"2000h:00 is \$NODEID\+0x200: a node-ID is needed"):
        eds.parse(file.encode()).dictionary()
    with pytest.raises(Exception, match="128"):
        eds.parse(file.encode()).dictionary(128)
    commissioned = eds.parse(f"{file}[DeviceComissioning]\nNodeID=0x10\n".encode())
    assert commissioned.dictionary().get(0x2000) == 0x210


def test_names_and_denotations_of_compact_storage() -> None:
    file = GOOD.replace("Type=7", "Type=8") + "CompactSubObj=2\n[2000Name]\n1=a\n[2000Denotation]\n2=left ; wheel\n"
    items = eds.parse(file.encode()).objects[0x2000].items
    assert [(item.name, item.denotation) for item in items] == [("NrOfObjects", ""), ("a", ""), ("Speed2", "left")]


def test_dummy_usage() -> None:
    document = eds.parse(b"[DummyUsage]\nDummy0002=1\nDummy0005=1\nDummy0006=0\nDummyFace=1\nother=1\n")
    assert document.dummies == {2, 5}
    assert eds.parse(b"").dummies == frozenset()


def test_a_node_serves_the_dictionary_of_a_file() -> None:
    device = LocalNode(5, eds.parse(GOOD.encode()).dictionary(5), [PdoConfig("TPDO", 1, (0x20000010,))])
    device.start(0.0)
    answers = device.feed(CanFrame.parse("605#4000200000000000"), 0.1)
    assert [str(frame) for frame in answers] == ["585#4B00200005000000"]
    unmapped = eds.parse(GOOD.replace("PDOMapping=1", "PDOMapping=0").encode())
    with pytest.raises(EncodeError, match=r"cannot be mapped to an? TPDO"):
        LocalNode(5, unmapped.dictionary(5), [PdoConfig("TPDO", 1, (0x20000010,))])


# Arbitrary bytes and text

PIECES = st.sampled_from(
    [
        *("[2000]", "[2000sub0]", "[2000sub1]", "[2000Value]", "[DeviceInfo]", "[DummyUsage]", "[1A00]", "[Comments]"),
        *("[ManufacturerObjects]", "[2000Name]", "[A0]", "[A0sub1]", "[DeviceComissioning]", "[sub]", "[", "]"),
        *("1=0x2000", "0=x", "CompactSubObj=3", "CompactPDO=0xFF", "NrOfTXPDO=3", "DataType=8", "DataType=0xA0"),
        *("DataType=12", "ObjectType=9", "ObjectType=8", "ObjectType=5", "AccessType=rw", "ParameterName=a;b ; c"),
        *(
            "DefaultValue=$NODEID+1",
            "DefaultValue=1,5",
            "LowLimit=-1",
            "HighLimit=0xFFFF",
            "ParameterValue=-",
            "NodeID=5",
        ),
        *(";", "=", ":", " ", "\t", "\r", "\n", "\r\n", "\0", "\x1a", "ü", "Dummy00zz=1", "SubNumber=99999999999"),
    ]
)


def check_that_nothing_raises(data: bytes) -> None:
    document = eds.parse(data)
    assert document.encode() == data
    assert document.copy().encode() == data
    lint(document)
    last = max(1, len(document.lines))
    assert all(PARSE_RULES[finding.rule] and 0 <= finding.line <= last for finding in document.diagnostics)
    objects = document.dictionary(5)
    for entry in objects:
        entry.codec.encode(objects.get(entry.index, entry.sub))


@modest
@given(st.binary(max_size=200))
@example(b"\xff\xfe[\x002")
@example(b"\xef\xbb\xbf\xff")
def test_any_bytes_parse_without_exception(data: bytes) -> None:
    check_that_nothing_raises(data)


@modest
@given(st.lists(PIECES | st.text(max_size=5), max_size=30), st.sampled_from(["", "\n", "\r\n"]))
def test_any_text_parses_without_exception(pieces: list[str], between: str) -> None:
    check_that_nothing_raises(between.join(pieces).encode("utf-8", "surrogatepass"))
