"""A recording played against a device: its own recording has no difference, and every change of it is found."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Iterable, Sequence

import pytest

from barewire.canopen import CanFrame, Entry, LocalNode, LssAddress, ObjectDictionary, PdoConfig, standard_objects
from barewire.devices.sim import simulator
from barewire_workbench.recordings.model import Dropped, Recorded, RecordedItem, Unread
from barewire_workbench.replay.peer_replay import PeerReplay
from barewire_workbench.replay.played import PLAYED_KINDS, Played, nodes_of, played_kind, values_of
from tests.workbench.monitor.recorded_run import DRIVE, PLAIN, plain, recorded


def thermometer() -> LocalNode:
    objects = ObjectDictionary(
        [
            *standard_objects(LssAddress(0x360, 1, 1, 77), name="thermometer for tests", heartbeat=1000),
            Entry(0x6000, 0, "temperature", "i16", "ro", 215),
            Entry(0x6001, 0, "alarm", "i16", "rw", 800),
        ]
    )
    return LocalNode(5, objects, [PdoConfig("TPDO", 1, (0x60000010,), type=1)])


def items_of(*lines: str) -> list[Recorded]:
    """Return frames from lines such as "0.5 605#4000100000000000"."""
    pairs = (line.split() for line in lines)
    return [Recorded(float(at), "can0", CanFrame.parse(text), n) for n, (at, text) in enumerate(pairs, start=1)]


def played(
    items: Iterable[RecordedItem], device: LocalNode | None = None, *, timed: bool = True, window: float = 0.5
) -> list[Played]:
    return list(PeerReplay(device or thermometer(), 5, timed=timed, window=window).play(list(items)))


def outcomes(items: Iterable[RecordedItem], *, timed: bool = True) -> list[tuple[str, str]]:
    """Return outcome and frame of each comparison that is not the same."""
    found = played(items, timed=timed)
    return [(one.outcome, str(one.recorded or one.sent)) for one in found if one.outcome != "same"]


RUN = (
    *("0.0 705#00", "0.5 605#4000600000000000", "0.503 585#4B006000D7000000", "1.004 705#7F", "1.2 000#0105"),
    *("1.5 080#", "1.502 185#D700", "2.01 705#05", "2.1 605#2B01600010000000", "2.11 585#6001600000000000"),
    *("2.2 605#4001600000000000", "2.21 585#4B01600010000000", "2.3 605#2B0060000A000000", "2.31 585#8000600002000106"),
    "2.9 100#000000000000",
)


def test_a_recording_of_the_same_device_has_no_difference() -> None:
    found = played(items_of(*RUN))
    assert {one.outcome for one in found} == {"same"}
    assert len(found) == 8
    assert [one.kind for one in found[:4]] == ["node", "sdo", "node", "pdo"]


@pytest.mark.parametrize("node", [DRIVE, PLAIN])
def test_a_long_run_of_simulated_nodes_is_repeated(node: int) -> None:
    """Every service and every kind of transfer, two nodes and a master; one of them is played."""
    items = [Recorded(at, "can0", frame) for at, frame in recorded()]
    machine = simulator("az3", node=DRIVE).canopen if node == DRIVE else plain()
    assert machine is not None
    replay = PeerReplay(machine, node)
    found = [one for one in replay.play(items) if one.recorded != one.sent]
    errors = [one for one in found if one.kind != "emcy"]  # the run raises errors by hand
    assert [one.text for one in errors] == []
    assert replay.counts["same"] > 10


def changed(line: int, text: str) -> list[Recorded]:
    lines = list(RUN)
    lines[line] = f"{lines[line].split()[0]} {text}"
    return items_of(*lines)


@pytest.mark.parametrize(
    "line", [place for place, text in enumerate(RUN) if text.split()[1][:3] in ("585", "705", "185")]
)
def test_a_frame_of_the_device_that_differs_or_is_left_out_is_found(line: int) -> None:
    at, text = RUN[line].split()
    if text == "705#00":
        return  # then the recording begins in the middle
    other = text[:-1] + ("1" if text[-1] != "1" else "2")
    assert outcomes(changed(line, other)) == [("different", other)]
    left_out = outcomes(items_of(*RUN[:line], *RUN[line + 1 :]))
    assert left_out == [("extra", text)]
    twice = outcomes(items_of(*RUN[:line], f"{at} {text}", *RUN[line:]))
    assert twice == [("missing", text)]


def test_the_text_says_what_was_asked_and_what_came() -> None:
    (one,) = (one for one in played(changed(2, "585#4B006000D8000000")) if one.outcome != "same")
    assert one.text == (
        "recorded 585#4B006000D8000000 (SDO answer from node 5: initiate upload, 6000h:00, 2 bytes: 00D8h); "
        "the device sends 585#4B006000D7000000 (SDO answer from node 5: initiate upload, 6000h:00, 2 bytes: 00D7h); "
        "after 605#4000600000000000 (SDO request to node 5: initiate upload, 6000h:00)"
    )
    assert (one.at, one.line, one.kind) == (0.503, 3, "sdo")


def test_a_reset_takes_effect_at_the_recorded_boot_up() -> None:
    """The real device boots for two seconds, and hears nothing in this time."""
    lines = ("0 000#8105", "0.5 605#4000600000000000", "2 705#00", "3 705#7F", "4 705#7F")
    replay = PeerReplay(thermometer(), 5, window=0.5)
    assert {one.outcome for one in replay.play(items_of(*lines))} == {"same"}
    assert (replay.received, replay.not_received, replay.restarts) == (1, 1, 0)


def test_a_device_is_switched_on_where_the_recording_shows_it() -> None:
    before = ("0 605#4000600000000000", "5 705#00", "6 705#7F", "6.5 705#00", "7.5 705#7F")
    replay = PeerReplay(thermometer(), 5, window=0.5)
    assert {one.outcome for one in replay.play(items_of(*before))} == {"same"}
    assert (replay.not_received, replay.restarts) == (1, 1)


@pytest.mark.parametrize(("state", "frame"), [("705#05", "185#D700"), ("185#D700", "185#D700"), ("705#04", "")])
def test_a_recording_that_begins_in_the_middle(state: str, frame: str) -> None:
    lines = ["0.9 " + state] if state.startswith("705") else ["0.9 080#", "0.91 " + state]
    lines += ["1.1 080#", *([f"1.101 {frame}"] if frame else [])]
    assert outcomes(items_of(*lines)) == []


def test_without_times_the_device_gets_the_time_that_it_needs() -> None:
    lines = [f"{place / 1000} {text.split()[1]}" for place, text in enumerate(RUN)]
    assert outcomes(items_of(*lines), timed=False) == []
    assert ("missing", "705#7F") in outcomes(items_of(*lines))


def test_the_log_says_who_sends_a_frame() -> None:
    """The device is the producer of SYNC, which its identifier does not show: the test tool sends SYNC as well."""
    device = thermometer()
    lines = items_of("0 705#00", "0.001 605#2306100010270000", "0.002 585#6006100000000000")
    lines += items_of("0.003 605#2305100080000040", "0.004 585#6005100000000000", "0.005 080#", "0.006 080#")
    sent = [item._replace(sent=item.frame.id in (0x605,)) for item in lines if isinstance(item.frame, CanFrame)]
    found = played(sent, device, timed=False)
    assert [(one.kind, one.outcome) for one in found if one.recorded] == [
        *(("node", "same"), ("sdo", "same"), ("sdo", "same"), ("sync", "same"), ("sync", "same")),
    ]


def test_an_answer_recorded_before_its_request_belongs_to_it() -> None:
    lines = ("0 705#00", "0.5 585#4B006000D7000000", "0.5 605#4000600000000000", "0.6 605#4001600000000000")
    assert outcomes(items_of(*lines, "0.601 585#4B01600020030000")) == []


def test_a_tpdo_with_the_identifier_of_an_rpdo_is_a_pdo() -> None:
    """Two devices exchange process data without a master if one sends with the identifier that the other receives."""
    assert played_kind(CanFrame.parse("206#01")) == "pdo"


def test_the_rest_of_a_transfer_that_differs_is_marked() -> None:
    lines = ["0 705#00", "0.1 605#4008100000000000", "0.11 585#410810000F000000"]
    lines += ["0.2 605#6000000000000000", "0.21 585#0041414141414141", "0.3 605#7000000000000000"]
    lines += ["0.31 585#1041414141414141", "0.4 605#6000000000000000", "0.41 585#0D41000000000000"]
    found = played(items_of(*lines, "0.5 605#4000600000000000", "0.51 585#4B00600000000000"))
    differences = [one.repeated for one in found if one.outcome == "different"]
    assert differences == [False, True, True, True, False]


def test_with_the_recorded_values_only_the_behaviour_is_compared() -> None:
    """What the device measures and is, it gets from the recording; what was written to it, it has to know itself."""
    lines = ["0 705#00", "0.1 605#4000600000000000", "0.11 585#4B00600001000000"]
    lines += ["0.2 605#4000600000000000", "0.21 585#4B00600002000000"]
    lines += ["0.3 605#4018100100000000", "0.31 585#4318100144332211"]
    lines += ["0.4 605#4008100000000000", "0.41 585#410810000A000000", "0.42 605#6000000000000000"]
    lines += ["0.43 585#0054686520676F6F", "0.44 605#7000000000000000", "0.45 585#1964206F00000000"]
    lines += ["0.5 605#2B01600010000000", "0.51 585#6001600000000000"]
    lines += ["0.6 605#4001600000000000", "0.61 585#4B01600011000000"]
    lines += ["0.7 605#4017100000000000", "0.71 585#4B17100011000000"]
    items = items_of(*lines)
    values = values_of(items, 5)
    assert sorted((value.index, value.data) for value in values.values()) == [
        *((0x1008, b"The good o"), (0x1018, b"\x44\x33\x22\x11"), (0x6000, b"\1\0"), (0x6000, b"\2\0")),
    ]
    found = list(PeerReplay(thermometer(), 5).play(items, values))
    assert [str(one.recorded) for one in found if one.outcome != "same"] == [
        *("585#4B01600011000000", "585#4B17100011000000"),
    ]
    assert sum(one.outcome != "same" for one in played(items)) > 6


def test_a_value_that_does_not_fit_is_not_taken() -> None:
    lines = ["0 705#00", "0.1 605#4000600000000000", "0.11 585#4300600001000000"]
    lines += ["0.2 605#4077770000000000", "0.21 585#4300600001000000"]
    items = items_of(*lines)
    found = list(PeerReplay(thermometer(), 5).play(items, values_of(items, 5)))
    assert [str(one.sent) for one in found[1:]] == ["585#4B006000D7000000", "585#8077770000000206"]


def test_any_frames_are_played() -> None:
    """Frames at random, and those of a run with bits inverted: the comparison ends, and counts every frame once."""
    dice = random.Random(13)
    for number in range(60):
        run = items_of(*RUN)
        ids = (0x000, 0x080, 0x085, 0x100, 0x185, 0x205, 0x585, 0x605, 0x705, 0x7E4, 0x7E5)
        items = [
            item._replace(at=dice.uniform(0, 3) if number % 3 else item.at, frame=CanFrame(dice.choice(ids), data))
            for item in run * 8
            for data in [dice.randbytes(dice.choice((0, 1, 2, 8, 8, 8)))]
        ]
        found = played([*run, *items], timed=bool(number % 2))
        assert sum(one.recorded is not None and one.kind != "lss" for one in found) >= 8
        assert all(one.text.isprintable() for one in found)


def test_frames_that_the_recorder_lost_are_no_differences() -> None:
    items: list[RecordedItem] = [*items_of("0 705#00", "0.5 605#4000600000000000"), Dropped(0.6, "can0", 3)]
    items += [Unread(0.61, 4, "no frame", "?"), *items_of("0.7 605#4001600000000000", "0.71 585#4B01600020030000")]
    assert outcomes(items) == []


def test_the_work_grows_with_the_frames_not_with_the_identifiers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each frame that waits is looked at when it has waited long enough, not whenever time passes."""
    looks: list[tuple[int, bool]] = []
    pair = PeerReplay._pair

    def counted(replay: PeerReplay, key: tuple[int, bool], sent_before: float, recorded_before: float) -> None:
        looks.append(key)
        pair(replay, key, sent_before, recorded_before)

    monkeypatch.setattr(PeerReplay, "_pair", counted)
    frames = [CanFrame(0x1000 + n, b"", extended=True) for n in range(600)]
    items = [Recorded(n / 1000, "can0", frame, n, sent=False) for n, frame in enumerate(frames)]
    found = played(items)
    assert [str(one.recorded) for one in found if one.outcome == "missing"] == [str(frame) for frame in frames]
    assert len(looks) <= 3 * len(frames)


def test_a_device_whose_deadline_does_not_move_ends() -> None:
    class Stuck:
        deadline = 0.0

        def start(self, now: float) -> list[CanFrame]:
            return []

        def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
            return []

    replay = PeerReplay(Stuck(), 5, timed=False)
    assert Counter(one.outcome for one in replay.play(items_of("0 705#00", "0.1 705#7F"))) == {"missing": 2}
    assert replay.cut_short == 2


def test_the_node_of_a_recording() -> None:
    lines: Sequence[Recorded] = items_of("0 705#05", "0 709#05", "0 589#4B01600020030000", "0 603#4001600020030000")
    assert nodes_of(lines) == [9]
    assert nodes_of(lines[:2]) == [5, 9]
    assert nodes_of([]) == []
    assert {one.kind for one in played(items_of(*RUN))} <= set(PLAYED_KINDS)
