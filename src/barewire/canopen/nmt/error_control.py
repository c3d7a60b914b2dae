"""Error control: heartbeats, and the older node guarding.   [CiA 301, heartbeat, node guarding, life guarding]

A heartbeat *producer* sends its state every 1017h milliseconds. A *consumer* has a time for each monitored node (1016h)
and keeps one of three conditions for it; each transition is an event:

        unknown --heartbeat--> active --silence--> lost --heartbeat--> active
           ^______________________boot-up_______________|

A boot-up message alone does not start the monitoring: a device without heartbeat sends one as well.

In node guarding the master requests the state by a remote frame:

        master                                     node
        700h+n, remote         ->                                  every guard time
                               <-        700h+n | t sssssss        t = 0 first after a boot, then alternating

        guard time 100Ch x life time factor 100Dh = life time

        no response for a life time: the master has lost the node         (node guarding)
        no request for a life time: the node has lost the master          (life guarding, from the first request on)

The toggle bit distinguishes a new response from a repeated old one: a response with the wrong toggle bit does not
count. A node that produces heartbeats (1017h is not 0) is not guarded: only one of the two is active.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

from barewire.canopen.cob_ids import check_node, cob_id
from barewire.canopen.cyclic import next_due
from barewire.canopen.frame import CanFrame
from barewire.canopen.nmt.messages import NmtState, NodeState, guarding_request, reported_state
from barewire.errors import EncodeError, shown


class HeartbeatProducer:
    """A machine that sends `state` every `period` seconds; a period of 0 means never.

    A late call does not shift the later heartbeats. After a long pause one is sent, and the missed ones are skipped.
    """

    __slots__ = ("_next", "_period", "node", "state")

    def __init__(self, node: int) -> None:
        self.node = check_node(node)
        self.state: NmtState = NmtState.INITIALISING
        self._period = 0.0
        self._next: float | None = None

    @property
    def deadline(self) -> float | None:
        """When the next heartbeat is due."""
        return self._next

    @property
    def period(self) -> float:
        """Seconds between two heartbeats, 0 for none."""
        return self._period

    def set_period(self, period: float, now: float) -> None:
        """Set the period of 1017h, in seconds. If it changes, the next heartbeat is due at once."""
        if period == self._period:
            return
        self._period = period
        self._next = now if period > 0 else None

    def boot_up(self, now: float) -> CanFrame:
        """Return the boot-up message; the first heartbeat is due one period later."""
        self._next = now + self._period if self._period > 0 else None
        return NodeState(self.node, NmtState.INITIALISING).encode()

    def feed(self, item: None, now: float) -> list[CanFrame]:
        """Return the heartbeat, if one is due."""
        if self._next is None or now < self._next:
            return []
        self._next, _ = next_due(self._next, self._period, now)
        return [NodeState(self.node, self.state).encode()]


Liveness = Literal["unknown", "active", "lost"]
HeartbeatKind = Literal["active", "state", "lost", "booted", "rebooted"]


class HeartbeatEvent(NamedTuple):
    """A change of a node.

    active      its first heartbeat, or the first one after it was lost
    state       its NMT state has changed
    lost        no heartbeat within its time
    booted      its boot-up message
    rebooted    the boot-up message of a node that was active
    """

    node: int
    kind: HeartbeatKind
    state: int | None
    at: float


class _Watched:
    __slots__ = ("deadline", "liveness", "state")

    def __init__(self) -> None:
        self.liveness: Liveness = "unknown"
        self.state: int | None = None
        self.deadline: float | None = None


class HeartbeatConsumer:
    """A machine that follows the heartbeats of all nodes, and monitors the nodes that have a time.

    >>> consumer = HeartbeatConsumer({5: 1.5})
    >>> [event.kind for event in consumer.feed(CanFrame.parse("705#7F"), 10.0)], consumer.deadline
    (['active'], 11.5)
    >>> [event.kind for event in consumer.feed(None, 11.5)], consumer.liveness(5)
    (['lost'], 'lost')
    """

    __slots__ = ("_nodes", "times")

    def __init__(self, times: Mapping[int, float]) -> None:
        self.times: dict[int, float] = {}
        self._nodes: dict[int, _Watched] = {}  # at most 127
        self.watch(times)

    def watch(self, times: Mapping[int, float]) -> None:
        """Monitor these nodes: node -> seconds. Monitoring restarts for a node whose time changed."""
        if not isinstance(times, Mapping):
            raise EncodeError(f"{shown(times)}: expected a mapping of node-ID to seconds, such as {{5: 1.5}}")
        for node, seconds in times.items():
            check_node(node)
            if not isinstance(seconds, (int, float)) or not seconds > 0:
                raise EncodeError(f"heartbeat time {shown(seconds)} s of node {node}: expected more than 0")
        for node, watched in self._nodes.items():
            if times.get(node) != self.times.get(node):
                watched.liveness, watched.deadline = "unknown", None
        self.times = dict(times)

    def expect(self, node: int, until: float) -> None:
        """Report the node as lost at `until` even without an earlier heartbeat, for a master that just started it."""
        self._nodes.setdefault(check_node(node), _Watched()).deadline = until

    @property
    def deadline(self) -> float | None:
        """When the next node counts as lost unless it sends a heartbeat before."""
        return min((due for watched in self._nodes.values() if (due := watched.deadline) is not None), default=None)

    def liveness(self, node: int) -> Liveness:
        """Return the condition of a node."""
        watched = self._nodes.get(node)
        return "unknown" if watched is None else watched.liveness

    def state(self, node: int) -> int | None:
        """Return the last NMT state that the node reported, None before the first."""
        watched = self._nodes.get(node)
        return None if watched is None else watched.state

    def feed(self, frame: CanFrame | None, now: float) -> list[HeartbeatEvent]:
        """Return the events of nodes that are lost by now, then those of the frame."""
        events: list[HeartbeatEvent] = []
        for node, watched in self._nodes.items():
            if watched.deadline is not None and now >= watched.deadline:
                watched.liveness, watched.deadline = "lost", None
                events.append(HeartbeatEvent(node, "lost", watched.state, now))
        received = None if frame is None else reported_state(frame)
        if received is None:
            return events
        watched = self._nodes.setdefault(received.node, _Watched())
        before, state_before = watched.liveness, watched.state
        watched.state = received.state
        if received.is_boot_up:
            watched.liveness, watched.deadline = "unknown", None
            kind: HeartbeatKind = "rebooted" if before == "active" else "booted"
            events.append(HeartbeatEvent(received.node, kind, received.state, now))
            return events
        seconds = self.times.get(received.node)
        watched.liveness = "active"
        watched.deadline = None if seconds is None else now + seconds
        if before != "active":
            events.append(HeartbeatEvent(received.node, "active", received.state, now))
        elif received.state != state_before:
            events.append(HeartbeatEvent(received.node, "state", received.state, now))
        return events


class Guard(NamedTuple):
    """How a node is guarded: a request every `time` seconds, lost after `factor` of them without a response."""

    time: float
    factor: int = 3


class GuardEvent(NamedTuple):
    """A change of a guarded node.

    answered   its first response, or the first one after it was lost
    state      its NMT state has changed
    toggle     a response with the wrong toggle bit
    lost       no response for a life time
    booted     its boot-up message
    """

    node: int
    kind: Literal["answered", "state", "toggle", "lost", "booted"]
    state: int | None
    at: float


@dataclass(slots=True)
class _Guarded:
    guard: Guard
    next: float
    lost_at: float
    toggle: bool | None = None  # of the next response; None: either, because the node may have been guarded before
    state: int | None = None
    active: bool = False
    lost: bool = False


class GuardingMaster:
    """The master in node guarding. A machine: `feed` returns requests to send (CanFrame) and changes (GuardEvent).

    >>> master = GuardingMaster({5: Guard(1.0, 2)}, 0.0)
    >>> [str(frame) for frame in master.feed(None, 0.0)]
    ['705#R1']
    >>> [event.kind for event in master.feed(CanFrame.parse("705#7F"), 0.001)]
    ['answered']
    """

    __slots__ = ("_nodes",)

    def __init__(self, guards: Mapping[int, Guard], now: float) -> None:
        for node, guard in guards.items():
            check_node(node)
            if not (0 < guard.time < float("inf") and guard.factor >= 1):
                raise EncodeError(f"guarding of node {node}: {guard}: expected a time above 0 and a factor from 1 on")
        # The requests to many nodes are spread over the guard time instead of sent in one burst.
        shares = {node: step / len(guards) for step, node in enumerate(guards)}
        self._nodes = {
            node: _Guarded(guard, now + guard.time * shares[node], now + guard.time * (guard.factor + shares[node]))
            for node, guard in guards.items()
        }

    @property
    def deadline(self) -> float | None:
        """When the next request is due, or a node counts as lost."""
        dues = [node.next for node in self._nodes.values()]
        dues += [node.lost_at for node in self._nodes.values() if not node.lost]
        return min(dues, default=None)

    def state(self, node: int) -> int | None:
        """Return the last state that the node reported, None before the first one and while it is lost."""
        guarded = self._nodes.get(node)
        return None if guarded is None or guarded.lost else guarded.state

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame | GuardEvent]:
        """Return the events of the frame and of nodes that are lost by now, and the requests that are due."""
        output: list[CanFrame | GuardEvent] = []
        if frame is not None:
            output += self._receive(frame, now)
        for number, node in self._nodes.items():
            if not node.lost and now >= node.lost_at:
                node.lost, node.active = True, False
                output.append(GuardEvent(number, "lost", node.state, now))
            if now >= node.next:
                node.next, _ = next_due(node.next, node.guard.time, now)
                output.append(guarding_request(number))
        return output

    def _receive(self, frame: CanFrame, now: float) -> list[GuardEvent]:
        received = reported_state(frame)
        node = None if received is None else self._nodes.get(received.node)
        if received is None or node is None:
            return []
        if received.is_boot_up:
            node.toggle, node.state = False, received.state
            node.lost_at = now + node.guard.time * node.guard.factor
            return [GuardEvent(received.node, "booted", received.state, now)]
        if node.toggle is not None and received.toggle is not node.toggle:
            return [GuardEvent(received.node, "toggle", received.state, now)]
        node.toggle = not received.toggle
        node.lost_at = now + node.guard.time * node.guard.factor
        before, node.state = node.state, received.state
        was_active, node.active, node.lost = node.active, True, False
        if not was_active:
            return [GuardEvent(received.node, "answered", received.state, now)]
        return [] if before == received.state else [GuardEvent(received.node, "state", received.state, now)]


class LifeEvent(NamedTuple):
    """A change in life guarding: `lost`, no request of the master for a life time; `resolved`, a request again."""

    kind: Literal["lost", "resolved"]
    at: float


class GuardedNode:
    """The guarded node. A machine: `feed` returns the response with `state` (CanFrame) and life guarding (LifeEvent).

    A `life_time` of 0 switches life guarding off.

    >>> node = GuardedNode(5)
    >>> node.state = NmtState.OPERATIONAL
    >>> [str(node.feed(guarding_request(5), now)[0]) for now in (1.0, 2.0, 3.0)]
    ['705#05', '705#85', '705#05']
    """

    __slots__ = ("_key", "_lost", "_requested_at", "_toggle", "life_time", "node", "state")

    def __init__(self, node: int) -> None:
        self.node = check_node(node)
        self.state: NmtState = NmtState.INITIALISING
        self.life_time = 0.0
        self._key = (cob_id("error control", node), False)
        self._toggle = False
        self._requested_at: float | None = None
        self._lost = False

    @property
    def deadline(self) -> float | None:
        """When the master counts as lost unless it sends a request before."""
        if self._requested_at is None or self._lost or not self.life_time:
            return None
        return self._requested_at + self.life_time

    def reset(self) -> None:
        """Restart with toggle bit 0 at a boot; life guarding then waits for the first request."""
        self._toggle, self._requested_at, self._lost = False, None, False

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame | LifeEvent]:
        """Return the response to a request, and the events of life guarding."""
        output: list[CanFrame | LifeEvent] = []
        due = self.deadline
        if due is not None and now >= due:
            self._lost = True
            output.append(LifeEvent("lost", now))
        if frame is None or not frame.remote or frame.key != self._key:
            return output
        self._requested_at = now
        if self._lost:
            self._lost = False
            output.append(LifeEvent("resolved", now))
        output.append(NodeState(self.node, self.state, self._toggle).encode())
        self._toggle = not self._toggle
        return output
