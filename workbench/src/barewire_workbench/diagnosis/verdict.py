"""The results of diagnosing a log: findings with their place and time, and verdicts on the line or bus.

        LogFinding     one place of the log: time, line, unit or node, and a `Finding` with its proof
        LineVerdict    the whole log: what is wrong with the line, the numbers that show it, what else it may be

A verdict is given if the numbers show it, and several are given if several are shown. Where there are findings and no
cause that explains them is shown, the verdict says so.
"""

from __future__ import annotations

from collections import Counter
from typing import Literal, NamedTuple

from barewire_workbench.frames.findings import Finding

VerdictCode = Literal[
    "nothing-wrong",
    "nothing-proved",
    "nothing-heard",
    "no-bytes",
    "said",
    "refused",
    "open",
    "not-seen",
    "dead-unit",
    "no-answers",
    "lost-answers",
    "late-answers",
    "two-units",
    "disturbed",
    "malformed",
    # a serial line
    "no-bias",
    "echo",
    "parity",
    "baud-rate",
    "inverted",
    "wrong-protocol",
    "turnaround",
    "no-frames",
    # a CAN bus
    "bit-rate",
    "not-acknowledged",
    "two-masters",
]

VERDICTS: dict[VerdictCode, str] = {
    "nothing-wrong": "Every byte is in a frame, every request has its response, and no device refused anything.",
    "nothing-proved": "There are findings, and the numbers show no common cause.",
    "nothing-heard": "There is no frame in the log, and nothing was received on the line.",
    "no-bytes": "The text has no bytes that are read; the verdict says what its words state, and how to log the bytes.",
    "said": "Words beside the bytes state something that the bytes do not show.",
    "refused": "A device refused a request or reported an error: no fault of the line or bus.",
    "open": "A request or a response stands alone in the log: whether there was another is not seen.",
    "not-seen": "A part of the traffic is not in the recording or was not read, so that it is not judged.",
    "dead-unit": "A unit or node does not answer, or fell silent, while others go on.",
    "no-answers": "No unit or node answers.",
    "lost-answers": "Responses are missing now and then.",
    "late-answers": "Responses come behind the next request: the client waits shorter than they take.",
    "two-units": "Two devices have the same address or node-ID.",
    "disturbed": "Frames are damaged on the way, and no single unit is the cause.",
    "malformed": "A device builds its frames wrongly.",
    "no-bias": "Noise comes before frames when the line changes its direction: bias resistors are missing.",
    "echo": "The transceiver receives what it sends.",
    "parity": "The reader has another character format than the sender.",
    "baud-rate": "The reader has another baud rate than the sender.",
    "inverted": "The two wires are exchanged.",
    "wrong-protocol": "The devices speak another framing than the one that is read.",
    "turnaround": "The direction of the line changes too late, or the next frame comes too early.",
    "no-frames": "There are bytes on the line or error frames on the bus, and no frame.",
    "bit-rate": "There are error frames and no good frame: the bit rate is wrong.",
    "not-acknowledged": "No other node acknowledges: the sender is alone on the bus.",
    "two-masters": "Two masters use the bus at the same time.",
}
"""What each verdict says, in a sentence. This is the closed list."""


UNDECIDED: frozenset[VerdictCode] = frozenset(
    {"nothing-proved", "nothing-heard", "no-bytes", "no-frames", "open", "not-seen"}
)
"""Verdicts that name no cause; their sentence begins with that."""
_KINDS_MAX, _KINDS_SHOWN = 1000, 5
"""The most pairs of a code and a place that are counted, and that a verdict names."""


class Unsettled:
    """What is no fault of a line or bus, and still not all good: what devices refused or reported, what is open, and
    what was not seen.

    >>> unsettled = Unsettled()
    >>> unsettled.refused["exception 02 of unit 5"] += 2
    >>> [verdict.sentence for verdict in unsettled.verdicts("9 frames")]
    ['verdict: a device refused or reported something [refused]: 2 exception 02 of unit 5; 9 frames']
    """

    def __init__(self) -> None:
        self.refused: Counter[str] = Counter()
        self.open: Counter[str] = Counter()
        self.unseen: list[str] = []
        self.one_side = ""  # what a log shows that has nothing of the other side

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.refused.total()} refused, {self.open.total()} open>"

    def __str__(self) -> str:
        return "; ".join(
            text for text in (_most(self.refused), _most(self.open), self.one_side, ", ".join(self.unseen)) if text
        )

    def verdicts(self, seen: str) -> list[LineVerdict]:
        """Return at most one verdict on each; `seen` is what was counted."""
        kinds: tuple[tuple[VerdictCode, str, str], ...] = (
            ("refused", "a device refused or reported something", _most(self.refused)),
            ("open", "not every request and response has its other half", _most(self.open)),
            ("open", "this log shows one side only", self.one_side),
            ("not-seen", "a part of the traffic was not seen, or is not judged", ", ".join(self.unseen)),
        )
        return [LineVerdict(code, text, f"{evidence}; {seen}") for code, text, evidence in kinds if evidence]


def _most(kinds: Counter[str]) -> str:
    shown = ", ".join(f"{number} {kind}" for kind, number in kinds.most_common(_KINDS_SHOWN))
    return f"{shown}, ..." if len(kinds) > _KINDS_SHOWN else shown


class LogFinding(NamedTuple):
    """A finding at its place in a log. `line` is 0 on a live line; `place` is the unit or the node, empty for the line
    or bus itself."""

    at: float
    line: int
    place: str
    finding: Finding
    timed: bool = True

    @property
    def sentence(self) -> str:
        """The finding in one line.

        >>> LogFinding(1.5, 7, "unit 3", Finding("role", "this is a request", "...")).sentence
        '1.500000  line 7  unit 3  this is a request [role]: ...'
        """
        columns = (f"{self.at:.6f}" if self.timed else "", f"line {self.line}" if self.line else "", self.place)
        finding = self.finding
        return "  ".join((*filter(None, columns), f"{finding.text} [{finding.code}]: {finding.proof}"))

    def as_dict(self) -> dict[str, object]:
        """Return the finding for `json.dumps`; the time is None if the log has none."""
        at = self.at if self.timed else None
        return {"event": "finding", "at": at, "line": self.line or None, "place": self.place, **self.finding._asdict()}


class FindingCounts:
    """The findings of one line or bus, counted by code and place. A verdict names the most frequent ones.

    >>> counts = FindingCounts()
    >>> counts.add("state", "node 5"), counts.add("state", "node 5"), str(counts)
    (None, None, '2 state of node 5')
    """

    def __init__(self) -> None:
        self.total = 0
        self._kinds: Counter[str] = Counter()

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.total}>"

    def __str__(self) -> str:
        return _most(self._kinds)

    def add(self, code: str, place: str) -> None:
        """Count a finding."""
        self.total += 1
        kind = f"{code} of {place}"
        if len(self._kinds) < _KINDS_MAX or kind in self._kinds:
            self._kinds[kind] += 1


class LineVerdict(NamedTuple):
    """What is wrong with the line or bus as a whole: a sentence, its evidence in numbers, and what else it may be."""

    code: VerdictCode
    text: str
    evidence: str
    otherwise: str = ""

    @property
    def sentence(self) -> str:
        """The verdict in one line.

        >>> LineVerdict("dead-unit", "unit 3 does not answer", "0 of 5 requests answered", "another address").sentence
        'verdict: unit 3 does not answer [dead-unit]: 0 of 5 requests answered; it may also be another address'
        """
        also = f"; it may also be {self.otherwise}" if self.otherwise else ""
        undecided = "undecided: " if self.code in UNDECIDED else ""
        return f"verdict: {undecided}{self.text} [{self.code}]: {self.evidence}{also}"

    def as_dict(self) -> dict[str, object]:
        """Return the verdict for `json.dumps`."""
        return {"event": "verdict", **self._asdict()}


def verdicts_without_cause(found: FindingCounts, unsettled: Unsettled, seen: str) -> list[LineVerdict]:
    """Return the verdicts on a line or bus whose numbers show no fault; `seen` is what was counted.

    Findings come first, then what devices refused and what is open, and only without both nothing is wrong.
    """
    if found.total:
        evidence = "; ".join(filter(None, (str(found), seen, str(unsettled))))
        return [LineVerdict("nothing-proved", "the findings show no common cause", evidence)]
    return unsettled.verdicts(seen) or [LineVerdict("nothing-wrong", "nothing wrong", seen)]
