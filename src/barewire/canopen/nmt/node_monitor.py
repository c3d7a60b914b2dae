"""The node monitor: which nodes sent frames and when, to explain why a node does not respond.

        705#7F          sent by node 5, which is pre-operational
        185#...         sent by node 5
        605#...         sent to node 5: no evidence of it

There is one dictionary entry for each identifier, evaluated only to explain a time-out, so recording a frame costs next
to nothing. Of extended identifiers only those up to 7FFh are kept,
because they are easily mistaken for base identifiers. All others are only counted, so another protocol does not fill
the memory.
"""

from __future__ import annotations

from typing import NamedTuple

from barewire.canopen.cob_ids import NODE_MAX, NODE_MIN, SERVICES, check_node
from barewire.canopen.frame import BASE_MAX, CanFrame, ErrorFrame
from barewire.canopen.nmt.messages import NmtState, NodeState, reported_state

_SHOWN = 5
"""How many other nodes are listed if the wanted one has sent nothing."""
_OF_DEVICES = tuple(service.base for service in SERVICES if service.from_device and not service.broadcast)
_RECENT = 10.0
"""Seconds for which a report of the controller is part of an explanation."""


_new = tuple.__new__


class TrafficMark(NamedTuple):
    """The frame counts at one moment, from which later frames are counted."""

    frames: int
    extended: int  # extended frames with the number of the response identifier


class NodeMonitor:
    """A record of all frames of a bus. A machine without events; its methods evaluate the record.

    >>> monitor = NodeMonitor()
    >>> mark = monitor.mark(0x585)
    >>> monitor.feed(CanFrame.parse("705#7F"), 1.0)
    []
    >>> monitor.explain_silence(5, 0x585, mark, 4.0, responses=0)
    'node 5 last sent a frame 3 s ago, pre-operational, 0 frames on 585h, 1 frame on the bus meanwhile'
    """

    __slots__ = ("_base", "_extended", "_remark", "error", "error_at", "foreign", "frames")
    deadline = None  # nothing is timed

    def __init__(self, remark: str = "") -> None:
        """`remark` is added to the explanation of a bus on which no frame was ever received."""
        self._remark = remark
        self.frames = 0
        self.foreign = 0  # extended frames above 7FFh
        self.error: ErrorFrame | None = None
        self.error_at = 0.0
        self._base: dict[int, tuple[int, float, CanFrame]] = {}  # at most 2048
        self._extended: dict[int, int] = {}  # at most 2048

    def feed(self, frame: CanFrame | None, now: float) -> list[None]:
        """Record a frame. Return an empty list, since there are no events.

        A remote frame only counts: it has no data, and the node that requests an answer sends it.
        """
        if frame is None:
            return []
        self.frames += 1
        if frame.remote:
            return []
        identifier = frame.id
        if not frame.extended:
            record = self._base.get(identifier)
            self._base[identifier] = (1 if record is None else record[0] + 1, now, frame)
        elif identifier <= BASE_MAX:
            self._extended[identifier] = self._extended.get(identifier, 0) + 1
        else:
            self.foreign += 1
        return []

    def report(self, error: ErrorFrame, now: float) -> None:
        """Record a report of the CAN controller."""
        self.error, self.error_at = error, now

    def count(self, identifier: int) -> int:
        """Return the number of base frames with this identifier, without remote frames."""
        record = self._base.get(identifier)
        return 0 if record is None else record[0]

    def last_frame(self, identifier: int, since: float) -> CanFrame | None:
        """Return the last base frame with this identifier if it was received after `since`; None otherwise."""
        record = self._base.get(identifier)
        return None if record is None or record[1] <= since else record[2]

    def last_sent(self, node: int) -> float | None:
        """Return when the node last sent a frame of the predefined connection set; None if never."""
        times = [self._base[base + node][1] for base in _OF_DEVICES if base + node in self._base]
        return max(times, default=None)

    def nodes(self) -> list[int]:
        """Return the nodes that sent frames of the predefined connection set."""
        return [
            node for node in range(NODE_MIN, NODE_MAX + 1) if any(base + node in self._base for base in _OF_DEVICES)
        ]

    def state(self, node: int) -> NodeState | None:
        """Return the last state that the node reported."""
        record = self._base.get(0x700 + check_node(node))
        return None if record is None else reported_state(record[2])

    def unanswered(self, request_id: int, response_id: int) -> float | None:
        """Return when the last SDO request was received, None if a response came after it, or if it needs none.

        An abort does not count as the response, because it may respond to an earlier frame."""
        request, response = self._base.get(request_id), self._base.get(response_id)
        if request is None:
            return None
        if response is not None and response[1] >= request[1] and response[2].data[:1] != b"\x80":
            return None
        data = request[2].data
        return None if len(data) < 8 or data[:1] in (b"\x80", b"\xa1") else request[1]

    def mark(self, response_id: int) -> TrafficMark:
        """Return the present counts, to be given to `explain_silence` later."""
        return _new(TrafficMark, (self.frames, self._extended.get(response_id, 0)))

    def explain_silence(self, node: int, response_id: int, since: TrafficMark, now: float, *, responses: int) -> str:
        """Return a sentence on why a node may not have responded; it sent `responses` frames on `response_id`."""
        frames = self.frames - since.frames
        sent_at, state = self.last_sent(node), self.state(node)
        parts = []
        if sent_at is None:
            others = self.nodes()
            more = ", ..." if len(others) > _SHOWN else ""
            hint = f" (others: node {', '.join(map(str, others[:_SHOWN]))}{more})" if others else ""
            parts.append(f"node {node} has sent no frame{hint}")
        else:
            parts.append(f"node {node} last sent a frame {_seconds(now - sent_at)} ago")
        if state is not None:
            stopped = ", and a stopped node does not answer SDO" if state.state == NmtState.STOPPED else ""
            parts.append(("booting" if state.is_boot_up else state.name) + stopped)
        parts.append(f"{_frames(responses)} on {response_id:03X}h")
        extended = self._extended.get(response_id, 0) - since.extended
        if extended:
            parts.append(f"{_frames(extended)} on extended {response_id:08X}h, which is another identifier")
        parts.append(f"{_frames(frames) if frames else 'nothing at all'} on the bus meanwhile")
        if self._remark and not self.frames:
            parts.append(f"and {self._remark}")
        if self.error is not None and now - self.error_at < _RECENT:
            parts.append(f"the controller reported {self.error.text} {_seconds(now - self.error_at)} ago")
        return ", ".join(parts)


def _frames(number: int) -> str:
    return f"{number} frame" if number == 1 else f"{number} frames"


def _seconds(seconds: float) -> str:
    return f"{max(seconds, 0.0):.3g} s"
