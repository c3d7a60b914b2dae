"""Many nodes on one bus as one machine: each frame goes only to the nodes that use its identifier.

        frame ---> identifier ---> nodes that receive it               the frames of a node go to the bus, and to the
                   000h  NMT       all                                 other nodes of the group that receive them
                   080h  SYNC      those whose 1005h is 80h
                   201h  RPDO      those with an RPDO of this COB-ID       node 1 --- 181h ---> bus
                   605h  SDO       node 5                                               '-----> node 2, if an RPDO of
                   705h            node 5, and those that monitor it by 1016h                   it has COB-ID 181h

Without a group a simulation of 127 nodes feeds every frame to 127 machines, and 126 of them ignore it. What a node
receives is `LocalNode.receives`, which follows its objects: an SDO that moves an RPDO, SYNC or SDO channel to another
identifier moves it here too. Other machines, which do not say what they receive, are fed every frame.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from typing import Any

from barewire._callbacks import check_callbacks
from barewire.canopen.cob_ids import check_node
from barewire.canopen.frame import CanFrame
from barewire.errors import EncodeError, shown

SWEEP_TIME = 0.1
"""Seconds after which each node is fed the time at the latest, because the application may have changed its values."""

_NEVER = float("inf")
_NOTHING: frozenset[tuple[int, bool]] = frozenset()


class _Member:
    """A node of the group, and what is known of it: its identifiers (None: all), and when it is due."""

    __slots__ = ("due", "is_stated", "keys", "machine", "name", "on_failure", "place")

    def __init__(self, machine: Any, place: int) -> None:
        self.machine = machine
        self.place = place
        self.name = f"node {getattr(machine, 'node', None) or place + 1}"
        self.is_stated = hasattr(type(machine), "receives")  # of the class: the property of a node may raise
        self.keys: frozenset[tuple[int, bool]] | None = _NOTHING
        self.due = _NEVER
        self.on_failure: Any = None  # the node's own, while the group has one


class NodeGroup:
    """Many nodes on one bus. A machine: frames and time in, frames out, as `LocalNode` is one.

        nodes        the nodes: `LocalNode`s, or other machines with feed and deadline
        on_failure   called as on_failure("node 5: SDO", error) for an error in the code of a node; the other nodes are
                     not affected. Without it the error is raised

    A frame that a node sends is fed to the other nodes of the group at the next `feed`, which is due at once. Frames
    that the application makes itself, such as those of `LocalNode.error`, reach them by `sent`.

    A node does not receive heartbeats of nodes that it does not monitor by 1016h.

    >>> from barewire.canopen import Entry, LocalNode, ObjectDictionary
    >>> group = NodeGroup(LocalNode(n, ObjectDictionary([Entry(0x1000, 0, "type", "u32", "ro", n)])) for n in (5, 6))
    >>> [str(frame) for frame in group.start(0.0)]
    ['705#00', '706#00']
    >>> [str(frame) for frame in group.feed(CanFrame.parse("606#4000100000000000"), 0.1)]
    ['586#4300100006000000']
    """

    def __init__(self, nodes: Iterable[Any], *, on_failure: Callable[[str, Exception], None] | None = None) -> None:
        self.nodes = tuple(nodes)
        """The nodes, in the order in which they are fed."""
        numbers = set()
        for machine in self.nodes:
            if isinstance(machine, type) or not (hasattr(machine, "feed") and hasattr(machine, "deadline")):
                text = "expected a LocalNode, or another machine with feed and deadline"
                raise EncodeError(f"NodeGroup: {shown(machine)}: {text}", "nodes")
            number = getattr(machine, "node", None)
            if isinstance(number, int) and number in numbers:
                raise EncodeError(f"NodeGroup: node {number} is there twice: expected each node-ID once", "nodes")
            numbers.add(number)
        self._members = [_Member(machine, place) for place, machine in enumerate(self.nodes)]
        self._listeners: dict[tuple[int, bool], list[_Member]] = {}
        self._promiscuous: list[_Member] = []
        self._own: deque[tuple[CanFrame, _Member]] = deque()  # frames of nodes that others of the group receive
        self._sweep_at = -_NEVER
        self._on_failure: Callable[[str, Exception], None] | None = None
        self.on_failure = on_failure
        for member in self._members:
            self._follow(member)

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {len(self.nodes)} nodes>"

    def node(self, number: int) -> Any:
        """Return the node with this node-ID. Raise EncodeError if there is none."""
        check_node(number)
        for machine in self.nodes:
            if getattr(machine, "node", None) == number:
                return machine
        raise EncodeError(f"node {number} is not in the group of {len(self.nodes)} nodes")

    @property
    def on_failure(self) -> Callable[[str, Exception], None] | None:
        """Called with each error in the code of a node."""
        return self._on_failure

    @on_failure.setter
    def on_failure(self, function: Callable[[str, Exception], None] | None) -> None:
        check_callbacks("NodeGroup", on_failure=function)
        if self._on_failure is not None:
            for member in self._reporting():
                member.machine.on_failure, member.on_failure = member.on_failure, None
        self._on_failure = function
        if function is not None:
            for member in self._reporting():
                member.on_failure = member.machine.on_failure
                member.machine.on_failure = _reporter(self, member)

    def _reporting(self) -> list[_Member]:
        return [member for member in self._members if hasattr(member.machine, "on_failure")]

    def report_failure(self, member: _Member, place: str, error: Exception) -> None:
        """Report an error of a node to its own `on_failure` and to that of the group; without one it is raised."""
        if member.on_failure is not None:
            member.on_failure(place, error)
        if self._on_failure is None:
            raise error
        self._on_failure(f"{member.name}: {place}", error)

    @property
    def deadline(self) -> float | None:
        """When the next node is due, or another one is to be fed a frame of the group."""
        if self._own:
            return -_NEVER
        return min(self._sweep_at, min((member.due for member in self._members), default=_NEVER))

    def start(self, now: float) -> list[CanFrame]:
        """Power on all nodes, and return their boot-up messages."""
        return self._each("start", now)

    def bus_off(self, now: float) -> None:
        """Tell all nodes that the CAN controller is bus-off."""
        self._each("bus_off", now)

    def recovered(self, now: float) -> list[CanFrame]:
        """Tell all nodes that the CAN controller has recovered, and return their emergencies."""
        return self._each("recovered", now)

    def _each(self, method: str, now: float) -> list[CanFrame]:
        frames: list[CanFrame] = []
        for member in self._members:
            call = getattr(member.machine, method, None)
            if call is not None:
                self._take(member, call(now) or (), frames)
                self._follow(member)
        return frames

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        """Return the frames that the nodes send after a frame, or after time passing."""
        frames: list[CanFrame] = []
        own, self._own = (
            self._own,
            deque(),
        )  # what is sent in answer to them waits for the next feed, or it might never end
        for sent, sender in own:
            self._deliver(sent, sender, now, frames)
        if frame is not None:
            self._deliver(frame, None, now, frames)
        if now >= self._sweep_at:
            self._sweep_at = now + SWEEP_TIME
            for member in self._members:
                self._feed(member, None, now, frames)
        else:
            for member in self._members:
                if member.due <= now:
                    self._feed(member, None, now, frames)
        return frames

    def sent(self, node: int, frames: Iterable[CanFrame]) -> list[CanFrame]:
        """Return frames that the application lets a node send, and feed them to the other nodes at the next `feed`.

        server.do(lambda now: group.sent(5, group.node(5).error(0x4210, now)))
        """
        machine, output = self.node(node), list[CanFrame]()
        member = next(member for member in self._members if member.machine is machine)
        self._take(member, frames, output)
        self._follow(member)
        return output

    def _deliver(self, frame: CanFrame, sender: _Member | None, now: float, frames: list[CanFrame]) -> None:
        listeners = self._listeners.get((frame.id, frame.extended), ())
        for member in (*listeners, *self._promiscuous):
            if member is not sender:
                self._feed(member, frame, now, frames)

    def _feed(self, member: _Member, frame: CanFrame | None, now: float, frames: list[CanFrame]) -> None:
        try:
            sent = member.machine.feed(frame, now)
        except Exception as error:
            self.report_failure(member, f"{type(member.machine).__name__}.feed", error)
            return
        if sent:
            self._take(member, sent, frames)
        self._follow(member)

    def _take(self, member: _Member, sent: Iterable[CanFrame], frames: list[CanFrame]) -> None:
        """Add the frames that a node sends to `frames`, and keep those that other nodes of the group receive."""
        for frame in sent:
            frames.append(frame)
            listeners = self._listeners.get((frame.id, frame.extended), ())
            if self._promiscuous or (len(listeners) - (member in listeners) if listeners else 0):
                self._own.append((frame, member))

    def _follow(self, member: _Member) -> None:
        """Take over when a node is due, and what it receives."""
        try:
            due = member.machine.deadline
            keys = member.machine.receives if member.is_stated else None
        except Exception as error:
            self.report_failure(member, f"{type(member.machine).__name__}.deadline", error)
            return
        member.due = _NEVER if due is None else due
        if keys is member.keys or keys == member.keys:
            return
        before, member.keys = member.keys, keys
        if before is None:
            self._promiscuous.remove(member)
        for key in (before or _NOTHING) - (keys or _NOTHING):
            self._listeners[key].remove(member)
        # Sorted, so that the order in which nodes answer a frame does not depend on when they were configured.
        for key in (keys or _NOTHING) - (before or _NOTHING):
            self._listeners[key] = sorted([*self._listeners.get(key, ()), member], key=_place)
        if keys is None:
            self._promiscuous = sorted([*self._promiscuous, member], key=_place)


def _place(member: _Member) -> int:
    return member.place


def _reporter(group: NodeGroup, member: _Member) -> Callable[[str, Exception], None]:
    return lambda place, error: group.report_failure(member, place, error)
