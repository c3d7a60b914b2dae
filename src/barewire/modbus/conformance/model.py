"""What a server must do, held against what it does: the words of a battery of cases (`conform_cases`).

    Case    a name, the clause, what is said turn by turn, and the ways in which it may go
    Turn    after a pause, some frames at once: PDUs to the unit under test or to another one, or raw bytes
    way     for each turn one answer as text: "83 03", with .. for a byte that may be anything, "; " between several
            answers, SILENCE, or CLOSED

Whoever runs a case puts the PDUs into the envelope, says them, and collects what comes back before it is silent; where
the peer hung up it opens the next connection for the next turn. `difference` compares.

I know: what is said and what may be answered.  I never know: envelopes, ports, clocks.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from barewire.modbus.adu import Adu

SILENCE, CLOSED = "", "closed"


class Stimulus(NamedTuple):
    """One frame: a PDU to a unit (None: the one under test), changed by `how` where it is not to be a good one; or raw
    bytes that are no frame."""

    pdu: bytes = b""
    unit: int | None = None
    raw: bytes = b""
    how: Callable[[bytes], bytes] | None = None

    def framed(self, frame: Callable[[int, bytes], bytes], unit: int) -> bytes:
        """The bytes on the wire: `frame` puts a PDU into the envelope, `unit` is the one under test."""
        if self.raw:
            return self.raw
        whole = frame(unit if self.unit is None else self.unit, self.pdu)
        return whole if self.how is None else self.how(whole)


class Step(NamedTuple):
    """What is said at once, after so many seconds of silence."""

    stimuli: tuple[Stimulus, ...]
    after: float = 0.0


class ServerCase(NamedTuple):
    """One case: `ways` are the accepted ones, each with an answer for each turn."""

    name: str
    clause: str
    steps: tuple[Step, ...]
    ways: tuple[tuple[str, ...], ...]


StepAnswer = Sequence[Adu] | None
"""What came back in one turn; None if the peer hung up."""


def difference(case: ServerCase, heard: Sequence[StepAnswer], unit: int) -> str | None:
    """None if the peer did as the standard says, the difference as a sentence otherwise.

    >>> from barewire.modbus.conformance.cases import CASES_TCP
    >>> case = CASES_TCP[0]
    >>> difference(case, [[Adu(1, bytes.fromhex("8303"), 1)]], unit=1)
    >>> difference(case, [[Adu(1, bytes.fromhex("8001"), 1)]], unit=1)
    '03 with quantity 0: 80 01, expected 83 03'
    """
    told = [answer_text(one) for one in heard]
    if accepted_way(case, heard) is not None:
        strangers = {adu.unit for answers in heard for adu in answers or ()} - _asked(case, unit)
        return f"{case.name}: an answer from unit {min(strangers)}" if strangers else None
    expected = " or ".join(dict.fromkeys(", then ".join(one or "silence" for one in way) for way in case.ways))
    return f"{case.name}: {', then '.join(one or 'silence' for one in told)}, expected {expected}"


def accepted_way(case: ServerCase, heard: Sequence[StepAnswer]) -> tuple[str, ...] | None:
    """The way that it went, of those that are accepted."""
    told = [answer_text(one) for one in heard]
    return next((way for way in case.ways if len(way) == len(told) and all(map(_fits, way, told))), None)


def answer_text(heard: StepAnswer) -> str:
    """What was heard in the words of a way."""
    return CLOSED if heard is None else "; ".join(adu.pdu.hex(" ").upper() for adu in heard)


def _fits(expected: str, told: str) -> bool:
    wanted, found = expected.split(), told.split()
    if wanted[-1:] == ["..."]:
        wanted, found = wanted[:-1], found[: len(wanted) - 1]
    return len(wanted) == len(found) and all(
        one == other or one.rstrip(";") == ".." for one, other in zip(wanted, found)
    )


def _asked(case: ServerCase, unit: int) -> set[int]:
    says = [say for step in case.steps for say in step.stimuli]
    return {unit if say.unit is None else say.unit for say in says if say.pdu}
