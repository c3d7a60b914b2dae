"""One SDO channel as a client has it: two identifiers, one transfer at a time, and what was heard.

        client  -- 600h+n -->  server of node n        [CiA 301, default SDO]
                <-- 580h+n --

Everything that comes and is no answer to the question of the moment is not an error but weather, and is counted in
`Hearing`:

    foreign    other identifiers, extended frames, remote frames: somebody else's talk
    late       an answer on our identifier to an earlier question (another object, another service)
    garbled    something on our identifier that cannot be read

After a time-out the channel stays `quiet_until` one more time-out has passed, so that a late answer cannot become the
answer to the next question.

I know: one node, what is heard of it.  I never know: clocks, buses, what an object means, how a transfer goes.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

from barewire.canopen.cob import classify, cob_id
from barewire.canopen.frame import CanFrame
from barewire.canopen.heartbeat import NodeState
from barewire.canopen.nmt import NmtState
from barewire.canopen.sdo.dialect import STANDARD, Dialect
from barewire.canopen.sdo.initiate_messages import ExpeditedUpload
from barewire.canopen.sdo.messages import M, may_be_late, read
from barewire.conversation import Conversation, Heard, Listen
from barewire.errors import DecodeError, EncodeError


@dataclass(slots=True)
class Hearing:
    """What was heard while waiting: the counters, and the evidence that a time-out is explained with."""

    frames: int = 0  # of any kind
    from_node: int = 0  # sent by the node, on any of its identifiers
    answers: int = 0  # on the answer identifier of this channel
    late: int = 0  # of these: to another question
    garbled: int = 0  # of these: unreadable
    short: int = 0  # of these: read, although with fewer than 8 bytes
    unsized: int = 0  # of these: 42h, a value without its size
    extended: int = 0  # with the number of our answer identifier, but extended: not ours
    state: NodeState | None = None  # the last heartbeat of the node

    def explain(self, node: int, answer_id: int) -> str:
        """The evidence in one sentence."""
        if not self.frames:
            return "nothing at all was heard on the bus"
        said = [f"heard {_count(self.frames, 'frame')}", f"{self.from_node or 'none'} from node {node}"]
        if self.state is not None:
            stopped = ", and a stopped node answers no SDO" if self.state.state == NmtState.STOPPED else ""
            said.append(f"its heartbeat says {self.state.name}{stopped}")
        said.append(f"{self.answers or 'none'} on {answer_id:03X}h")
        if self.late:
            said.append(f"{_count(self.late, 'answer')} to another question")
        if self.garbled:
            said.append(f"{self.garbled} unreadable")
        if self.extended:
            said.append(f"{_count(self.extended, 'extended frame')} {answer_id:08X}h, which is another identifier")
        return ", ".join(said)


BACKLOG = 0.1
"""Seconds that reading what waited may take at most, on a bus that never falls silent."""

_PAST = float("-inf")
_COUNTERS = tuple(field.name for field in fields(Hearing) if field.name != "state")


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


class Channel:
    """The client's side of one SDO channel.

    Keep one for each node and give it to every transfer: it remembers that the last one timed out, and counts.
    `total` sums up over all transfers what `Hearing` counts in one.

    >>> channel = Channel(5)
    >>> f"{channel.request_id:X}h {channel.answer_id:X}h"
    '605h 585h'
    """

    __slots__ = ("answer_id", "busy", "dialect", "heard", "node", "quiet_until", "request_id", "total")

    def __init__(self, node: int, dialect: Dialect = STANDARD) -> None:
        self.node = node
        self.dialect = dialect
        self.request_id = cob_id("SDO request", node)
        self.answer_id = cob_id("SDO answer", node)
        self.quiet_until: float | None = None
        self.busy = False
        self.heard = Hearing()
        self.total = Hearing()

    def hear(self, frame: CanFrame) -> bytes | None:
        """Count a frame; what is said on this channel is returned, whatever it says."""
        heard = self.heard
        heard.frames += 1
        if frame.id != self.answer_id or frame.extended or frame.remote:
            self._note_foreign(frame)
            return None
        heard.from_node += 1
        heard.answers += 1
        return frame.data

    def understand(self, data: bytes, wanted: tuple[type[M], ...]) -> M | None:
        """The message, if it is of a wanted kind; otherwise it is counted as late or garbled."""
        heard = self.heard
        try:
            message = read(data, wanted)
        except DecodeError:
            if may_be_late(data):
                heard.late += 1
            else:
                heard.garbled += 1
            return None
        heard.short += len(data) < 8
        heard.unsized += isinstance(message, ExpeditedUpload) and not message.indicated
        return message

    def _note_foreign(self, frame: CanFrame) -> None:
        self.heard.extended += frame.extended and frame.id == self.answer_id
        owner = classify(frame)
        if owner is None or owner[1] != self.node or not owner[0].from_device or frame.remote:
            return
        self.heard.from_node += 1
        if owner[0].name == "error control" and frame.data:
            self.heard.state = NodeState.decode(frame)

    def begin(self, what: str) -> None:
        """A new transfer: what the last one heard goes into the total. The heartbeat stays, it is still the last."""
        if self.busy:
            raise EncodeError(f"{what} has to wait: the SDO channel to node {self.node} carries one transfer at a time")
        for name in _COUNTERS:
            setattr(self.total, name, getattr(self.total, name) + getattr(self.heard, name))
        self.total.state = self.heard.state
        self.heard = Hearing(state=self.heard.state)
        self.busy = True

    def settle(self) -> Conversation[CanFrame, None]:
        """Before a transfer: what is still waiting to be heard is the answer to nothing; after a time-out, so is what
        comes until late answers have had their time."""
        quiet = _PAST if self.quiet_until is None else self.quiet_until
        end: float | None = None
        while True:
            heard: Heard[CanFrame] = yield Listen(quiet)
            end = max(quiet, heard.now + BACKLOG) if end is None else end
            if heard.item is not None:
                self.heard.late += self.hear(heard.item) is not None
            if (heard.item is None and heard.now >= quiet) or heard.now >= end:
                break
        self.quiet_until = None


def channel_to(node: int | Channel, dialect: Dialect | None) -> Channel:
    """The channel that was given, which has its dialect, or a fresh one to the default server of a node."""
    if isinstance(node, int):
        return Channel(node, STANDARD if dialect is None else dialect)
    if dialect is not None and dialect != node.dialect:
        raise EncodeError(f"the channel to node {node.node} speaks {node.dialect.name}, not {dialect.name}")
    return node
