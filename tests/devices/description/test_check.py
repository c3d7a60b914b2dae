"""Errors in descriptions: each kind is reported with the file, the line, the key and what was expected.

Line numbers of TOML keys: which lines are keys and headers, and which are inside of strings, arrays and comments.
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from hypothesis import given, strategies as st

from barewire.devices import DescriptionError, load
from barewire.devices.description.check import KeyLines, KeyPath, rule_of
from barewire.devices.description.load import CATALOG
from barewire.errors import BarewireError
from tests.helpers import every_case, modest, refused

HEAD = """\
name = "mine"
title = "My machine"
[modbus]
first_register = 1
read_functions = { holding = 3, input = 4, coil = 1 }
write_functions = { holding = [6], coil = [5] }
[canopen]
"""

# The row under test has lines 8 to 12 of rows.toml, and what is added to it begins with line 13. The lines before it
# contain a table header inside of a string, which is not a header.
BEFORE = '''\
[[parameter]]
name = "first"
type = "u16"
holding = 7
access = "rw"
note = """
[[parameter]] half = "L" """
'''
ROW = {"name": '"second"', "type": '"u16"', "holding": "8", "access": '"rw"'}


def write(directory: Path, rows: str, head: str = HEAD) -> Path:
    (directory / "device.toml").write_text(head, encoding="utf-8")
    (directory / "rows.toml").write_text(rows, encoding="utf-8")
    return directory


def row(**changes: str | None) -> str:
    """Return the second row with some of its values changed, left out (None) or added."""
    lines = {**ROW, **changes}
    return "[[parameter]]\n" + "".join(f"{key} = {value}\n" for key, value in lines.items() if value is not None)


def load_error(directory: Path) -> str:
    with pytest.raises(DescriptionError) as caught:
        load(directory)
    assert isinstance(caught.value, BarewireError)
    text = str(caught.value)
    assert "\n" not in text
    return text


KEY_ERRORS: list[tuple[str, str, int, dict[str, str | None]]] = [
    # key, message, line after the header of the row, the row
    ("name", "missing; expected it in every parameter", 0, {"name": None}),
    ("type", "missing; expected", 0, {"type": None}),
    ("access", "missing; expected", 0, {"access": None}),
    ("name", "'': expected text, not empty", 1, {"name": '""'}),
    ("name", "7: expected text", 1, {"name": "7"}),
    ("type", "'u17': expected one of bool, u8, u16", 2, {"type": '"u17"'}),
    ("type", "16: expected one of", 2, {"type": "16"}),
    ("type", "'u16' in table 'coil'; expected bool", 2, {"holding": None, "coil": "8"}),
    ("holding", "'8': expected a whole number, 0..531071", 3, {"holding": '"8"'}),
    ("holding", "8.0: expected a whole number", 3, {"holding": "8.0"}),
    ("holding", "True: expected a whole number", 3, {"holding": "true"}),
    ("holding", "0 is address -1 on the wire; expected 0..65535", 3, {"holding": "0"}),
    ("holding", "65536 is address 65535 on the wire; expected 0..65534", 3, {"holding": "65536", "type": '"u32"'}),
    ("access", "'r': expected one of ro, rw, wo", 4, {"access": '"r"'}),
    ("access", "no function writes table 'input'; expected ro", 3, {"holding": None, "input": "8"}),
    ("discrete", "no function reads it; expected 'discrete' in read_functions", 4, {
        "holding": None, "type": '"bool"', "access": '"ro"', "discrete": "1"}),
    ("input", "a second table beside 'holding'; expected at most one address", 5, {"input": "8"}),
    ("half", "'M': expected one of L, H", 5, {"half": '"M"'}),
    ("half", "half a register with type 'u16'; expected u8 or i8", 5, {"half": '"L"'}),
    ("half", "a coil is one bit already", 5, {"holding": None, "type": '"bool"', "coil": "1", "half": '"L"'}),
    ("half", "belongs to a register", 5, {"holding": None, "type": '"u8"', "object": "0x2000", "half": '"L"'}),
    ("bit", "one bit with type 'u16'; expected bool", 5, {"bit": "3"}),
    ("bit", "16: expected a whole number, 0..15", 5, {"type": '"bool"', "bit": "16"}),
    ("order", "'BACD': expected one of ABCD, CDAB, BADC, DCBA", 5, {"order": '"BACD"'}),
    ("order", "text has no byte order", 6, {"type": '"text"', "words": "2", "order": '"ABCD"'}),
    ("words", "type 'u16' has its own width; expected words only with text", 5, {"words": "2"}),
    ("words", "missing; expected how many registers", 0, {"type": '"text"'}),
    ("words", "0: expected a whole number, 1..125", 5, {"type": '"text"', "words": "0"}),
    ("object", "0: expected a whole number, 1..65535", 5, {"object": "0"}),
    ("sub", "256: expected a whole number, 0..255", 6, {"object": "0x2000", "sub": "256"}),
    ("sub", "belongs to an object; expected object", 5, {"sub": "1"}),
    ("object_bit", "belongs to an object", 5, {"object_bit": "1"}),
    ("object_bit", "one bit with type 'u16'; expected bool", 6, {"object": "0x2000", "object_bit": "1"}),
    ("object_type", "belongs to an object", 5, {"object_type": '"u16"'}),
    ("object_type", "'text': expected one of u8", 6, {"object": "0x2000", "object_type": '"text"'}),
    ("object_type", "'i32' with type 'u16'; expected a wider u type", 6, {"object": "0x2000", "object_type": '"i32"'}),
    ("object_type", "'u8' with type 'u16'; expected a wider u type", 6, {"object": "0x2000", "object_type": '"u8"'}),
    ("name", "no address; expected one of holding, input, coil, discrete, or object, or both", 1, {"holding": None}),
    ("unit", "3: expected text", 5, {"unit": "3"}),
    ("scale", "0.1: expected a fraction or a decimal above 0, as text", 5, {"scale": "0.1"}),
    ("scale", "'1/0': expected", 5, {"scale": '"1/0"'}),
    ("scale", "'-1/10': expected", 5, {"scale": '"-1/10"'}),
    ("scale", "'tenth': expected", 5, {"scale": '"tenth"'}),
    ("scale", "'0.0': expected", 5, {"scale": '"0.0"'}),
    ("scale", "'1e999999999': expected", 5, {"scale": '"1e999999999"'}),
    ("scale", "type 'bool' has none", 5, {"type": '"bool"', "scale": '"1/10"'}),
    ("min", "-1 does not fit u16; expected 0..65535", 5, {"min": "-1"}),
    ("max", "65536 does not fit u16; expected 0..65535", 5, {"max": "65536"}),
    ("max", "6554 does not fit u16; expected 0..6553.5", 6, {"scale": '"1/10"', "max": "6554"}),
    ("max", "1e+39 does not fit f32", 5, {"type": '"f32"', "max": "1e39"}),
    ("max", "inf: expected a number", 5, {"max": "inf"}),
    ("min", "nan: expected a number", 5, {"min": "nan"}),
    ("min", "'0': expected a number", 5, {"min": '"0"'}),
    ("min", "type 'bool' has none", 5, {"type": '"bool"', "min": "0"}),
    ("min", "5 is above max; expected at most 4", 5, {"min": "5", "max": "4"}),
    ("default", "7 is outside min..max", 6, {"max": "6", "default": "7"}),
    ("default", "0 is outside min..max", 6, {"min": "1", "default": "0"}),
    ("default", "70000 does not fit u16", 6, {"note": '"known"', "default": "70000"}),
    ("default", "0.5 falls between two steps of 1", 5, {"default": "0.5"}),
    ("default", "'x'; expected a number", 5, {"default": '"x"'}),
    ("default", "True; expected a number", 5, {"default": "true"}),
    ("default", "1; expected true or false", 5, {"type": '"bool"', "default": "1"}),
    ("default", "1; expected text", 6, {"type": '"text"', "words": "1", "default": "1"}),
    ("default", "[1]: expected a number", 5, {"default": "[1]"}),
    ("values", "'on' is not a whole number", 5, {"values": '{ on = "x" }'}),
    ("values", "'01' is not a whole number", 5, {"values": '{ 01 = "x" }'}),
    ("values", "0 = 1: expected text", 5, {"values": "{ 0 = 1 }"}),
    ("values", "[]: expected a table", 5, {"values": "[]"}),
    ("values", "-1 is not in u16; expected 0..65535", 5, {"values": '{ -1 = "x" }'}),
    ("values", "type 'f32' has no such names", 5, {"type": '"f32"', "values": '{ 1 = "x" }'}),
    ("bits", "16 is not in u16; expected 0..15", 5, {"bits": '{ 16 = "x" }'}),
    ("bits", "type 'bool' has no such names", 5, {"type": '"bool"', "bits": '{ 0 = "x" }'}),
    ("firmware", "1.1: expected text", 5, {"firmware": "1.1"}),
    ("storable", "1: expected true or false", 5, {"storable": "1"}),
    ("kind", "expected one of setting, command, measurement, reserved", 5, {"kind": '"value"'}),
    ("kind", "a setting with access 'ro'; expected rw", 5, {"access": '"ro"', "kind": '"setting"'}),
    ("note", "'': expected text, not empty", 5, {"note": '""'}),
    ("printed", "'colour' is not a field", 5, {"printed": '{ colour = "x" }'}),
    ("printed", "max = 7: expected text", 5, {"printed": "{ max = 7 }"}),
    ("printed", "7: expected a table of fields and texts", 5, {"printed": "7"}),
    ("hafl", "unknown; did you mean 'half'?", 5, {"hafl": '"L"'}),
    ("zzz", "unknown; expected one of name, type", 5, {"zzz": "0"}),
]  # fmt: skip


@every_case(("key", "message", "line", "changes"), KEY_ERRORS)
def test_an_error_in_a_row_names_line_and_key(
    key: str, message: str, line: int, changes: dict[str, str | None], tmp_path: Path
) -> None:
    text = load_error(write(tmp_path, BEFORE + row(**changes)))
    titled = "2" if changes.get("name", "") is None else changes.get("name", "'second'")
    title = re.escape(str(titled).replace('"', "'"))
    assert re.match(rf".*rows\.toml:{8 + line}: parameter {title}: key '{key}': ", text), text
    assert message in text


def test_the_line_of_a_key_in_a_table_of_its_own(tmp_path: Path) -> None:
    rows = BEFORE + row() + "\n[parameter.values]\n0 = 'off'\n\n[parameter.bits]\n3 = 'x'\nnine = 'y'\n"
    assert "rows.toml:17: parameter 'second': key 'bits': " in load_error(write(tmp_path, rows))


def test_a_second_parameter_of_the_same_name_is_refused(tmp_path: Path) -> None:
    text = load_error(write(tmp_path, BEFORE + row(name='" FIRST"')))
    assert text.endswith("expected one, the first is " + str(tmp_path / "rows.toml") + ":2")
    assert "rows.toml:9: parameter ' FIRST': key 'name': a second one of this name" in text


def test_a_default_outside_its_range_is_accepted_with_a_note(tmp_path: Path) -> None:
    rows = row(max="6", default="7", note='"the manual says so"')
    assert load(write(tmp_path, rows)).parameters[0].default == 7


def test_a_decimal_limit_without_an_exact_binary_form_is_accepted(tmp_path: Path) -> None:
    rows = row(scale='"1/100"', max="655.35", default="0.07")
    assert load(write(tmp_path, rows)).parameters[0].maximum == 655.35


DRIVE = HEAD + "[drive]\nstatus_word = 'second'\n"
BOTH_WORDS = DRIVE + "control_word = 'second'\n"

HEAD_ERRORS: list[tuple[str, str]] = [
    # device.toml, the message behind its name
    ('title = "t"\n', "1: key 'name': missing; expected it in every device.toml"),
    ('name = "n"\n', "1: key 'title': missing"),
    ('name = "n"\ntitle = 7\n', "2: key 'title': 7: expected text"),
    ('name = "n"\ntitle = "t"\ndocuments = "d"\n', "3: key 'documents': 'd': expected a list of texts"),
    ('name = "n"\ntitle = "t"\ntitel = "t"\n', "3: key 'titel': unknown; did you mean 'title'?"),
    (HEAD + "\n[modbus.unknown]\n", "9: [modbus]: key 'unknown': unknown"),
    (HEAD.replace("first_register = 1", "unit = 256"), "4: [modbus]: key 'unit': 256: expected a whole number, 0..255"),
    (HEAD.replace("first_register = 1", "port = 0"), "4: [modbus]: key 'port': 0: expected a whole number, 1..65535"),
    (HEAD.replace("first_register = 1", "order = 'AB'"), "4: [modbus]: key 'order': 'AB': expected one of"),
    (HEAD.replace("first_register = 1", "read_limit = 126"), "4: [modbus]: key 'read_limit': 126: expected"),
    (HEAD.replace("first_register = 1", "write_limit = 124"), "4: [modbus]: key 'write_limit': 124: expected"),
    (HEAD.replace("holding = 3", "holding = 1"), "5: [modbus]: key 'read_functions': {'holding': 1, 'input': 4"),
    (HEAD.replace("holding = 3", "h = 3"), "5: [modbus]: key 'read_functions': "),
    (HEAD.replace("[6]", "6"), "6: [modbus]: key 'write_functions': "),
    (HEAD.replace("[6]", "[5]"), "6: [modbus]: key 'write_functions': "),
    (HEAD + "node = 128\n", "8: [canopen]: key 'node': 128: expected a whole number, 1..127"),
    (HEAD + "bitrate = 123\n", "8: [canopen]: key 'bitrate': 123: expected one of"),
    (HEAD + "dialect = 'swiss'\n", "8: [canopen]: key 'dialect': 'swiss': expected one of standard, az3"),
    (HEAD + "[[pdo]]\nname = 'P'\n", "8: pdo 'P': key 'cob_id': missing; expected it in every pdo"),
    (HEAD + "[[pdo]]\nname = 'P'\ncob_id = 0x800\ntransmission = 0\nmap = []\n", "10: pdo 'P': key 'cob_id': 2048"),
    (HEAD + "[[pdo]]\nname = 'P'\ncob_id = 0x200\ntransmission = 0\nmap = [\n[0x6040, 0]\n]\n",
     "12: pdo 'P': key 'map': [[24640, 0]]: expected [index, sub-index, bits]"),
    (HEAD + "[[pdo]]\nname = 'P'\ncob_id = 0x200\ntransmission = 0\nmap = [[1, 0, 64], [2, 0, 1]]\n",
     "12: pdo 'P': key 'map': 65 bits; a PDO has room for 64"),
    (HEAD.replace("[canopen]\n", "[[pdo]]\nname = 'P'\n"), "7: key 'pdo': the device has no CANopen"),
    ('name = "n"\ntitle = "t"\nmodbus = 5\n', "3: key 'modbus': expected a table [modbus]"),
    (DRIVE, "8: [drive]: key 'control_word': missing; expected it in every [drive]"),
    (DRIVE + "control_word = 'secnd'\n", "10: [drive]: key 'control_word': 'secnd' is not a parameter of this device"),
    (DRIVE + "control_word = ''\n", "10: [drive]: key 'control_word': '': expected text, not empty"),
    (DRIVE + "controlword = 'second'\n", "10: [drive]: key 'controlword': unknown; did you mean 'control_word'?"),
    (BOTH_WORDS + "modes = { position = 1 }\n", "11: [drive]: key 'modes': no parameter to write them to; expected"),
    (BOTH_WORDS + "modes = { flying = 1 }\n", "11: [drive]: key 'modes': {'flying': 1}: 'flying' is unknown"),
    (BOTH_WORDS + "settle = -1\n", "11: [drive]: key 'settle': -1: expected seconds, 0..60"),
    ('name = "n"\ntitle = "t"\nparameter = 5\n', "3: key 'parameter': expected [[parameter]] tables"),
    ('name = "n"\ntitle = "t\n', "2: not TOML: Illegal character '\\n'"),
    ('name = "n"\ntitle = """t\n', "3: not TOML: Unterminated string"),
    ('name = "n"\nname = "n"\n', "2: not TOML: Cannot overwrite a value"),
    ("a = " + "9" * 5000, "1: not TOML: Exceeds the limit"),
    ("a = " + "[" * 20_000, "1: nested too deeply to be read"),
]  # fmt: skip


@every_case(("head", "message"), HEAD_ERRORS)
def test_an_error_in_device_toml_names_line_and_key(head: str, message: str, tmp_path: Path) -> None:
    text = load_error(write(tmp_path, row(), head))
    assert text.startswith(str(tmp_path / "device.toml") + ":" + message), text


@pytest.mark.parametrize(
    ("head", "rows", "message"),
    [
        ('name = "n"\ntitle = "t"\n', row(), "rows.toml:4: parameter 'second': key 'holding': the device has no"),
        (HEAD.replace("[canopen]", ""), row(object="1"), "rows.toml:6: parameter 'second': key 'object': the device"),
        (HEAD, row() + "[canopen]\n", "rows.toml:6: key 'canopen': unknown; expected only [[parameter]] here"),
        (HEAD, "parameter = 7\n", "rows.toml:1: key 'parameter': expected [[parameter]] tables"),
    ],
)  # fmt: skip
def test_an_error_between_the_files(head: str, rows: str, message: str, tmp_path: Path) -> None:
    assert message in load_error(write(tmp_path, rows, head))


@pytest.mark.parametrize(
    ("part", "changes", "message"),
    [
        ("status_word", {"access": '"wo"'}, "'second' is write only; expected one that can be read"),
        ("control_word", {"access": '"ro"'}, "'second' is read only; expected one that can be written"),
        ("status_word", {"type": '"i16"'}, "'second' is of type 'i16'; expected u16"),
        ("position", {"type": '"bool"', "bit": "3"}, "'second' is of type 'bool'; expected a number"),
    ],
)
def test_a_parameter_that_does_not_fit_its_role_in_the_drive(
    part: str, changes: dict[str, str | None], message: str, tmp_path: Path
) -> None:
    parts = {"status_word": "'first'", "control_word": "'first'", part: "'second'"}
    head = HEAD + "[drive]\n" + "".join(f"{key} = {name}\n" for key, name in parts.items())
    text = load_error(write(tmp_path, BEFORE + row(**changes), head))
    assert f"[drive]: key '{part}': {message}" in text, text


def test_a_file_that_is_not_utf_8(tmp_path: Path) -> None:
    write(tmp_path, "")
    (tmp_path / "rows.toml").write_bytes(b"# fine\n# \xb0C\n")
    assert "rows.toml:2: not UTF-8" in load_error(tmp_path)


def test_a_directory_without_device_toml(tmp_path: Path) -> None:
    assert (
        load_error(tmp_path)
        == f"{tmp_path / 'device.toml'}:1: no such file; a device is a directory with a device.toml"
    )


def test_a_file_that_cannot_be_read(tmp_path: Path) -> None:
    write(tmp_path, "")
    (tmp_path / "rows.toml").unlink()
    (tmp_path / "rows.toml").mkdir()
    assert "rows.toml:1: Is a directory" in load_error(tmp_path)


NUMBERS = ["0", "-1", "7", "99999999999999999999", "0.5", "-1e300", "inf", "nan", "1979-05-27", "07:32:00"]
TEXTS = ['""', '"x"', '"L"', '"u8"', '"text"', '"f64"', '"bool"', '"ro"', '"1/3"']
TABLES = ["true", "[]", "[1]", "{}", '{ 0 = "x" }', "{ max = 1 }"]
values = st.sampled_from([*NUMBERS, *TEXTS, *TABLES])
keys = st.sampled_from([*rule_of("parameter")["properties"], "unknown", '""', '"two words"', "a.b"])


@modest
@given(st.dictionaries(keys, values, max_size=6))
def test_any_row_loads_or_is_refused_with_line_and_key(changes: dict[str, str]) -> None:
    text = ""
    with TemporaryDirectory() as directory:
        write(Path(directory), row(**changes))
        try:
            load(directory)
        except DescriptionError as error:
            text = str(error)
    assert not text or re.match(r".*rows\.toml:\d+: parameter .*: key '.*': ", text)


def test_a_pdo_whose_cob_id_is_too_large_with_the_node_id_added(tmp_path: Path) -> None:
    head = HEAD + "[[pdo]]\nname = 'P'\ncob_id = 0x7FF\ntransmission = 0\nmap = []\n"
    with refused(DescriptionError, "10: pdo 'P': key 'cob_id': with node 1 it is 800h; expected 7FFh at most"):
        load(write(tmp_path, BEFORE, head))


TEXT = '''\
top = 1  # [not.a.header]
a.b.c = 2
"quoted key" = { inner = 3 }
long = """
[[parameter]]
key = "inside"
"quote" at the end""""
literal = \'\'\'
[x]
\'\'\'
array = [
  [1, 2],  # ]
  ["]", '['],
]
[ table . sub ]
key = 4
[[parameter]]
name = "one # no comment"
[parameter.bits]
0 = "zero"
[[ parameter ]]
name = "two"
bits.5 = "five"
[[parameter.deeper]]
key = 6
'''


@every_case(
    ("path", "line"),
    [
        (("top",), 1),
        (("a",), 2),
        (("a", "b", "c"), 2),
        (("quoted key",), 3),
        (("quoted key", "inner"), 3),
        (("long",), 4),
        (("literal",), 8),
        (("array",), 11),
        (("table", "sub"), 15),
        (("table", "sub", "key"), 16),
        (("parameter", 0), 17),
        (("parameter", 0, "name"), 18),
        (("parameter", 0, "bits"), 19),
        (("parameter", 0, "bits", "0"), 20),
        (("parameter", 0, "missing"), 17),
        (("parameter", 1), 21),
        (("parameter", 1, "name"), 22),
        (("parameter", 1, "bits", "5"), 23),
        (("parameter", 1, "deeper", 0), 24),
        (("parameter", 1, "deeper", 0, "key"), 25),
        (("key",), 1),
        (("nowhere",), 1),
    ],
)
def test_line_of_a_key(path: KeyPath, line: int) -> None:
    assert KeyLines(TEXT).of(path) == line


def test_the_example_is_valid_toml() -> None:
    assert tomllib.loads(TEXT)["parameter"][1]["bits"] == {"5": "five"}


@every_case("file", sorted(CATALOG.glob("*/*.toml")))
def test_every_key_of_the_catalogue_is_found_on_its_line(file: Any) -> None:
    text = file.read_text(encoding="utf-8")
    lines, written = KeyLines(text), text.splitlines()
    for place, row in enumerate(tomllib.loads(text).get("parameter", [])):
        assert written[lines.of(("parameter", place)) - 1] == "[[parameter]]"
        for key in row:
            line = written[lines.of(("parameter", place, key)) - 1]
            assert line.startswith(f"{key} =") or line == f"[parameter.{key}]"
