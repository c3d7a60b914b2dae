"""Node guarding and life guarding: the older way of error control, in which the master asks.   [CiA 301, guarding]

        master                                     node
        700h+n, remote         ->                                  every guard time
                               <-        700h+n | t sssssss        t = 0 first after a boot, then alternating

        guard time 100Ch x life time factor 100Dh = life time

        no answer for a life time: the master has lost the node           (node guarding)
        no question for a life time: the node has lost the master         (life guarding, from the first question on)

The toggle bit tells an answer of now from one that a queue somewhere repeats: an answer with the wrong one does not
count. A node that says heartbeats (1017h is not 0) is not guarded: the one replaces the other.
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
    """How a node is guarded: a question every `time` seconds, lost after `factor` of them without an answer."""

    time: float
    factor: int = 3


class GuardEvent(NamedTuple):
    """Something changed about a guarded node.

    `answered` its first answer, or the first after it was lost; `state` another NMT state than before; `toggle` an
    answer with the wrong toggle bit; `lost` no answer for a life time; `booted` its boot-up message.
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
    toggle: bool | None = None  # of the answer to come; None: either, we may have come later
    state: int | None = None
    active: bool = False
    lost: bool = False


class GuardingMaster:
    """Guards nodes: asks each in its time, and says both its questions (CanFrame) and what changed (GuardEvent).

    >>> master = GuardingMaster({5: Guard(1.0, 2)}, 0.0)
    >>> [str(said) for said in master.feed(None, 0.0)]
    ['705#R1']
    >>> [said.kind for said in master.feed(CanFrame.parse("705#7F"), 0.001)]
    ['answered']
    """

    __slots__ = ("_nodes",)

    def __init__(self, guards: Mapping[int, Guard], now: float) -> None:
        for node, guard in guards.items():
            check_node(node)
            if not (guard.time > 0 and guard.factor >= 1):
                raise EncodeError(f"guarding of node {node}: {guard}: expected a time above 0 and a factor from 1 on")
        # The questions to many nodes are spread over the guard time, not said in one burst.
        self._nodes = {
            node: _Guarded(
                guard, now + place * guard.time / len(guards), now + guard.time * (guard.factor + place / len(guards))
            )
            for place, (node, guard) in enumerate(guards.items())
        }

    @property
    def deadline(self) -> float | None:
        """When the next question is due, or a node is lost."""
        dues = [node.next for node in self._nodes.values()]
        dues += [node.lost_at for node in self._nodes.values() if not node.lost]
        return min(dues, default=None)

    def state(self, node: int) -> int | None:
        """The last state that the node told, None before the first, or while it is lost."""
        guarded = self._nodes.get(node)
        return None if guarded is None or guarded.lost else guarded.state

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame | GuardEvent]:
        """What the frame tells, who was lost, and the questions that are due."""
        said: list[CanFrame | GuardEvent] = []
        if frame is not None:
            said += self._hear(frame, now)
        for number, node in self._nodes.items():
            if not node.lost and now >= node.lost_at:
                node.lost, node.active = True, False
                said.append(GuardEvent(number, "lost", node.state, now))
            if now >= node.next:
                missed = int((now - node.next) / node.guard.time)
                node.next += (missed + 1) * node.guard.time
                if node.next <= now:
                    node.next = now + node.guard.time
                said.append(guarding_request(number))
        return said

    def _hear(self, frame: CanFrame, now: float) -> list[GuardEvent]:
        try:
            told = NodeState.decode(frame)
        except DecodeError:
            return []
        node = self._nodes.get(told.node)
        if node is None:
            return []
        if told.is_boot_up:
            node.toggle, node.state = False, told.state
            node.lost_at = now + node.guard.time * node.guard.factor
            return [GuardEvent(told.node, "booted", told.state, now)]
        if node.toggle is not None and told.toggle is not node.toggle:
            return [GuardEvent(told.node, "toggle", told.state, now)]
        node.toggle = not told.toggle
        node.lost_at = now + node.guard.time * node.guard.factor
        before, node.state = node.state, told.state
        was_active, node.active, node.lost = node.active, True, False
        if not was_active:
            return [GuardEvent(told.node, "answered", told.state, now)]
        return [] if before == told.state else [GuardEvent(told.node, "state", told.state, now)]


class LifeEvent(NamedTuple):
    """Life guarding, seen from the node: `lost` the master asks no longer, `resolved` it asks again."""

    kind: Literal["lost", "resolved"]
    at: float


class GuardedNode:
    """The node's side: answers questions with its `state` (CanFrame), and watches that they keep coming (LifeEvent).

    A machine. A `life_time` of 0 watches nothing.

    >>> node = GuardedNode(5)
    >>> node.state = NmtState.OPERATIONAL
    >>> [str(node.feed(guarding_request(5), now)[0]) for now in (1.0, 2.0, 3.0)]
    ['705#05', '705#85', '705#05']
    """

    __slots__ = ("_asked_at", "_key", "_lost", "_toggle", "life_time", "node", "state")

    def __init__(self, node: int) -> None:
        self.node = check_node(node)
        self.state: NmtState = NmtState.INITIALISING
        self.life_time = 0.0
        self._key = (cob_id("error control", node), False)
        self._toggle = False
        self._asked_at: float | None = None
        self._lost = False

    @property
    def deadline(self) -> float | None:
        """When the master will be missed."""
        if self._asked_at is None or self._lost or not self.life_time:
            return None
        return self._asked_at + self.life_time

    def reset(self) -> None:
        """A boot: the toggle bit begins with 0, and nobody has asked yet."""
        self._toggle, self._asked_at, self._lost = False, None, False

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame | LifeEvent]:
        """The answer to a question, and what the time brings."""
        said: list[CanFrame | LifeEvent] = []
        due = self.deadline
        if due is not None and now >= due:
            self._lost = True
            said.append(LifeEvent("lost", now))
        if frame is None or not frame.remote or frame.key != self._key:
            return said
        self._asked_at = now
        if self._lost:
            self._lost = False
            said.append(LifeEvent("resolved", now))
        said.append(NodeState(self.node, self.state, self._toggle).encode())
        self._toggle = not self._toggle
        return said
