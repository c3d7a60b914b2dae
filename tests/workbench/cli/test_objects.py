"""Objects of a CANopen device in `read`, `write`, `watch` and `devices`: by an EDS or DCF, and by their addresses."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from barewire import CanopenServer
from barewire.canopen import Entry, LssAddress, ObjectDictionary, eds
from barewire.canopen.communication_objects import standard_objects
from barewire.canopen.datatypes import DATA_TYPES
from barewire_workbench.cli.raw_address import raw_parameter
from tests.workbench.cli.helpers import error_of, output_of, run_here
from tests.workbench.eds.test_device import plant

VALUES = {
    "bool": ("on", "on"),
    "string": ("Hall 4", "Hall 4"),
    "unicode": ("Größe", "Größe"),
    "octets": ("01AB", "01 AB"),
    "domain": ("00ff10", "00 FF 10"),
    "time_of_day": ("2026-03-01T12:00:00", "2026-03-01 12:00:00"),
    "time_difference": ("90000", "0:01:30"),
    "f32": ("-1.5", "-1.5"),
    "f64": ("0.1", "0.1"),
    **{row.name: (str((1 << row.bits) - 1),) * 2 for row in DATA_TYPES if row.name[0] == "u" and row.bits},
    **{row.name: (str(-1 << row.bits - 1),) * 2 for row in DATA_TYPES if row.name[0] == "i"},
}
"""For each data type of CiA 301 a value as it is typed, and as it is shown."""


@pytest.fixture
def pump(tmp_path: Path) -> Iterator[tuple[str, Path]]:
    """Serve the device of `plant`; yield the URL of its node and its EDS."""
    file = tmp_path / "pump.eds"
    file.write_bytes(plant().encode())
    with CanopenServer(f"can://memory/{tmp_path.name}?node=5", eds=plant()) as server:
        yield server.url, file


def test_an_eds_stands_where_a_device_does(pump: tuple[str, Path]) -> None:
    url, file = pump
    lines = output_of("read", url, str(file), "1018h.1", "identity / code", "vendor-id", "speed [*", "1000h")
    assert lines.splitlines() == [
        "Identity / Vendor-ID = 876",
        "Identity / Code = 7",
        "Speed [rpm] = 0",
        "Device type = 131474",
    ]
    written = output_of("write", url, str(file), "Speed [rpm]=-4000", "2004h:01=0.5", "--verify").splitlines()
    assert written == [
        "Speed [rpm] = -4000, written; the device has it",
        "Curve / Point = 0.5, written; the device has it",
    ]
    assert "Speed [rpm] = -4000; Curve / Point = 0.5" in output_of(
        "watch", url, str(file), "2000h", "point", "--count", "1"
    )
    assert "Speed [rpm]" in output_of("devices", str(file), "2000h")
    rows = [json.loads(line) for line in output_of("read", url, str(file), "--all", "--json").splitlines()]
    names = [row["name"] for row in rows]
    assert "Device type" in names
    assert not {"Program", "Secret", "Clear"} & set(names)  # a domain, a refused scan, write only
    assert output_of("read", url, str(file), "Program") == "Program = \n"


def test_what_an_eds_lacks_is_said(pump: tuple[str, Path], tmp_path: Path) -> None:
    url, file = pump
    bus = url.partition("?")[0]
    assert f"an EDS has no node-ID: give it with the endpoint, such as {bus}?node=5" in error_of(
        "read", bus, str(file), "1000h", status=2
    )
    assert "pump.eds has no Modbus" in error_of("read", "tcp://127.0.0.1:1", str(file), "1000h", status=2)
    assert "expected -5000..5000" in error_of("write", url, str(file), "2000h=5001", status=2)
    assert "Identity / Vendor-ID is read only" in error_of("write", url, str(file), "1018h.1=5", status=2)
    assert "nothing.eds: No such file" in error_of("read", url, str(tmp_path / "nothing.eds"), "1000h")
    (tmp_path / "empty.eds").write_text("hello")
    assert "the file describes no object" in error_of("read", url, str(tmp_path / "empty.eds"), "1000h", status=2)
    assert "is a device: expected barewire read" in error_of("read", str(file), url, "1000h", status=2)


def test_another_device_than_that_of_the_eds_is_not_read(pump: tuple[str, Path], tmp_path: Path) -> None:
    url, file = pump
    other = plant()
    other.set(0x1018, 2, "DefaultValue", 8)
    wrong = tmp_path / "other.eds"
    wrong.write_bytes(other.encode())
    assert "node 5 is not " in (text := error_of("read", url, str(wrong), "2000h"))
    assert "product 00000007h" in text
    assert output_of("read", url, str(wrong), "2000h", "--no-check") == "Speed [rpm] = 0\n"
    assert output_of("read", url, str(file), "2000h") == "Speed [rpm] = 0\n"


def test_a_dcf_shows_what_it_wants(pump: tuple[str, Path], tmp_path: Path) -> None:
    url, _ = pump
    file = tmp_path / "pump.dcf"
    file.write_bytes(eds.to_dcf(plant(), 5, {(0x2000, 0): -100, (0x2004, 1): 0.0}).encode())
    bus = url.partition("?")[0]  # the node-ID is that of the DCF
    lines = output_of("read", bus, str(file), "2000h", "2004h.1").splitlines()
    assert lines == ["Speed [rpm] = 0; the DCF has -100", "Curve / Point = 0"]
    row = json.loads(output_of("read", bus, str(file), "2000h", "--json"))
    assert (row["value"], row["configuration"]) == (0, -100)
    table = output_of("read", bus, str(file), "2000h", "1000h", "--csv").splitlines()
    assert table == [
        "name,value,unit,text,error,configuration",
        "Speed [rpm],0,,0,,-100",
        "Device type,131474,,131474,,",
    ]


def test_every_type_of_cia_301_is_written_and_read_by_address(tmp_path: Path) -> None:
    assert VALUES.keys() == {row.name for row in DATA_TYPES}
    entries = []
    for number, row in enumerate(DATA_TYPES):
        default = "" if row.name in ("string", "unicode") else b"" if not row.bits else 0
        entries.append(Entry(0x2000, number + 1, row.name, row.name, "rw", default))
    objects = ObjectDictionary([*standard_objects(LssAddress(1, 2, 3, 4)), *entries])
    addresses = [f"object:2000h.{number + 1:X}:{row.standard}" for number, row in enumerate(DATA_TYPES)]
    with CanopenServer(f"can://memory/{tmp_path.name}?node=5", device=objects) as server:
        given = [f"{address}={VALUES[row.name][0]}" for address, row in zip(addresses, DATA_TYPES)]
        written = run_here("write", server.url, "raw", *given, "--verify")
        assert written.returncode == 0, written.stderr
        lines = output_of("read", server.url, "raw", *addresses).splitlines()
        assert lines == [f"{address} = {VALUES[row.name][1]}" for address, row in zip(addresses, DATA_TYPES)]
        rows = [json.loads(line) for line in output_of("read", server.url, "raw", *addresses, "--json").splitlines()]
        values = {row.name: fields["value"] for row, fields in zip(DATA_TYPES, rows)}
        assert (values["octets"], values["time_difference"], values["bool"]) == ("01 AB", 90000, True)
        (tmp_path / "program.bin").write_bytes(bytes(range(20)))
        place = addresses[[row.name for row in DATA_TYPES].index("domain")]
        assert run_here("write", server.url, "raw", f"{place}=@{tmp_path / 'program.bin'}").returncode == 0
        assert bytes(range(20)).hex(" ").upper() in output_of("read", server.url, "raw", place)


def test_values_that_are_none_of_the_type() -> None:
    url = "can://memory/nobody?node=5"
    text = error_of("write", url, "raw", "object:2000h:octets=xy", status=2)
    assert "'xy': expected bytes such as 01AB, or @FILE" in text
    text = error_of("write", url, "raw", "object:2000h:time_of_day=noon", status=2)
    assert "expected a time such as 2026-03-01T12:00:00, or milliseconds since 1984" in text
    assert "expected a number" in error_of("write", url, "raw", "object:2000h:i24=xy", status=2)
    assert "missing.bin: No such file" in error_of("write", url, "raw", "object:2000h:domain=@missing.bin")


def test_a_missing_type_is_told_where_it_is_known() -> None:
    url = "can://memory/nobody?node=5"
    text = error_of("read", url, "raw", "object:1008h", status=2)
    assert "its type is missing" in text
    assert "CiA 301 has string for it: object:1008h:string" in text
    hints = {"object:1018h.1": "u32", "object:1018h.0": "u8", "object:1A00h.3": "u32", "object:100Ah:": "string"}
    for address, kind in hints.items():
        assert f"CiA 301 has {kind} for it" in error_of("read", url, "raw", address, status=2)
    assert "CiA 301" not in error_of("read", url, "raw", "object:2000h", status=2)
    text = error_of("read", url, "raw", "object:1008h:strin", status=2)
    assert "expected one of bool, i8" in text
    assert "did you mean 'string'" in text


def test_a_text_that_ends_with_zeros_is_shown_without_them() -> None:
    assert raw_parameter("object:1008h:string").from_object(b"pump\0\0") == "pump"
