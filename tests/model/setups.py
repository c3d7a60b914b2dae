"""The alphabets that are checked, by the tests and by tools/late_answers.py."""

from __future__ import annotations

from dataclasses import replace

from tests.model.one_line import (
    DIAGNOSE,
    READ,
    READ_INPUT,
    READ_OTHER_UNIT,
    WRITE,
    Fate,
    Framing,
    Setup,
)

EVERYTHING = Setup(
    length=12,
    questions=(READ, READ_INPUT, READ_OTHER_UNIT, WRITE, DIAGNOSE),
    fates=(Fate.ARRIVES, Fate.ARRIVES, Fate.LOST, Fate.IS_AN_EXCEPTION, Fate.DAMAGED, Fate.DOUBLED_AT_ONCE),
    delays=(0.002, 0.1, 0.35, 0.7, 0.8),
    pauses=(0.0, 0.5),
    cancel_after=(None, None, 0.1, 0.31),
    retries=(0, 1, 2),
)
SMALL = {
    "three reads": Setup(length=3),
    "two questions, cancelled": Setup(length=2, cancel_after=(None, 0.1, 0.31)),
    "two questions, other functions and units": replace(
        EVERYTHING, length=2, fates=Setup.fates, delays=Setup.delays, pauses=(0.0,), cancel_after=(None,), retries=(0,)
    ),
    "two questions, every fate of an answer": Setup(length=2, fates=EVERYTHING.fates),
    "two questions, repeated": Setup(length=2, retries=(0, 1), questions=(READ, WRITE)),
}
DEEP = {"five reads": Setup(length=5)}
"""Too long for a test."""
FEW_FAULTS = Setup(
    length=12,
    fates=(Fate.ARRIVES, Fate.ARRIVES, Fate.ARRIVES, Fate.LOST),
    delays=(0.002, 0.002, 0.35, 0.8),
    probing=("declines",),
    recovery=("probe",),
)
"""For the comparison with other clients."""


def for_framing(setup: Setup, framing: Framing) -> Setup:
    """Return the alphabet on another framing: on TCP there are no probes, but copies and wrong numbers."""
    if framing != "tcp":
        return replace(setup, framing=framing)
    fates = (*setup.fates, Fate.DOUBLED_LATER, Fate.AFTER_ANOTHER_NUMBER)
    return replace(setup, framing=framing, probing=("ignores",), recovery=("probe",), fates=fates)
