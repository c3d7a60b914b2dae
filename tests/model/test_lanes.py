"""Several requests on one TCP connection in the model checker (`lanes`)."""

from __future__ import annotations

import pytest

from barewire.tcp import FanOut
from tests.model.choices import run_all, run_random
from tests.model.lanes import Fate, LanesSetup, LanesTally, lanes_scenario

pytestmark = pytest.mark.long


@pytest.mark.parametrize(
    "setup",
    [
        LanesSetup(lanes=2, questions=3, fates=(Fate.PROMPT, Fate.LATE), may_cancel=False),
        LanesSetup(lanes=2, questions=3),
        LanesSetup(lanes=2, questions=2, fates=tuple(Fate)),
    ],
    ids=["three questions", "three, cancelled at any time", "two, with every fate"],
)
def test_no_answer_is_delivered_to_another_lane_in_any_order_of_events(setup: LanesSetup) -> None:
    tally = LanesTally()
    assert run_all(lanes_scenario(setup, tally)) > 100
    assert not tally.wrong, tally.wrong[0]
    assert tally.right > 0
    assert tally.no_answer > 0


def test_no_answer_is_delivered_to_another_lane_in_random_orders() -> None:
    tally = LanesTally()
    run_random(lanes_scenario(LanesSetup(lanes=4, questions=20, fates=tuple(Fate)), tally), 300)
    assert not tally.wrong, tally.wrong[0]
    assert min(tally.right, tally.no_answer, tally.cancelled) > 100


def test_the_checker_finds_lanes_that_share_one_transaction_number() -> None:
    class Careless(FanOut):
        def _number(self, place: int) -> int:
            self._asked[7] = place
            return 7

    tally = LanesTally()
    run_all(lanes_scenario(LanesSetup(questions=2, fan_out=Careless), tally))
    assert tally.wrong
