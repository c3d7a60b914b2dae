"""Which device of the catalogue gives an answer about itself; tables [identity] that are wrong."""

from __future__ import annotations

from pathlib import Path

import pytest

from barewire.devices.sim import simulator
from barewire.errors import EncodeError
from barewire.modbus.messages.identification import (
    ReadDeviceIdentification,
    ReadDeviceIdentificationResponse,
    ReportServerId,
    ReportServerIdResponse,
)
from barewire_workbench.scan.identity import DeviceIdentity, device_of, known_devices

DEVICE = """
name = "pump"
title = "A pump"
[modbus]
[identity]
{identity}
[[parameter]]
name = "SPEED"
type = "u16"
access = "ro"
holding = 1
"""


def pump(folder: Path, identity: str) -> str:
    (folder / "device.toml").write_text(DEVICE.format(identity=identity))
    return str(folder)


def name_of(identity: DeviceIdentity, *descriptions: str) -> str | None:
    device = device_of(identity, known_devices(descriptions))
    return device.name if device else None


def test_the_machines_of_the_manuals_that_say_what_they_are() -> None:
    server_id = simulator("adxl").modbus.handle(ReportServerId(), 0.0)
    assert isinstance(server_id, ReportServerIdResponse)
    assert name_of(DeviceIdentity(server_id=server_id.data)) == "adxl"
    objects = simulator("az3").modbus.handle(ReadDeviceIdentification(1, 0), 0.0)
    assert isinstance(objects, ReadDeviceIdentificationResponse)
    assert name_of(DeviceIdentity({str(number): text.decode() for number, text in objects.objects})) == "az3"


@pytest.mark.parametrize(
    "identity",
    [
        DeviceIdentity(),
        DeviceIdentity(server_id=bytes.fromhex("01 02 00 00 06 00")),  # another series
        DeviceIdentity(server_id=bytes.fromhex("01 02 00 00")),  # too short
        DeviceIdentity({"VendorName": "TEM", "ProductCode": "XY"}),
    ],
    ids=str,
)
def test_others_are_not_named_after_them(identity: DeviceIdentity) -> None:
    assert name_of(identity) is None


def test_a_description_of_the_user_is_compared_too(tmp_path: Path) -> None:
    folder = pump(tmp_path, "device_type = 0x00020191\nvendor = 7")
    assert name_of(DeviceIdentity(numbers={"device_type": 0x20191, "vendor": 7}), folder) == "pump"
    assert name_of(DeviceIdentity(numbers={"device_type": 0x20191, "vendor": 8}), folder) is None
    assert name_of(DeviceIdentity(numbers={"device_type": 0x20191}), folder) == "pump"


@pytest.mark.parametrize(
    ("identity", "message"),
    [
        ("serverid = 1", r"'serverid': expected server_id"),
        ('server_id = "5"', r'server_id = .*: expected bytes such as "\?\? 05"'),
        ("server_id = 5", "expected bytes"),
        ('texts = "AZ3"', "expected a list of texts"),
        ('vendor = "7"', "expected a number"),
        ("vendor = true", "expected a number"),
    ],
)
def test_a_wrong_table_is_named(tmp_path: Path, identity: str, message: str) -> None:
    with pytest.raises(EncodeError, match=message):
        known_devices([pump(tmp_path, identity)])


def test_control_characters_of_a_device_do_not_reach_the_terminal() -> None:
    assert str(DeviceIdentity({"name": "PUMP\x00\x1b[31m "})) == "PUMP[31m"
