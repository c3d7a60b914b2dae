"""The monitor by service: nodes, process data, SYNC, LSS and the others."""

from __future__ import annotations

import re
from collections.abc import Sequence

import pytest

from barewire.canopen import CanFrame, ErrorFrame, FdFrame, PdoConfig
from barewire.canopen.eds import parse
from barewire.canopen.frame import AnyFrame
from barewire.devices import load
from barewire.errors import EncodeError
from barewire_workbench.eds.export import export
from barewire_workbench.frames.can import explain_can
from barewire_workbench.monitor import CanMonitor, KnownNode, event_line, of_device, of_dictionary
from barewire_workbench.monitor.events import (
    BusErrorReport,
    EmcyReport,
    ForeignFrameReport,
    Gap,
    LssReport,
    MonitorEvent,
    NmtCommandReport,
    NodeReport,
    PdoMappingReport,
    PdoReport,
    SdoTransferReport,
    Summary,
    SyncReport,
    TimeReport,
    Violation,
)
from barewire_workbench.monitor.pdos import PdoTracker
from tests.workbench.monitor.recorded_run import DRIVE, LONG, PLAIN, of, recorded


def listen(
    frames: Sequence[tuple[float, AnyFrame | str]], known: Sequence[KnownNode] = (), end: float | None = None
) -> list[MonitorEvent]:
    monitor, events = CanMonitor(known), list[MonitorEvent]()
    for now, frame in frames:
        events += monitor.feed(CanFrame.parse(frame) if isinstance(frame, str) else frame, now)
    return events + monitor.end(frames[-1][0] if end is None else end)


def every(*lines: str, step: float = 0.1) -> list[tuple[float, AnyFrame | str]]:
    return [(place * step, line) for place, line in enumerate(lines)]


def az3() -> KnownNode:
    return of_device(load("az3"), DRIVE)


def test_every_service_of_a_recorded_run_is_reported_with_its_values() -> None:
    """Every service once, with the values that were transferred."""
    events = listen(recorded(), [az3()])
    assert [event for event in events if isinstance(event, Gap | Violation)] == []
    transfers = {
        (event.node, event.direction, event.manner, event.index): event for event in of(SdoTransferReport, events)
    }
    assert transfers[DRIVE, "upload", "expedited", 0x6041].name == "STATUS WORD"
    assert transfers[PLAIN, "upload", "segmented", 0x1008].data == b"thermometer for tests"
    assert transfers[PLAIN, "download", "segmented", 0x2100].data == b"in segments, 26 bytes long"
    for direction in ("upload", "download"):
        block = transfers[PLAIN, direction, "block", 0x2100]
        assert (block.data, block.crc, block.blocks, block.size) == (LONG, "ok", 3, len(LONG))
    assert transfers[PLAIN, "upload", "segmented", 0x2101].data == b""
    assert (
        transfers[DRIVE, "upload", "expedited", 0x5FFF].abort,
        transfers[DRIVE, "upload", "expedited", 0x5FFF].by,
    ) == (
        0x06020000,
        "server",
    )
    refused = transfers[PLAIN, "download", "expedited", 0x6001]
    assert (refused.outcome, refused.abort, refused.data) == ("aborted", 0x06090031, b"\x08\x07")
    assert [event.text for event in of(TimeReport, events)] == ["2024-02-29 12:34:56.789"]
    assert [(event.code, event.register) for event in of(EmcyReport, events)][1:] == [
        (0x4210, 0x19),
        (0, 0x11),
    ]
    assert [(event.command, event.node) for event in of(NmtCommandReport, events)] == [(1, 0)]
    assert [event.text for event in of(LssReport, events)][-1].endswith("found 11223344-FFFFFFFF-00000000-80000001")
    assert any(event.guarded for event in of(NodeReport, events))
    beats = [event for event in of(SyncReport, events) if event.kind == "summary"]
    assert [(event.beats, round(event.period or 0, 6)) for event in beats] == [(303, 0.01)]
    summary = events[-1]
    assert isinstance(summary, Summary)
    assert (summary.frames, sum(summary.counts.values())) == (len(recorded()), len(recorded()))


def test_a_time_offset_changes_only_the_times() -> None:
    def lines(begin: float) -> list[str]:
        events = listen([(begin + now, frame) for now, frame in recorded()[:300]])
        return [re.sub(r"[0-9.]+ m?s", "", event_line(event).partition("  ")[2]) for event in events]

    assert lines(4096.0) == lines(0.0)


# Process data ------------------------------------------------------------------------------------------------------


def test_process_data_is_named_and_repeated_data_is_marked() -> None:
    frames = every("205#0F00A8610000", "205#0F00A8610000", "205#0F00589EFFFF", "185#R8")
    reports = of(PdoReport, listen(frames, [az3()]))
    assert [event.values for event in reports[:3]] == [
        {"CONTROL WORD": 15, "TARGET VELOCITY": 25000},
        {"CONTROL WORD": 15, "TARGET VELOCITY": 25000},
        {"CONTROL WORD": 15, "TARGET VELOCITY": -25000},
    ]
    assert [(event.repeated, event.requested) for event in reports] == [
        (False, False),
        (True, False),
        (False, False),
        (False, True),
    ]
    assert reports[0].texts[1] == "TARGET VELOCITY = 25000 User units"


def test_an_eds_gives_the_same_values_as_the_catalogue() -> None:
    document = parse(export(load("az3")).encode())
    known = of_dictionary(document.dictionary(DRIVE), DRIVE)
    frames = [(now, frame) for now, frame in recorded() if now < 2.5]
    from_eds, from_catalogue = (
        [report for report in of(PdoReport, listen(frames, [node])) if report.node == DRIVE] for node in (known, az3())
    )
    assert len(from_eds) > 40
    assert [event.values for event in from_eds] == [event.values for event in from_catalogue]


def test_a_pdo_that_an_eds_leaves_without_a_cob_id_does_not_take_the_frames_of_nmt() -> None:
    pdo = PdoConfig("TPDO", 5, (0x6041_0010,), cob_id=0)
    tracker = PdoTracker((az3()._replace(pdos=(pdo,)),))
    assert explain_can(CanFrame.parse("000#8000"), tracker).summary == "NMT: enter pre operational, all nodes"


def sdo_writes(*writes: tuple[int, int, str], node: int = DRIVE) -> list[str]:
    lines = []
    for index, sub, data in writes:
        size = len(bytes.fromhex(data))
        place = index.to_bytes(2, "little").hex() + f"{sub:02X}"
        lines += [f"{0x600 + node:03X}#{0x2F - 4 * (size - 1):02X}{place}{data.ljust(8, '0')}"]
        lines += [f"{0x580 + node:03X}#60{place}00000000"]
    return lines


REMAP = [
    *((0x1800, 1, "85010080"), (0x1A00, 0, "00"), (0x1A00, 1, "10004160"), (0x1A00, 2, "20006460")),
    *((0x1A00, 0, "02"), (0x1800, 1, "A0010000")),
]


def test_a_changed_mapping_is_followed() -> None:
    lines = [*sdo_writes(*REMAP), "1A0#371601000000", "705#00", "185#3706000000000000"]
    events = listen(every(*lines, step=0.01), [az3()])
    mapped = of(PdoMappingReport, events)
    assert [(event.name, event.cob_id, event.objects) for event in mapped] == [
        ("TPDO1", None, ()),
        ("TPDO1", 0x1A0, ("STATUS WORD", "POSITION ACTUAL VALUE")),
        ("TPDO1", 0x185, mapped[-1].objects),
    ]
    assert len(mapped[-1].objects) == 4
    reports = of(PdoReport, events)
    assert (reports[0].node, reports[0].name, reports[0].values) == (
        *(DRIVE, "TPDO1"),
        {"STATUS WORD": 0x1637, "POSITION ACTUAL VALUE": 1},
    )
    assert len(reports[1].values) == 4


def test_a_stored_mapping_survives_a_boot() -> None:
    store = sdo_writes((0x1010, 1, "73617665"))
    events = listen(every(*sdo_writes(*REMAP), *store, "705#00", "1A0#371601000000", step=0.01), [az3()])
    assert [event.values["POSITION ACTUAL VALUE"] for event in of(PdoReport, events)] == [1]


def test_the_mapping_of_a_node_without_description_is_learned() -> None:
    """Writes and reads of the mapping both show it."""
    reads = []
    for index, sub, data in [(0x1A00, 0, "02"), (0x1A00, 1, "08004160"), (0x1A00, 2, "10016060")]:
        place = index.to_bytes(2, "little").hex() + f"{sub:02X}"
        size = len(bytes.fromhex(data))
        reads += [f"607#40{place}00000000", f"587#{0x4F - 4 * (size - 1):02X}{place}{data.ljust(8, '0')}"]
    for lines in (reads, sdo_writes(*[(0x1A00, 1, "08004160"), (0x1A00, 2, "10016060"), (0x1A00, 0, "02")], node=7)):
        (reports,) = of(PdoReport, listen(every(*lines, "187#01FFFF")))
        assert reports.values == {"6041h:00": 1, "6060h:01": 0xFFFF}


def test_a_further_sdo_channel_is_learned() -> None:
    lines = sdo_writes((0x1201, 1, "C0060000"), (0x1201, 2, "40060000"))
    events = listen(every(*lines, "6C0#4041600000000000", "640#4B41600037060000"))
    last = of(SdoTransferReport, events)[-1]
    assert (last.node, last.channel, last.data) == (DRIVE, 0x6C0, b"\x37\x06")


def test_process_data_is_explained_field_by_field() -> None:
    monitor = CanMonitor([az3()])
    explanation = explain_can(CanFrame.parse("205#0F00A8610000"), monitor.pdos)
    assert [(field.name, field.length, field.value) for field in explanation.fields] == [
        *(("COB-ID", 0, 0x205), ("CONTROL WORD", 2, 15), ("TARGET VELOCITY", 4, 25000)),
    ]
    assert explanation.valid
    for data in ("205#0F00", "205#0F00A861000001", "205#"):
        wrong = explain_can(CanFrame.parse(data), monitor.pdos)
        assert not wrong.valid
        assert sum(field.length for field in wrong.fields) == len(CanFrame.parse(data).data)
    # Objects in the same byte share a field.
    lines = sdo_writes(
        (0x1A00, 1, "04004160"), (0x1A00, 2, "04004260"), (0x1A00, 3, "08004360"), (0x1A00, 0, "03"), node=7
    )
    for place, line in enumerate(lines):
        monitor.feed(CanFrame.parse(line), place / 100)
    explanation = explain_can(CanFrame.parse("187#5AFF"), monitor.pdos)
    assert [(field.name, field.length) for field in explanation.fields[1:]] == [
        ("6041h:00, 6042h:00", 1),
        ("6043h:00", 1),
    ]
    assert explanation.fields[1].meaning == "10, 5"


def test_a_node_without_canopen_and_a_wrong_node_id_are_refused() -> None:
    with pytest.raises(EncodeError, match="has no CANopen"):
        of_device(load("adxl"), 5)
    with pytest.raises(EncodeError, match=r"expected 1\.\.127"):
        of_device(load("az3"), 200)


# Nodes -------------------------------------------------------------------------------------------------------------


def test_the_configured_heartbeat_period_sets_the_deadline() -> None:
    lines = [
        (0.0, "705#05"),
        *((0.1, line) for line in sdo_writes((0x1017, 0, "2C01"))),
        (0.5, "705#05"),
        (0.6, "080#"),
    ]
    monitor, events = CanMonitor(), list[MonitorEvent]()
    for now, line in lines:
        events += monitor.feed(CanFrame.parse(line), now)
    assert monitor.deadline == pytest.approx(1.1)
    (missing,) = monitor.feed(None, 1.2)
    assert isinstance(missing, NodeReport)
    assert missing.kind == "missing"
    assert (missing.at, missing.seconds) == pytest.approx((1.1, 0.6))
    assert monitor.deadline is None


def test_heartbeats_switched_off_are_not_reported_missing() -> None:
    monitor = CanMonitor()
    for place in range(6):
        monitor.feed(CanFrame.parse("705#05"), float(place))
    assert monitor.deadline == pytest.approx(7.5)
    for line in sdo_writes((0x1017, 0, "0000")):
        monitor.feed(CanFrame.parse(line), 5.1)
    assert monitor.deadline is None


def test_a_node_that_reboots_by_itself() -> None:
    events = listen(every("705#05", "705#05", "705#00", "705#7F"))
    reports = [(event.kind, event.state, event.before) for event in of(NodeReport, events) if not event.repeated]
    assert reports == [("heard", 5, None), ("boot-up", 0, 5), ("state", 0x7F, 0)]


def test_an_unanswered_guarding_request_excuses_the_toggle_bit() -> None:
    events = listen(every("705#R1", "705#05", "705#R1", "705#R1", "705#05", "705#R1", "705#85"))
    assert [event.rule for event in of(Violation, events)] == []


def test_emergencies_and_foreign_frames() -> None:
    frames: list[tuple[float, AnyFrame | str]] = [
        *every("085#30811102", "00000605#40", "1FFFFFFF#"),
        (0.5, FdFrame(0x605, bytes(20))),
        (0.6, ErrorFrame(0x40)),
        (0.7, ErrorFrame(0x40)),
        (0.8, ErrorFrame(0x04, b"\0\x10")),
        (0.9, ErrorFrame(0x200, bytes.fromhex("0000000000006007"))),
    ]
    events = listen(frames)
    (emergency,) = of(EmcyReport, events)
    assert (emergency.code, emergency.info) == (0x8130, b"\x02\0\0\0\0")
    assert [event.what for event in of(ForeignFrameReport, events)] == [
        "extended identifier",
        "CAN FD",
    ]
    assert [(event.text, event.repeated) for event in of(BusErrorReport, events)] == [
        *(("bus off", False), ("bus off", True), ("controller problem: error passive (receiving)", False)),
        ("error counters (96 transmit, 7 receive)", False),
    ]
    summary = events[-1]
    assert isinstance(summary, Summary)
    assert summary.counts == {"CAN FD": 1, "EMCY": 1, "error frame": 4, "extended identifier": 2}


def test_a_fastscan_without_a_device_and_an_invalid_one() -> None:
    lss = [event.text for event in of(LssReport, listen(every("7E5#5100000000800000", "7E5#4C00000000000000")))]
    assert lss[0].endswith("0 answers: no device")
    assert lss[1] == "identify devices without a node-ID"
    invalid = [event.text for event in of(LssReport, listen(every("7E5#5100000000200000")))]
    assert invalid[0].startswith("fastscan that no device answers: ")


def test_the_jitter_of_sync_and_a_missing_sync() -> None:
    """Period and jitter of SYNC, and a SYNC that does not come."""
    frames = [(place * 0.01 + (0.001 if place % 2 else 0.0), "080#") for place in range(20)]
    monitor, events = CanMonitor(), list[MonitorEvent]()
    for now, line in frames:
        events += monitor.feed(CanFrame.parse(line), now)
    due = monitor.deadline
    assert due is not None
    (missing,) = monitor.feed(None, due)
    assert isinstance(missing, SyncReport)
    assert (missing.kind, round(missing.shortest or 0, 6), round(missing.longest or 0, 6)) == ("missing", 0.009, 0.011)
    (back,) = monitor.feed(CanFrame.parse("080#"), 1.0)
    assert isinstance(back, SyncReport)
    assert back.kind == "back"
