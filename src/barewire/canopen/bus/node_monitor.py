"""Who was heard on a bus, and when: what is known of a node before anybody asks it anything.

        705#7F          node 5 was heard, and is pre-operational
        185#...         node 5 was heard
        605#...         somebody spoke to node 5: no sign of it

One dictionary entry for each identifier, the last frame and how often it came. Read out only when somebody wants to
know why nothing answered, so listening costs next to nothing. Of extended identifiers only those are kept whose number
could be taken for one of ours; the others are counted, so a foreign protocol does not fill the memory.
"""

from __future__ import annotations

from typing import NamedTuple

from barewire.canopen.cob_ids import NODE_MAX, NODE_MIN, SERVICES, check_node
from barewire.canopen.frame import BASE_MAX, CanFrame, ErrorFrame
from barewire.canopen.nmt.heartbeat import NodeState
from barewire.canopen.nmt.messages import NmtState
from barewire.errors import DecodeError

SHOWN = 5
"""How many of those that were heard are named where the one that is wanted was not."""
_OF_DEVICES = tuple(service.base for service in SERVICES if service.from_device and not service.broadcast)
RECENT = 10.0
"""Seconds for which a report of the controller is worth telling."""


class TrafficMark(NamedTuple):
    """A moment in what was heard, to count from."""

    frames: int
    extended: int  # with the number of the answer identifier


class NodeMonitor:
    """Listens to everybody. A machine without events: it is asked.

    >>> monitor = NodeMonitor()
    >>> mark = monitor.mark(0x585)
    >>> monitor.feed(CanFrame.parse("705#7F"), 1.0)
    []
    >>> monitor.explain_silence(5, 0x585, mark, 4.0, answers=0)
    'node 5 last heard 3 s ago, pre-operational, 0 frames on 585h, 1 frame on the bus meanwhile'
    """

    __slots__ = ("_base", "_extended", "error", "error_at", "foreign", "frames")

    def __init__(self) -> None:
        self.frames = 0
        self.foreign = 0  # extended frames whose number is none of ours
        self.error: ErrorFrame | None = None
        self.error_at = 0.0
        self._base: dict[int, tuple[int, float, CanFrame]] = {}  # at most 2048
        self._extended: dict[int, int] = {}  # at most 2048

    @property
    def deadline(self) -> float | None:
        """None: it waits for nothing."""
        return None

    def feed(self, frame: CanFrame | None, now: float) -> list[None]:
        """One frame more."""
        if frame is None:
            return []
        self.frames += 1
        identifier = frame.id
        if not frame.extended:
            known = self._base.get(identifier)
            self._base[identifier] = (1 if known is None else known[0] + 1, now, frame)
        elif identifier <= BASE_MAX:
            self._extended[identifier] = self._extended.get(identifier, 0) + 1
        else:
            self.foreign += 1
        return []

    def report(self, error: ErrorFrame, now: float) -> None:
        """The controller said something about the bus."""
        self.error, self.error_at = error, now

    def count(self, identifier: int) -> int:
        """How many base frames with this identifier were heard."""
        known = self._base.get(identifier)
        return 0 if known is None else known[0]

    def last_heard(self, node: int) -> float | None:
        """When the node said anything on an identifier of the predefined connection set; None if it never did."""
        times = [self._base[base + node][1] for base in _OF_DEVICES if base + node in self._base]
        return max(times, default=None)

    def nodes(self) -> list[int]:
        """Who has said anything on an identifier of the predefined connection set."""
        return [
            node for node in range(NODE_MIN, NODE_MAX + 1) if any(base + node in self._base for base in _OF_DEVICES)
        ]

    def state(self, node: int) -> NodeState | None:
        """What the node said last of its own state."""
        known = self._base.get(0x700 + check_node(node))
        try:
            return None if known is None else NodeState.decode(known[2])
        except DecodeError:
            return None

    def mark(self, answer_id: int) -> TrafficMark:
        """The counts as they are now."""
        return TrafficMark(self.frames, self._extended.get(answer_id, 0))

    def explain_silence(self, node: int, answer_id: int, since: TrafficMark, now: float, *, answers: int) -> str:
        """Why a node may have been silent: everything that was heard, in one sentence. `answers` is how many frames
        came on `answer_id` since then."""
        frames = self.frames - since.frames
        last, state = self.last_heard(node), self.state(node)
        said = []
        if last is None:
            others = self.nodes()
            more = ", ..." if len(others) > SHOWN else ""
            hint = f" (heard so far: node {', '.join(map(str, others[:SHOWN]))}{more})" if others else ""
            said.append(f"node {node} was never heard{hint}")
        else:
            said.append(f"node {node} last heard {_seconds(now - last)} ago")
        if state is not None:
            stopped = ", and a stopped node answers no SDO" if state.state == NmtState.STOPPED else ""
            said.append(("booting" if state.is_boot_up else state.name) + stopped)
        said.append(f"{_frames(answers)} on {answer_id:03X}h")
        extended = self._extended.get(answer_id, 0) - since.extended
        if extended:
            said.append(f"{_frames(extended)} on extended {answer_id:08X}h, which is another identifier")
        said.append(f"{_frames(frames) if frames else 'nothing at all'} on the bus meanwhile")
        if self.error is not None and now - self.error_at < RECENT:
            said.append(f"the controller reported {self.error.text} {_seconds(now - self.error_at)} ago")
        return ", ".join(said)


def _frames(number: int) -> str:
    return f"{number} frame" if number == 1 else f"{number} frames"


def _seconds(seconds: float) -> str:
    return f"{max(seconds, 0.0):.3g} s"
