"""One SDO channel as a client has it: two identifiers, one transfer at a time, and what was heard.

        client  -- 600h+n -->  server of node n        [CiA 301, default SDO]
                <-- 580h+n --

A server may have more channels than the default one, on identifiers that its objects 1201h to 127Fh tell: `cob_ids`.

Everything that comes and is no answer to the question of the moment is not an error but weather, and is counted in
`ChannelCounters`. A channel whose shell hears the whole bus and gives the channel only its own frames says so with
`node_monitor`: then a time-out is explained with what was heard of the node before.

After a time-out the channel stays `quiet_until` one more time-out has passed, so that a late answer cannot become the
answer to the next question.

I know: one node, what is heard of it.  I never know: clocks, buses, what an object means, how a transfer goes.
"""

from __future__ import annotations

from barewire.canopen.bus.node_monitor import NodeMonitor, TrafficMark
from barewire.canopen.cob_ids import CobEntry, classify, cob_id
from barewire.canopen.frame import CanFrame
from barewire.canopen.nmt.heartbeat import NodeState
from barewire.canopen.sdo.client.channel_counters import ChannelCounters
from barewire.canopen.sdo.dialect import STANDARD, SdoDialect
from barewire.canopen.sdo.messages.codec import M, decode_one_of, is_any_response
from barewire.canopen.sdo.messages.initiate import ExpeditedUpload
from barewire.conversation import Conversation, Heard, Listen
from barewire.errors import DecodeError, EncodeError

BACKLOG = 0.1
"""Seconds that reading what waited may take at most, on a bus that never falls silent."""

_PAST = float("-inf")


class Channel:
    """The client's side of one SDO channel.

    Keep one for each node and give it to every transfer: it remembers that the last one timed out, and counts.
    `total` sums up over all transfers what `ChannelCounters` counts in one.

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
    )  # fmt: skip

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
        self.blocks = True  # until the server says that it has none: then `block="auto"` does not ask again
        self.quiet_until: float | None = None
        self.busy = False
        self.counters = ChannelCounters()
        self.total = ChannelCounters()

    def hear(self, frame: CanFrame) -> bytes | None:
        """Count a frame; what is said on this channel is returned, whatever it says."""
        if frame.id != self.answer_id or frame.extended != self.answer_extended or frame.remote:
            self._note_foreign(frame)
            return None
        self.counters.answers += 1
        return frame.data

    def understand(self, data: bytes, wanted: tuple[type[M], ...]) -> M | None:
        """The message, if it is of a wanted kind; otherwise it is counted as late or garbled."""
        heard = self.counters
        try:
            message = decode_one_of(data, wanted)
        except DecodeError:
            if is_any_response(data):
                heard.late += 1
            else:
                heard.garbled += 1
            return None
        heard.short += len(data) < 8
        heard.unsized += isinstance(message, ExpeditedUpload) and not message.indicated
        return message

    def _note_foreign(self, frame: CanFrame) -> None:
        self.counters.others += 1
        self.counters.extended += frame.extended and not self.answer_extended and frame.id == self.answer_id
        owner = classify(frame)
        if owner is None or owner[1] != self.node or not owner[0].from_device or frame.remote:
            return
        self.counters.signs += 1
        if owner[0].name == "error control" and frame.data:
            self.counters.state = NodeState.decode(frame)

    def begin(self, what: str) -> None:
        """A new transfer: what the last one heard goes into the total. The heartbeat stays, it is still the last."""
        if self.busy:
            raise EncodeError(f"{what} has to wait: the SDO channel to node {self.node} carries one transfer at a time")
        self.total.add(self.counters)
        self.counters = ChannelCounters(state=self.counters.state)
        self._mark = None if self.node_monitor is None else self.node_monitor.mark(self.answer_id)
        self.busy = True

    def explain(self, now: float) -> str:
        """Why there was no answer, as far as what was heard tells."""
        if self.node_monitor is None or self._mark is None:
            return self.counters.explain(self.node, self.answer_id)
        told = self.node_monitor.explain_silence(
            self.node, self.answer_id, self._mark, now, answers=self.counters.answers
        )
        return ", ".join([told, *self.counters.oddities()])

    def settle(self) -> Conversation[CanFrame, None]:
        """Before a transfer: what is still waiting to be heard is the answer to nothing; after a time-out, so is what
        comes until late answers have had their time."""
        quiet = _PAST if self.quiet_until is None else self.quiet_until
        end: float | None = None
        while True:
            heard: Heard[CanFrame] = yield Listen(quiet)
            end = max(quiet, heard.now + BACKLOG) if end is None else end
            if heard.item is not None:
                self.counters.late += self.hear(heard.item) is not None
            if (heard.item is None and heard.now >= quiet) or heard.now >= end:
                break
        self.quiet_until = None


def channel_to(node: int | Channel, dialect: SdoDialect | None) -> Channel:
    """The channel that was given, which has its dialect, or a fresh one to the default server of a node."""
    if isinstance(node, int):
        return Channel(node, STANDARD if dialect is None else dialect)
    if dialect is not None and dialect != node.dialect:
        raise EncodeError(f"the channel to node {node.node} speaks {node.dialect.name}, not {dialect.name}")
    return node
