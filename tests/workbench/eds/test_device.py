"""The device that an EDS describes: names, types, access, and what a DCF wants."""

from __future__ import annotations

import pytest

from barewire.canopen import eds
from barewire.canopen.eds import EdsItem, EdsObject, Formula
from barewire.canopen.eds.objects import ARRAY, DOMAIN, RECORD, VAR
from barewire.devices import UnknownName
from barewire.errors import BarewireError
from barewire_workbench.eds.device import configured_values, device_of_eds
from tests.canopen.eds.field_files import ODDITIES


def plant() -> eds.Eds:
    """Return an EDS with one object of each kind."""

    def variable(index: int, name: str, *rest: object, **fields: object) -> EdsObject:
        return EdsObject(index, name, VAR, (EdsItem(0, name, *rest, **fields),))  # type: ignore[arg-type]

    def record(index: int, name: str, *items: EdsItem) -> EdsObject:
        return EdsObject(index, name, RECORD, (EdsItem(0, "Highest sub-index", "u8", "const", len(items)), *items))

    return eds.compose(
        [
            variable(0x1000, "Device type", "u32", "ro", 0x20192),
            variable(0x1008, "Manufacturer device name", "string", "const", "pump"),
            record(0x1018, "Identity", EdsItem(1, "Vendor-ID", "u32", "ro", 876), EdsItem(2, "Code", "u32", "ro", 7)),
            record(0x1400, "RPDO parameter", EdsItem(1, "COB-ID", "u32", "rw", Formula(0x200))),
            record(0x1401, "RPDO parameter", EdsItem(1, "COB-ID", "u32", "rw", Formula(0x300))),
            variable(0x2000, "Speed [rpm]", "i24", "rww", 0, -5000, 5000),
            EdsObject(0x2001, "Program", DOMAIN, (EdsItem(0, "Program", "domain", "rw", object_type=DOMAIN),)),
            variable(0x2002, "Secret", "u8", "rw", flags=2),
            variable(0x2003, "Clear", "u8", "wo"),
            EdsObject(0x2004, "Curve", ARRAY, (EdsItem(0, "Points", "u8", "const", 1), EdsItem(1, "Point", "f64"))),
        ],
        device_info={"VendorName": "Acme", "ProductName": "Pump", "ProductNumber": "9"},
    )  # fmt: skip


def test_names_types_and_access() -> None:
    device = device_of_eds(plant(), "pump.eds", 5)
    assert (device.name, device.title, device.canopen and device.canopen.node) == ("pump.eds", "Acme Pump", 5)
    rows = {row.name: (row.type, row.access, row.kind, row.default, row.group) for row in device.parameters}
    assert rows["Device type"] == ("u32", "ro", "measurement", 0x20192, "communication")
    assert rows["Identity / Vendor-ID"][0] == "u32"
    assert rows["RPDO parameter / COB-ID (1401h:01)"] == ("u32", "rw", "setting", 0x305, "PDOs")
    assert rows["Speed [rpm]"] == ("i24", "rw", "command", 0, "manufacturer")  # rww: process data
    assert rows["Clear"] == ("u8", "wo", "command", None, "manufacturer")
    assert rows["Manufacturer device name"][:4] == ("text", "ro", "measurement", "pump")
    speed = device.find("speed [RPM]")
    assert (speed.minimum, speed.maximum, speed.to_object(-2)) == (-5000, 5000, b"\xfe\xff\xff")
    with pytest.raises(UnknownName, match="did you mean 'Curve / Point'"):
        device.find("curve point")


def test_what_is_read_alone_and_what_the_device_must_say() -> None:
    device = device_of_eds(plant(), "pump.eds", 5)
    assert device.extra["read_alone"] == {
        "Program": "a domain may be long",
        "Secret": "its ObjFlags want no scan to read it",
    }
    assert device.extra["identity"] == {"device_type": 0x20192, "vendor": 0x36C, "product": 7}  # the object wins
    assert configured_values(device) == {}
    assert device_of_eds(eds.compose([]), "empty.eds", 1).extra["identity"] == {}


def test_what_a_dcf_wants() -> None:
    dcf = eds.to_dcf(plant(), 5, {(0x2000, 0): -100, (0x1400, 1): Formula(0x400)})
    assert configured_values(device_of_eds(dcf, "pump.dcf", 5)) == {
        "RPDO parameter / COB-ID (1400h:01)": 0x405,
        "Speed [rpm]": -100,
    }


def test_odd_files_are_devices_with_a_name_for_each_object() -> None:
    for oddity in ODDITIES:
        data = oddity.file.encode() if isinstance(oddity.file, str) else oddity.file
        document = eds.parse(data)
        try:
            entries = list(document.dictionary(5))
        except BarewireError:
            continue
        device = device_of_eds(document, "odd.eds", 5)
        places = {(row.object.index, row.object.sub) for row in device.parameters if row.object}
        assert places <= {(entry.index, entry.sub) for entry in entries}, oddity.name
        assert all(device.find(row.name) is row for row in device.parameters), oddity.name
