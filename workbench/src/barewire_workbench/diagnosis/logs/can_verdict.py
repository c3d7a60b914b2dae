"""What is counted on a CAN bus, and the verdicts that the numbers show.

What was counted, and the verdict:

        error frames, and not one good frame            bit-rate; not-acknowledged if nothing but that is reported
        requests to all nodes, and no node was heard    no-answers
        requests to one node, and others answer         dead-unit; also a heartbeat that does not come back
        two answers to one request, again and again     two-units
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection

from barewire.canopen.cob_ids import classify
from barewire.canopen.frame import CanFrame, ErrorFrame, FdFrame
from barewire_workbench.diagnosis.logs.verdict import LineVerdict
from barewire_workbench.frames.result import counted

_NO_ACKNOWLEDGEMENT = 0x20
_FAULTS = 0x01 | 0x08 | 0x20 | 0x40 | 0x80
"""Classes of error frames that report a fault of the bus. Lost arbitration is none, the overrun of a controller is not
of the bus, and its restart is not one either."""
_CONTROLLER = 0x04
ERROR_PASSIVE = 128
"""The error counter from which on a controller is error passive; one frame that cannot be sent adds 8 [ISO 11898-1]."""
PROVES = 3
"""So many times something must happen before it is no accident."""
_TWICE = 0.01
"""Seconds in which the second of two nodes answers the same request."""
_PATIENCE = 1.0
"""Seconds in which a node answers."""
_IDENTITY = frozenset({0x1000, 0x1018})
"""Objects that a search for nodes reads of every node-ID."""


class BusCounts:
    """What was counted on one bus."""

    def __init__(self) -> None:
        self.frames = 0
        self.fd_frames = 0
        self.errors = 0
        self.unacknowledged = 0
        self.counter = 0  # the highest error counter that a controller reported
        self.first: float | None = None
        self.last = 0.0
        self.heard: dict[int, float] = {}  # node -> when it sent its last frame
        self.requests: Counter[int] = Counter()  # by node
        self.second_request = 0.0  # when the second request of the log was sent
        self.asked: Counter[int] = Counter()  # transfers by node
        self.unanswered: Counter[int] = Counter()
        self.streak: Counter[int] = Counter()  # the last transfers by node without an answer, since one with an answer
        self.used: set[int] = set()  # nodes that were asked for more than their identity
        self.silent: dict[int, float] = {}  # node -> since when its heartbeat is missing
        self.twice: Counter[int] = Counter()  # second answers by node
        self.overlaps: list[str] = []  # proofs that two masters use the bus
        self._answers: dict[int, tuple[float, bytes]] = {}  # node -> the last answer since the last request

    def note(self, frame: object, now: float) -> None:
        """Count a frame or error frame."""
        self.first = now if self.first is None else self.first
        self.last = max(self.last, now)
        if isinstance(frame, ErrorFrame):
            self.errors += bool(frame.classes & _FAULTS)
            self.unacknowledged += frame.classes & _FAULTS == _NO_ACKNOWLEDGEMENT
            if frame.classes & _CONTROLLER or frame.counters:  # Linux before 6.0 has no class of its own for them
                self.counter = max(self.counter, *frame.data[6:8], 0)
            return
        self.frames += 1
        self.fd_frames += isinstance(frame, FdFrame)
        owner = classify(frame) if isinstance(frame, CanFrame) and not frame.remote else None
        if owner is not None and owner[0].from_device and owner[1]:
            self.heard[owner[1]] = now

    def second_answer(self, node: int, data: bytes, from_client: bool, now: float) -> bool:
        """Take an SDO frame that begins or ends a transfer. Return whether it is the second answer to one request."""
        if from_client:
            self._answers.pop(node, None)
            return False
        before = self._answers.get(node)
        self._answers[node] = now, data[1:4]
        second = before is not None and before[1] == data[1:4] and now - before[0] <= _TWICE
        self.twice[node] += second
        return second

    def request(self, node: int, now: float) -> None:
        """Count a request that begins a transfer."""
        self.requests[node] += 1
        if self.requests.total() == 2:
            self.second_request = now

    def transfer(self, node: int, index: int | None, *, answered: bool) -> None:
        """Count an SDO transfer that is over."""
        self.asked[node] += 1
        self.unanswered[node] += not answered
        self.streak[node] = 0 if answered else self.streak[node] + 1
        if index not in _IDENTITY:
            self.used.add(node)

    def answered_late(self, node: int) -> None:
        """Correct the count of a transfer whose answer came later."""
        if self.unanswered[node]:
            self.unanswered[node] -= 1
        self.streak[node] = 0

    def may_be_search(self, node: int) -> bool:
        """Return whether a search for nodes asked this one: it was never heard, and asked for its identity only."""
        return node not in self.heard and node not in self.used

    def is_search(self, node: int) -> bool:
        """Return whether a search for nodes asked this one: others, too, were asked for their identity in vain."""
        return self.may_be_search(node) and sum(map(self.may_be_search, self.asked)) >= PROVES

    # Verdicts

    def verdicts(self) -> list[LineVerdict]:
        """Return the verdicts that the numbers show, those that explain most first."""
        if not self.frames:
            return [self._no_frames()] if self.errors >= PROVES or self.counter >= ERROR_PASSIVE else []
        found = [*self._silence(), *self._two_masters(), *self._two_nodes()]
        if self.errors >= PROVES:
            found.append(self._disturbed())
        return found

    def _seconds(self) -> str:
        return f"in {self.last - (self.first or 0.0):.3f} s"

    def _no_frames(self) -> LineVerdict:
        evidence = f"{counted(self.errors, 'error frame')} and not one good frame {self._seconds()}"
        if self.counter:
            evidence += f"; an error counter of the controller is {self.counter}"
        if self.unacknowledged == self.errors:
            other = "that the other nodes have another bit rate or are off, or that the cable is interrupted"
            return LineVerdict("not-acknowledged", "no other node acknowledges the frames", evidence, other)
        other = "exchanged wires CAN_H and CAN_L, or a bus without its termination of 120 ohm at both ends"
        return LineVerdict("bit-rate", "the bit rate is not that of the bus", evidence, other)

    def _silence(self) -> list[LineVerdict]:
        silent = [node for node, number in self.unanswered.items() if number and number == self.asked[node]]
        dead = [node for node in silent if not self.is_search(node)]
        requests = self.requests.total()
        if not self.heard and requests >= 2 and self.last - self.second_request >= _PATIENCE:
            evidence = f"{counted(requests, 'request')} to {_nodes(self.requests)}, and not one frame of any node"
            other = "nodes that are off or have other node-IDs, or another bit rate than the master"
            return [LineVerdict("no-answers", "no node answers", evidence, other)]
        found = []
        for node in dead:
            if self.asked[node] >= 2:
                others = sum(count - self.unanswered[other] for other, count in self.asked.items())
                seen = f"it was last heard at {self.heard[node]:.6f}" if node in self.heard else "it never sent a frame"
                evidence = f"0 of {counted(self.asked[node], 'request')} answered, {seen}; others answered {others}"
                found.append(_dead(node, "does not answer", evidence))
        for node, number in self.streak.items():
            if node not in dead and number >= PROVES and node not in self.silent:
                evidence = f"the last {number} of {counted(self.asked[node], 'request')} have no answer"
                found.append(_dead(node, "fell silent", evidence))
        for node, since in self.silent.items():
            if node not in dead and self.heard.get(node, 0.0) <= since < self.last:
                evidence = f"its heartbeat is missing from {since:.6f} to the end at {self.last:.6f}"
                found.append(_dead(node, "fell silent", evidence))
        return found

    def _two_masters(self) -> list[LineVerdict]:
        if not self.overlaps:
            return []
        evidence = f"{counted(len(self.overlaps), 'time')}, the first: {self.overlaps[0]}"
        return [
            LineVerdict("two-masters", "two masters use one SDO channel", evidence, "one master that does not wait")
        ]

    def _two_nodes(self) -> list[LineVerdict]:
        found = []
        for node, number in self.twice.items():
            if number >= PROVES and 2 * number >= self.asked[node]:
                evidence = (
                    f"{number} of {counted(self.asked[node], 'request')} answered twice within {1e3 * _TWICE:.0f} ms"
                )
                other = "a gateway or recorder that repeats frames"
                found.append(LineVerdict("two-units", f"two nodes have the node-ID {node}", evidence, other))
        return found

    def _disturbed(self) -> LineVerdict:
        evidence = f"{counted(self.errors, 'error frame')} among {counted(self.frames, 'good frame')} {self._seconds()}"
        other = "a node with another bit rate, a missing termination, a bad contact, or a cable that is too long"
        return LineVerdict("disturbed", "frames are damaged on the bus", evidence, other)


def _dead(node: int, what: str, evidence: str) -> LineVerdict:
    return LineVerdict("dead-unit", f"node {node} {what}", evidence, "another node-ID, or a broken stub to this node")


def _nodes(nodes: Collection[int]) -> str:
    listed = [str(node) for node in sorted(nodes)]
    shown = ", ".join(listed[:8]) + (" ..." if len(listed) > 8 else "")
    return f"node{'s' if len(listed) > 1 else ''} {shown}"
