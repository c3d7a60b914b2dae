"""Diagnosis of a CAN bus, recorded or live: findings on the events of the monitor, and verdicts.

        frame --> CanMonitor --> transfers, states, broken rules --+
              --> diagnose_can: the frame alone -------------------+--> findings
              --> BusCounts: answers, silences, error frames ------+--> verdicts, at the end

What a gap in the recording explains as well is no finding: the monitor reports it as a `Gap`. Reserved bits that a
device accepts are none either, since a receiver ignores them; a read request with such bits that is refused is one.

What was counted, and the verdict:

        error frames, and not one good frame            bit-rate; not-acknowledged if nothing but that is reported
        requests to all nodes, and no node was heard    no-answers
        requests to one node, and others answer         dead-unit; also a heartbeat that does not come back
        two answers to one request, again and again     two-units
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import NamedTuple

from barewire.canopen.abort_codes import AbortCode, abort_text
from barewire.canopen.cob_ids import classify
from barewire.canopen.frame import AnyFrame, CanFrame, ErrorFrame, FdFrame
from barewire.canopen.lss.messages import ANSWER_KEY, LssRefused, LssService
from barewire.canopen.nmt.messages import NmtState
from barewire.canopen.sdo.messages import InitiateUpload
from barewire_workbench.diagnosis.can import diagnose_can
from barewire_workbench.diagnosis.iso_tp import IsoTp
from barewire_workbench.diagnosis.verdict import (
    FindingCounts,
    LineVerdict,
    LogFinding,
    Unsettled,
    verdicts_without_cause,
)
from barewire_workbench.frames.findings import DiagnosisCode, Finding
from barewire_workbench.frames.result import counted
from barewire_workbench.monitor import BUS_RULES, CanMonitor, KnownNode
from barewire_workbench.monitor.events import (
    EmcyReport,
    Gap,
    Loss,
    MonitorEvent,
    NodeReport,
    SdoTransferReport,
    Violation,
    object_name,
    state_name,
)
from barewire_workbench.monitor.nodes import ObservedNode
from barewire_workbench.monitor.recording import BUSES_MAX
from barewire_workbench.recordings.model import LEFT_OUT, Dropped, RecordedItem, Unread

_NO_ACKNOWLEDGEMENT = 0x20
_FAULTS = 0x01 | 0x08 | 0x10 | _NO_ACKNOWLEDGEMENT | 0x40 | 0x80
"""Classes of error frames that report a fault of the bus: send time-out, protocol violation, transceiver, no
acknowledgement, bus off, bus error. Lost arbitration is none, and an overrun or restart is of the controller alone."""
_BIT_ERRORS = 0x01 | 0x08 | 0x10
"""Kinds of a violation of the protocol, in the third byte, that only the sender of a frame sees: it reads another bit
than it sends."""
_PROTOCOL, _ACKNOWLEDGE_BITS = 0x08, (b"\x19", b"\x1b")
"""A violation of the protocol has its place in the fourth byte: here the slot of the acknowledgement, or its end."""
_LSS_CONFIGURES = (b"\x11", b"\x13", b"\x17")
"""Services of LSS whose answer has an error."""
_LSS = (ANSWER_KEY[0], ANSWER_KEY[0] + 1)
_CONTROLLER = 0x04
ERROR_PASSIVE = 128
"""The error counter from which on a controller is error passive; one frame that cannot be sent adds 8 [ISO 11898-1]."""
PROVES = 3
"""So many times something must happen before it is no accident."""
_TWICE = 0.01
"""Seconds in which the second of two nodes answers the same request."""
_PATIENCE = 1.0
"""Seconds in which a node answers."""
_BLOCK_CONFIRMED, _NO_SIZE = b"\xa2", 0x42
_NOT_STARTED = (NmtState.INITIALISING, NmtState.PRE_OPERATIONAL)
_RESETS = (b"\x81", b"\x82")
"""Commands of NMT after which a node sends its boot-up."""
_STATUS_MASK, _SWITCH_ON_DISABLED = 0x024F, 0x0240
"""Bits of the status word of CiA 402, with that of remote control."""
_IDENTITY = frozenset({0x1000, 0x1018})
"""Objects that a search for nodes reads of every node-ID."""


class BusCounts:
    """What was counted on one bus."""

    def __init__(self) -> None:
        self.frames = 0
        self.received = 0  # frames that the recorder did not send itself
        self.fd_frames = 0
        self.extended = 0
        self.errors = 0
        self.error_frames = 0  # with those that report no fault of the bus
        self.last_error = ""
        self.sides: set[str] = set()  # of SDO: requests, answers
        self.unacknowledged = 0
        self.unsent = 0  # of frames in which the controller read another bit than it sent
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

    def note(self, frame: object, now: float, sent: bool | None = None) -> None:
        """Count a frame or error frame; `sent`: by the recorder."""
        self.first = now if self.first is None else self.first
        self.last = max(self.last, now)
        if isinstance(frame, ErrorFrame):
            self.error_frames, self.last_error = self.error_frames + 1, _error_text(frame)
            self.errors += bool(frame.classes & _FAULTS)
            in_acknowledgement = frame.classes & _PROTOCOL and frame.data[3:4] in _ACKNOWLEDGE_BITS
            self.unacknowledged += frame.classes & _FAULTS == _NO_ACKNOWLEDGEMENT or bool(in_acknowledgement)
            self.unsent += bool(frame.classes & _PROTOCOL and len(frame.data) > 2 and frame.data[2] & _BIT_ERRORS)
            # The counters are valid in their own class; Linux before 6.0 has none, and gives them with this one.
            if frame.classes & _CONTROLLER or frame.counters:
                self.counter = max(self.counter, *frame.data[6:8], 0)
            return
        self.frames += 1
        self.received += sent is not True
        self.fd_frames += isinstance(frame, FdFrame)
        self.extended += isinstance(frame, CanFrame | FdFrame) and frame.extended
        owner = classify(frame) if isinstance(frame, CanFrame) and not frame.remote else None
        if owner is not None and owner[0].from_device and owner[1]:
            self.heard[owner[1]] = now
        if owner is not None and owner[0].name.startswith("SDO"):
            self.sides.add(owner[0].name)

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
        if not self.received and (self.errors or not self.frames):
            is_many = self.errors >= PROVES or (self.errors and self.counter >= ERROR_PASSIVE)
            return [self._no_frames()] if is_many else []
        verdicts = [*self._silence(), *self._two_masters(), *self._two_nodes()]
        if self.errors >= PROVES:
            verdicts.append(self._disturbed())
        return verdicts

    def _seconds(self) -> str:
        return f"in {self.last - (self.first or 0.0):.3f} s"

    def _no_frames(self) -> LineVerdict:
        evidence = f"{counted(self.errors, 'error frame')} and no other frame read {self._seconds()}"
        if self.frames:
            evidence = f"{counted(self.errors, 'error frame')}, and only own frames {self._seconds()}: {self.frames}"
        if self.counter:
            evidence += f"; an error counter of the controller is {self.counter}"
        if self.unacknowledged == self.errors:
            other = "that the other nodes have another bit rate or are off, or that the cable is interrupted"
            return LineVerdict("not-acknowledged", "no other node acknowledges the frames", evidence, other)
        if self.unsent == self.errors:
            text = "the controller reads other bits than it sends, so that its own frames fail"
            other = "a transceiver without supply, an exchanged wire, no termination, or another bit rate"
            return LineVerdict("no-frames", text, f"{evidence}; the last: {self.last_error}", other)
        other = "exchanged wires CAN_H and CAN_L, or a bus without its termination of 120 ohm at both ends"
        return LineVerdict(
            "bit-rate", "only error frames are received, as with another bit rate than that of the bus", evidence, other
        )

    def _silence(self) -> list[LineVerdict]:
        silent = [node for node, number in self.unanswered.items() if number and number == self.asked[node]]
        dead = [node for node in silent if not self.is_search(node)]
        requests = self.requests.total()
        if not self.heard and requests >= 2 and self.last - self.second_request >= _PATIENCE:
            evidence = f"{counted(requests, 'request')} to {_nodes(self.requests)}, and not one frame of any node"
            other = "nodes that are off or have other node-IDs, or another bit rate than the master"
            return [LineVerdict("no-answers", "no node answers", evidence, other)]
        verdicts = []
        for node in dead:
            if self.asked[node] >= 2:  # one request may have been lost
                others = sum(count - self.unanswered[other] for other, count in self.asked.items())
                seen = f"it was last heard at {self.heard[node]:.6f}" if node in self.heard else "it never sent a frame"
                evidence = f"0 of {counted(self.asked[node], 'request')} answered, {seen}; others answered {others}"
                verdicts.append(_dead(node, "does not answer", evidence))
        for node, streak in self.streak.items():
            if node not in dead and streak >= PROVES and node not in self.silent:
                evidence = f"the last {streak} of {counted(self.asked[node], 'request')} have no answer"
                verdicts.append(_dead(node, "fell silent", evidence))
        for node, since in self.silent.items():
            if node not in dead and self.heard.get(node, 0.0) <= since < self.last:
                evidence = f"its heartbeat is missing from {since:.6f} to the end at {self.last:.6f}"
                verdicts.append(_dead(node, "fell silent", evidence))
        return verdicts

    def _two_masters(self) -> list[LineVerdict]:
        if not self.overlaps:
            return []
        evidence = f"{counted(len(self.overlaps), 'time')}, the first: {self.overlaps[0]}"
        return [
            LineVerdict("two-masters", "two masters use one SDO channel", evidence, "one master that does not wait")
        ]

    def _two_nodes(self) -> list[LineVerdict]:
        verdicts = []
        for node, twice in self.twice.items():
            # Two nodes answer every request twice, unless one of them is slower; some alone may be a repeated frame.
            if twice >= PROVES and 2 * twice >= self.asked[node]:
                requests = counted(self.asked[node], "request")
                evidence = f"{twice} of {requests} answered twice within {1e3 * _TWICE:.0f} ms"
                other = "a gateway or recorder that repeats frames"
                verdicts.append(LineVerdict("two-units", f"two nodes have the node-ID {node}", evidence, other))
        return verdicts

    def _disturbed(self) -> LineVerdict:
        evidence = f"{counted(self.errors, 'error frame')} among {counted(self.frames, 'good frame')} {self._seconds()}"
        other = "a node with another bit rate, a missing termination, a bad contact, or a cable that is too long"
        return LineVerdict("disturbed", "frames are damaged on the bus", evidence, other)


_STATES = (
    "receive overflow", "transmit overflow", "receive warning", "transmit warning", "receive passive",
    "transmit passive", "active again",
)  # fmt: skip
"""Bits of the second byte of an error frame of SocketCAN of the class of the controller."""


_KINDS = (
    "one bit", "form", "stuff bits", "a dominant bit read as recessive", "a recessive bit read as dominant", "overload",
)  # fmt: skip
"""Bits of the third byte of one of the class of the protocol."""


def _error_text(frame: ErrorFrame) -> str:
    state = frame.data[1] if frame.classes & _CONTROLLER and len(frame.data) > 1 else 0
    kind = frame.data[2] if frame.classes & _PROTOCOL and len(frame.data) > 2 else 0
    words = [
        name for bits, names in ((state, _STATES), (kind, _KINDS)) for bit, name in enumerate(names) if bits >> bit & 1
    ]
    return f"{frame.text} ({', '.join(words)})" if words else frame.text


def _dead(node: int, what: str, evidence: str) -> LineVerdict:
    return LineVerdict("dead-unit", f"node {node} {what}", evidence, "another node-ID, or a broken stub to this node")


def _nodes(nodes: Collection[int]) -> str:
    listed = [str(node) for node in sorted(nodes)]
    shown = ", ".join(listed[:8]) + (" ..." if len(listed) > 8 else "")
    return f"node{'s' if len(listed) > 1 else ''} {shown}"


CODE_OF_RULE: dict[str, DiagnosisCode] = {
    "SDO-TOGGLE": "sdo-toggle",
    "SDO-SIZE": "sdo-size",
    "PDO-TOO-SHORT": "short-pdo",
    "EMCY-REGISTER": "emcy-register",
    "ID-RESERVED": "foreign-cob-id",
    "PDO-NOT-OPERATIONAL": "state",
    "STOPPED-SENDS": "state",
    "SDO-LENGTH": "cut-frame",
}
"""Rule of the monitor -> code of a finding. Other rules are findings with the code `bus-rule`."""
_HARMLESS = frozenset({"SDO-RESERVED", "SDO-ABORT-CODE"})
"""The rules about bits that a receiver ignores, and about codes: makers have codes of their own."""
_FEW, _ALONE = 16, 4
"""Different refusals that are told apart by their objects; frames of PDOs of a log that has no others."""
_WAITS = 0.05
"""Seconds: no client gives up an answer sooner, and sends its next request."""
_PAUSE = 3.0
"""Periods without a heartbeat that are a pause."""
_UNREAD_MAX = 1000
"""The most lines that cannot be read of which the text is kept."""
_WRONG_SIZE = (AbortCode.LENGTH, AbortCode.TOO_LONG, AbortCode.TOO_SHORT)


class InitiatingFrame(NamedTuple):
    """A request that begins a transfer, with its place in the log."""

    at: float
    line: int
    frame: CanFrame


class Proved(NamedTuple):
    """A finding on a node, 0 for the bus; with its own place, if that is not the frame that proves it."""

    node: int
    finding: Finding
    at: float | None = None
    line: int = 0


class HeartbeatWatch:
    """Pauses of heartbeats of which too few came before for the monitor, which learns the period from three intervals.

    705#05   0 s   1 s               6 s   7 s       an interval that is longer than 3 times those beside it
    """

    def __init__(self) -> None:
        self._intervals: dict[int, list[float]] = {}  # node -> the last three

    def pause(self, report: NodeReport) -> float | None:
        """Take the report of a node; return the length of a pause that ended one heartbeat before."""
        if report.kind != "beat" or report.guarded or report.seconds is None:
            self._intervals.pop(report.node, None)  # a state is reported at once, a boot-up when it is over
            return None
        intervals = self._intervals[report.node] = [*self._intervals.get(report.node, [])[-2:], report.seconds]
        if len(intervals) == 3 and intervals[1] > _PAUSE * max(intervals[0], intervals[2]):
            return intervals[1]
        return None

    def silences(self, nodes: Mapping[int, ObservedNode], end: float) -> Iterator[tuple[int, float]]:
        """Yield the nodes whose heartbeat ended before the log, and since when."""
        for node, intervals in self._intervals.items():
            observed = nodes[node]
            if observed.last is None or observed.longest_silence is not None or observed.configured_period is not None:
                continue  # the monitor judges a node whose period is known
            if len(intervals) > 1 and end - observed.last > _PAUSE * max(intervals):
                yield node, observed.last


class BusDiagnosis:
    """One bus. A machine: frames in, findings out; `verdicts` at any time. `known` describes its nodes.

    >>> bus = BusDiagnosis()
    >>> [found.finding.code for found in bus.feed(CanFrame.parse("085#1042080000000000"), 1.5, line=7)]
    ['emcy-register']
    >>> [verdict.code for verdict in bus.verdicts()]
    ['nothing-proved']

    With `complete` no frame is missing: what would be a gap is a broken rule.
    """

    def __init__(self, known: Iterable[KnownNode] = (), bus: str = "", *, complete: bool = False) -> None:
        described = tuple(known)
        self.bus = bus
        self.monitor = CanMonitor(described, complete=complete)
        self.counts = BusCounts()
        self.found = FindingCounts()
        self.unsettled = Unsettled()
        self._not_awaited: Counter[int] = Counter()  # SDO transfers by node of which a part was not seen
        self._heartbeats = HeartbeatWatch()
        self.left_out: list[str] = []
        """What the recording holds beside this bus, in words."""
        self.gaps = 0
        self._silences = 0
        self._dialects = {node.node: node.commands for node in described}
        self._requests: dict[int, list[InitiatingFrame]] = {}  # channel -> its last two initiating requests
        self._toggled: dict[int, Gap] = {}  # node -> a toggle bit that did not alternate, if no segment is missing
        self._searched: dict[int, Proved] = {}  # node -> no answer, perhaps in a search for nodes
        self._errors = 0  # error frames since the last good frame
        self._confirmed: dict[int, tuple[int, int]] = {}  # channel -> segments of a block that arrived, and its size
        self._waiting: set[int] = set()  # nodes whose last request has no answer yet
        self._last_transfer = ""
        self._sizeless = ""  # the first expedited answer without a size
        self._foreign = 0  # frames with an identifier that CANopen does not use
        self._iso_messages = IsoTp()
        self._iso_tp = 0  # frames of another protocol
        self._judged = False  # a frame was heard whose meaning is known
        self._reset = ""  # the nodes that were reset by a command, if none was heard after it
        self._alone: dict[int, str] = {}  # the PDOs of a log with few frames and no others
        self._words: dict[int, tuple[int, int]] = {}  # COB-ID of a PDO -> its node, and the first two bytes of the last

    def __repr__(self) -> str:
        return (
            f"<{type(self).__name__}: {counted(self.counts.frames, 'frame')}, {counted(self.found.total, 'finding')}>"
        )

    def feed(
        self, item: AnyFrame | Dropped | None, now: float, line: int = 0, sent: bool | None = None
    ) -> list[LogFinding]:
        """Take a frame, or None if only time has passed. Return the findings that it proves. `sent`: by us."""
        proofs: list[Proved] = []
        if isinstance(item, ErrorFrame):
            proofs += self._error_frame(item, now)
        elif item is not None and not isinstance(item, Dropped):
            self._errors = 0 if sent is not True else self._errors
            if not self._judged and isinstance(item, CanFrame):
                if item.data and 0x10 <= item.data[0] < 0x33:
                    proofs += [Proved(0, finding) for finding in self._iso_messages.take(item)]
                if _is_iso_tp(item):
                    self._iso_tp += 1
                    item = item._replace(id=0x7FF)  # which no service of CANopen uses
            self.counts.note(item, now, sent)
            if isinstance(item, CanFrame):
                proofs += self._frame(item, now, line)
        frame = item if isinstance(item, CanFrame) else None
        # What is wrong with the frame alone, the monitor reports again as a rule that the same bytes break.
        known_codes: set[DiagnosisCode] = {proved.finding.code for proved in proofs}
        if known_codes:
            known_codes |= {"bus-rule", "cut-frame"}
        if frame is not None and frame.id & 0x7F and not self.counts.heard:
            foreign = [proved for proved in proofs if proved.finding.code == "foreign-cob-id"]
            # On a bus without CANopen an identifier that CANopen does not use is no fault.
            if foreign:
                self._foreign += len(foreign)
            proofs = [proved for proved in proofs if proved not in foreign]
        for event in self.monitor.feed(item, now):
            proofs += [proved for proved in self._event(event, frame) if proved.finding.code not in known_codes]
        return self._at(proofs, now, line)

    def end(self, now: float) -> list[LogFinding]:
        """End the log, and return the last findings."""
        proofs = [proved for event in self.monitor.end(now) for proved in self._event(event, None)]
        for node, since in self._heartbeats.silences(self.monitor.nodes.nodes, now):
            self.counts.silent[node] = since
            state = self.monitor.nodes.nodes[node].state
            proofs.append(_missing_heartbeat(node, state, now - since))
        # Only now it is known how many nodes were asked in vain.
        proofs += [proved for node, proved in self._searched.items() if not self.counts.is_search(node)]
        self._searched.clear()
        for node, number in self._not_awaited.items():
            if len(self.counts.sides) == 1:
                self.unsettled.one_side = f"each {''.join(self.counts.sides)} stands alone"
            elif not self.counts.may_be_search(node):
                self.unsettled.open[f"SDO transfer with node {node} without its other half"] += number
        self._not_awaited.clear()
        if self._iso_tp == self.counts.frames:
            self.unsettled.open.update(self._iso_messages.open())
        if self._reset:
            self.unsettled.open[f"reset of {self._reset}, and none heard after it"] += 1
        return self._at(proofs, now, 0)

    def verdicts(self) -> list[LineVerdict]:
        """Return what the numbers show about the bus; if no fault, what devices refused, and what is open."""
        counts = self.counts
        causes = counts.verdicts()
        answered = sum(counts.asked.values()) - sum(counts.unanswered.values())
        seen = f"{counted(counts.frames, 'frame')} read"
        seen += f", of {counted(len(counts.heard), 'node')}" if counts.heard else ""
        seen += f", {counted(answered, 'SDO transfer')} ended" if answered else ""
        seen += "".join(f"; {fact}" for fact in self._facts())
        if self._silences:
            seen += f"; requests to several nodes have no answer at {counted(self._silences, 'place')}"
        fd, gaps = counted(counts.fd_frames, "frame"), counted(self.gaps, "gap")
        unknown = self._foreign if self._judged else counts.frames - counts.fd_frames
        data = f"the data of {'' if self._judged else 'all '}{counted(unknown, 'frame')}, whose meaning is not known"
        self.unsettled.unseen = [
            *([f"{fd} of CAN FD, not decoded"] if counts.fd_frames else []),
            *([data] if unknown else []),
            *([f"{gaps} in the recording"] if self.gaps else []),
            *self.left_out,
        ]
        if not causes and not counts.frames and not self.found.total:
            errors = f"{counted(counts.error_frames, 'error frame')} read"
            errors += f", the last: {counts.last_error}" if counts.last_error else ""
            errors += f"; an error counter of the controller is {counts.counter}" if counts.counter else ""
            causes.append(LineVerdict("nothing-heard", "no frame of a node is read", errors))
        return causes or verdicts_without_cause(self.found, self.unsettled, seen)

    def _facts(self) -> Iterator[str]:
        """Yield what one asks next about a bus on which nothing is wrong."""
        counts, now = self.counts, self.monitor.now
        if self._sizeless:
            yield f"{self._sizeless} has 4 bytes and does not state how many count (42h), which is allowed"
        if counts.frames and counts.extended == counts.frames:
            yield "all identifiers have 29 bits: no CANopen"
        if self._iso_tp and self._iso_tp == counts.frames:
            yield "all are as frames of ISO-TP (ISO 15765-2): no CANopen"
        yield from (f"{identifier:03X}h is {what} of the predefined set" for identifier, what in self._alone.items())
        searched = [node for node in counts.asked if counts.is_search(node)]
        if searched:
            heard = f"{_nodes(counts.heard)} {'answer' if len(counts.heard) > 1 else 'answers'}"
            yield f"{counted(len(searched), 'node')} more {'are' if len(searched) > 1 else 'is'} asked; {heard}"
        waiting = [node for node in counts.heard if self.monitor.nodes.state(node, now) in _NOT_STARTED]
        if waiting and self._last_transfer:
            yield f"{_nodes(waiting)} not started (NMT); the last SDO is {self._last_transfer}"
        disabled = {  # of each node the first PDO that may have a status word
            node: f"if PDO {identifier:03X}h is a status word, drive {node} is in switch on disabled: {word:04X}h"
            for identifier, (node, word) in reversed(self._words.items())
            if word & _STATUS_MASK == _SWITCH_ON_DISABLED
        }
        yield from disabled.values()

    def _at(self, proofs: Iterable[Proved], now: float, line: int) -> list[LogFinding]:
        findings = []
        for node, finding, at, own_line in proofs:
            place = " ".join(filter(None, (self.bus, f"node {node}" if node else "")))
            self.found.add(finding.code, place or "the bus")
            findings.append(LogFinding(now if at is None else at, own_line or line, place, finding))
        return findings

    # Frames

    def _error_frame(self, frame: ErrorFrame, now: float) -> Iterator[Proved]:
        before, counter = self.counts.errors, self.counts.counter
        self.unsettled.refused["error frame of the controller"] += 1
        self.counts.note(frame, now)
        self._errors += self.counts.errors - before
        if self.counts.unacknowledged == self.counts.errors and not self.counts.received:
            return  # no other node is on the bus, or none with this bit rate: the verdict says both
        is_passive = counter < ERROR_PASSIVE <= self.counts.counter and self._errors < PROVES
        if is_passive or (self._errors == PROVES and self.counts.errors > before):
            good = counted(self.counts.frames, "good frame") if self.counts.frames else "no other frame read"
            text = f"{PROVES} error frames in a row: {frame.text}"
            if is_passive:
                text = f"an error counter of the controller is {self.counts.counter}: {frame.text}"
            yield Proved(0, Finding("bit-rate", text, f"{self.counts.errors} error frames and {good} so far"))

    def _frame(self, frame: CanFrame, now: float, line: int) -> Iterator[Proved]:
        """Findings on the frame alone, unless it is a segment of a block, whose bytes can look like any message."""
        if self.monitor.takes_segment(frame):
            return
        owner = classify(frame)
        is_pdo = owner is not None and "PDO" in owner[0].name
        if owner is not None and not frame.remote and (not is_pdo or self._dialects):
            self._judged = True
        if owner is not None and owner[0].from_device:
            self._reset = ""
        elif frame.id == 0 and frame.data[:1] in _RESETS and len(frame.data) > 1:
            self._reset = f"node {frame.data[1]}" if frame.data[1] else "all nodes"
        if owner is not None and is_pdo and self.counts.frames <= _ALONE:
            self._alone[frame.id] = f"{owner[0].name} of node {owner[1]}"
        elif self._alone:
            self._alone.clear()
        if owner is not None and owner[0].name.startswith("TPDO") and len(frame.data) > 1:
            self._words[frame.id] = owner[1], int.from_bytes(frame.data[:2], "little")
        if owner is not None and owner[0].name == "SDO answer" and frame.data[:1] == _BLOCK_CONFIRMED:
            self._confirmed[owner[1]] = frame.data[1], frame.data[2]
        if owner is not None and owner[0].name.startswith("SDO") and frame.data:
            request = owner[0].name == "SDO request"
            if request and frame.data[0] >> 5 in (1, 2, 5, 6):
                before = self._requests.get(frame.id, [])[-1:]
                if before and before[0].frame == frame and owner[1] in self._waiting:
                    what = f"SDO request to node {owner[1]} repeated before its answer"
                    self.unsettled.open[f"{what}: {frame.data[:4].hex(' ').upper()}"] += 1
                self._requests[frame.id] = [*before, InitiatingFrame(now, line, frame)]
                self.counts.request(owner[1], now)
                self._waiting.add(owner[1])
            elif not request:
                self._waiting.discard(owner[1])
                if frame.data[0] == _NO_SIZE and not self._sizeless:
                    self._sizeless = f"the answer {frame}"
            yield from self._answered_twice(frame, owner[1], request, now)
        if frame.id == ANSWER_KEY[0] and frame.data[:1] in _LSS_CONFIGURES and len(frame.data) == 8 and frame.data[1]:
            refusal = LssRefused(LssService(frame.data[0]), frame.data[1], frame.data[2])
            self.unsettled.refused[f"LSS: {refusal}"] += 1
        for finding in diagnose_can(frame, self.monitor.pdos, self._dialects):
            if finding.code != "sdo-read-command":  # a fault if the server refuses it: `_transfer`
                yield Proved(owner[1] if owner else 0, finding)

    def _answered_twice(self, frame: CanFrame, node: int, request: bool, now: float) -> Iterator[Proved]:
        if len(frame.data) != 8 or not (request or frame.data[0] >> 5 in (2, 3)):
            return
        if self.counts.second_answer(node, frame.data, request, now) and self.counts.twice[node] == PROVES:
            text = f"a request was answered twice, {counted(PROVES, 'time')} so far: two nodes have this node-ID"
            yield Proved(node, Finding("two-units", text, f"the last second answer is {frame}"))

    # Events of the monitor

    def _event(self, event: MonitorEvent, frame: CanFrame | None) -> Iterator[Proved]:
        match event:
            case Violation() if event.rule not in _HARMLESS and not event.repeated:
                yield Proved(event.node, self._violation(event))
            case Gap():
                if not event.rule:
                    # Transfers that are silent together may be a search for nodes; heartbeats and SYNC do not stop.
                    is_seen = event.since is None or "heartbeat" in event.evidence or "SYNC" in event.evidence
                    self.gaps += is_seen
                    self._silences += not is_seen
                if event.rule == "SDO-TOGGLE":
                    self._toggled[event.node] = event
            case Loss():
                yield Proved(event.node, self._loss(event, frame))
            case SdoTransferReport():
                yield from self._transfer(event)
            case NodeReport():
                yield from self._node(event)
            case EmcyReport() if event.code:
                self.unsettled.refused[f"emergency {event.code:04X}h of node {event.node}"] += 1

    def _violation(self, event: Violation) -> Finding:
        if event.rule == "SDO-OVERLAP" and (proof := self._two_masters(event)):
            self.counts.overlaps.append(proof)
            return Finding("two-masters", "two SDO transfers at once on one channel", proof)
        rule = BUS_RULES[event.rule]
        proof = f"{event.frame}; {rule.text} [{rule.clause}]"
        return Finding(CODE_OF_RULE.get(event.rule, "bus-rule"), event.text, proof)

    def _two_masters(self, event: Violation) -> str:
        """Return the proof that two clients use the channel: a client alone waits for its answer before it goes on."""
        requests = self._requests.get(0x600 + event.node, [])
        if len(requests) < 2:
            return ""
        first, second = requests
        if second.at - first.at > _WAITS:
            return ""
        return f"{first.frame} and {1e3 * (second.at - first.at):.1f} ms later {second.frame}; {event.text}"

    def _loss(self, event: Loss, frame: CanFrame | None) -> Finding:
        proof = str(frame) if frame is not None else "both sides show it"
        # A segment, download or upload, has a toggle bit; the segments of a block have a number in its place.
        if frame is not None and _is_segment(frame) and not self.monitor.takes_segment(frame):
            text = f"the client repeated the segment with toggle bit {frame.data[0] >> 4 & 1}"
            return Finding("sdo-toggle", text, f"{proof}: {event.evidence}")
        return Finding("lost-frame", event.evidence, proof)

    def _transfer(self, event: SdoTransferReport) -> Iterator[Proved]:
        node, place = event.node, object_name(event.index, event.sub)
        self._last_transfer = f"{place} of node {node}"
        toggled = self._toggled.pop(node, None)
        if toggled is not None and event.outcome == "done" and event.size is not None and event.size == event.count:
            proof = f"all {event.size} bytes of {place} are in the recording, so no segment is missing"
            yield Proved(node, Finding("sdo-toggle", "the client repeated a toggle bit, and the server went on", proof))
        gave_up = event.abort == AbortCode.TIMED_OUT and event.by == "client"
        if event.late:
            self.counts.answered_late(node)
            text = f"the answer about {place} is late"
            yield Proved(node, Finding("late-answer", text, "its request was given up before"))
        elif event.outcome == "unanswered":
            yield from self._unanswered(event, place)
        elif event.outcome != "cut" and event.began is not None:
            self.counts.transfer(node, event.index, answered=not gave_up)
            if gave_up:
                text = f"no answer about {place}: the client gave up"
                proof = f"{abort_text(event.abort or 0)} after {event.at - event.began:.3f} s"
                yield Proved(node, Finding("no-answer", text, proof))
            elif event.outcome == "aborted":
                by = "node" if event.by == "server" else "the client of node"
                self.unsettled.refused[f"abort {_meaning(event.abort)} by {by} {node}{self._to(place)}"] += 1
                if event.by == "server":
                    yield from self._refused(event, place)
        elif event.outcome == "aborted":
            arrived, size = self._confirmed.get(node, (0, 0))
            lost = f" after {arrived} of {size} segments of a block arrived" if arrived < size else ""
            self.unsettled.refused[f"abort {_meaning(event.abort)} on the channel of node {node}{lost}"] += 1
        else:  # its beginning or its end is not in the recording
            self._not_awaited[node] += 1

    def _to(self, place: str) -> str:
        """Return the object of a refusal, as long as there are few."""
        return f" to {place}" if len(self.unsettled.refused) < _FEW else ""

    def _unanswered(self, event: SdoTransferReport, place: str) -> Iterator[Proved]:
        node, state = event.node, self.monitor.nodes.state(event.node, event.at)
        if state == NmtState.STOPPED:
            text = f"an SDO request to a stopped node, which does not answer: {place}"
            yield Proved(node, Finding("state", text, f"its state is {state_name(state)}"))
            return
        waited = 0.0 if event.began is None else event.at - event.began
        if waited < _WAITS:  # another request came so soon that the answer was not awaited, or the log has no times
            self._not_awaited[node] += 1
            return
        self.counts.transfer(node, event.index, answered=False)
        finding = Finding("no-answer", f"no answer about {place}", f"nothing from node {node} for {waited:.3f} s")
        requests = [request for request in self._requests.get(event.channel, []) if request.at == event.began]
        proved = Proved(node, finding, event.at, requests[0].line if requests else 0)
        if self.counts.may_be_search(node):
            self._searched[node] = proved
        else:
            yield proved

    def _refused(self, event: SdoTransferReport, place: str) -> Iterator[Proved]:
        """Findings of an abort that says how the request was wrong. Other aborts are answers, not faults."""
        requests = self._requests.get(event.channel, [])
        request = requests[-1].frame if requests else None
        refusal = f"the server aborted with {abort_text(event.abort or 0)}"
        if event.abort == AbortCode.COMMAND and request is not None and InitiateUpload.pattern.matches(request.data[0]):
            if request.data[0] != 0x40:
                text = f"{request.data[0]:02X}h is how a server answers; a read request is 40h"
                yield Proved(event.node, Finding("sdo-read-command", text, f"{request}: {refusal}"))
        elif event.abort in _WRONG_SIZE:
            size = event.size if event.size is not None else event.count
            text = f"{counted(size)} were announced for {place}, which has another size"
            yield Proved(event.node, Finding("sdo-size", text, f"{request}: {refusal}"))

    def _node(self, event: NodeReport) -> Iterator[Proved]:
        if event.kind == "missing":
            self.counts.silent[event.node] = event.at
            yield _missing_heartbeat(event.node, event.state, event.seconds or 0.0)
        elif event.kind in ("back", "boot-up", "beat"):
            self.counts.silent.pop(event.node, None)
        if (seconds := self._heartbeats.pause(event)) is not None:
            yield _missing_heartbeat(event.node, event.state, seconds)
        if event.kind == "boot-up" and event.unasked:
            text = f"the node restarted by itself; it was {state_name(event.before or 0)}"
            yield Proved(event.node, Finding("restart", text, "a boot-up message without a reset command before it"))


def _is_iso_tp(frame: CanFrame) -> bool:
    """Return whether 8 bytes with an identifier of error control, or a higher one, begin as ISO-TP has them: the length
    of one frame, of the first of several, a number, or flow control. A state has its byte alone, or zeros behind it."""
    is_high = 0x700 < frame.id <= 0x7FF and frame.id not in _LSS and not frame.remote
    return is_high and len(frame.data) == 8 and 0 < frame.data[0] < 0x40 and any(frame.data[1:])


def _meaning(code: int | None) -> str:
    """Return an abort code with its text; a maker has codes of its own."""
    number = code or 0
    text = next((known.text for known in AbortCode if known == number), "a code of the maker")
    return f"{number:08X}h ({text})"


def _is_segment(frame: CanFrame) -> bool:
    return bool(frame.data) and frame.data[0] >> 5 in (0, 3)


def _missing_heartbeat(node: int, state: int | None, seconds: float) -> Proved:
    text = f"the heartbeat is missing; the node was {state_name(state or 0)}"
    return Proved(node, Finding("no-heartbeat", text, f"none for {seconds:.3f} s"))


class CanLogDiagnosis:
    """All buses of a recording, each with its own diagnosis. `bus` selects one of them.

    >>> from barewire_workbench.recordings.model import Recorded
    >>> log = CanLogDiagnosis()
    >>> [found.sentence for found in log.feed(Recorded(1.5, "can0", CanFrame.parse("705#01"), line=3))]
    ['1.500000  line 3  node 5  01h is an NMT command, not a state: the state is 05h [state]: 705#05 is error control \
from node 5: operational']
    """

    def __init__(self, known: Iterable[KnownNode] = (), bus: str | None = None, *, complete: bool = False) -> None:
        self.only = bus
        self.seen: list[str] = []  # the names of buses with frames
        self._known, self._complete = tuple(known), complete
        self.buses: dict[str, BusDiagnosis] = {}
        self.unread: list[Unread] = []
        self._left_out: list[str] = []

    def feed(self, item: RecordedItem | float) -> list[LogFinding]:
        """Take an item of a recording, or a time at which nothing was received. Return the findings."""
        if isinstance(item, float):
            return [found for bus in self.buses.values() for found in bus.feed(None, item)]
        if isinstance(item, Unread):
            if LEFT_OUT in item.why:
                self._left_out.append(item.why)
            if len(self.unread) < _UNREAD_MAX:
                self.unread.append(item)
            return []
        if item.bus not in self.seen and len(self.seen) < BUSES_MAX:
            self.seen.append(item.bus)
        if self.only not in (None, item.bus):
            return []
        if item.bus not in self.buses:
            if len(self.buses) == BUSES_MAX:
                return []
            self.buses[item.bus] = BusDiagnosis(self._known, complete=self._complete)
        bus = self.buses[item.bus]
        if len(self.buses) > 1:
            for name, other in self.buses.items():  # with one bus its name says nothing
                other.bus = f"bus {name}"
        if isinstance(item, Dropped):
            return bus.feed(item, item.at)
        return bus.feed(item.frame, item.at, item.line, item.sent)

    def end(self) -> list[LogFinding]:
        """End the recording, and return the last findings."""
        return [found for bus in self.buses.values() for found in bus.end(bus.monitor.now)]

    def verdicts(self) -> list[tuple[str, LineVerdict]]:
        """Return the verdicts on each bus, each with the name of the bus; the name is empty if there is only one."""
        named = [(name if len(self.buses) > 1 else "", bus) for name, bus in self.buses.items()]
        for _, bus in named:
            bus.left_out = self._left_out
        return [(name, verdict) for name, bus in named or [("", BusDiagnosis())] for verdict in bus.verdicts()]
