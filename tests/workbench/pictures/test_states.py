"""The state machine of CiA 402 with a path; values in registers."""

from __future__ import annotations

import re

import pytest
from hypothesis import given, settings, strategies as st

from barewire.devices.cia402 import STATUS_PATTERNS, TRANSITIONS, DriveCommand, State
from barewire.errors import EncodeError
from barewire_workbench.pictures.picture import as_svg
from barewire_workbench.pictures.states import (
    STEPS_DRAWN,
    DriveWord,
    StatesPicture,
    state_path,
    transitions_between,
)
from barewire_workbench.pictures.steps import TYPES, RegistersPicture
from tests.workbench.pictures.checks import check, svg_texts


def status(*words: int) -> list[DriveWord]:
    return [DriveWord("status", word) for word in words]


def test_all_seventeen_transitions_and_eight_states_are_drawn() -> None:
    texts = svg_texts(StatesPicture([]))
    assert {text for text in texts if text.isdecimal()} == {str(number) for number in range(17)}
    assert {state.value for state in State} <= set(texts)


def test_the_path_of_a_drive_that_is_enabled() -> None:
    steps = state_path(status(0x0250, 0x0231, 0x0233, 0x0237))
    assert [step.taken for step in steps] == [(), (2,), (3,), (4,)]
    assert all(step.sure for step in steps)
    svg = as_svg(StatesPicture(status(0x0250, 0x0231, 0x0233, 0x0237)))
    assert re.findall(r'aria-label="transition (\d+), taken"', svg) == ["2", "3", "4"]


def test_each_single_transition_is_found() -> None:
    for row in TRANSITIONS:
        words = [STATUS_PATTERNS[state][1] for state in (row.source, row.target)]
        if row.command is not None:
            control = [DriveWord("control", int(row.command))]
            if row.number == 3 and row.command is DriveCommand.ENABLE_OPERATION:  # 4 follows at once
                continue
            steps = state_path([*status(words[0]), *control, *status(words[1])])
            assert (steps[2].taken, steps[2].sure) == ((row.number,), True)
        assert state_path(status(*words))[1].taken == (row.number,)
    for state in State:
        if state not in (State.FAULT, State.FAULT_REACTION_ACTIVE):
            assert transitions_between(state, State.FAULT_REACTION_ACTIVE) == (13,)


def test_commands_decide_between_two_ways() -> None:
    enabled, disabled, quick_stop = DriveWord("status", 0x0637), DriveWord("status", 0x0270), DriveWord("control", 2)
    assert state_path([enabled, quick_stop, disabled])[2][3:] == ((11, 12), True)
    assert state_path([enabled, DriveWord("control", 0), disabled])[2][3:] == ((9,), True)
    assert state_path([enabled, disabled])[1][3:] == ((9,), False)


def test_several_commands_between_two_status_words() -> None:
    commands = [DriveWord("control", word) for word in (6, 7, 15)]
    steps = state_path([*status(0x0250), *commands, *status(0x0237)])
    assert steps[-1][3:] == ((2, 3, 4), True)
    steps = state_path([*status(0x0250), DriveWord("control", 6), *status(0x0218)])
    assert steps[-1][3:] == ((13, 14), False)


def test_a_jump_is_not_called_sure() -> None:
    step = state_path(status(0x0250, 0x0237))[1]
    assert (step.taken, step.sure) == ((2, 3, 4), False)
    assert "which the words do not prove" in step.text
    assert "transition 3, on the way" in as_svg(StatesPicture(status(0x0250, 0x0237)))


def test_no_way_back_to_power_on() -> None:
    step = state_path(status(0x0237, 0x0000))[1]
    assert step.state is State.NOT_READY_TO_SWITCH_ON
    assert step.taken == ()


def test_fault_reset_is_an_edge() -> None:
    steps = state_path([DriveWord("control", 0x80), DriveWord("control", 0x80)])
    assert [step.command for step in steps] == [DriveCommand.FAULT_RESET, None]
    assert [step.text for step in steps] == ["fault reset", "no command"]


def test_a_word_in_a_transition_keeps_the_state_before() -> None:
    steps = state_path(status(0x0231, 0x0001, 0x0233))
    assert [step.state for step in steps] == [State.READY_TO_SWITCH_ON, None, State.SWITCHED_ON]
    assert steps[2].taken == (3,)


@pytest.mark.parametrize("word", [-1, 0x10000])
def test_a_word_has_sixteen_bits(word: int) -> None:
    with pytest.raises(EncodeError, match=r"expected 0\.\.FFFFh"):
        state_path(status(word))


@given(st.lists(st.tuples(st.sampled_from(["status", "control"]), st.integers(0, 0xFFFF)), max_size=20))
@settings(max_examples=30)
def test_any_words_have_a_picture(words: list[tuple[str, int]]) -> None:
    check(StatesPicture(DriveWord("status" if kind == "status" else "control", word, 0.5) for kind, word in words))


def test_many_words_are_bounded_and_counted() -> None:
    picture = StatesPicture(status(*[0x0231, 0x0233] * 5_000))
    assert len(as_svg(picture)) < 60_000
    assert f"... {10_000 - STEPS_DRAWN} words left out ..." in svg_texts(picture)
    assert f"... {10_000 - 2 * STEPS_DRAWN} words left out ..." in picture.lines()


def test_a_value_lies_in_four_ways_in_two_registers() -> None:
    picture = RegistersPicture.of_value(1.1, order="CDAB", address=4017)
    orders = {row["order"]: row["registers"] for row in picture.as_dict()["orders"]}
    assert orders == {
        "ABCD": [0x3F8C, 0xCCCD],
        "CDAB": [0xCCCD, 0x3F8C],
        "BADC": [0x8C3F, 0xCDCC],
        "DCBA": [0xCDCC, 0x8C3F],
    }
    texts = svg_texts(picture)
    assert texts.count("register 4017") == texts.count("register 4018") == 4
    assert "CDAB (this device)" in texts


def test_four_bytes_are_four_values() -> None:
    rows = RegistersPicture.of_bytes(bytes.fromhex("00 01 00 00"), "u32").rows
    assert {row.order: row.value for row in rows} == {"ABCD": 0x10000, "CDAB": 1, "BADC": 0x1000000, "DCBA": 0x100}


@given(st.binary(min_size=4, max_size=4), st.sampled_from(TYPES))
@settings(max_examples=30)
def test_any_four_bytes_have_a_picture(data: bytes, type_: str) -> None:
    check(RegistersPicture.of_bytes(data, type_))


def test_wrong_arguments_of_registers() -> None:
    with pytest.raises(EncodeError, match="expected one of f32, i32, u32"):
        RegistersPicture.of_value(1, "f64")
    with pytest.raises(EncodeError, match="byte order 'ABDC'"):
        RegistersPicture.of_value(1, order="ABDC")
    with pytest.raises(EncodeError, match="3 bytes: expected the 4 bytes"):
        RegistersPicture.of_bytes(b"abc")
