"""What goes wrong, in the notations in which people post it: the cause is named, or the verdict stays open. Never is
anything else accused."""

from __future__ import annotations

from random import Random

import pytest

from barewire.errors import BarewireError
from barewire_workbench.diagnosis.modbus_log import ModbusLogDiagnosis
from barewire_workbench.recordings.modbus_log import read_modbus_log
from tests.helpers import every_case, part_or_whole
from tests.workbench.diagnosis.habits import ASCII, RTU, TCP, UNDECIDED, Habit, exchanges
from tests.workbench.diagnosis.notations import NOTATIONS

HABITS = {"rtu": RTU, "tcp": TCP, "ascii": ASCII}
CASES = [(framing, cause) for framing, habits in HABITS.items() for cause in habits]
UNTOLD = frozenset({"short digits", "decimal blanks", "modbus_tk", "Rust", "Python list", "NModbus"})
"""Notations in which a log of few frames may be hexadecimal or decimal: this is an error, and no guess."""
CUT = frozenset({"in a line", "wrapped", "ASCII column"})
"""Notations that do not show where a piece of one or two bytes belongs."""

HARDER = ("pieces", "length", "exception without a CRC", "RTU in the answer")
"""Causes of which up to two notations of a sample accuse something else: what is left is taken for none."""


def made(habit: Habit, notation: str, count: int, seed: str) -> str:
    dice = Random(f"{seed} {notation} {count}")
    return NOTATIONS[notation](list(habit.make(dice, exchanges(dice, count, reads=habit.reads))))


def codes_of(text: str) -> set[str]:
    """Return the codes of the first finding and of all verdicts."""
    diagnosis = ModbusLogDiagnosis(read_modbus_log(text.encode()))
    found = [finding.finding.code for finding in diagnosis.findings()]
    return {*found[:1], *(verdict.code for _, verdict in diagnosis.verdicts())}


def judged(framing: str, cause: str, notations: list[str]) -> tuple[list[str], int]:
    """Return the logs that accuse something else, and how many are right."""
    habit, wrong, right = HABITS[framing][cause], [], 0
    for place, notation in enumerate(notations):
        for count in (1, 5) if len(notations) > 20 else ((1, 5)[place % 2],):
            text = made(habit, notation, count, cause)
            try:
                codes = codes_of(text)
            except BarewireError as error:
                codes = set() if notation in UNTOLD else {str(error)}
            right += bool(codes & habit.right)
            if codes - habit.right - UNDECIDED:
                wrong.append(f"{notation}, {count}: {sorted(codes)}")
    return wrong, right


@pytest.mark.parametrize("count", part_or_whole(2, 10))
@every_case(("framing", "cause"), CASES)
def test_a_cause_is_named_or_left_open_in_every_notation(framing: str, cause: str, count: int) -> None:
    """Each cause in ten notations; in two of them, one with a single exchange and one with five, in `make test`."""
    notations = Random(f"{framing} {cause}").sample(sorted(NOTATIONS.keys() - CUT), 10)[:count]
    wrong, _ = judged(framing, cause, notations)
    assert len(wrong) <= count // 5 * any(words in cause for words in HARDER), wrong


@pytest.mark.proof
@pytest.mark.parametrize(("framing", "cause"), CASES)
def test_of_all_notations_one_in_fifty_accuses_at_most(framing: str, cause: str) -> None:
    wrong, _ = judged(framing, cause, sorted(NOTATIONS))
    assert 50 * len(wrong) <= 2 * len(NOTATIONS) * (4 if any(words in cause for words in HARDER) else 1), wrong


@every_case("notation", sorted(NOTATIONS))
@every_case("framing", ["rtu", "tcp"])
def test_a_good_log_is_good_in_every_notation(framing: str, notation: str) -> None:
    text = made(HABITS[framing]["good"], notation, 5, "good")
    assert codes_of(text) == {"nothing-wrong"}
