"""The parameter as JSON, and the JSON schema of the format: the catalogue follows it, and it agrees with `load`."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import get_args

import pytest
from jsonschema import Draft202012Validator

from barewire.codecs.order import ORDERS
from barewire.devices import (
    CanopenSettings,
    DescriptionError,
    DevicePdo,
    DriveRoles,
    ModbusAt,
    ModbusSettings,
    load,
)
from barewire.devices.description.check import rule_of, schema
from barewire.devices.description.load import CATALOG
from barewire.devices.parameter import INTEGER_TYPES, TABLE_NAMES, VALUE_TYPES, ParameterAccess
from barewire.devices.sdo_dialects import DIALECTS
from tests.devices.description.test_check import HEAD, HEAD_ERRORS, row, write
from tests.helpers import every_case

ROOT = Path(__file__).parents[3]
VALIDATOR = Draft202012Validator(dict(schema()))


@every_case("file", sorted(CATALOG.glob("*/*.toml")))
def test_the_catalogue_follows_the_schema(file: Path) -> None:
    VALIDATOR.validate(tomllib.loads(file.read_text(encoding="utf-8")))


def test_the_schema_is_a_schema_of_the_same_keys_and_words() -> None:
    Draft202012Validator.check_schema(dict(schema()))
    row = rule_of("parameter")["properties"]
    assert row["type"]["enum"] == list(VALUE_TYPES)
    assert row["object_type"]["enum"] == list(INTEGER_TYPES)
    assert row["access"]["enum"] == list(get_args(ParameterAccess))
    assert set(TABLE_NAMES) < set(row)
    assert rule_of("order")["enum"] == list(ORDERS)
    assert rule_of("canopen")["properties"]["dialect"]["enum"] == list(DIALECTS)
    assert set(rule_of("drive")["properties"]) == set(DriveRoles._fields)
    assert set(rule_of("modbus")["properties"]) == {*ModbusSettings._fields, "first_register", "first_coil"}
    assert set(rule_of("canopen")["properties"]) == {*CanopenSettings._fields} - {"pdos"}
    assert set(rule_of("pdo")["properties"]) == set(DevicePdo._fields)
    printed = rule_of("parameter")["properties"]["printed"]["propertyNames"]["pattern"]
    assert all(re.match(printed, f"{manual}{key}") for key in row for manual in ("", "canopen_", "modbus_"))


@pytest.mark.parametrize(
    "changes",
    [
        {"name": None},
        {"type": '"u17"'},
        {"access": '"r"'},
        {"holding": "-1"},
        {"holding": None},
        {"input": "8"},
        {"half": '"M"'},
        {"values": '{ on = "x" }'},
        {"bits": "{ 0 = 1 }"},
        {"scale": "0.1"},
        {"printed": '{ colour = "x" }'},
        {"hafl": '"L"'},
    ],
)
def test_schema_and_loader_refuse_the_same_rows(changes: dict[str, str | None], tmp_path: Path) -> None:
    rows = row(**changes)
    assert not VALIDATOR.is_valid(tomllib.loads(rows))
    with pytest.raises(DescriptionError):
        load(write(tmp_path, rows))


# A JSON schema cannot describe errors of TOML syntax, sums of PDO bits, or references to parameters in other files.
BEYOND_SCHEMA = ("not TOML", "nested", "room for 64", "is not a parameter")


@every_case("head", [head for head, message in HEAD_ERRORS if not any(word in message for word in BEYOND_SCHEMA)])
def test_schema_and_loader_refuse_the_same_heads(head: str) -> None:
    assert not VALIDATOR.is_valid(tomllib.loads(head))


def test_schema_and_loader_accept_a_correct_row(tmp_path: Path) -> None:
    VALIDATOR.validate(tomllib.loads(HEAD))
    VALIDATOR.validate(tomllib.loads(row()))
    assert load(write(tmp_path, row())).find("second").modbus


def test_a_manual_that_counts_from_400001(tmp_path: Path) -> None:
    head, rows = HEAD.replace("first_register = 1", "first_register = 400001"), row(holding="465536")
    VALIDATOR.validate(tomllib.loads(head))
    VALIDATOR.validate(tomllib.loads(rows))
    assert load(write(tmp_path, rows, head)).find("second").modbus == ModbusAt("holding", 65535)


def test_the_wheel_has_every_file_that_the_code_reads() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["setuptools"]
    package = ROOT / "src" / "barewire"
    packed = {path for pattern in settings["package-data"]["barewire"] for path in package.glob(pattern)}
    files = {path for path in package.rglob("*") if path.is_file() and path.suffix not in (".py", ".pyc", ".md")}
    assert files == packed
