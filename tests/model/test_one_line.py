"""The bus in the model checker: every order of events up to a bound, and random ones beyond it (`one_line`)."""

from __future__ import annotations

import random
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import pytest

from barewire.conversation import Conversation
from barewire.modbus import Bus, EchoLine, Request
from barewire.rtu import RtuLine
from tests.helpers import part_or_whole
from tests.model.choices import Choices, run_all, run_random
from tests.model.one_line import Tally, scenario
from tests.model.setups import EVERYTHING, SERIAL, SMALL, WITH_OTHERS, for_framing, traffic_of
from tests.model.units import UNKNOWN_ECHO, WRITE, Fate, Framing, Setup

pytestmark = pytest.mark.long


LARGE = {
    "two questions, repeated",
    "two questions, echo, others ask another unit",
    "three questions to three units",
    "three questions, some broadcast",
    "two questions, others never pause",
    "two questions, others ask another unit",
    "two questions, others use other functions",
}
"""`make test` plays none of these, and each other alphabet on one framing; `make proof` plays every one on each. What
they have is in the random orders of `EVERYTHING` and `WITH_OTHERS` too."""


def on_framings(names: Iterable[str], *framings: Framing) -> list[Any]:
    """Return each alphabet with each framing; those of `make proof` are marked."""
    pairs = []
    for number, name in enumerate(names):
        for place, framing in enumerate(framings):
            is_in_proof = name in LARGE or place != number % len(framings)
            pairs.append(pytest.param(name, framing, marks=[pytest.mark.proof] if is_in_proof else []))
    return pairs


@pytest.mark.parametrize(("name", "framing"), on_framings(SMALL, "rtu", "ascii", "tcp"))
def test_no_answer_is_delivered_to_another_request_in_any_order_of_events(name: str, framing: Framing) -> None:
    tally = Tally()
    assert run_all(scenario(for_framing(SMALL[name], framing), tally)) > 30
    assert not tally.wrong, tally.wrong[0]
    assert tally.right > 0
    assert tally.no_answer > 0


@pytest.mark.parametrize("runs", part_or_whole(200, 600))
@pytest.mark.parametrize("framing", ["rtu", "ascii", "tcp"])
def test_no_answer_is_delivered_to_another_request_in_random_orders(framing: Framing, runs: int) -> None:
    tally = Tally()
    run_random(scenario(for_framing(EVERYTHING, framing), tally), runs)
    assert not tally.wrong, tally.wrong[0]
    assert min(tally.right, tally.exceptions, tally.no_answer, tally.cancelled) > runs / 4


@pytest.mark.parametrize(("name", "framing"), on_framings(SERIAL, "ascii", "rtu"))
def test_neither_broadcasts_nor_other_units_nor_others_nor_an_echo_change_that(name: str, framing: Framing) -> None:
    tally = Tally()
    assert run_all(scenario(for_framing(SERIAL[name], framing), tally)) > 30
    assert not tally.wrong, tally.wrong[0]
    assert tally.right > 0
    assert tally.no_answer > 0


@pytest.mark.parametrize("framing", ["rtu", "ascii"])
def test_nor_all_of_that_in_random_orders(framing: Framing) -> None:
    tally = Tally()
    run_random(scenario(for_framing(WITH_OTHERS, framing), tally), 300)
    assert not tally.wrong, tally.wrong[0]
    assert min(tally.right, tally.exceptions, tally.no_answer, tally.cancelled) > 75


def test_the_checker_finds_a_bus_that_takes_any_exception_to_a_probe_for_proof() -> None:
    """The mistake of barewire before this checker: 88 01 carries no number."""

    class Credulous(Bus):
        def _response_in(self, events, unit: int, request: Request, now: float, passed_over: list[str]):  # type: ignore[no-untyped-def,type-arg]
            if request.function_code == 8:
                self.state.pending = [late for late in self.state.pending if late.request.function_code != 8]
            return super()._response_in(events, unit, request, now, passed_over)

    tally = Tally()
    setup = Setup(length=3, bus=Credulous, probing=("declines",), recovery=("probe",))
    run_all(scenario(setup, tally), until=lambda: tally.wrong)
    assert tally.wrong


def test_the_checker_finds_a_bus_that_remembers_nothing() -> None:
    tally = Tally()
    run_all(scenario(Setup(length=2, bus=Forgetful), tally), until=lambda: tally.wrong)
    assert tally.wrong


class Forgetful(Bus):
    """A bus that expects no late answers, as most clients do."""

    def _leave_pending(self, now: float) -> None:
        super()._leave_pending(now)
        self.state.pending.clear()


def wrong_of(name: str, framing: Framing = "rtu", bus: type[Bus] = Bus) -> list[str]:
    """Return the first wrong answers in a setup of `SERIAL` with a planted mistake."""
    tally = Tally()
    setup = replace(for_framing(SERIAL[name], framing), bus=bus)
    run_all(scenario(setup, tally), until=lambda: tally.wrong)
    return tally.wrong


@pytest.mark.parametrize("name", ["three questions to three units", "two questions, others ask another unit"])
def test_the_checker_finds_a_line_that_takes_the_answer_of_any_unit(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(RtuLine, "answers", lambda line, adu: True)
    assert wrong_of(name)


@pytest.mark.parametrize("framing", ["rtu", "ascii"])
@pytest.mark.parametrize("name", [name for name in SERIAL if "echo" in name])
def test_the_checker_finds_a_line_that_expects_the_echo_only_as_the_first_bytes(
    name: str, framing: Framing, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The mistake of barewire before this checker: behind a late answer, the echo of a write confirmed it."""
    monkeypatch.setattr(EchoLine, "_is_echo", lambda line, event: False)
    assert wrong_of(name, framing)


def test_the_checker_finds_a_bus_that_forgets_late_answers_at_a_broadcast() -> None:
    class Forgets(Bus):
        def _broadcast(self, request: Request[Any], turnaround: float) -> Conversation[bytes, None]:
            self.state.pending.clear()
            yield from super()._broadcast(request, turnaround)

    assert wrong_of("three questions, some broadcast", bus=Forgets)


def test_the_checker_finds_a_bus_that_repeats_a_broadcast() -> None:
    class Repeats(Bus):
        def _broadcast(self, request: Request[Any], turnaround: float) -> Conversation[bytes, None]:
            yield from super()._broadcast(request, turnaround)
            yield from super()._broadcast(request, turnaround)

    with pytest.raises(AssertionError, match=r"\(broadcast\)"):
        wrong_of("three questions, some broadcast", bus=Repeats)


def test_the_checker_finds_a_bus_that_waits_for_silence_without_a_bound() -> None:
    class Patient(Bus):
        def wait_until_idle(self, timeout: float) -> Conversation[bytes, float]:
            return super().wait_until_idle(100.0)

    with pytest.raises(AssertionError, match="took"):
        wrong_of("two questions, others never pause", bus=Patient)


@pytest.mark.parametrize(
    "setup",
    [
        Setup(delays=(0.002, 1.5)),
        Setup(fates=(Fate.ARRIVES, Fate.DOUBLED_LATER)),
        Setup(length=1, traffic=traffic_of(1)),
        Setup(length=1, questions=(WRITE,), traffic=traffic_of(1)),
        Setup(length=1, questions=(WRITE,), adapters=(UNKNOWN_ECHO,)),
    ],
    ids=[
        "an answer after the late window",
        "an answer that comes a second time, later",
        "another master reads from this unit",
        "another master writes to this unit",
        "an echo that is not configured",
    ],
)
def test_beyond_its_assumptions_the_bus_can_be_wrong(setup: Setup) -> None:
    tally = Tally()
    run_all(scenario(setup, tally), until=lambda: tally.wrong)
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
