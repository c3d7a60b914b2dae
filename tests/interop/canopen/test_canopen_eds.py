"""EDS files between barewire and the `canopen` package of PyPI: each reads the files of the other."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import pytest

from barewire.canopen import eds
from barewire.canopen.datatypes import BY_NAME
from barewire.devices import load
from barewire_workbench.eds.export import export

canopen = pytest.importorskip("canopen")

NODE = 5


def their_variables(dictionary: Any) -> dict[tuple[int, int], Any]:
    found = {}
    for index in dictionary:
        described = dictionary[index]
        for variable in [described] if not hasattr(described, "subindices") else described.subindices.values():
            found[index, variable.subindex] = variable
    return found


CANOPEN_READS = pytest.mark.evidence("canopen", "device", "file", "EDS")
BAREWIRE_READS = pytest.mark.evidence("canopen", "master", "file", "EDS")


@CANOPEN_READS
def test_canopen_reads_our_eds_of_the_az3(tmp_path: Path) -> None:
    document = export(load("az3"))
    file = tmp_path / "az3.eds"
    file.write_bytes(document.encode())
    theirs = their_variables(canopen.import_od(str(file), NODE))
    ours = {(entry.index, entry.sub): entry for entry in document.dictionary(NODE)}
    assert theirs.keys() == ours.keys()
    for place, entry in ours.items():
        variable = theirs[place]
        assert variable.name == entry.name
        assert variable.data_type == BY_NAME[entry.type].code
        assert variable.access_type == entry.access
        assert variable.pdo_mappable == bool(entry.mappable)
        if variable.default is not None:
            assert variable.default == entry.default
        if entry.type[0] != "f":  # canopen reads limits of REAL as integers, or not at all
            assert (variable.min, variable.max) == (entry.minimum, entry.maximum)


@CANOPEN_READS
def test_canopen_finds_objects_of_our_eds_by_name(tmp_path: Path) -> None:
    file = tmp_path / "az3.eds"
    file.write_bytes(export(load("az3")).encode())
    dictionary = canopen.import_od(str(file), NODE)
    assert dictionary["STATUS WORD"].index == 0x6041
    assert dictionary["RPDO1 communication parameter"]["RPDO1 COB-ID"].default == 0x205
    assert dictionary["GEAR RATIO"]["GEAR RATIO MOTOR REVOLUTION"].subindex == 1
    assert dictionary.device_information.allowed_baudrates == {20_000, 50_000, 125_000, 250_000, 500_000, 1_000_000}


@CANOPEN_READS
def test_canopen_evaluates_a_value_with_the_node_id(tmp_path: Path) -> None:
    item = eds.EdsItem(0, "Node ID", "u8", default=eds.Formula(0))
    file = tmp_path / "node.eds"
    file.write_bytes(eds.compose([eds.EdsObject(0x2000, "Node ID", 7, (item,))]).encode())
    assert canopen.import_od(str(file), NODE)[0x2000].default == NODE


@BAREWIRE_READS
@pytest.mark.filterwarnings("ignore:datetime.datetime.utcnow")
def test_barewire_reads_a_file_written_by_canopen(tmp_path: Path) -> None:
    file = tmp_path / "az3.eds"
    file.write_bytes(export(load("az3")).encode())
    written = io.StringIO()
    canopen.export_od(canopen.import_od(str(file), NODE), written, "dcf")
    document = eds.parse(written.getvalue().encode())
    assert {oddity.rule for oddity in document.diagnostics} <= {"blanks"}
    ours = {(entry.index, entry.sub): entry for entry in export(load("az3")).dictionary(NODE)}
    for entry in document.dictionary(NODE):
        mine = ours[entry.index, entry.sub]
        assert (entry.name, entry.type, entry.access) == (mine.name, mine.type, mine.access)
        assert entry.codec.encode(document.dictionary(NODE).get(entry.index, entry.sub)) == mine.codec.encode(
            mine.default
        )


@CANOPEN_READS
def test_canopen_reads_our_dcf(tmp_path: Path) -> None:
    made = eds.to_dcf(export(load("az3")), NODE, {"MODES OF OPERATION": 3}, name="axis", bitrate=500_000)
    file = tmp_path / "axis.dcf"
    file.write_bytes(made.encode())
    dictionary = canopen.import_od(str(file))
    assert (dictionary.node_id, dictionary.bitrate) == (NODE, 500_000)
    assert dictionary["MODES OF OPERATION"].value == 3
    assert dictionary[0x1401][1].default == 0x305
