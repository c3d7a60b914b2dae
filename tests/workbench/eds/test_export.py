"""A device description as an EDS: without diagnostics, and with every parameter of the description."""

from __future__ import annotations

import pytest

from barewire.canopen import eds
from barewire.devices import load, names
from barewire.devices.device import Device
from barewire.devices.sim import simulator
from barewire.errors import EncodeError
from barewire_workbench.eds.export import export
from barewire_workbench.eds.lint import lint

WITH_CANOPEN = [name for name in names() if load(name).canopen is not None]


@pytest.mark.parametrize("name", WITH_CANOPEN)
def test_the_exported_eds_has_no_diagnostics(name: str) -> None:
    data = export(load(name)).encode()
    assert lint(eds.parse(data, strict=True)) == ()
    assert data.isascii()


@pytest.mark.parametrize("name", WITH_CANOPEN)
def test_every_parameter_is_in_the_exported_eds(name: str) -> None:
    device = load(name)
    objects = eds.parse(export(device).encode()).dictionary(device.canopen.node if device.canopen else 1)
    owners = set()
    for parameter in device.parameters:
        place = parameter.object
        if place is None or place.bit is not None or (place.index, place.sub) in owners:
            continue
        owners.add((place.index, place.sub))
        entry = objects.entry(place.index, place.sub)
        assert (entry.name, entry.type, entry.access) == (parameter.name, parameter.object_type, parameter.access)
        if parameter.default is not None:
            assert entry.codec.encode(entry.default) == parameter.to_object(parameter.default)
        for limit, raw in ((parameter.minimum, entry.minimum), (parameter.maximum, entry.maximum)):
            assert raw == (None if limit is None else parameter.to_raw(limit))
    assert len(owners) > 100


def test_the_exported_eds_of_the_az3() -> None:
    document = export(load("az3"), "drive.eds")
    assert document.get("FileInfo", "FileName") == "drive.eds"
    assert [document.get("DeviceInfo", f"BaudRate_{rate}") for rate in (10, 20, 800, 1000)] == ["0", "1", "0", "1"]
    assert document.get("1800sub1", "DefaultValue") == "$NODEID+0x180"
    assert document.get("1A00sub0", "DefaultValue") == "4"
    assert document.get("1A00", "ParameterName") == "TPDO1 mapping parameter"
    assert document.get("6091", "ParameterName") == "GEAR RATIO"
    assert [document.get(section, "PDOMapping") for section in ("6041", "6060", "2040sub0", "1017")] == [
        "1",
        "1",
        "0",
        "0",
    ]
    assert document.dictionary(9).get(0x1400, 1) == 0x209
    assert document.dictionary(9).get(0x1000) == 0x00020192


def test_the_exported_identity_is_that_of_the_simulated_drive() -> None:
    """The guide of the AZ3 does not list 1018h, which every node has: the vendor-ID alone, and it is 0."""
    document = export(load("az3"))
    assert "0x1018" in [document.get("MandatoryObjects", number) for number in ("1", "2", "3")]
    keys = ("ParameterName", "ObjectType", "SubNumber")
    assert [document.get("1018", key) for key in keys] == ["Identity object", "0x9", "2"]
    for section, values in (("1018sub0", ["0x0005", "const", "1", "0"]), ("1018sub1", ["0x0007", "ro", "0", "0"])):
        assert [
            document.get(section, key) for key in ("DataType", "AccessType", "DefaultValue", "PDOMapping")
        ] == values
    drive = simulator("az3", 0.0, node=9).canopen
    assert drive is not None
    exported = document.dictionary(9)
    assert [exported.get(0x1018, sub) for sub in exported.subs(0x1018)] == [
        drive.objects.get(0x1018, sub) for sub in drive.objects.subs(0x1018)
    ]


def test_a_device_without_canopen_cannot_be_exported() -> None:
    with pytest.raises(EncodeError, match="no CANopen in its description"):
        export(Device("box", "A box", ()))
