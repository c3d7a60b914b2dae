"""The alphabets that are checked, by the tests and by tools/late_answers.py."""

from __future__ import annotations

from dataclasses import replace

from barewire.modbus import ReadHoldingRegisters, ReadInputRegisters, WriteSingleRegister
from tests.model.units import (
    DIAGNOSE,
    ECHO,
    ECHO_TO_DETECT,
    NO_ECHO_TO_DETECT,
    PLAIN,
    READ,
    READ_INPUT,
    READ_OTHER_UNIT,
    READ_THIRD_UNIT,
    SLOW_ECHO,
    WRITE,
    WRITE_ALL,
    Fate,
    Framing,
    Setup,
    Traffic,
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
REQUEST, RESPONSE, WRITTEN = (
    ReadHoldingRegisters(7, 1).encode(),
    b"\x03\x02\xee\xee",
    WriteSingleRegister(7, 7).encode(),
)


def traffic_of(unit: int) -> tuple[tuple[Traffic, ...], ...]:
    """Return what others may do during a question: nothing, read from this unit, write to it, both late."""
    return (
        (),
        (Traffic(0.001, unit, REQUEST), Traffic(0.1, unit, RESPONSE)),
        (Traffic(0.006, unit, WRITTEN), Traffic(0.2, unit, WRITTEN)),
        (Traffic(0.29, unit, b"\x88\x01"), Traffic(0.31, unit, RESPONSE), Traffic(0.312, unit, WRITTEN)),
    )


OTHER_FUNCTION = (
    (),
    (Traffic(0.001, 1, ReadInputRegisters(7, 1).encode()), Traffic(0.1, 1, b"\x04\x02\xee\xee")),
    (Traffic(0.29, 1, b"\x84\x02"), Traffic(0.31, 1, b"\x05\x00\x07\xff\x00")),
)
"""Another master asks unit 1 as well, with functions that the client does not use."""
BUSY = tuple(Traffic(0.0019 * step, 9, RESPONSE) for step in range(1200))
"""Another master that makes no pause of t3.5 for two seconds."""
_WITH_ECHO = Setup(length=2, questions=(READ, WRITE), delays=(0.002, 0.312, 0.8), adapters=(ECHO, SLOW_ECHO))
SERIAL = {
    "three questions to three units": Setup(
        length=3,
        questions=(READ, READ_OTHER_UNIT, READ_THIRD_UNIT),
        probing=("echoes", "declines"),
        recovery=("probe",),
    ),
    "three questions, some broadcast": Setup(length=3, questions=(WRITE, WRITE_ALL), cancel_after=(None, 0.05)),
    "two questions, others ask another unit": Setup(length=2, questions=(READ, WRITE), traffic=traffic_of(9)),
    "two questions, others use other functions": Setup(length=2, questions=(READ, WRITE), traffic=OTHER_FUNCTION),
    "two questions, others never pause": Setup(length=2, delays=(0.002, 0.35), traffic=((), BUSY)),
    "two questions, echo": replace(_WITH_ECHO, cancel_after=(None, 0.01)),
    "two questions, echo to be detected": replace(_WITH_ECHO, adapters=(ECHO_TO_DETECT, NO_ECHO_TO_DETECT)),
    "two questions, echo, others ask another unit": replace(_WITH_ECHO, traffic=traffic_of(9)),
    "three writes, echo": replace(_WITH_ECHO, length=3, questions=(WRITE,)),
}
"""For RTU and ASCII."""
WITH_OTHERS = replace(
    EVERYTHING,
    questions=(*EVERYTHING.questions, READ_THIRD_UNIT, WRITE, WRITE_ALL),
    delays=(*EVERYTHING.delays, 0.312),
    cancel_after=(*EVERYTHING.cancel_after, None, 0.01),
    traffic=traffic_of(9),
    adapters=(PLAIN, ECHO, SLOW_ECHO, ECHO_TO_DETECT, NO_ECHO_TO_DETECT),
)
"""For RTU and ASCII, at random: all of it."""
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
