"""The parameter as JSON, and the JSON schema of the format: the catalogue follows it, and it agrees with `load`."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from barewire.canopen import STANDARD
from barewire.devices import DescriptionError, load, names
from barewire.devices.description import check as rules
from barewire.devices.description.load import CATALOG
from barewire.devices.sdo_dialects import AZ3
from tests.devices.description.test_descriptions import HEAD, HEAD_ERRORS, row, write

KEYS = ["name", "type", "unit", "scale", "default", "min", "max", "access", "values", "firmware", "note"]
KEYS += ["modbus", "object", "bits", "storable", "answered", "printed", "group"]

SCHEMA: dict[str, Any] = json.loads((CATALOG / "schema.json").read_text(encoding="utf-8"))
VALIDATOR = Draft202012Validator(SCHEMA)


@pytest.mark.parametrize("name", names())
def test_every_parameter_is_json_with_the_same_keys(name: str) -> None:
    for parameter in load(name).parameters:
        fields = parameter.as_dict()
        assert list(fields) == KEYS
        assert json.loads(json.dumps(fields, allow_nan=False)) == fields


def test_places_scale_and_names() -> None:
    fields = load("az3").find("START PHASING").as_dict()
    assert fields["modbus"] == {"table": "coil", "address": 1, "words": 1, "half": None, "bit": None, "order": "ABCD"}
    assert fields["object"] == {"index": 0x2018, "sub": 0, "bit": 1, "type": "bool"}
    assert fields["default"] is False
    fields = load("adxl").find("Frequency").as_dict()
    assert (fields["scale"], fields["unit"], fields["object"], fields["min"]) == (0.001, "Hz", None, None)
    fields = load("adxl").find("C02 Thermal status reset").as_dict()
    assert (fields["scale"], fields["values"]) == (1, {"1": "execute"})
    half = load("adxl").find("Events counter").as_dict()["modbus"]
    assert half == {"table": "input", "address": 0x502F, "words": 1, "half": "H", "bit": None, "order": "ABCD"}
    assert load("az3").find("IQRMSX10").as_dict()["modbus"] is None


@pytest.mark.parametrize("file", sorted(CATALOG.glob("*/*.toml")), ids=lambda file: f"{file.parent.name}/{file.name}")
def test_the_catalogue_follows_the_schema(file: Path) -> None:
    VALIDATOR.validate(tomllib.loads(file.read_text(encoding="utf-8")))


def test_the_schema_is_a_schema_of_the_same_keys_and_words() -> None:
    Draft202012Validator.check_schema(SCHEMA)
    definitions = SCHEMA["$defs"]
    assert list(definitions["parameter"]["properties"]) == list(rules.PARAMETER)
    assert definitions["parameter"]["required"] == list(rules.PARAMETER_REQUIRED)
    canopen = definitions["device"]["properties"]["canopen"]["properties"]
    assert canopen["dialect"]["enum"] == [STANDARD.name, AZ3.name]
    drive = definitions["device"]["properties"]["drive"]
    assert list(drive["properties"]) == list(rules.DRIVE)
    assert drive["required"] == list(rules.DRIVE_REQUIRED)


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


@pytest.mark.parametrize(
    "head", [head for head, message in HEAD_ERRORS if not any(word in message for word in BEYOND_SCHEMA)]
)
def test_schema_and_loader_refuse_the_same_heads(head: str) -> None:
    assert not VALIDATOR.is_valid(tomllib.loads(head))


def test_schema_and_loader_accept_a_correct_row(tmp_path: Path) -> None:
    VALIDATOR.validate(tomllib.loads(HEAD))
    VALIDATOR.validate(tomllib.loads(row()))
    assert load(write(tmp_path, row())).find("second").modbus
