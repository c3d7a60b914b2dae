"""Error control by heartbeat: the state byte of a node, its producer and its consumer.   [CiA 301, heartbeat, boot-up]

        700h+n | t sssssss |        1 byte        s = 00 boot-up, 04 stopped, 05 operational, 7F pre-operational
                                                  t = 0 in a heartbeat; alternates in responses to node guarding

A *producer* sends its state every 1017h milliseconds. A *consumer* has a time for each monitored node (1016h:
`00 | node | time in ms`) and reports a node that sends no heartbeat within its time. In the older node guarding, the
master requests the same byte with a remote frame on 700h+n, and its top bit toggles (84h, 85h, FFh).

The consumer keeps one of three conditions for each node; each transition is an event:

        unknown --heartbeat--> active --silence--> lost --heartbeat--> active
           ^______________________boot-up_______________|

A boot-up message alone does not start the monitoring: a device without heartbeat sends one as well.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

from barewire.canopen.cob_ids import check_node, classify, cob_id
from barewire.canopen.frame import CanFrame
from barewire.canopen.nmt.messages import NmtState
from barewire.codecs import BitPattern
from barewire.errors import DecodeError, EncodeError, shown

STATE_BYTE = BitPattern("tsss ssss")
_NAMES = {state.value: state.name.lower().replace("_", "-") for state in NmtState}


@dataclass(frozen=True, slots=True)
class NodeState:
    """A heartbeat, a boot-up message or the response to node guarding: all carry this one byte.

        700h+n | t sssssss

    >>> str(NodeState(5, NmtState.OPERATIONAL).encode())
    '705#05'
    >>> NodeState.decode(CanFrame.parse("705#85"))
    NodeState(node=5, state=5, toggle=True)
    """

    node: int
    state: int
    toggle: bool = False

    @property
    def is_boot_up(self) -> bool:
        """Whether it is the boot-up message 00h: the node has just finished its initialisation."""
        return self.state == NmtState.INITIALISING and not self.toggle

    @property
    def name(self) -> str:
        """The state in words, or as a number if it is a reserved value."""
        return _NAMES.get(self.state, f"state {self.state:02X}h")

    def encode(self) -> CanFrame:
        """Return the frame: one byte on 700h+n."""
        return CanFrame(cob_id("error control", self.node), bytes([STATE_BYTE.encode(t=self.toggle, s=self.state)]))

    @classmethod
    def decode(cls, frame: CanFrame) -> NodeState:
        """Decode a frame. Bytes behind the first are ignored, because some devices send them.

        Raise DecodeError for another identifier and for a frame without data.
        """
        found = classify(frame)
        if found is None or found[0].name != "error control" or frame.remote:
            raise DecodeError(
                "mismatch", frame.data, 0, f"{frame} is not an error control message: expected 701h..77Fh"
            )
        if not frame.data:
            raise DecodeError("short", frame.data, 0, "the state is byte 0, but there are none")
        fields = STATE_BYTE.decode(frame.data[0])
        return cls(found[1], fields["s"], bool(fields["t"]))


def guarding_request(node: int) -> CanFrame:
    """Return the remote frame by which a master requests the state of a node.

    >>> str(guarding_request(5))
    '705#R1'
    """
    return CanFrame(cob_id("error control", node), remote=True, requested=1)


def consumer_entry(word: int) -> tuple[int, float] | None:
    """Return one entry of 1016h as (node, seconds); None if it is unused, which is node 0 or time 0.

    >>> consumer_entry(134072)
    (2, 3.0)
    """
    node, milliseconds = word >> 16 & 0x7F, word & 0xFFFF
    return (node, milliseconds / 1000) if node and milliseconds else None


class HeartbeatProducer:
    """A machine that sends `state` every `period` seconds; a period of 0 means never.

    The times are absolute (t0 + k times the period), so a late call does not shift the later heartbeats. After a long
    pause one heartbeat is sent, and the missed ones are skipped.
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
        missed = int((now - self._next) / self._period)
        self._next += (missed + 1) * self._period
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
        if frame is None:
            return events
        try:
            received = NodeState.decode(frame)
        except DecodeError:
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
