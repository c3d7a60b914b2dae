"""One SDO channel of a client: two identifiers, one transfer at a time, and counters of received frames.

        client  -- 600h+n -->  server of node n        [CiA 301, default SDO]
                <-- 580h+n --

A device may have further servers with their own channels; objects 1201h to 127Fh give their identifiers (`cob_ids`).

Frames that are not the response to the present request are normal, and counted in `ChannelCounters`. A bus that passes
a channel only its own frames gives it a `node_monitor`, from which a time-out is explained with what the node sent
before.

After a time-out the channel waits until `quiet_until`, one more time-out, before the next request, so that a late
response is not taken for the response to that one.

Depends on: messages, times passed in. Used by: transfers, the CAN bus, which keeps one for each node.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

from barewire.canopen.cob_ids import CobEntry, classify, cob_id
from barewire.canopen.frame import CanFrame
from barewire.canopen.nmt.heartbeat import NodeState
from barewire.canopen.nmt.messages import NmtState
from barewire.canopen.nmt.node_monitor import NodeMonitor, TrafficMark
from barewire.canopen.sdo.dialect import STANDARD, SdoDialect
from barewire.canopen.sdo.messages.codec import M, decode_one_of, is_any_response
from barewire.canopen.sdo.messages.initiate import ExpeditedUpload
from barewire.conversation import Conversation, Heard, Listen
from barewire.errors import DecodeError, EncodeError

_BACKLOG = 0.1
"""Seconds that reading the waiting frames may take at most, on a bus that is never silent."""

_PAST = float("-inf")


@dataclass(slots=True)
class ChannelCounters:
    """Counts of the frames that a client received while it waited; they explain a time-out."""

    answers: int = 0  # frames on the response identifier of this channel
    others: int = 0  # frames on other identifiers
    signs: int = 0  # of these: sent by the node of this channel
    late: int = 0  # of `answers`: responses to an earlier request
    garbled: int = 0  # of `answers`: cannot be decoded
    short: int = 0  # of `answers`: decoded, with fewer than 8 bytes
    unsized: int = 0  # of `answers`: 42h, a value without its size
    extended: int = 0  # extended frames with the number of the response identifier
    state: NodeState | None = None  # the last heartbeat of the node

    @property
    def frames(self) -> int:
        """All frames received."""
        return self.answers + self.others

    @property
    def from_node(self) -> int:
        """Frames from the node, on any of its identifiers."""
        return self.answers + self.signs

    def explain(self, node: int, answer_id: int) -> str:
        """Return the counters as one sentence."""
        if not self.frames:
            return "no frame was received on the bus"
        parts = [f"received {_count(self.frames, 'frame')}", f"{self.from_node or 'none'} from node {node}"]
        if self.state is not None:
            stopped = ", and a stopped node answers no SDO" if self.state.state == NmtState.STOPPED else ""
            parts.append(f"its heartbeat reports {self.state.name}{stopped}")
        parts.append(f"{self.answers or 'none'} on {answer_id:03X}h")
        parts += self.oddities()
        if self.extended:
            parts.append(f"{_count(self.extended, 'extended frame')} {answer_id:08X}h, which is another identifier")
        return ", ".join(parts)

    def oddities(self) -> list[str]:
        """Return what arrived on the channel itself and was not the response."""
        parts = []
        if self.late:
            parts.append(f"{_count(self.late, 'response')} to another request")
        if self.garbled:
            parts.append(f"{self.garbled} unreadable")
        return parts

    def add(self, other: ChannelCounters) -> None:
        """Add the counters of `other`, and take over its state, which is the later one."""
        for name in _COUNTERS:
            setattr(self, name, getattr(self, name) + getattr(other, name))
        self.state = other.state


_COUNTERS = tuple(field.name for field in fields(ChannelCounters) if field.name != "state")


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


class Channel:
    """The client's end of one SDO channel.

    Keep one for each node and pass it to every transfer: it records that the last one timed out. `counters` counts
    during the present transfer, `total` has the sums of the ones before.

    >>> channel = Channel(5)
    >>> f"{channel.request_id:X}h {channel.answer_id:X}h"
    '605h 585h'
    """

    __slots__ = (
        "_mark",
        "answer_extended",
        "answer_id",
        "blocks",
        "busy",
        "counters",
        "dialect",
        "node",
        "node_monitor",
        "quiet_until",
        "request_extended",
        "request_id",
        "total",
    )

    def __init__(
        self,
        node: int,
        dialect: SdoDialect = STANDARD,
        *,
        cob_ids: tuple[CobEntry, CobEntry] | None = None,
        node_monitor: NodeMonitor | None = None,
    ) -> None:
        self.node = node
        self.dialect = dialect
        self.request_id = cob_id("SDO request", node)
        self.answer_id = cob_id("SDO answer", node)
        self.request_extended = self.answer_extended = False
        if cob_ids is not None:
            self.request_id, self.request_extended = cob_ids[0][:2]
            self.answer_id, self.answer_extended = cob_ids[1][:2]
        self.node_monitor = node_monitor
        self._mark: TrafficMark | None = None
        self.blocks = True  # False once the server has refused: then `block="auto"` does not ask again
        self.quiet_until: float | None = None
        self.busy = False
        self.counters = ChannelCounters()
        self.total = ChannelCounters()

    def receive(self, frame: CanFrame) -> bytes | None:
        """Count a frame, and return its data if it is on the response identifier."""
        if frame.id != self.answer_id or frame.extended != self.answer_extended or frame.remote:
            self._count_other(frame)
            return None
        self.counters.answers += 1
        return frame.data

    def decode(self, data: bytes, wanted: tuple[type[M], ...]) -> M | None:
        """Return the message, if it is of a wanted kind; otherwise None, counted as late or garbled."""
        counters = self.counters
        try:
            message = decode_one_of(data, wanted)
        except DecodeError:
            if is_any_response(data):
                counters.late += 1
            else:
                counters.garbled += 1
            return None
        counters.short += len(data) < 8
        counters.unsized += isinstance(message, ExpeditedUpload) and not message.indicated
        return message

    def _count_other(self, frame: CanFrame) -> None:
        self.counters.others += 1
        self.counters.extended += frame.extended and not self.answer_extended and frame.id == self.answer_id
        owner = classify(frame)
        if owner is None or owner[1] != self.node or not owner[0].from_device or frame.remote:
            return
        self.counters.signs += 1
        if owner[0].name == "error control" and frame.data:
            self.counters.state = NodeState.decode(frame)

    def begin(self, what: str) -> None:
        """Begin a transfer: the counters go into `total` and restart; the last heartbeat remains.

        Raise EncodeError while another transfer runs.
        """
        if self.busy:
            raise EncodeError(f"{what} must wait: the SDO channel to node {self.node} carries one transfer at a time")
        self.total.add(self.counters)
        self.counters = ChannelCounters(state=self.counters.state)
        self._mark = None if self.node_monitor is None else self.node_monitor.mark(self.answer_id)
        self.busy = True

    def explain(self, now: float) -> str:
        """Return the received frames in words, as an explanation of why there was no response."""
        if self.node_monitor is None or self._mark is None:
            return self.counters.explain(self.node, self.answer_id)
        monitor, answers = self.node_monitor, self.counters.answers
        text = monitor.explain_silence(self.node, self.answer_id, self._mark, now, answers=answers)
        return ", ".join([text, *self.counters.oddities()])

    def settle(self) -> Conversation[CanFrame, None]:
        """Before a transfer: discard the frames that wait, and after a time-out those that come until `quiet_until`."""
        quiet = _PAST if self.quiet_until is None else self.quiet_until
        end: float | None = None
        while True:
            heard: Heard[CanFrame] = yield Listen(quiet)
            end = max(quiet, heard.now + _BACKLOG) if end is None else end
            if heard.item is not None:
                self.counters.late += self.receive(heard.item) is not None
            if (heard.item is None and heard.now >= quiet) or heard.now >= end:
                break
        self.quiet_until = None


def channel_to(node: int | Channel, dialect: SdoDialect | None) -> Channel:
    """Return the given channel, or one to the default server of a node. Raise EncodeError if the dialects differ."""
    if isinstance(node, int):
        return Channel(node, STANDARD if dialect is None else dialect)
    if dialect is not None and dialect != node.dialect:
        raise EncodeError(
            f"the channel to node {node.node} has the SDO dialect {node.dialect.name}, not {dialect.name}"
        )
    return node
