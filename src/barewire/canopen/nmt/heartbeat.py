"""Error control: who is alive, and in which state.   [CiA 301, heartbeat, node guarding, boot-up]

        700h+n | t sssssss |        1 byte        s = 00 boot-up, 04 stopped, 05 operational, 7F pre-operational
                                                  t = 0 in a heartbeat; alternates in the answers to node guarding

A *producer* says its state every 1017h milliseconds without being asked. A *consumer* has a time for each node it
cares for (1016h: `00 | node | time in ms`) and notices silence. The older way, node guarding, has the master ask
with a remote frame on 700h+n; the answer is the same byte with a toggle bit, which is how 84h, 85h and FFh come to
stand in the guide of the AZ3.

The consumer keeps one of three words for each node, and each step between them is an event:

        unknown --heartbeat--> active --silence--> lost --heartbeat--> active
           ^______________________boot-up_______________|

A boot-up message alone does not start the watch: a device whose heartbeat is switched off boots as well.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

from barewire.canopen.cob_ids import check_node, classify, cob_id
from barewire.canopen.frame import CanFrame
from barewire.canopen.nmt.messages import NmtState
from barewire.codecs import BitPattern
from barewire.errors import DecodeError, EncodeError

STATE_BYTE = BitPattern("tsss ssss")
_NAMES = {state.value: state.name.lower().replace("_", "-") for state in NmtState}


@dataclass(frozen=True, slots=True)
class NodeState:
    """A heartbeat, a boot-up message or the answer to node guarding: all are this one byte.

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
        """00h: somebody has just come up."""
        return self.state == NmtState.INITIALISING and not self.toggle

    @property
    def name(self) -> str:
        """The state in words; a number that no standard knows stays a number."""
        return _NAMES.get(self.state, f"state {self.state:02X}h")

    def encode(self) -> CanFrame:
        """One byte on 700h+n."""
        return CanFrame(cob_id("error control", self.node), bytes([STATE_BYTE.encode(t=self.toggle, s=self.state)]))

    @classmethod
    def decode(cls, frame: CanFrame) -> NodeState:
        """More than one byte is tolerated, as some devices send it; none at all is DecodeError("short")."""
        found = classify(frame)
        if found is None or found[0].name != "error control" or frame.remote:
            raise DecodeError("mismatch", frame.data, 0, f"{frame} tells no node's state")
        if not frame.data:
            raise DecodeError("short", frame.data, 0, "the state is byte 0, but there are none")
        fields = STATE_BYTE.decode(frame.data[0])
        return cls(found[1], fields["s"], bool(fields["t"]))


def guarding_request(node: int) -> CanFrame:
    """The remote frame with which a master asks one node for its state.

    >>> str(guarding_request(5))
    '705#R1'
    """
    return CanFrame(cob_id("error control", node), remote=True, requested=1)


def consumer_entry(word: int) -> tuple[int, float] | None:
    """One entry of 1016h as (node, seconds); None if it is unused, which is node 0 or time 0.

    >>> consumer_entry(134072)
    (2, 3.0)
    """
    node, milliseconds = word >> 16 & 0x7F, word & 0xFFFF
    return (node, milliseconds / 1000) if node and milliseconds else None


class HeartbeatProducer:
    """Says `state` every `period` seconds, 0 for never. A machine.

    The beat is absolute (t0 + k times the period), so a late shell does not make it drift; and after a long sleep
    it is said once, not once for every beat that was missed.
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
        """The object 1017h was written. The same value again changes nothing, another one starts at once."""
        if period == self._period:
            return
        self._period = period
        self._next = now if period > 0 else None

    def boot_up(self, now: float) -> CanFrame:
        """The boot-up message, and the beat begins one period later."""
        self._next = now + self._period if self._period > 0 else None
        return NodeState(self.node, NmtState.INITIALISING).encode()

    def feed(self, item: None, now: float) -> list[CanFrame]:
        """What is due now."""
        if self._next is None or now < self._next:
            return []
        missed = int((now - self._next) / self._period)
        self._next += (missed + 1) * self._period
        return [NodeState(self.node, self.state).encode()]


Liveness = Literal["unknown", "active", "lost"]
HeartbeatKind = Literal["active", "state", "lost", "booted", "rebooted"]


class HeartbeatEvent(NamedTuple):
    """Something changed about a node.

    `active` first or again heard, `state` another NMT state than before, `lost` silent for too long, `booted` its
    boot-up message, `rebooted` the same of a node that was active: it has restarted without being told to by us.
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
    """Listens to every node and watches those that have a time. A machine.

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
        """Care for these nodes from now on. What is known of a node stays known; one with a new time begins anew."""
        for node, seconds in times.items():
            check_node(node)
            if not seconds > 0:
                raise EncodeError(f"heartbeat time {seconds} s of node {node}: expected more than 0")
        for node, watched in self._nodes.items():
            if times.get(node) != self.times.get(node):
                watched.liveness, watched.deadline = "unknown", None
        self.times = dict(times)

    def expect(self, node: int, until: float) -> None:
        """Miss this node at `until` even if it was never heard: for a master that has just started it."""
        self._nodes.setdefault(check_node(node), _Watched()).deadline = until

    @property
    def deadline(self) -> float | None:
        """When the first of the active nodes will be lost if it stays silent."""
        return min((w.deadline for w in self._nodes.values() if w.deadline is not None), default=None)

    def liveness(self, node: int) -> Liveness:
        """What is known about a node."""
        watched = self._nodes.get(node)
        return "unknown" if watched is None else watched.liveness

    def state(self, node: int) -> int | None:
        """The last NMT state that the node told, None before the first."""
        watched = self._nodes.get(node)
        return None if watched is None else watched.state

    def feed(self, frame: CanFrame | None, now: float) -> list[HeartbeatEvent]:
        """Who was lost up to now, then what the frame tells. Foreign frames tell nothing."""
        events: list[HeartbeatEvent] = []
        for node, watched in self._nodes.items():
            if watched.deadline is not None and now >= watched.deadline:
                watched.liveness, watched.deadline = "lost", None
                events.append(HeartbeatEvent(node, "lost", watched.state, now))
        if frame is None:
            return events
        try:
            told = NodeState.decode(frame)
        except DecodeError:
            return events
        watched = self._nodes.setdefault(told.node, _Watched())
        before, state_before = watched.liveness, watched.state
        watched.state = told.state
        if told.is_boot_up:
            watched.liveness, watched.deadline = "unknown", None
            kind: HeartbeatKind = "rebooted" if before == "active" else "booted"
            events.append(HeartbeatEvent(told.node, kind, told.state, now))
            return events
        seconds = self.times.get(told.node)
        watched.liveness = "active"
        watched.deadline = None if seconds is None else now + seconds
        if before != "active":
            events.append(HeartbeatEvent(told.node, "active", told.state, now))
        elif told.state != state_before:
            events.append(HeartbeatEvent(told.node, "state", told.state, now))
        return events
