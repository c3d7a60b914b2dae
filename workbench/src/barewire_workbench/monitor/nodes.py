"""Nodes: states, boot-ups, missing heartbeats, node guarding, and the effect of NMT commands.

        701h  05   05   05        05     the period is learned from the intervals, or from an access to 1017h
              |----|----|----x----|      after 2.5 periods of silence (2, if 1017h is known) the node is missing

A node is in the state that it reports until a command changes it; a command counts after `_GRACE` unless the node
reports another state. [CiA 301, heartbeat, node guarding, NMT]
"""

from __future__ import annotations

from barewire.canopen.frame import CanFrame
from barewire.canopen.nmt.messages import STATE_AFTER, NmtCommand, NmtState
from barewire_workbench.monitor.events import (
    MonitorEvent,
    NmtCommandReport,
    NodeReport,
    Violation,
    command_name,
    state_name,
)

_PERIODS_LEARNED, _PERIODS_CONFIGURED = 2.5, 2.0
"""Periods of silence after which a node is missing, for a learned period and for the period in 1017h."""
_GRACE = 0.05
"""Seconds after a command in which frames of the old state may still come from a queue."""
_INTERVALS, _INTERVALS_MIN = 5, 3
"""The number of intervals whose longest one is the learned period, and how many of them are needed."""
_RESETS = (NmtCommand.RESET_NODE, NmtCommand.RESET_COMMUNICATION)
_STATES = frozenset(int(state) for state in NmtState)


class ObservedNode:
    """The state of one node."""

    def __init__(self) -> None:
        self.state: int | None = None
        self.last: float | None = None  # when it reported its state
        self.commanded: NmtCommand | None = None
        self.commanded_at = 0.0
        self.intervals: list[float] = []
        self.configured_period: float | None = None  # the value of 1017h, if an access to it was recorded
        self.missing = False
        self.deadline: float | None = None  # when it counts as missing
        self.guarded = False
        self.pending = 0  # guarding requests without an answer
        self.toggle: bool | None = None  # of the next answer
        self.unsure = False  # an answer may have been lost
        self.reported: set[str] = set()  # broken rules that were reported in this state: each is reported once

    @property
    def longest_silence(self) -> float | None:
        """The seconds of silence after which the node is missing; None without a known period."""
        if self.configured_period is not None:
            return _PERIODS_CONFIGURED * self.configured_period or None  # a period of 0 switches the heartbeat off
        if len(self.intervals) < _INTERVALS_MIN:
            return None
        return _PERIODS_LEARNED * max(self.intervals)

    def update_deadline(self) -> None:
        """Compute the deadline again after a change."""
        silence = self.longest_silence
        # A missing node has no deadline: it is reported once, until it is back.
        self.deadline = None if silence is None or self.last is None or self.missing else self.last + silence


class NodeTracker:
    """All nodes, at most 127. A machine for error control and NMT."""

    def __init__(self) -> None:
        self.nodes: dict[int, ObservedNode] = {}

    @property
    def deadline(self) -> float | None:
        """When the next node counts as missing."""
        return min((node.deadline for node in self.nodes.values() if node.deadline is not None), default=None)

    def _node(self, number: int) -> ObservedNode:
        return self.nodes.setdefault(number, ObservedNode())

    def pass_time(self, now: float) -> list[MonitorEvent]:
        """Report the nodes whose deadline has passed."""
        events: list[MonitorEvent] = []
        for number, node in self.nodes.items():
            due = node.deadline
            if due is not None and now >= due and node.last is not None:
                node.missing = True
                node.update_deadline()
                events.append(NodeReport(due, number, "missing", node.state, seconds=due - node.last))
        return events

    def overdue(self, now: float) -> int:
        """Return the number of nodes that have passed their deadline."""
        return sum(node.deadline is not None and now >= node.deadline for node in self.nodes.values())

    def interrupt(self, now: float) -> None:
        """Note the end of a gap in the recording."""
        for node in self.nodes.values():
            node.last = now if node.last is not None else None
            node.unsure = True
            node.update_deadline()

    def set_period(self, number: int, seconds: float) -> None:
        """Set the heartbeat period that an access to 1017h shows; 0 switches the heartbeat off."""
        node = self._node(number)
        node.configured_period = seconds
        node.intervals.clear()
        node.update_deadline()

    # Commands

    def command(self, frame: CanFrame, now: float) -> list[MonitorEvent]:
        """Take an NMT command."""
        data = frame.data
        if len(data) != 2:
            return [Violation(now, "NMT-LENGTH", 0, f"{len(data)} bytes", str(frame))]
        if data[1] > 127:
            return [Violation(now, "NMT-NODE", 0, f"node {data[1]}", str(frame))]
        if data[0] not in STATE_AFTER:
            return [Violation(now, "NMT-COMMAND", data[1], f"{data[0]:02X}h is not a command", str(frame))]
        for number in [data[1]] if data[1] else list(self.nodes):
            node = self._node(number)
            node.commanded, node.commanded_at = NmtCommand(data[0]), now
            node.reported.clear()
        return [NmtCommandReport(now, data[0], data[1])]

    # States

    def state(self, number: int, now: float) -> int | None:
        """Return the state of a node; None if it is not certain."""
        node = self.nodes.get(number)
        if node is None:
            return None
        if node.commanded is not None:
            after = STATE_AFTER[node.commanded]
            return int(after) if after and now - node.commanded_at > _GRACE else None
        return None if node.missing else node.state

    def check_allowed(
        self, number: int, service: str, sent_by_node: bool, frame: CanFrame, now: float
    ) -> list[MonitorEvent]:
        """Check that the node may send this in its state. Reported once per state."""
        state = self.state(number, now) if sent_by_node else None
        rule = None
        if state == NmtState.STOPPED:
            rule = "STOPPED-SENDS"
        elif state == NmtState.PRE_OPERATIONAL and "PDO" in service:
            rule = "PDO-NOT-OPERATIONAL"
        if state is None or rule is None or rule in self.nodes[number].reported:
            return []
        self.nodes[number].reported.add(rule)
        return [Violation(now, rule, number, f"it is {state_name(state)}, and sends {service}", str(frame))]

    def guarding_request(self, number: int) -> None:
        """Take a remote frame that requests the state."""
        node = self._node(number)
        node.guarded = True
        node.pending += 1

    def feed(self, number: int, frame: CanFrame, now: float) -> list[MonitorEvent]:
        """Take a boot-up message, a heartbeat, or an answer to node guarding."""
        events: list[MonitorEvent] = []
        node, data = self._node(number), frame.data
        if len(data) != 1:
            events.append(Violation(now, "HEARTBEAT-LENGTH", number, f"{len(data)} bytes", str(frame)))
            if not data:
                return events
        state, toggle = data[0] & 0x7F, bool(data[0] & 0x80)
        if state not in _STATES:
            events.append(Violation(now, "HEARTBEAT-STATE", number, f"{state:02X}h is not a state", str(frame)))
        if state == NmtState.INITIALISING and not toggle:  # 80h has the toggle bit of an answer to guarding
            return [*events, self._boot(number, node, now)]
        answers = node.pending > 0
        events += self._check_toggle(number, node, toggle, now, frame)
        events += self._check_obeyed(number, node, state, now, frame)
        since = None if node.last is None else now - node.last
        before, node.state, node.last = node.state, state, now
        if node.missing:
            node.missing = False
            node.intervals.clear()  # a period that was learned before may have been changed meanwhile
            events.append(NodeReport(now, number, "back", state, before, since, answers))
        elif before is None:
            events.append(NodeReport(now, number, "heard", state, None, None, answers))
        elif state != before:
            node.reported -= {"STOPPED-SENDS", "PDO-NOT-OPERATIONAL"}
            events.append(NodeReport(now, number, "state", state, before, since, answers))
        else:
            if since is not None and before != NmtState.INITIALISING:
                node.intervals = [*node.intervals[1 - _INTERVALS :], since]
            events.append(NodeReport(now, number, "beat", state, before, since, answers))
        node.update_deadline()
        return events

    def _check_toggle(
        self, number: int, node: ObservedNode, toggle: bool, now: float, frame: CanFrame
    ) -> list[MonitorEvent]:
        """Check bit 7: it alternates in answers to node guarding, and is 0 in heartbeats."""
        if node.guarded:
            # After a request without an answer the bit may have alternated in a frame that is not in the recording.
            repeats = node.pending == 1 and node.toggle is not None and toggle is not node.toggle and not node.unsure
            node.toggle, node.unsure, node.pending = not toggle, False, 0
            if repeats:
                text = f"the toggle bit is {int(toggle)}, as in the answer before"
                return [Violation(now, "GUARD-TOGGLE", number, text, str(frame))]
        elif toggle and "HEARTBEAT-TOGGLE" not in node.reported:
            node.reported.add("HEARTBEAT-TOGGLE")
            text = "bit 7 is set without a guarding request"
            return [Violation(now, "HEARTBEAT-TOGGLE", number, text, str(frame))]
        return []

    def _boot(self, number: int, node: ObservedNode, now: float) -> NodeReport:
        """Replace all that is known of a node, except whether it is guarded."""
        before, after_reset = node.state, node.commanded in _RESETS
        fresh = ObservedNode()
        fresh.state, fresh.last, fresh.guarded, fresh.toggle = 0, now, node.guarded, False
        self.nodes[number] = fresh
        unasked = before is not None and not after_reset and not node.unsure
        return NodeReport(now, number, "boot-up", 0, before, unasked=unasked)

    def _check_obeyed(
        self, number: int, node: ObservedNode, state: int, now: float, frame: CanFrame
    ) -> list[MonitorEvent]:
        """Check the last command against the first state that the node reports after the grace time."""
        if node.commanded is None:
            return []
        expected, since = STATE_AFTER[node.commanded], now - node.commanded_at
        if state == expected:
            node.commanded = None
        elif since > _GRACE:
            command = command_name(node.commanded)
            node.commanded = None
            text = f"commanded to {command} {since:.3f} s ago, reports {state_name(state)}"
            if not expected:
                text = f"commanded to {command} {since:.3f} s ago, no boot-up followed"
            return [Violation(now, "NMT-NOT-OBEYED", number, text, str(frame))]
        return []
