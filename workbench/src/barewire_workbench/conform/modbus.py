"""Conformance of Modbus servers: cases as data, from the vectors of kind `server-conformance`, and their judgement.

    {"comment": "03 with quantity 0", "clause": "MB-APP 6.3", "framings": ["tcp", "rtu", "ascii"],
     "steps": [{"send": [{"pdu": "03 00 00 00 00"}]}], "answers": [["83 03"]]}

    ServerCase    a name, the clause, the steps, and the accepted sequences
    ServerStep    after a pause, some stimuli at once
    Stimulus      a PDU to the unit under test or to another one, or raw bytes
    sequence      one answer for each step, as text: "83 03", with .. for any byte and ... for any rest; "; " separates
                  several responses; or SILENCE, or CLOSED

A runner frames and sends the stimuli of each step and collects the responses until the line is silent; if the server
closed the connection, it opens a new one for the next step. `difference` compares the answers with the sequences.
vectors/kinds/server-conformance.md describes the fields.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from barewire.errors import EncodeError, shown
from barewire.modbus.adu import Adu

SILENCE, CLOSED = "", "closed"


class Stimulus(NamedTuple):
    """A PDU to `unit` (None: the one under test), its frame altered by `change` if given; or raw bytes."""

    pdu: bytes = b""
    unit: int | None = None
    raw: bytes = b""
    change: Callable[[bytes], bytes] | None = None

    def framed(self, frame: Callable[[int, bytes], bytes], unit: int) -> bytes:
        """Return the bytes on the wire. `frame(unit, pdu)` makes a frame; `unit` is the unit under test."""
        if self.raw:
            return self.raw
        adu = frame(unit if self.unit is None else self.unit, self.pdu)
        return adu if self.change is None else self.change(adu)


class ServerStep(NamedTuple):
    """The stimuli that are sent at once, after `after` seconds of silence."""

    stimuli: tuple[Stimulus, ...]
    after: float = 0.0


class ServerCase(NamedTuple):
    """One case: `accepts` are the accepted sequences, each with one answer for each step."""

    name: str
    clause: str
    steps: tuple[ServerStep, ...]
    accepts: tuple[tuple[str, ...], ...]
    id: str = ""


StepAnswer = Sequence[Adu] | None
"""The responses in one step; None if the server closed the connection."""


def difference(case: ServerCase, answers: Sequence[StepAnswer], unit: int) -> str | None:
    """Return None if the answers are accepted, and otherwise the difference as a sentence.

    >>> read = ServerStep((Stimulus(bytes.fromhex("0300000000")),))
    >>> case = ServerCase("03 with quantity 0", "MB-APP 6.3", (read,), (("83 03",),))
    >>> difference(case, [[Adu(1, bytes.fromhex("8303"), 1)]], unit=1)
    >>> difference(case, [[Adu(1, bytes.fromhex("8001"), 1)]], unit=1)
    '03 with quantity 0: 80 01, expected 83 03'
    """
    if accepted_sequence(case, answers) is not None:
        others = {adu.unit for answer in answers for adu in answer or ()} - _addressed(case, unit)
        return f"{case.name}: an answer from unit {min(others)}" if others else None
    received = ", then ".join(answer_text(answer) or "silence" for answer in answers)
    expected = " or ".join(
        dict.fromkeys(", then ".join(answer or "silence" for answer in sequence) for sequence in case.accepts)
    )
    return f"{case.name}: {received}, expected {expected}"


def accepted_sequence(case: ServerCase, answers: Sequence[StepAnswer]) -> tuple[str, ...] | None:
    """Return the accepted sequence that fits the answers; None if there is none."""
    return fitting(case.accepts, [answer_text(answer) for answer in answers])


def fitting(accepts: Iterable[tuple[str, ...]], texts: Sequence[str]) -> tuple[str, ...] | None:
    """Return the first sequence that fits the answers, given as texts; None if there is none.

    >>> fitting([("88 01",), ("08 00 0B .. ..",)], ["08 00 0B 00 07"])
    ('08 00 0B .. ..',)
    """
    for sequence in accepts:
        if len(sequence) == len(texts) and all(map(_fits, sequence, texts)):
            return sequence
    return None


def refusals(case: ServerCase, answers: Sequence[StepAnswer]) -> dict[int, bytes]:
    """Return the steps that were refused by exception 01 (no such function) or 02 (no such address): place -> response.

    01 counts where the case expects a response, 02 only where it accepts a response that is not an exception.
    """
    refused = {}
    for place, (step, answer) in enumerate(zip(case.steps, answers)):
        accepted = [sequence[place] for sequence in case.accepts if sequence[place] not in (SILENCE, CLOSED)]
        pdus = [adu.pdu for adu in answer or ()]
        functions = [stimulus.pdu[0] for stimulus in step.stimuli if stimulus.pdu]
        # Exception 02 is the answer that a case about a wrong address expects; there it is no refusal.
        codes = (1, 2) if any(int(text[:2], 16) < 0x80 for text in accepted) else (1,)
        for code in codes if accepted and pdus else ():
            if pdus == [bytes((function | 0x80, code)) for function in functions]:
                refused[place] = pdus[0]
    return refused


def accepted_apart_from(case: ServerCase, answers: Sequence[StepAnswer], places: Collection[int]) -> bool:
    """Whether the answers are accepted if those of the steps `places` are not compared."""
    texts = [answer_text(answer) for answer in answers]
    return any(
        len(sequence) == len(texts)
        and all(place in places or _fits(sequence[place], text) for place, text in enumerate(texts))
        for sequence in case.accepts
    )


def answer_text(answer: StepAnswer) -> str:
    """Return an answer in the notation of a sequence."""
    return CLOSED if answer is None else "; ".join(adu.pdu.hex(" ").upper() for adu in answer)


def _fits(expected: str, received: str) -> bool:
    bytes_expected, bytes_received = expected.split(), received.split()
    if bytes_expected[-1:] == ["..."]:
        bytes_expected, bytes_received = bytes_expected[:-1], bytes_received[: len(bytes_expected) - 1]
    return len(bytes_expected) == len(bytes_received) and all(
        byte == pattern or pattern.rstrip(";") == ".." for pattern, byte in zip(bytes_expected, bytes_received)
    )


def _addressed(case: ServerCase, unit: int) -> set[int]:
    stimuli = [stimulus for step in case.steps for stimulus in step.stimuli if stimulus.pdu]
    return {unit if stimulus.unit is None else stimulus.unit for stimulus in stimuli}


# Cases of the vectors -----------------------------------------------------------------------------------------------


CHANGES: dict[str, Callable[[bytes], bytes]] = {
    "first-four": lambda frame: frame[:4],
    "wrong-crc": lambda frame: frame[:-1] + bytes((frame[-1] ^ 0x10,)),
    "wrong-lrc": lambda frame: frame[:-3] + (b"0" if frame[-3:-2] != b"0" else b"1") + frame[-2:],
    "lower-case": lambda frame: frame.lower(),
    "no-colon": lambda frame: frame[1:],
    "no-cr": lambda frame: frame[:-2] + b"\n",
    "not-a-digit": lambda frame: frame[:4] + b"G" + frame[5:],
    "digit-less": lambda frame: frame[:4] + frame[5:],
    "begun-twice": lambda frame: frame[:9] + frame,
    "semicolon": lambda frame: frame[:-1] + b";",
}
"""By name: what is done to a good frame before it is sent."""


def read_case(fields: Mapping[str, Any]) -> ServerCase:
    """Return the case that these fields describe. Raises EncodeError for an unknown change."""
    return ServerCase(
        fields["comment"],
        fields.get("clause", ""),
        tuple(read_step(step) for step in fields["steps"]),
        tuple(map(tuple, fields.get("answers", ()))),
        fields.get("id", ""),
    )


def read_step(fields: Mapping[str, Any]) -> ServerStep:
    """Return one step: `send` at once, after `after` microseconds of silence."""
    return ServerStep(tuple(map(_stimulus, fields["send"])), fields.get("after", 0) / 1e6)


def _stimulus(fields: Mapping[str, Any]) -> Stimulus:
    name = fields.get("change")
    if name is not None and name not in CHANGES:
        raise EncodeError(f"change {shown(name)}: expected one of {', '.join(CHANGES)}", "change")
    return Stimulus(
        bytes.fromhex(fields.get("pdu", "")),
        fields.get("unit"),
        bytes.fromhex(fields.get("raw", "")),
        None if name is None else CHANGES[name],
    )
