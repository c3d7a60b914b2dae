"""Node guarding and life guarding: error control by polling with remote frames.   [CiA 301, node guarding]

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
from barewire.canopen.frame import CanFrame
from barewire.canopen.nmt.heartbeat import NodeState, guarding_request
from barewire.canopen.nmt.messages import NmtState
from barewire.errors import DecodeError, EncodeError


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
            if not (guard.time > 0 and guard.factor >= 1):
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
                missed = int((now - node.next) / node.guard.time)
                node.next += (missed + 1) * node.guard.time
                if node.next <= now:
                    node.next = now + node.guard.time
                output.append(guarding_request(number))
        return output

    def _receive(self, frame: CanFrame, now: float) -> list[GuardEvent]:
        try:
            received = NodeState.decode(frame)
        except DecodeError:
            return []
        node = self._nodes.get(received.node)
        if node is None:
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
