"""Recordings with one thing wrong: each is reported, as a violation or as a gap that names the rule; with `complete`,
always as a violation."""

from __future__ import annotations

from barewire.canopen import CanFrame
from barewire.devices import load
from barewire_workbench.monitor import CanMonitor, event_line, of_device
from barewire_workbench.monitor.events import Gap, MonitorEvent, NodeReport, SdoTransferReport, Violation
from tests.helpers import every_case
from tests.workbench.monitor.recorded_run import DRIVE, of, recorded

READ = ["605#4000100000000000", "585#4300100091010F00"]
LONG = ["605#4008100000000000", "585#4108100014000000"]
FIRST = ["605#6000000000000000", "585#0041424344454647"]
WRITE = ["605#2108100014000000", "585#6008100000000000"]
BLOCK_READ = ["605#A40810007F000000", "585#C608100014000000", "605#A300000000000000"]

# What the frames prove, whatever the recording lacks.
PROVED: dict[str, tuple[str, list[str]]] = {
    "reserved bits of a command": ("SDO-RESERVED", ["605#4F00100000000000", READ[1]]),
    "reserved bytes of a request": ("SDO-RESERVED", ["605#4000100012345678", READ[1]]),
    "reserved bytes of a confirmation": ("SDO-RESERVED", ["605#2B17100000000000", "585#6017100011223344"]),
    "reserved bytes of a download without size": ("SDO-RESERVED", ["605#2017100011223344", "585#6017100000000000"]),
    "reserved bytes of a segment request": ("SDO-RESERVED", [*LONG, "605#6011000000000000", FIRST[1]]),
    "reserved bytes of a segment confirmation": (
        "SDO-RESERVED", [*WRITE, "605#0041424344454647", "585#2001000000000000"],
    ),
    "reserved bytes of a block request": ("SDO-RESERVED", ["605#A40810007F000001", "585#C608100014000000"]),
    "reserved bytes of a block start": ("SDO-RESERVED", [*BLOCK_READ[:2], "605#A300000000000001"]),
    "reserved bytes of an acknowledgement": (
        "SDO-RESERVED", [*BLOCK_READ, "585#8141424344454647", "605#A2017F0100000000"],
    ),
    "reserved bytes of a block answer": ("SDO-RESERVED", ["605#C600210015000000", "585#A400210004010000"]),
    "segments of two transfers interlaced": (
        "SDO-OVERLAP",
        [*LONG, *FIRST, "605#4018100100000000", "585#4318100101000000", "605#7000000000000000", "585#1041424344454647"],
    ),
    "downloads interlaced": (
        "SDO-OVERLAP",
        [*WRITE, "605#0041424344454647", "585#2000000000000000", *READ, "605#1041424344454647", "585#3000000000000000"],
    ),
    "a block and another transfer interlaced": (
        "SDO-OVERLAP",
        [*BLOCK_READ, "585#0141424344454647", "605#4018100100000000", "585#4318100101000000", "585#0241424344454647"],
    ),
    "an abort about another object": ("SDO-MUX", [READ[0], "585#8008100000000206"]),
    "an emergency code of a reserved class": ("EMCY-CODE", ["085#0101010000000000"]),
    "an emergency without the generic bit": ("EMCY-REGISTER", ["085#1042080000000000"]),
    "an emergency with the reserved bit": ("EMCY-REGISTER", ["085#1042490000000000"]),
}  # fmt: skip

# What a frame that is missing in the recording would explain as well.
UNLESS_COMPLETE: dict[str, tuple[str, list[str]]] = {
    "an answer without a request": ("SDO-UNASKED", [*READ, "585#4B41600037060000"]),
    "a confirmation without a request": ("SDO-UNASKED", [*READ, "585#6017100000000000"]),
    "the same answer twice": ("SDO-UNASKED", [*READ, READ[1]]),
    "an abort of the server without a transfer": ("SDO-UNASKED", [*READ, "585#8008100000000206"]),
    "an abort of the client without a transfer": ("SDO-UNASKED", [*READ, "605#8008100000000008"]),
    "a segment requested without a transfer": ("SDO-UNASKED", [*READ, *FIRST]),
    "a segment requested without a transfer or an answer": ("SDO-UNASKED", [*READ, FIRST[0]]),
    "a segment sent without a transfer": ("SDO-UNASKED", [*READ, "605#0041424344454647", "585#2000000000000000"]),
    "a segment answered without a transfer": ("SDO-UNASKED", [*READ, FIRST[1]]),
    "a segment confirmed without a transfer": ("SDO-UNASKED", [*READ, "585#2000000000000000"]),
    "an acknowledgement in a segmented transfer": ("SDO-UNASKED", [*LONG, *FIRST, "605#A2027F0000000000"]),
    "the end of a block in a segmented transfer": ("SDO-UNASKED", [*LONG, *FIRST, "585#C100000000000000"]),
    "the start of a block in a segmented transfer": ("SDO-UNASKED", [*LONG, BLOCK_READ[2]]),
    "a segment of a block in a segmented download": (
        "SDO-TOGGLE", [*WRITE, "605#0141424344454647", "605#0248494A4B4C4D4E"],
    ),
    "the first toggle bit is 1": ("SDO-TOGGLE", [*LONG, "605#7000000000000000", "585#1041424344454647"]),
    "the first toggle bit of a download is 1": ("SDO-TOGGLE", [*WRITE, "605#1041424344454647", "585#3000000000000000"]),
    "segments after the last one": (
        "SDO-UNASKED",
        ["605#2108100007000000", WRITE[1], "605#0141424344454647", "585#2000000000000000", "605#1041424344454647"],
    ),
    "a request in the middle of a transfer": ("SDO-OVERLAP", [*LONG, *FIRST, *READ]),
    "two block transfers begun": ("SDO-OVERLAP", [*BLOCK_READ[:2], "605#A40910007F000000", "585#C609100014000000"]),
    "a number left out, and acknowledged": (
        "SDO-BLOCK-SEQNO",
        [*BLOCK_READ, "585#0141424344454647", "585#0341424344454647", "585#8441424344454600", "605#A2047F0000000000"],
    ),
    "SYNC leaves out a number and its time": (
        "SYNC-COUNTER", [*(f"080#{number:02X}" for number in range(1, 9)), "", "080#0A"],
    ),
}  # fmt: skip


def events_of(lines: list[str], *, complete: bool = False) -> list[MonitorEvent]:
    monitor = CanMonitor([of_device(load("az3"), 5)._replace(commands=())], complete=complete)
    events: list[MonitorEvent] = []
    for place, line in enumerate(lines):
        events += monitor.feed(CanFrame.parse(line), place / 100) if line else []
    events += monitor.end(len(lines) / 100)
    assert all(event_line(event).isprintable() for event in events)
    return events


@every_case("complete", [False, True])
@every_case("name", PROVED)
def test_what_the_frames_prove_is_a_violation(name: str, complete: bool) -> None:
    rule, lines = PROVED[name]
    found = of(Violation, events_of(lines, complete=complete))
    assert rule in [violation.rule for violation in found], found
    assert all(violation.frame in lines for violation in found)


@every_case("name", UNLESS_COMPLETE)
def test_what_a_missing_frame_explains_is_a_gap_that_names_the_rule(name: str) -> None:
    rule, lines = UNLESS_COMPLETE[name]
    events = events_of(lines)
    assert rule in [gap.rule for gap in of(Gap, events)], [event_line(event) for event in events]
    assert rule not in [violation.rule for violation in of(Violation, events)]
    assert any(f" or {rule} is broken: " in event_line(gap) for gap in of(Gap, events))


@every_case("name", UNLESS_COMPLETE)
def test_in_a_complete_recording_it_is_a_violation(name: str) -> None:
    rule, lines = UNLESS_COMPLETE[name]
    events = events_of(lines, complete=True)
    found = [violation for violation in of(Violation, events) if violation.rule == rule]
    assert found, [event_line(event) for event in events]
    assert found[0].frame in lines
    assert of(Gap, events) == []


def test_both_interlaced_transfers_are_read() -> None:
    lines = PROVED["segments of two transfers interlaced"][1]
    ends = ["605#6000000000000000", "585#0341424344454600"]
    reports = of(SdoTransferReport, events_of([*lines, *ends]))
    assert [(report.index, report.outcome, report.count) for report in reports] == [
        *((0x1008, "cut", 7), (0x1018, "done", 4), (0x1008, "done", 20)),
    ]
    block = [*PROVED["a block and another transfer interlaced"][1], "585#8341424344454600", "605#A2037F0000000000"]
    reports = of(SdoTransferReport, events_of([*block, "585#C500000000000000", "605#A100000000000000"]))
    assert [(report.index, report.outcome) for report in reports][-1] == (0x1008, "done")


def test_a_boot_up_without_a_reset_is_told() -> None:
    by_itself = events_of(["705#00", "705#05", "705#00"])
    commanded = events_of(["705#00", "705#05", "000#8105", "705#00"])
    for events, told in ((by_itself, True), (commanded, False)):
        last = of(NodeReport, events)[-1]
        assert (last.kind, last.unasked) == ("boot-up", told)
        assert ("no reset was commanded" in event_line(last)) is told
    assert not of(NodeReport, by_itself)[0].unasked


def test_a_complete_correct_recording_breaks_no_rule() -> None:
    monitor = CanMonitor([of_device(load("az3"), DRIVE)], complete=True)
    events = [event for now, frame in recorded() for event in monitor.feed(frame, now)]
    events += monitor.end(monitor.now)
    assert [event_line(event) for event in events if isinstance(event, Gap | Violation)] == []
