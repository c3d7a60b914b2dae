"""The bus in the model checker: every order of events up to a bound, and random ones beyond it (`one_line`)."""

from __future__ import annotations

import random

import pytest

from barewire.modbus import Bus, Request
from tests.model.choices import Choices, run_all, run_random
from tests.model.one_line import Fate, Framing, Setup, Tally, scenario
from tests.model.setups import EVERYTHING, SMALL, for_framing

pytestmark = pytest.mark.long


@pytest.mark.parametrize("framing", ["rtu", "ascii", "tcp"])
@pytest.mark.parametrize("setup", SMALL.values(), ids=SMALL)
def test_no_answer_is_delivered_to_another_request_in_any_order_of_events(setup: Setup, framing: Framing) -> None:
    tally = Tally()
    assert run_all(scenario(for_framing(setup, framing), tally)) > 30
    assert not tally.wrong, tally.wrong[0]
    assert tally.right > 0
    assert tally.no_answer > 0


@pytest.mark.parametrize("framing", ["rtu", "ascii", "tcp"])
def test_no_answer_is_delivered_to_another_request_in_random_orders(framing: Framing) -> None:
    tally = Tally()
    run_random(scenario(for_framing(EVERYTHING, framing), tally), 2000)
    assert not tally.wrong, tally.wrong[0]
    assert min(tally.right, tally.exceptions, tally.no_answer, tally.cancelled) > 500


def test_the_checker_finds_a_bus_that_takes_any_exception_to_a_probe_for_proof() -> None:
    """The mistake of barewire before this checker: 88 01 carries no number."""

    class Credulous(Bus):
        def _response_in(self, events, unit: int, request: Request, now: float, passed_over: list[str]):  # type: ignore[no-untyped-def,type-arg]
            if request.function_code == 8:
                self.state.pending = [late for late in self.state.pending if late.request.function_code != 8]
            return super()._response_in(events, unit, request, now, passed_over)

    tally = Tally()
    run_all(scenario(Setup(length=3, bus=Credulous, probing=("declines",), recovery=("probe",)), tally))
    assert tally.wrong


def test_the_checker_finds_a_bus_that_remembers_nothing() -> None:
    tally = Tally()
    run_all(scenario(Setup(length=2, bus=Forgetful), tally))
    assert tally.wrong


class Forgetful(Bus):
    """A bus that expects no late answers, as most clients do."""

    def _leave_pending(self, unit: int, request: object, sent_at: float, timeout: float) -> None:
        self.counters.lost += 1


@pytest.mark.parametrize(
    "setup",
    [Setup(delays=(0.002, 1.5)), Setup(fates=(Fate.ARRIVES, Fate.DOUBLED_LATER))],
    ids=["an answer after the late window", "an answer that comes a second time, later"],
)
def test_beyond_its_assumptions_the_bus_can_be_wrong(setup: Setup) -> None:
    tally = Tally()
    run_all(scenario(setup, tally))
    assert tally.wrong


def test_a_sequence_of_choices_is_repeated_by_its_script() -> None:
    play = scenario(EVERYTHING, Tally())
    first = play(Choices(dice=random.Random(7)))
    assert len(first.log) > 12
    assert play(Choices(first.choices.script)).log == first.log


def test_all_sequences_of_choices_are_run_once() -> None:
    seen: list[str] = []

    def spell(choices: Choices) -> None:
        first = choices.take("ab")
        seen.append(first + (choices.take("xyz") if first == "b" else ""))

    assert run_all(spell) == 4
    assert seen == ["a", "bx", "by", "bz"]
