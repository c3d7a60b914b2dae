"""One SDO channel as a client has it: two identifiers, one transfer at a time, and what was heard.

        client  -- 600h+n -->  server of node n        [CiA 301, default SDO]
                <-- 580h+n --

`ask` is the turn of talk under every transfer: one frame out, one answer to *this* question back. Everything else that
comes meanwhile is not an error but weather, and is counted in `Hearing`:

    foreign    other identifiers, extended frames, remote frames: somebody else's talk
    late       an answer on our identifier to an earlier question (another object, another service)
    garbled    something on our identifier that cannot be read

A write is never said twice on its own account: when the time is up nobody knows whether the first one arrived. The
last word is an abort with the object of the transfer, and then the channel stays `quiet_until` one more time-out has
passed, so that a late answer cannot become the answer to the next question.

I know: one node, one question, one answer.  I never know: clocks, buses, what an object means.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TypeVar

from barewire.canopen.cob import classify, cob_id
from barewire.canopen.frame import CanFrame
from barewire.canopen.heartbeat import NodeState
from barewire.canopen.nmt import NmtState
from barewire.canopen.sdo.aborts import AbortCode, SdoAbort
from barewire.canopen.sdo.dialect import STANDARD, Dialect
from barewire.canopen.sdo.messages import Abort, Answer, ExpeditedUpload, InitiateUpload, Request, decode_answer
from barewire.conversation import Abandoned, Conversation, Heard, Listen, Send
from barewire.errors import DecodeError, EncodeError, NoAnswer

Wanted = TypeVar("Wanted", bound=Answer)
"""The answers that a question is waiting for."""


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

    def note(self, frame: CanFrame) -> Answer | None:
        """Count a frame; an answer on this channel is returned, whatever it answers."""
        heard = self.heard
        heard.frames += 1
        if frame.key != (self.answer_id, False) or frame.remote:
            self._note_foreign(frame)
            return None
        heard.from_node += 1
        heard.answers += 1
        try:
            answer = decode_answer(frame.data)
        except DecodeError:
            heard.garbled += 1
            return None
        heard.short += len(frame.data) < 8
        heard.unsized += isinstance(answer, ExpeditedUpload) and not answer.indicated
        return answer

    def _note_foreign(self, frame: CanFrame) -> None:
        self.heard.extended += frame.extended and frame.id == self.answer_id
        owner = classify(frame)
        if owner is None or owner[1] != self.node or not owner[0].from_device or frame.remote:
            return
        self.heard.from_node += 1
        if owner[0].name == "error control" and frame.data:
            self.heard.state = NodeState.decode(frame)

    def _begin(self, request: Request) -> None:
        """A new transfer: what the last one heard goes into the total. The heartbeat stays, it is still the last."""
        if self.busy:
            what = f"{request.index:04X}h:{request.sub:02X}"
            raise EncodeError(f"{what} has to wait: the SDO channel to node {self.node} carries one transfer at a time")
        for name in _COUNTERS:
            setattr(self.total, name, getattr(self.total, name) + getattr(self.heard, name))
        self.total.state = self.heard.state
        self.heard = Hearing(state=self.heard.state)
        self.busy = True

    def _abort(self, request: Request, code: int) -> Send[CanFrame]:
        return Send(CanFrame(self.request_id, Abort(request.index, request.sub, code).encode()))

    def settle(self) -> Conversation[CanFrame, None]:
        """After a time-out: listen until late answers have had their time, and count them."""
        while self.quiet_until is not None:
            heard: Heard[CanFrame] = yield Listen(self.quiet_until)
            if heard.item is not None:
                self.heard.late += self.note(heard.item) is not None
            if heard.item is None or heard.now >= self.quiet_until:
                self.quiet_until = None

    def ask(self, request: Request, wanted: tuple[type[Wanted], ...], timeout: float) -> Conversation[CanFrame, Wanted]:
        """Say one request and return the answer to it: one of the `wanted` types, about the same object.

        Raises SdoAbort if the server aborts (whatever object the abort names) and NoAnswer when the time is up;
        abandoned, it says an abort as its last word.
        """
        self._begin(request)
        try:
            yield from self.settle()
            return (yield from self._turn(request, wanted, timeout))
        finally:
            self.busy = False

    def _turn(
        self, request: Request, wanted: tuple[type[Wanted], ...], timeout: float
    ) -> Conversation[CanFrame, Wanted]:
        until: float | None = None
        try:
            sent: Heard[CanFrame] = yield Send(CanFrame(self.request_id, request.encode()))
            until = sent.now + timeout
            while True:
                heard: Heard[CanFrame] = yield Listen(until)
                if heard.item is not None:
                    answer = self.note(heard.item)
                    if isinstance(answer, Abort):
                        raise SdoAbort(answer.code, request.index, request.sub, (answer.index, answer.sub))
                    if isinstance(answer, wanted) and (answer.index, answer.sub) == (request.index, request.sub):
                        return answer
                    self.heard.late += answer is not None
                # A bus that never falls silent must not keep us past the time either.
                if heard.item is None or heard.now >= until:
                    break
        except Abandoned:
            # The server must not be left waiting, and its answer must not be taken for that of the next transfer.
            self.quiet_until = until
            yield self._abort(request, AbortCode.GENERAL)
            raise
        self.quiet_until = heard.now + timeout
        yield self._abort(request, AbortCode.TIMED_OUT)
        what = f"the {_verb(request)} of {request.index:04X}h:{request.sub:02X}"
        evidence = self.heard.explain(self.node, self.answer_id)
        raise NoAnswer(f"node {self.node} did not answer {what} within {timeout:g} s: {evidence}")

    def refuse(self, request: Request, code: int) -> Conversation[CanFrame, None]:
        """Tell the server that we do not go on with this transfer."""
        yield self._abort(request, code)


def _verb(request: Request) -> str:
    return "upload" if isinstance(request, InitiateUpload) else "download"


def channel_to(node: int | Channel, dialect: Dialect | None) -> Channel:
    """The channel that was given, which has its dialect, or a fresh one to the default server of a node."""
    if isinstance(node, int):
        return Channel(node, STANDARD if dialect is None else dialect)
    if dialect is not None and dialect != node.dialect:
        raise EncodeError(f"the channel to node {node.node} speaks {node.dialect.name}, not {dialect.name}")
    return node
