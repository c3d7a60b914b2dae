"""Several requests on one TCP connection in the model checker (`lanes`)."""

from __future__ import annotations

import pytest

from barewire.tcp import FanOut
from tests.model.choices import run_all, run_random
from tests.model.lanes import MANY_LANES, Fate, LanesSetup, LanesTally, lanes_scenario

pytestmark = pytest.mark.long


@pytest.mark.parametrize(
    "setup",
    [
        LanesSetup(lanes=2, questions=3, fates=(Fate.PROMPT, Fate.LATE), may_cancel=False),
        pytest.param(LanesSetup(lanes=2, questions=3), marks=pytest.mark.proof),  # six times as many orders as the next
        LanesSetup(lanes=2, questions=2, fates=tuple(Fate)),
        LanesSetup(lanes=2, questions=3, fates=(Fate.PROMPT, Fate.SLOW, Fate.LOST), may_cancel=False, may_wrap=True),
        LanesSetup(questions=2, fates=(Fate.PROMPT, Fate.LATE), writes=(False, True), retries=(0, 1)),
    ],
    ids=["three questions", "three, cancelled at any time", "two, with every fate", "wrapped", "writes and retries"],
)
def test_no_answer_is_delivered_to_another_lane_in_any_order_of_events(setup: LanesSetup) -> None:
    tally = LanesTally()
    assert run_all(lanes_scenario(setup, tally)) > 100
    assert not tally.wrong, tally.wrong[0]
    assert tally.right > 0
    assert tally.no_answer > 0


def test_no_answer_is_delivered_to_another_lane_in_random_orders() -> None:
    tally = LanesTally()
    run_random(lanes_scenario(MANY_LANES, tally), 300)
    assert not tally.wrong, tally.wrong[0]
    assert min(tally.right, tally.no_answer, tally.cancelled) > 100


def test_the_checker_finds_lanes_that_share_one_transaction_number() -> None:
    class Careless(FanOut):
        def _number(self, place: int) -> int:
            self._asked[7] = place
            return 7

    tally = LanesTally()
    run_all(lanes_scenario(LanesSetup(questions=2, fan_out=Careless), tally), until=lambda: tally.wrong)
    assert tally.wrong


def test_the_checker_finds_a_number_that_is_used_again_while_its_question_is_open() -> None:
    class Forgetful(FanOut):
        def _number(self, place: int) -> int:
            self._last = number = self._last + 1 & 0xFFFF
            self._numbers[place], self._asked[number] = number, place
            return number

    tally = LanesTally()
    setup = LanesSetup(questions=3, fates=(Fate.PROMPT, Fate.SLOW), may_cancel=False, may_wrap=True, fan_out=Forgetful)
    run_all(lanes_scenario(setup, tally), until=lambda: tally.wrong)
    assert tally.wrong
