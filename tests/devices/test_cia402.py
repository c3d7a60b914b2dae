"""States of a drive, compared with the tables and the drawing of CiA 402."""

from __future__ import annotations

from itertools import product

import pytest

from barewire.devices.cia402 import (
    STATUS_PATTERNS,
    TRANSITIONS,
    DriveCommand,
    State,
    after,
    command_of,
    next_control_word,
    state_of,
    with_state,
)
from barewire.errors import DecodeError, EncodeError
from tests.helpers import every_case, refused

COMMANDED = [
    State.SWITCH_ON_DISABLED,
    State.READY_TO_SWITCH_ON,
    State.SWITCHED_ON,
    State.OPERATION_ENABLED,
]


@pytest.mark.parametrize(
    ("word", "state"),
    [
        (0x0000, State.NOT_READY_TO_SWITCH_ON),
        (0x0250, State.SWITCH_ON_DISABLED),
        (0x0221, State.READY_TO_SWITCH_ON),
        (0x0231, State.READY_TO_SWITCH_ON),
        (0x0233, State.SWITCHED_ON),
        (0x0637, State.OPERATION_ENABLED),
        (0x1637, State.OPERATION_ENABLED),
        (0x1237, State.OPERATION_ENABLED),
        (0x0217, State.QUICK_STOP_ACTIVE),
        (0x021F, State.FAULT_REACTION_ACTIVE),
        (0x0218, State.FAULT),
    ],
)
def test_state_of(word: int, state: State) -> None:
    assert state_of(word) is state


def test_a_word_has_one_state_at_most_and_other_bits_do_not_matter() -> None:
    for low in range(0x80):
        found = [state for state, (mask, value) in STATUS_PATTERNS.items() if low & mask == value]
        assert len(found) <= 1
        for state in found:
            assert state_of(low | 0xFF80) is state


@pytest.mark.parametrize("word", [0x0001, 0x0013, 0x0203, 0x0060 | 0x08, 0x10000, -1])
def test_a_word_without_a_state(word: int) -> None:
    with refused(DecodeError, f"status word {word:04X}h is not a state of CiA 402"):
        state_of(word)


def test_with_state_keeps_every_other_bit() -> None:
    for state, word in product(State, (0x0000, 0xFFFF, 0x1637)):
        shown = with_state(word, state)
        assert state_of(shown) is state
        assert (shown ^ word) & ~STATUS_PATTERNS[state][0] == 0


@pytest.mark.parametrize(
    ("word", "previous", "command"),
    [
        (0x0006, 0, DriveCommand.SHUTDOWN),
        (0x000E, 0, DriveCommand.SHUTDOWN),
        (0x0007, 0, DriveCommand.SWITCH_ON),
        (0x005F, 0, DriveCommand.ENABLE_OPERATION),
        (0x0100, 0, DriveCommand.DISABLE_VOLTAGE),
        (0x000D, 0, DriveCommand.DISABLE_VOLTAGE),
        (0x000B, 0, DriveCommand.QUICK_STOP),
        (0x0080, 0x0000, DriveCommand.FAULT_RESET),
        (0x008F, 0x000F, DriveCommand.FAULT_RESET),
        (0x0080, 0x0080, None),
        (0x008F, 0x0080, None),
    ],
)
def test_command_of(word: int, previous: int, command: DriveCommand | None) -> None:
    assert command_of(word, previous) is command


def test_every_transition() -> None:
    assert {row.number for row in TRANSITIONS} == {*range(1, 17)} - {13}
    for number, source, target, command in TRANSITIONS:
        if command is None:
            assert all(after(source, word) is source for word in DriveCommand)
        elif number == 16:
            assert after(source, command) is source
            assert after(source, command, stays_in_quick_stop=True) is target
        elif (number, command) == (3, DriveCommand.ENABLE_OPERATION):
            assert after(source, command) is State.OPERATION_ENABLED
        else:
            assert after(source, command) is target


def test_a_command_without_a_transition_changes_nothing() -> None:
    transitions = {(row.source, row.command) for row in TRANSITIONS}
    for state, command in product(State, DriveCommand):
        if (state, command) not in transitions:
            assert after(state, command) is state


def test_a_fault_is_left_by_the_edge_only() -> None:
    assert after(State.FAULT, 0x0080, 0x0080) is State.FAULT
    assert after(State.FAULT, 0x0080, 0x0000) is State.SWITCH_ON_DISABLED


@every_case(("start", "goal", "stays"), [*product(State, COMMANDED, (False, True))])
def test_the_goal_is_reached_from_everywhere(start: State, goal: State, stays: bool) -> None:
    by_itself = {row.source: row.target for row in TRANSITIONS if row.command is None}
    state, previous, seen = start, 0, [start]
    while state is not goal:
        word = next_control_word(state, goal, stays_in_quick_stop=stays)
        state = by_itself[state] if word is None else after(state, word, previous, stays_in_quick_stop=stays)
        previous = previous if word is None else word
        seen.append(state)
        assert len(seen) <= 6, seen
    assert next_control_word(goal, goal) is None


def test_the_commands_from_switch_on_disabled_to_enabled() -> None:
    state, words = State.SWITCH_ON_DISABLED, []
    while (word := next_control_word(state, State.OPERATION_ENABLED)) is not None:
        words.append(word)
        state = after(state, word)
    assert words == [0x0006, 0x0007, 0x000F]


def test_a_quick_stop_needs_an_enabled_drive() -> None:
    assert next_control_word(State.OPERATION_ENABLED, State.QUICK_STOP_ACTIVE) == 0x0002
    assert next_control_word(State.QUICK_STOP_ACTIVE, State.QUICK_STOP_ACTIVE) is None
    with refused(EncodeError, "a quick stop needs an enabled drive, this one is 'switched on'"):
        next_control_word(State.SWITCHED_ON, State.QUICK_STOP_ACTIVE)


@pytest.mark.parametrize("goal", [State.FAULT, State.FAULT_REACTION_ACTIVE, State.NOT_READY_TO_SWITCH_ON])
def test_no_command_leads_to_a_fault(goal: State) -> None:
    with refused(EncodeError, f"no control word leads to {goal.value!r}: expected one of"):
        next_control_word(State.OPERATION_ENABLED, goal)
