"""Nodes overheard: states, boot-ups, heartbeats that fail to come, node guarding, and whether commands are obeyed.

        701h  05   05   05        05     the period is learned from the intervals, or told by a write to 1017h
              |----|----|----x----|      after 2.5 periods of silence (2, if the period was told) the node is missing

What a node says of its state holds until it is commanded to another; a command that nobody contradicts within
`GRACE` holds, too. [CiA 301, heartbeat, node guarding, NMT]
"""

from __future__ import annotations

from statistics import median

from barewire.canopen.frame import CanFrame
from barewire.canopen.nmt.heartbeat import NodeState
from barewire.canopen.nmt.messages import STATE_AFTER, NmtCommand, NmtState
from barewire.explain.can_monitor.events import MonitorEvent, NmtCommandReport, NodeReport, Violation

LEARNED, TOLD = 2.5, 2.0
"""After so many periods of silence a node is missing."""
GRACE = 0.05
"""So many seconds after a command frames of the old state may still come: they waited in a queue."""
INTERVALS = 5
"""The period is the median of so many intervals; three are the least."""
STATES = frozenset(int(state) for state in NmtState)


def state_name(state: int) -> str:
    """A state in words.

    >>> state_name(0x7F), state_name(0x33)
    ('pre-operational', 'state 33h')
    """
    return NodeState(0, state).name if state else "boot-up"


class ObservedNode:
    """What is known of one node."""

    __slots__ = (
        *(
            "commanded",
            "commanded_at",
            "deadline",
            "guarded",
            "intervals",
            "last",
            "missing",
            "period",
            "pending",
            "said",
            "state",
        ),
        *("toggle", "told_period", "unsure"),
    )

    def __init__(self) -> None:
        self.state: int | None = None
        self.last: float | None = None  # when it told its state
        self.commanded: NmtCommand | None = None
        self.commanded_at = 0.0
        self.intervals: list[float] = []
        self.told_period: float | None = None  # 1017h, if it was seen
        self.missing = False
        self.deadline: float | None = None  # when it is missing
        self.guarded = False
        self.pending = 0  # remote frames without an answer
        self.toggle: bool | None = None  # of the next answer
        self.unsure = False  # an answer may have been lost
        self.said: set[str] = set()  # rules that were broken in this state: said once

    @property
    def beat(self) -> tuple[float, float] | None:
        """The period, and after how much silence the node is missing; None if it has none."""
        if self.told_period is not None:
            return (self.told_period, TOLD * self.told_period) if self.told_period else None
        if len(self.intervals) < 3:
            return None
        period = median(self.intervals)
        return (period, LEARNED * max(period, *self.intervals))

    def settle(self) -> None:
        """Compute anew when it is missing: something has changed."""
        beat = self.beat
        self.deadline = None if beat is None or self.last is None or self.missing else self.last + beat[1]


class NodeTracker:
    """All nodes: at most 127. A machine for error control and NMT."""

    def __init__(self) -> None:
        self.nodes: dict[int, ObservedNode] = {}

    @property
    def deadline(self) -> float | None:
        """When the next one is missing."""
        return min((due for node in self.nodes.values() if (due := node.deadline) is not None), default=None)

    def _node(self, number: int) -> ObservedNode:
        return self.nodes.setdefault(number, ObservedNode())

    def pass_time(self, now: float) -> list[MonitorEvent]:
        """Who is missing by now."""
        events: list[MonitorEvent] = []
        for number, node in self.nodes.items():
            due = node.deadline
            if due is not None and now >= due and node.last is not None:
                node.missing = True
                node.settle()
                events.append(NodeReport(due, number, "missing", node.state, seconds=due - node.last))
        return events

    def overdue(self, now: float) -> int:
        """How many nodes would be missing by now."""
        return sum((due := node.deadline) is not None and now >= due for node in self.nodes.values())

    def interrupt(self, now: float) -> None:
        """The recording has a hole that ends here."""
        for node in self.nodes.values():
            node.last = now if node.last is not None else None
            node.unsure = True
            node.settle()

    def tell_period(self, number: int, seconds: float) -> None:
        """Somebody wrote or read 1017h."""
        node = self._node(number)
        node.told_period = seconds
        node.intervals.clear()
        node.settle()

    # Commands

    def command(self, frame: CanFrame, now: float) -> list[MonitorEvent]:
        """An NMT command."""
        data = frame.data
        if len(data) != 2:
            return [Violation(now, "NMT-LENGTH", 0, f"{len(data)} bytes", str(frame))]
        if data[1] > 127:
            return [Violation(now, "NMT-NODE", 0, f"node {data[1]}", str(frame))]
        if data[0] not in STATE_AFTER:
            return [Violation(now, "NMT-COMMAND", data[1], f"{data[0]:02X}h is no command", str(frame))]
        for number in [data[1]] if data[1] else list(self.nodes):
            node = self._node(number)
            node.commanded, node.commanded_at = NmtCommand(data[0]), now
            node.said.clear()
        return [NmtCommandReport(now, data[0], data[1])]

    # States

    def state(self, number: int, now: float) -> int | None:
        """The state that a node is in, as far as that is certain."""
        node = self.nodes.get(number)
        if node is None:
            return None
        if node.commanded is not None:
            after = STATE_AFTER[node.commanded]
            return int(after) if after and now - node.commanded_at > GRACE else None
        return None if node.missing else node.state

    def allowed(self, number: int, what: str, is_its_own: bool, frame: CanFrame, now: float) -> list[MonitorEvent]:
        """Whether the node may say this in its state; told once in each."""
        state = self.state(number, now) if is_its_own else None
        rule = ""
        if state == NmtState.STOPPED:
            rule = "STOPPED-TALKS"
        elif state == NmtState.PRE_OPERATIONAL and "PDO" in what:
            rule = "PDO-NOT-OPERATIONAL"
        said = self._node(number).said if rule else set()
        if not rule or rule in said or state is None:
            return []
        said.add(rule)
        return [Violation(now, rule, number, f"it is {state_name(state)}, and sends {what}", str(frame))]

    def guard(self, number: int) -> None:
        """A remote frame asks for the state."""
        node = self._node(number)
        node.guarded = True
        node.pending += 1

    def hear(self, number: int, frame: CanFrame, now: float) -> list[MonitorEvent]:
        """A boot-up message, a heartbeat, or the answer to node guarding."""
        events: list[MonitorEvent] = []
        node, data = self._node(number), frame.data
        if len(data) != 1:
            events.append(Violation(now, "HEARTBEAT-LENGTH", number, f"{len(data)} bytes", str(frame)))
            if not data:
                return events
        state, toggle = data[0] & 0x7F, bool(data[0] & 0x80)
        if state not in STATES:
            events.append(Violation(now, "HEARTBEAT-STATE", number, f"{state:02X}h is no state", str(frame)))
        if state == NmtState.INITIALISING and not toggle:
            return [*events, self._boot(number, node, now)]
        answers = node.pending > 0
        if node.guarded:
            # After a question without an answer nobody knows whether the bit has alternated unheard.
            if node.pending == 1 and node.toggle is not None and toggle is not node.toggle and not node.unsure:
                text = f"the bit is {int(toggle)}, and was {int(toggle)} in the answer before"
                events.append(Violation(now, "GUARD-TOGGLE", number, text, str(frame)))
            node.toggle, node.unsure, node.pending = not toggle, False, 0
        elif toggle and "HEARTBEAT-TOGGLE" not in node.said:
            node.said.add("HEARTBEAT-TOGGLE")
            events.append(Violation(now, "HEARTBEAT-TOGGLE", number, "bit 7 is set, and nobody asked", str(frame)))
        events += self._obeyed(number, node, state, now, frame)
        since = None if node.last is None else now - node.last
        before, node.state, node.last = node.state, state, now
        if node.missing:
            node.missing = False
            node.intervals.clear()
            events.append(NodeReport(now, number, "back", state, before, since, answers))
        elif before is None:
            events.append(NodeReport(now, number, "heard", state, None, None, answers))
        elif state != before:
            node.said -= {"STOPPED-TALKS", "PDO-NOT-OPERATIONAL"}
            events.append(NodeReport(now, number, "state", state, before, since, answers))
        else:
            if since is not None and before != NmtState.INITIALISING:
                node.intervals = [*node.intervals[1 - INTERVALS :], since]
            events.append(NodeReport(now, number, "beat", state, before, since, answers))
        node.settle()
        return events

    def _boot(self, number: int, node: ObservedNode, now: float) -> NodeReport:
        before = node.state
        fresh = ObservedNode()
        fresh.state, fresh.last, fresh.guarded, fresh.toggle = 0, now, node.guarded, False
        self.nodes[number] = fresh
        return NodeReport(now, number, "boot-up", 0, before)

    def _obeyed(self, number: int, node: ObservedNode, state: int, now: float, frame: CanFrame) -> list[MonitorEvent]:
        """Whether the node is where it was told to go; the first state that it tells in good time decides."""
        if node.commanded is None:
            return []
        expected, since = STATE_AFTER[node.commanded], now - node.commanded_at
        if state == expected:
            node.commanded = None
        elif since > GRACE:
            told = node.commanded.name.lower().replace("_", " ")
            node.commanded = None
            text = f"told to {told} {since:.3f} s ago, says {state_name(state)}"
            if not expected:
                text = f"told to {told} {since:.3f} s ago, and no boot-up came"
            return [Violation(now, "NMT-NOT-OBEYED", number, text, str(frame))]
        return []
