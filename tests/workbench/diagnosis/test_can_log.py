"""Recordings of CAN buses: good ones have no finding, each fault is found with its proof, and the verdict follows."""

from __future__ import annotations

from typing import Any

import pytest

from barewire.canopen.frame import AnyFrame, CanFrame, ErrorFrame, FdFrame
from barewire_workbench.diagnosis.can_log import BusDiagnosis, CanLogDiagnosis
from barewire_workbench.recordings.model import Dropped, Recorded, Unread
from tests.helpers import every_case, some_of
from tests.workbench.diagnosis.can_cases import Frames, az3_known, diagnosed, good_recording, timed
from tests.workbench.monitor.recorded_run import recorded

READ, ANSWER = "605#4041600000000000", "585#4B41600037060000"
LONG = ("605#4008100000000000", "585#410810000E000000")
DEAD = [frame for at in range(5) for frame in timed("607#4041600000000000", READ, ANSWER, start=4.0 * at)]

FAULTS: dict[str, tuple[list[Any], list[str], str]] = {
    "two transfers at once": (
        timed(*LONG, "605#6000000000000000", "585#0041424344454647", "605#4018100100000000", "585#4318100101000000",
              "605#7000000000000000", "585#1141424344454647"),
        ["two-masters"], "two-masters",
    ),
    "an answer after the next request": (
        timed(READ, "605#4018100100000000", ANSWER, "585#4318100101000000"), ["two-masters"], "two-masters",
    ),
    "a server that answers with the other toggle bit": (
        timed(*LONG, "605#6000000000000000", "585#1041424344454647"), ["sdo-toggle"], "nothing-proved",
    ),
    "a client that repeats the toggle bit, and is aborted": (
        timed(*LONG, "605#6000000000000000", "585#0041424344454647", "605#6000000000000000", "585#8008100000000305"),
        ["sdo-toggle"], "nothing-proved",
    ),
    "a client that begins with toggle bit 1, and the server goes on": (
        timed(*LONG, "605#7000000000000000", "585#1041424344454647", "605#6000000000000000", "585#0141424344454647"),
        ["sdo-toggle"], "nothing-proved",
    ),
    "a client that sends a segment again": (
        timed("605#210810000E000000", "585#6008100000000000", "605#0041424344454647", "605#0041424344454647",
              "585#2000000000000000", "605#1141424344454647", "585#3000000000000000"),
        ["sdo-toggle"], "nothing-proved",
    ),
    "less than announced": (
        timed(*LONG, "605#6000000000000000", "585#0141424344454647"), ["sdo-size"], "nothing-proved",
    ),
    "a size that the server refuses": (
        timed("605#2340600006000000", "585#8040600010000706"), ["sdo-size"],
        "nothing-proved",
    ),
    "a frame that ends before its data": (timed("605#23406000060000"), ["sdo-size"], "nothing-proved"),
    "a frame without its unused bytes": (timed("605#40416000"), ["cut-frame"], "nothing-proved"),
    "a read request that the server refuses": (
        timed("605#4341600000000000", "585#8041600001000405"), ["sdo-read-command"], "nothing-proved",
    ),
    "an emergency without its error bit": (timed("085#1042000000000000"), ["emcy-register"], "nothing-proved"),
    "a restricted identifier": (timed("705#05", "6E1#00"), ["foreign-cob-id"], "nothing-proved"),
    "a restricted identifier, where no node of CANopen is heard": (timed("7DF#0100"), [], "not-seen"),
    "a PDO of a node that is not operational": (timed("705#7F", "185#0102030405060708"), ["state"], "nothing-proved"),
    "a stopped node that is asked": (
        [*timed("705#04", READ), *timed("705#04", "705#04", start=5.0)], ["state"], "nothing-proved",
    ),
    "a heartbeat that ends": (
        [*[pair for at in range(6) for pair in timed("705#05", "706#05", start=1.0 * at)], *timed("706#05", start=6.0),
         *timed("706#05", start=7.0), *timed("706#05", start=8.0), *timed("706#05", start=9.0)],
        ["no-heartbeat"], "dead-unit",
    ),
    "a restart": (timed("705#05", "705#05", "705#00"), ["restart"], "nothing-proved"),
    "a client that gives up": (
        [*timed(READ), *timed("605#8041600000000405", "706#05", start=0.5)], ["no-answer"], "nothing-proved",
    ),
    "one node that never answers": (DEAD, ["no-answer"] * 4, "dead-unit"),
    "no node that answers": ([pair for pair in DEAD if pair[1].id >= 0x600], [], "no-answers"),
    "two nodes with one node-ID": (
        [pair for at in range(5) for pair in timed(READ, ANSWER, ANSWER, start=1.0 * at)], ["two-units"], "two-units",
    ),
    "a wrong bit rate": ([(0.001 * at, ErrorFrame(0x88)) for at in range(20)], ["bit-rate"], "bit-rate"),
    "no other node": ([(0.001 * at, ErrorFrame(0x20)) for at in range(20)], [], "not-acknowledged"),
    "an error counter of 128": (
        [(0.0, ErrorFrame(0x88)), (0.001, ErrorFrame(0x04, bytes.fromhex("0020000000008000")))],
        ["bit-rate"], "bit-rate",
    ),
    "an error counter of 128, in the class of the counters alone": (
        [(0.0, ErrorFrame(0x88)), (0.001, ErrorFrame(0x200, bytes.fromhex("0000000000008000")))],
        ["bit-rate"], "bit-rate",
    ),
    "a wire that is torn off now and then": (
        [*timed(READ, ANSWER), *[(1.0 + at, ErrorFrame(0x10)) for at in range(3)], *timed(READ, ANSWER, start=9.0)],
        ["bit-rate"], "disturbed",
    ),
    "error frames among good ones": (
        [*timed(READ, ANSWER), *[(1.0 + at, ErrorFrame(0x88)) for at in range(3)], *timed(READ, ANSWER, start=9.0)],
        ["bit-rate"], "disturbed",
    ),
}  # fmt: skip


@every_case("name", FAULTS)
def test_a_fault_is_found_and_the_verdict_follows(name: str) -> None:
    frames, codes, verdict = FAULTS[name]
    findings, verdicts = diagnosed(frames)
    assert [found.finding.code for found in findings] == codes, [found.sentence for found in findings]
    assert [found.code for found in verdicts] == [verdict], [found.sentence for found in verdicts]
    assert all(found.finding.proof for found in findings)
    assert verdicts[0].evidence


def test_a_missing_answer_is_at_its_request_and_at_the_time_when_it_was_certain() -> None:
    first = diagnosed(DEAD)[0][0]
    assert (first.line, first.at, first.finding.proof) == (1, 3.0, "nothing from node 7 for 3.000 s")


def test_a_verdict_has_its_numbers_and_what_else_it_may_be() -> None:
    (verdict,) = diagnosed(DEAD)[1]
    assert verdict.sentence == (
        "verdict: node 7 does not answer [dead-unit]: 0 of 4 requests answered, it never sent a frame; "
        "others answered 5; it may also be another node-ID, or a broken stub to this node"
    )


NO_FAULT = {"nothing-wrong", "refused", "open"}
"""The verdicts on a good bus: some of these runs have aborts and emergencies, or end within a transfer."""


@pytest.mark.parametrize("seed", some_of(range(40), 4))
def test_a_good_recording_has_no_finding(seed: int) -> None:
    frames = good_recording(seed)
    for known in ((), (az3_known(),)):
        findings, verdicts = diagnosed(frames, *known)
        assert [found.sentence for found in findings] == []
        assert {verdict.code for verdict in verdicts} <= NO_FAULT


@pytest.mark.parametrize("known", [(), (az3_known(),)], ids=["plain", "described"])
def test_a_run_with_every_service_has_no_finding_wherever_the_recording_begins(known: Any) -> None:
    frames = list(recorded())
    for first in (0, 3, 50, 400, 1000, 2000):
        findings, verdicts = diagnosed(frames[first:], *known)
        assert [found.sentence for found in findings] == []
        assert {verdict.code for verdict in verdicts} <= NO_FAULT


def test_a_search_for_nodes_is_no_dead_unit() -> None:
    asked = [
        (0.1 * node, CanFrame.parse(f"{0x600 + node:03X}#4000100000000000")) for node in range(1, 127) if node != 5
    ]
    frames = [*asked, *timed("605#4000100000000000", "585#4300100091010F00", start=20.0)]
    findings, verdicts = diagnosed(frames)
    assert [found.sentence for found in findings] == []
    assert [verdict.code for verdict in verdicts] == ["nothing-wrong"]


def test_an_answer_that_comes_late_is_not_missing() -> None:
    frames = [*timed(READ), *timed("706#05", start=4.0), *timed(ANSWER, READ, ANSWER, start=4.5)]
    findings, verdicts = diagnosed(frames)
    assert [found.finding.code for found in findings] == ["no-answer", "late-answer"]
    assert [verdict.code for verdict in verdicts] == ["nothing-proved"]


def test_without_frames_the_verdict_says_so() -> None:
    assert [verdict.code for verdict in BusDiagnosis().verdicts()] == ["nothing-heard"]
    assert [verdict.code for _, verdict in CanLogDiagnosis().verdicts()] == ["nothing-heard"]


def test_each_bus_of_a_recording_has_its_own_verdict() -> None:
    log = CanLogDiagnosis()
    for at in range(3):
        log.feed(Recorded(0.1 * at, "can0", CanFrame.parse(READ)))
        log.feed(Recorded(0.1 * at + 0.01, "can0", CanFrame.parse(ANSWER)))
        log.feed(Recorded(0.1 * at + 0.02, "can1", ErrorFrame(0x88)))
    found = log.feed(Recorded(1.0, "can0", CanFrame.parse("705#01"), line=9))
    assert [(one.place, one.line) for one in found] == [("bus can0 node 5", 9)] * len(found)
    log.end()
    assert [(bus, verdict.code) for bus, verdict in log.verdicts()] == [
        ("can0", "nothing-proved"),
        ("can1", "bit-rate"),
    ]


def test_only_one_bus_is_judged_if_it_is_selected() -> None:
    log = CanLogDiagnosis(bus="can1")
    assert log.feed(Recorded(0.0, "can0", CanFrame.parse("705#01"))) == []
    assert log.feed(Recorded(0.0, "can1", CanFrame.parse("705#01"))) != []
    assert list(log.buses) == ["can1"]


def test_what_the_recorder_lost_is_no_fault_of_the_bus() -> None:
    log = CanLogDiagnosis()
    log.feed(Unread(0.0, 1, "not a frame", "hello"))
    log.feed(Recorded(0.0, "can0", CanFrame.parse(READ)))
    log.feed(Dropped(0.1, "can0", 7))
    log.feed(5.0)
    log.end()
    assert [(verdict.code, verdict.evidence) for _, verdict in log.verdicts()] == [
        ("open", "each SDO request stands alone; 1 frame read"),
        ("not-seen", "1 gap in the recording; 1 frame read"),
    ]
    assert [item.line for item in log.unread] == [1]


def test_frames_of_can_fd_are_not_seen() -> None:
    frames: list[tuple[float, AnyFrame]] = [
        *timed(READ, ANSWER),
        (0.5, FdFrame(0x605, bytes(12))),
        (0.6, FdFrame(0x585, bytes(12))),
    ]
    findings, (verdict,) = diagnosed(frames)
    assert findings == []
    assert (verdict.code, verdict.evidence) == (
        "not-seen",
        "2 frames of CAN FD, not decoded; 4 frames read, of 1 node, 1 SDO transfer ended",
    )


def heartbeats(*times: float) -> Frames:
    return [(at, CanFrame.parse("705#05")) for at in times]


def other_node(until: int) -> Frames:
    return [(place + 0.1, CanFrame.parse("706#05")) for place in range(until)]


@pytest.mark.parametrize(
    ("frames", "code", "evidence"),
    [
        (heartbeats(0, 1, 2, 7, 8), "nothing-proved", "1 no-heartbeat of node 5"),
        (heartbeats(0, 1, 6, 7, 8), "nothing-proved", "1 no-heartbeat of node 5"),
        (heartbeats(0, 1, 2, 3, 4, 9, 10, 11), "nothing-proved", "1 no-heartbeat of node 5"),
        (sorted([*heartbeats(0, 1, 2), *other_node(9)]), "dead-unit", "its heartbeat is missing from"),
        (sorted([*heartbeats(0, 1, 2, 3, 4), *other_node(10)]), "dead-unit", "its heartbeat is missing from"),
        (
            sorted([*heartbeats(0, 1, 2, 3, 9, 10), *other_node(4), (9.1, CanFrame.parse("706#05"))]),
            "not-seen",
            "1 gap in the recording",
        ),
    ],
)  # fmt: skip
def test_a_pause_of_the_heartbeat_is_named(frames: Frames, code: str, evidence: str) -> None:
    findings, verdicts = diagnosed(frames)
    assert [(verdict.code, evidence in verdict.evidence) for verdict in verdicts] == [(code, True)]
    assert [found.finding.code for found in findings] == ([] if code == "not-seen" else ["no-heartbeat"])


def test_heartbeats_of_another_period_are_no_pause() -> None:
    """The period changes once, a command restarts the node, a state is reported at once."""
    for frames in (
        heartbeats(0, 1, 2, 2.2, 2.4, 2.6, 2.8),
        [*heartbeats(0, 1, 2), (2.5, CanFrame.parse("000#8105")), (7.0, CanFrame.parse("705#00")), *heartbeats(8, 9)],
        heartbeats(0, 0.01, 1.01, 2.01, 3.01),
    ):
        assert [verdict.code for verdict in diagnosed(frames)[1]] == ["nothing-wrong"]


def test_an_abort_with_a_code_of_the_maker_is_a_refusal_and_no_fault() -> None:
    request, abort = CanFrame.parse("67D#2B30500000070000"), CanFrame.parse("5FD#803050000900000F")
    findings, (verdict,) = diagnosed([(1.0, request), (1.01, abort)])
    assert [found.sentence for found in findings] == []
    assert verdict.code == "refused"
    assert "0F000009h (a code of the maker) by node 125 to 5030h:00" in verdict.evidence


def test_a_request_that_is_repeated_before_its_answer_is_named() -> None:
    request, answer = CanFrame.parse("67D#2B30500000070000"), CanFrame.parse("5FD#6030500000000000")
    _, verdicts = diagnosed([(1.0, request), (1.001, request), (1.002, answer)])
    assert any("repeated before its answer: 2B 30 50 00" in verdict.evidence for verdict in verdicts)


def test_the_pdo_of_a_log_of_one_frame_is_named() -> None:
    _, (verdict,) = diagnosed([(1.0, CanFrame.parse("220#0000E8030000"))])
    assert "220h is RPDO1 of node 32 of the predefined set" in verdict.evidence


@every_case(
    ("frames", "seen"),
    [
        (["185#0102030405060708", "205#0102"], "the data of all 2 frames, whose meaning is not known"),
        (["0CF00400#F87D7D0000000000"], "the data of all 1 frame, whose meaning is not known"),
        (["007#01", "007#02", "007#03"], "the data of all 3 frames, whose meaning is not known"),
    ],
)
def test_frames_of_data_alone_are_not_judged(frames: list[str], seen: str) -> None:
    _, verdicts = diagnosed(timed(*frames))
    assert [verdict.code for verdict in verdicts] == ["not-seen"]
    assert seen in verdicts[0].evidence


def test_a_bus_on_which_no_node_is_heard_after_a_reset_is_open() -> None:
    _, verdicts = diagnosed(timed("703#00", "000#8200", "080#", "080#", "080#"))
    assert [verdict.code for verdict in verdicts] == ["open"]
    assert "reset of all nodes, and none heard after it" in verdicts[0].evidence
    assert [verdict.code for verdict in diagnosed(timed("703#00", "000#8203", "703#00", "080#"))[1]] == [
        "nothing-wrong"
    ]
