"""What a bus remembers: pending answers, late replies, units that are silent, counters."""

from __future__ import annotations

from typing import Any

import pytest

from barewire.modbus import (
    Adu,
    Noise,
    ReadCoils,
    ReadHoldingRegisters,
    ReadInputRegisters,
    WriteSingleRegister,
)
from barewire.modbus.client.line_state import (
    NEVER,
    BusCounters,
    LateReply,
    LineState,
    PendingAnswer,
    UnitOptions,
    Units,
    no_answer,
    note_stray,
)
from tests.helpers import unhex

READ, INPUT, WRITE = ReadHoldingRegisters(10, 1), ReadInputRegisters(10, 1), WriteSingleRegister(1, 2)


def state_of(*pending: tuple[int, Any], any_unit: bool = False, own: Any = None, **options: Any) -> LineState:
    """Return a state with these pending answers; the time of the first is over at 10.0, of the next at 11.0, ..."""
    state = LineState(Units(UnitOptions(**options), own or {}), any_unit=any_unit)
    for place, (unit, request) in enumerate(pending):
        state.pending.append(PendingAnswer(unit, request, 10.0 + place))
    return state


def left(state: LineState) -> list[tuple[int, int]]:
    """Return unit and function of each pending answer."""
    return [(pending.unit, pending.request.function_code) for pending in state.pending]


# Late replies ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("pdu", "fits"),
    [
        ("03 02 000A", True),
        ("83 02", True),  # an exception to it
        ("03 04 000A 000B", False),  # another quantity
        ("04 02 000A", False),
        ("84 02", False),
        ("03", False),
    ],
)
def test_a_frame_is_a_late_reply_if_it_is_a_response_to_a_pending_request(pdu: str, fits: bool) -> None:
    state = state_of((1, READ))
    state.stray(Adu(1, unhex(pdu)), 5.0)
    assert left(state) == ([] if fits else [(1, 3)])
    assert (state.counters.strays, state.counters.late) == (1, int(fits))
    assert list(state.counters.replies) == ([LateReply(1, READ, unhex(pdu), 5.0)] if fits else [])


@pytest.mark.parametrize("event", [Adu(2, unhex("03 02 000A")), Noise(unhex("03 02 000A"), "checksum", "noise")])
def test_frames_of_other_units_and_noise_are_no_late_replies(event: Adu | Noise) -> None:
    state = state_of((1, READ))
    for strays in (1, 2):
        state.stray(event, 5.0)
        assert (state.counters.strays, state.counters.late, left(state)) == (strays, 0, [(1, 3)])


def test_a_late_reply_settles_what_its_unit_was_asked_before_and_nothing_else() -> None:
    state = state_of((1, READ), (2, READ), (1, INPUT), (1, WRITE), (2, INPUT))
    state.stray(Adu(1, unhex("04 02 000A")), 5.0)
    assert left(state) == [(2, 3), (1, 6), (2, 4)]
    state.stray(Adu(2, unhex("04 02 000A")), 6.0)
    assert left(state) == [(1, 6)]
    assert (state.counters.strays, state.counters.late) == (2, 2)
    assert [(late.unit, late.at) for late in state.counters.replies] == [(1, 5.0), (2, 6.0)]


@pytest.mark.parametrize(
    ("pending", "still", "late"),
    [
        ([(1, READ)], [], [1, 1]),
        ([(1, INPUT), (1, READ)], [], [1, 1]),
        ([(1, READ), (2, INPUT)], [(2, 4)], [1, 1]),
        ([(1, INPUT)], [(1, 4)], [0, 0]),
        ([(1, READ), (2, READ)], [(1, 3), (2, 3)], [1, 2]),  # of which unit is unknown
        ([(1, READ), (2, READ), (3, READ)], [(1, 3), (2, 3), (3, 3)], [1, 2]),
    ],
)
def test_where_units_are_not_compared_a_late_reply_settles_only_what_is_certain(
    pending: list[tuple[int, Any]], still: list[tuple[int, int]], late: list[int]
) -> None:
    state = state_of(*pending, any_unit=True)
    for count in late:
        state.stray(Adu(255, unhex("03 02 000A")), 5.0)
        assert (left(state), state.counters.late) == (still, count)
    is_certain = late == [1, 1]
    assert list(state.counters.replies) == [LateReply(1, READ, unhex("03 02 000A"), 5.0)] * is_certain


def test_every_stray_is_reported_with_the_request_that_it_answers_late() -> None:
    state, reported = state_of((1, READ), (1, INPUT)), list[tuple[Any, PendingAnswer | None]]()
    late, noise = state.pending[0], Noise(b"\xff", "short", "noise")
    state.on_stray = lambda event, pending: reported.append((event, pending))
    for event in (noise, Adu(1, unhex("03 02 000A")), Adu(2, unhex("04 02 000A"))):
        state.stray(event, 5.0)
    assert reported == [(noise, None), (Adu(1, unhex("03 02 000A")), late), (Adu(2, unhex("04 02 000A")), None)]


def test_the_latest_late_replies_are_kept() -> None:
    state = state_of()
    for address in range(20):
        state.pending.append(PendingAnswer(1, ReadHoldingRegisters(address, 1), 10.0))
        state.stray(Adu(1, unhex("03 02 000A")), 5.0)
    assert state.counters.late == 20
    assert [late.request for late in state.counters.replies] == [ReadHoldingRegisters(at, 1) for at in range(4, 20)]


# Pending answers -------------------------------------------------------------------------------------------------


def test_pending_answers_of_the_same_unit_and_function_could_pass_for_a_response() -> None:
    pending = [(1, READ), (1, INPUT), (2, READ)]
    state, any_unit = state_of(*pending), state_of(*pending, any_unit=True)
    other = ReadHoldingRegisters(99, 7)
    assert [found.until for found in state.confusable(1, other)] == [10.0]
    assert [found.until for found in any_unit.confusable(1, other)] == [10.0, 12.0]
    assert [found.until for found in state.of_unit(1)] == [10.0, 11.0]
    assert [found.until for found in any_unit.of_unit(1)] == [10.0, 11.0, 12.0]
    assert state.confusable(1, ReadCoils(0, 1)) == []


def test_a_pending_answer_cannot_come_from_the_end_of_its_window_on() -> None:
    state = state_of((1, READ), (1, INPUT))
    for now, count in ((9.9, 2), (10.0, 1), (10.9, 1), (11.0, 0), (12.0, 0)):
        state.expire(now)
        assert len(state.pending) == count, now


# Units -----------------------------------------------------------------------------------------------------------


def test_an_answer_settles_its_unit_and_restarts_the_count_of_unanswered_requests() -> None:
    state = state_of((1, READ), (2, READ), (1, INPUT), dead_after=2)
    unit = state.units[1]
    assert not unit.settled
    for _ in range(2):
        unit.was_silent(1.0)
        assert unit.dead_until == NEVER
        state.answered(1, 2.0)
        assert (unit.silent, unit.settled, left(state)) == (0, True, [(2, 3)])
    assert not state.units[2].settled


def test_a_dead_unit_is_asked_after_1_2_4_8_16_and_then_every_30_seconds() -> None:
    state = state_of(dead_after=3)
    unit = state.units[1]
    pauses = []
    for _ in range(9):
        unit.was_silent(100.0)
        pauses.append(unit.dead_until - 100.0)
    assert pauses == [NEVER, NEVER, 1.0, 2.0, 4.0, 8.0, 16.0, 30.0, 30.0]
    state.answered(1, 200.0)
    assert (unit.silent, unit.dead_until) == (0, NEVER)


def test_a_unit_that_is_dead_for_days_is_asked_every_30_seconds() -> None:
    state = state_of(dead_after=3)
    unit = state.units[1]
    for _ in range(10_000):  # 2.0**10000 would be no number
        unit.was_silent(100.0)
    assert unit.dead_until == 130.0


def test_without_dead_after_no_unit_is_dead() -> None:
    state = state_of()
    for _ in range(99):
        state.units[1].was_silent(1.0)
    assert (state.units[1].silent, state.units[1].dead_until) == (99, NEVER)


@pytest.mark.parametrize(
    ("gap", "own", "free"),
    [
        (0.0, None, [NEVER, NEVER]),
        (0.5, None, [2.5, 2.5]),
        (0.0, 0.25, [2.25, NEVER]),
        (0.5, 0.25, [2.25, 2.5]),
        (0.5, 0.0, [NEVER, 2.5]),
    ],
)
def test_the_pause_of_a_unit_begins_with_its_answer(gap: float, own: float | None, free: list[float]) -> None:
    state = state_of(gap=gap, own={} if own is None else {1: UnitOptions(gap=own)})
    for unit in (1, 2):
        state.answered(unit, 2.0)
    assert [state.units[unit].free_at for unit in (1, 2)] == free


# Texts and counters ----------------------------------------------------------------------------------------------


def test_counters_begin_at_zero_and_are_shown_with_their_names() -> None:
    assert repr(BusCounters()) == (
        "BusCounters(asked=0, answered=0, lost=0, late=0, probes=0, strays=0, replies=deque([], maxlen=16))"
    )


def test_the_first_three_texts_are_kept() -> None:
    texts: list[str] = []
    for text in "abcdef":
        note_stray(texts, text)
    assert texts == ["a", "b", "c", "..."]


def test_the_error_of_a_write_says_that_its_outcome_is_unknown() -> None:
    assert str(no_answer(READ, "no response")) == "no response"
    assert str(no_answer(WRITE, "no response")) == "no response; whether it was carried out is unknown"
