"""The conformance battery against a plain device and the simulated AZ3, and against faulty ones, in virtual time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

import pytest

from barewire.canopen import CanFrame, Entry, LocalNode, NmtState
from barewire.conversation import play
from barewire.devices import load
from barewire.errors import NoAnswer
from barewire_workbench.conform.canopen.battery import FLOOD, run_case
from barewire_workbench.conform.canopen.model import NodeCase, NodeStep, Sdo, Subject
from barewire_workbench.conform.canopen.probe import probe, second_answer
from barewire_workbench.eds.export import export
from barewire_workbench.live.canopen_conformance import case_names, cases
from barewire_workbench.vectors.answers.device_conformance import plain_device
from tests.canopen.virtual_bus import VirtualBus
from tests.helpers import every_case, part_or_whole, some_of
from tests.workbench.conform.canopen.devices import (
    ADDRESS,
    LARGE,
    NODE,
    FaultyDevice,
    az3,
    bus_with,
    failures,
    plain,
    run_after_reset,
    subject_of,
)

PLAIN_SUBJECT, AZ3_SUBJECT = subject_of(plain, LARGE), subject_of(az3)
PLAIN, AZ3 = cases(PLAIN_SUBJECT), cases(AZ3_SUBJECT)
"""All cases; those with the effect "power" need somebody to switch the device off and on."""


def runnable(all_cases: tuple[NodeCase, ...]) -> list[NodeCase]:
    return [case for case in all_cases if not case.lacks and case.effect != "power"]


# Where the guide of the AZ3 departs from the standard.
DEVIATIONS = {
    "SDO-47": "it sends every number in four bytes",
}


@pytest.mark.parametrize("step", part_or_whole(4, 1))
@every_case(("place", "case"), list(enumerate(runnable(AZ3))))
def test_the_simulated_drive(place: int, case: NodeCase, step: int) -> None:
    """Each case has a drive of its own, which is dear to make."""
    if place % step and case.name not in DEVIATIONS:
        return
    outcome = run_after_reset(bus_with(az3()), AZ3_SUBJECT, case)
    assert (outcome.failure is not None) == (case.name in DEVIATIONS), outcome.failure


def test_the_simulated_drive_is_as_its_exported_eds() -> None:
    """The identity, the mapping records, what can be mapped, and a measured value that cannot be written."""
    described = export(load("az3")).objects
    bus = bus_with(az3())
    subject = bus.run(probe(NODE, timeout=0.1, objects=described))
    chosen = {index: described[index] for index in (0x1018, 0x1600, 0x1A00, 0x2040, 0x2081, 0x6041, 0x6060, 0x606C)}
    names = tuple(f"OD-{group}-" for group in ("READ", "SUB", "DEFAULT", "ACCESS", "RPDO", "TPDO", "WRITE"))
    assert failures(bus, subject, prefixes=names, objects=chosen) == {}


def test_one_device_passes_the_whole_battery() -> None:
    device = plain()
    bus = bus_with(device)
    subject = bus.run(probe(NODE, timeout=0.1, large=LARGE))
    assert failures(bus, subject) == {}
    assert device.sdo.counters.timed_out == 0


@pytest.mark.parametrize("groups", part_or_whole(("SDO", "SEG", "BLK", "CHN", "RND"), ("",)))
@pytest.mark.parametrize("name", some_of(["", "x", "7 bytes"], 1))
def test_a_device_with_a_short_name_passes(name: str, groups: tuple[str, ...]) -> None:
    """Its name takes one segment at most, so the cases with a text of several segments are left out."""
    made = Entry(0x1008, 0, "manufacturer device name", "string", "const", name)
    device = plain()
    device.objects.replace(made)
    bus = bus_with(device)
    subject = bus.run(probe(NODE, timeout=0.1, large=LARGE))
    assert failures(bus, subject, prefixes=groups) == {}
    assert {case.name for case in cases(subject) if case.lacks == "text of 8 bytes"} >= {"SEG-01", "SEG-10", "BLK-03"}


@pytest.mark.parametrize(
    "place", some_of([(0x1017, 0), (0x1A00, 1), (0x1000, 0), (0x1001, 0), (0x1018, 1), (0x1019, 0), (0x1600, 0)], 2)
)
def test_a_device_with_a_value_of_wrong_length_is_judged(place: tuple[int, int]) -> None:
    values = {**PLAIN_SUBJECT.values, place: bytes(range(1, 13))}
    assert len(cases(PLAIN_SUBJECT._replace(values=values))) >= len(PLAIN) - 1


def test_the_battery_covers_all_services() -> None:
    held = Counter(case.name[:3] for case in PLAIN if not case.lacks)
    assert held.total() >= 130
    assert {
        "SDO",
        "SEG",
        "BLK",
        "NMT",
        "HB-",
        "GRD",
        "HBC",
        "EMC",
        "SYN",
        "TIM",
        "RPD",
        "TPD",
        "LSS",
        "COB",
        "CHN",
        "CFG",
        "RND",
    } <= set(held)
    assert sum(not case.lacks for case in AZ3) >= 130


def test_case_names_are_unique_and_every_frame_can_be_parsed() -> None:
    assert len({case.name for case in PLAIN}) == len(PLAIN)
    for case in PLAIN:
        assert case.title
        assert case.clause.startswith(("CiA 301 7.", "CiA 305"))
        for step in case.steps:
            assert step.accepts
            assert [str(CanFrame.parse(text)) for text in step.sends] == list(step.sends), case.name


def test_every_device_has_the_same_case_names_but_one() -> None:
    """RPD-33 sends more bytes than the RPDO maps, and a frame has at most 8."""
    whole = {
        (0x1400, 1): (0x205).to_bytes(4, "little"),
        (0x1600, 0): b"\x01",
        (0x1600, 1): (0x6062_0040).to_bytes(4, "little"),
    }
    names = list(case_names())
    for found in (PLAIN, AZ3, cases(Subject(NODE, {}))):
        assert [case.name for case in found] == names
    assert [case.name for case in cases(Subject(NODE, whole))] == [name for name in names if name != "RPD-33"]


def test_cases_that_only_read_send_nothing_that_changes_a_device() -> None:
    for case in PLAIN:
        if case.effect == "reads":
            sent = [CanFrame.parse(text) for step in case.steps for text in step.sends]
            assert not any(frame.id in (0x000, 0x080) for frame in sent), case.name
            sdo = [frame.data[0] for frame in sent if frame.key == (0x600 + NODE, False) and frame.data]
            assert not any(command & 0xE0 == 0x20 or command & 0xE1 == 0xC0 for command in sdo), case.name


def test_cases_name_the_objects_that_a_device_lacks() -> None:
    lacking = {case.name: case.lacks for case in AZ3 if case.lacks}
    assert lacking["LSS-01"] == "LSS"
    assert lacking["SYN-04"] == "1005h, 1006h, 1019h"
    assert lacking["SEG-01"] == "text of 8 bytes"
    assert lacking["BLK-53"] == "large object"


def test_probing_a_missing_node() -> None:
    with pytest.raises(NoAnswer):
        bus_with(plain()).run(probe(NODE + 1, timeout=0.1))


def test_two_devices_with_one_node_id() -> None:
    """They differ in the serial number, or in nothing; one device, whatever it answers, is one."""
    one = bus_with(plain())
    assert one.run(second_answer(NODE, timeout=0.1)) is None
    for serial in (7, 8):
        bus = bus_with(plain())
        other = plain_device(address=ADDRESS._replace(serial=serial))
        bus.add(other, latency=0.03, sent=other.start(0.0))
        bus.pass_time(0.1)
        answers = bus.run(second_answer(NODE, timeout=0.5))
        assert answers is not None
        assert [str(frame) for frame in answers] == ["585#4318100407000000", f"585#431810040{serial}000000"]
    assert bus_with(plain()).run(second_answer(NODE + 1, timeout=0.1)) is None
    late = bus_with(plain())
    late.inject("585#4318100407000000", late.now)
    assert late.run(second_answer(NODE, timeout=0.1)) is None


# Faulty devices are found -----------------------------------------------------------------------------------


Change = Callable[[LocalNode, CanFrame | None, list[CanFrame]], list[CanFrame]]


def without(identifier: int) -> Change:
    """Return a change that drops the frames with this identifier."""
    return lambda device, received, sent: [frame for frame in sent if frame.id != identifier]


def other(old: str, new: str) -> Change:
    """Return a change that replaces the first digits `old` of frames by `new`."""

    def change(device: LocalNode, received: CanFrame | None, sent: list[CanFrame]) -> list[CanFrame]:
        texts = [new + str(frame)[len(old) :] if str(frame).startswith(old) else str(frame) for frame in sent]
        return [CanFrame.parse(text) for text in texts]

    return change


def answers_when_stopped(device: LocalNode, received: CanFrame | None, sent: list[CanFrame]) -> list[CanFrame]:
    if device.state is NmtState.STOPPED and received is not None and received.id == 0x600 + NODE:
        return [*sent, CanFrame(0x580 + NODE, received.data)]
    return sent


def answers_twice(device: LocalNode, received: CanFrame | None, sent: list[CanFrame]) -> list[CanFrame]:
    return [frame for frame in sent for _ in range(2 if frame.id == 0x580 + NODE else 1)]


def answers_aborts(device: LocalNode, received: CanFrame | None, sent: list[CanFrame]) -> list[CanFrame]:
    if received is not None and received.key == (0x600 + NODE, False) and received.data[:1] == b"\x80":
        return [CanFrame(0x580 + NODE, received.data)]
    return sent


def sends_with_every_sync(device: LocalNode, received: CanFrame | None, sent: list[CanFrame]) -> list[CanFrame]:
    if received is not None and received.id == 0x080 and not sent:
        return [CanFrame(0x180 + NODE, bytes(2))]
    return sent


def boots_twice(device: LocalNode, received: CanFrame | None, sent: list[CanFrame]) -> list[CanFrame]:
    return [*sent, sent[0]] if sent and sent[0] == CanFrame(0x700 + NODE, b"\0") else sent


def takes_any_cob_id(device: LocalNode, received: CanFrame | None, sent: list[CanFrame]) -> list[CanFrame]:
    refused = [str(frame) for frame in sent]
    answers = [f"585#60{text[6:12]}00000000" if text.endswith("30000906") else text for text in refused]
    return [CanFrame.parse(text) for text in answers]


def serves_in_stopped(device: LocalNode, received: CanFrame | None, sent: list[CanFrame]) -> list[CanFrame]:
    if device.state is NmtState.STOPPED and received is not None and received.id in (0x600 + NODE, 0x6A0):
        return [*sent, CanFrame(0x6A1 if received.id == 0x6A0 else 0x580 + NODE, received.data)]
    return sent


def keeps_1203h(device: LocalNode, received: CanFrame | None, sent: list[CanFrame]) -> list[CanFrame]:
    """Restore every channel but this one after a reset of the communication."""
    if received is not None and str(received) == "000#8205":
        device.objects.set(0x1203, 1, 0x8000_06A0)
    return sent


def answers_remote_frames(device: LocalNode, received: CanFrame | None, sent: list[CanFrame]) -> list[CanFrame]:
    asked = received is not None and received.remote and received.id == 0x180 + NODE
    return [*sent, CanFrame(0x180 + NODE, bytes(2))] if asked and not sent else sent


def sends_in_every_state(device: LocalNode, received: CanFrame | None, sent: list[CanFrame]) -> list[CanFrame]:
    """Send the TPDO after each write of its type, whatever the state: as if a timer ran."""
    written = received is not None and str(received).startswith(("605#2B00180564", "605#2F00180200", "000#02"))
    return [*sent, CanFrame(0x180 + NODE, bytes(2)), CanFrame(0x180 + NODE, bytes(2))] if written else sent


def stores_nothing(device: LocalNode, received: CanFrame | None, sent: list[CanFrame]) -> list[CanFrame]:
    device.stored.values.clear()
    return sent


def loads_at_once(device: LocalNode, received: CanFrame | None, sent: list[CanFrame]) -> list[CanFrame]:
    if received is not None and str(received).startswith("605#23111001"):
        device.objects.restore(0x1000, 0x1FFF)
    return sent


def without_identity(device: LocalNode, received: CanFrame | None, sent: list[CanFrame]) -> list[CanFrame]:
    """Answer no read of 1018h."""
    return [frame for frame in sent if not str(frame).startswith("585#431810")]


@pytest.mark.parametrize(
    ("change", "found"),
    [
        pytest.param(answers_when_stopped, {"NMT-02", "NMT-03", "NMT-06", "NMT-12"}, id="responds when stopped"),
        pytest.param(answers_twice, {"SDO-01", "SDO-06", "SDO-45"}, id="answers twice"),
        pytest.param(answers_aborts, {"SDO-27", "SEG-06", "BLK-17"}, id="answers aborts"),
        pytest.param(sends_with_every_sync, {"TPD-31", "TPD-33", "TPD-34", "TPD-36"}, id="a PDO with every SYNC"),
        pytest.param(boots_twice, {"NMT-10", "NMT-11"}, id="boots twice"),
        pytest.param(without(0x085), {"HBC-01", "EMC-02", "GRD-06", "RPD-31", "SYN-11"}, id="no emergencies"),
        pytest.param(other("705#05", "705#85"), {"HB-02"}, id="bit 7 in a heartbeat"),
        pytest.param(other("705#FF", "705#7F"), {"GRD-01"}, id="guarding without a toggle"),
        pytest.param(other("585#10", "585#00"), {"SEG-01", "SEG-43"}, id="segments without a toggle"),
        pytest.param(other("585#8000100002", "585#8000100001"), {"SDO-40"}, id="another abort code"),
        pytest.param(other("585#80FF0F00", "585#80000000"), {"SDO-06", "SDO-43"}, id="another object in the abort"),
        pytest.param(other("585#A201", "585#A200"), {"BLK-30", "BLK-31", "BLK-53"}, id="blocks never acknowledged"),
        pytest.param(other("585#4B171000", "585#43171000"), {"SDO-45", "NMT-17"}, id="two bytes announced as four"),
        pytest.param(other("185#37", "185#0037"), {"TPD-30"}, id="a PDO that is too long"),
        pytest.param(other("080#02", "080#01"), {"SYN-04"}, id="a counter that does not count"),
        pytest.param(other("7E4#5A", "7E4#5B"), {"LSS-02"}, id="another LSS answer"),
        pytest.param(takes_any_cob_id, {f"COB-{number:02d}" for number in range(1, 12)}, id="restricted CAN-IDs"),
        pytest.param(without(0x6A1), {"CHN-01", "CHN-02", "CHN-05"}, id="a second server that is silent"),
        pytest.param(without(0x6A1), {"CHN-07"}, id="further servers that are silent"),
        pytest.param(other("585#60031201", "585#80031201"), {"CHN-07", "CHN-08"}, id="1203h cannot be written"),
        pytest.param(other("585#43821202A1", "585#43821202A2"), {"CHN-13"}, id="1282h is changed"),
        pytest.param(keeps_1203h, {"CHN-08"}, id="1203h is kept over a reset"),
        pytest.param(serves_in_stopped, {"CHN-05", "RND-04"}, id="SDO on both channels in STOPPED"),
        pytest.param(answers_remote_frames, {"TPD-43", "TPD-44"}, id="a PDO for every remote frame"),
        pytest.param(sends_in_every_state, {"TPD-45", "TPD-46", "TPD-47"}, id="a PDO every 100 ms, in every state"),
        pytest.param(sends_with_every_sync, {"TPD-48", "TPD-49"}, id="a PDO with every SYNC, whatever its type"),
        pytest.param(other("585#8010100120000008", "585#6010100100000000"), {"SDO-53"}, id="stored by any word"),
        pytest.param(other("585#4320100198", "585#4320100199"), {"CFG-01"}, id="1020h changed"),
        pytest.param(other("585#4B171000", "585#4B171001"), {"RND-02", "RND-03"}, id="another sub-index"),
        pytest.param(stores_nothing, {f"STO-0{number}" for number in range(1, 7)}, id="nothing is stored"),
        pytest.param(loads_at_once, {"STO-07"}, id="defaults are restored at once"),
        pytest.param(without_identity, {"RND-01"}, id="the identity is not read"),
    ],
)
def test_a_faulty_device_fails_the_expected_cases(change: Change, found: set[str]) -> None:
    bus = bus_with_faulty(change)
    assert found <= failures(bus, PLAIN_SUBJECT, prefixes=tuple({name[:3] for name in found})).keys()


@pytest.mark.parametrize("groups", part_or_whole(("LSS", "NMT", "SDO"), ("",)))
def test_a_device_without_lss_does_not_fail(groups: tuple[str, ...]) -> None:
    bus = bus_with_faulty(without(0x7E4))
    assert failures(bus, bus.run(probe(NODE, timeout=0.1, large=LARGE)), prefixes=groups) == {}


def bus_with_faulty(change: Change) -> VirtualBus:
    """Return a bus with such a device, which has sent its boot-up message."""
    device = plain()
    bus = bus_with(FaultyDevice(device, change))
    bus.pass_time(0.01)
    for frame in device.start(bus.now):
        assert frame == CanFrame(0x700 + NODE, b"\0")
    return bus


def test_a_failure_is_described_in_one_sentence() -> None:
    case = case_of(NodeStep(("605#4000100000000000",), ("585#43......", "585#80")), NodeStep(("080#",), ("",)))
    answers = {"605#4000100000000000": "585#80", "080#": "185#01"}
    outcome, _ = play(run_case(case), lambda frame, now: [(now + 0.1, CanFrame.parse(answers[str(frame)]))])
    assert outcome.received == (("585#80",), ("185#01",))
    assert outcome.failure == "after 080#: 185#01, expected silence"


def test_a_flood_of_frames_ends_the_case() -> None:
    """A step ends after FLOOD of the frames that the case listens for, and the message stays short."""
    case = NodeCase(
        "X-1", "any", "CiA 301", "reads", ("585",), (NodeStep(("605#4000100000000000",), ("585#43......",)),)
    )

    def flood(frame: CanFrame, now: float) -> list[tuple[float, CanFrame]]:
        return [(now + number / 1e6, CanFrame.parse(f"585#{number:016X}")) for number in range(30_000)]

    outcome, _ = play(run_case(case), flood)
    assert outcome.failure is not None
    assert outcome.failure.startswith("after 605#4000100000000000: 585#0000000000000000, 585#00")
    assert f"{FLOOD} frames and more, expected 585#43" in outcome.failure
    assert len(outcome.failure) < 400
    assert sum(map(len, outcome.received)) == FLOOD


def test_an_accepted_end_ends_the_case() -> None:
    case = case_of(NodeStep(("605#A400100014000000",), ("585#C6",), ("585#80",)), NodeStep(("605#A3",), ("585#81",)))
    outcome, _ = play(run_case(case), lambda frame, now: [(now + 0.1, CanFrame.parse("585#80"))])
    assert (outcome.received, outcome.failure) == ((("585#80",),), None)


def test_other_frames_are_ignored() -> None:
    case = case_of(NodeStep(("605#4000100000000000",), ("585#43",)))
    answers = ["705#7F", "181#0000", "00000585#80", "585#43"]
    coming = [(0.1 * number, CanFrame.parse(text)) for number, text in enumerate(answers)]
    outcome, _ = play(run_case(case), lambda frame, now: coming)
    assert outcome.failure is None


def case_of(*steps: NodeStep) -> NodeCase:
    return PLAIN[0]._replace(steps=steps, listens=("585#", "185#"))


def test_responses_are_padded_and_a_class_of_digits_is_one_digit() -> None:
    assert Sdo(5).response("A[04]171000") == "585#A[04]171000........"
    assert Sdo(5).value(0x1001, 0, b"\x11") == "585#4F01100011......|585#4201100011......"


def test_a_subject_without_pdos_or_texts_still_has_all_cases() -> None:
    subject = Subject(NODE, {})
    assert {case.name for case in cases(subject)} >= {"SDO-01", "TPD-30", "LSS-01"}
    assert all(case.lacks for case in cases(subject) if case.name[:3] in ("TPD", "RPD", "LSS", "EMC"))
