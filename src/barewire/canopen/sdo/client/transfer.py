"""One transfer as a client has it: it asks, it waits, and however it ends, the other side is told.

        asked     request -> ... -> the answer of a wanted kind, about the same object        `ask`
        refused   an abort came, whatever object it names                                     SdoAbort
        broken    the server broke the rules: our abort, with the code that says how          SdoAbort, with `why`
        silent    the time was up: our abort 0504 0000h                                       NoAnswer
        left      abandoned, or our own data or sink failed: our abort 0800 0000h             as it was raised

A request is never said twice on its own account: when the time is up nobody knows whether the first one arrived.

A server that refuses because it was somewhere else (0503 0000h, 0504 0000h, 0504 0001h, 0504 0003h) has heard something
that we did not mean, a frame twice perhaps, and may answer that as well. As after a time-out the channel is quiet for a
time before the next transfer, or this answer would confirm it.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypeVar

from barewire.canopen.frame import CanFrame
from barewire.canopen.sdo.aborts import AbortCode, ProtocolViolation, SdoAbort
from barewire.canopen.sdo.client.channel import Channel
from barewire.canopen.sdo.messages.codec import M, SdoMessage
from barewire.canopen.sdo.messages.initiate import Abort
from barewire.conversation import Conversation, Heard, Listen, Send, SendAll
from barewire.errors import DecodeError, EncodeError, NoAnswer

_Result = TypeVar("_Result")

ABORT = 0x80
# An abort with one of these shows that the server was not where we thought that it is.
_OUT_OF_STEP = frozenset({AbortCode.COMMAND, AbortCode.TOGGLE, AbortCode.SEQUENCE_NUMBER, AbortCode.TIMED_OUT})


class ClientTransfer:
    """One transfer on a channel. `until` is when the present wait ends, None before anything was asked; `now` is the
    time of whatever was sent or heard last."""

    __slots__ = ("channel", "index", "now", "sub", "timeout", "until", "verb")

    def __init__(self, channel: Channel, verb: str, index: int, sub: int, timeout: float) -> None:
        if not timeout >= 0:
            raise EncodeError(f"time-out {timeout} s: expected 0 or more")
        self.channel = channel
        self.verb = verb
        self.index = index
        self.sub = sub
        self.timeout = timeout
        self.now = 0.0
        self.until: float | None = None

    def __str__(self) -> str:
        return f"{self.index:04X}h:{self.sub:02X}"

    def carry_out(self, body: Conversation[CanFrame, _Result]) -> Conversation[CanFrame, _Result]:
        """The whole transfer around its body: one at a time, quiet first, and an end that both sides know of."""
        channel = self.channel
        channel.begin(str(self))
        try:
            yield from channel.settle()
            return (yield from body)
        except SdoAbort as refusal:
            if refusal.code in _OUT_OF_STEP:
                channel.quiet_until = self.now + self.timeout
            raise
        except ProtocolViolation as breach:
            yield from self._end(breach.code)
            if breach.code == AbortCode.TIMED_OUT:
                raise NoAnswer(self._explain()) from None
            raise SdoAbort(breach.code, self.index, self.sub, why=breach.why) from None
        except GeneratorExit:
            raise  # nobody carries this out any more, so nothing can be said
        except BaseException:
            # Abandoned, or the caller's own data or sink, Ctrl-C in them too. The server must not be left waiting.
            yield from self._end(AbortCode.GENERAL)
            raise
        finally:
            channel.busy = False

    def _end(self, code: AbortCode) -> Conversation[CanFrame, None]:
        """Our abort is the last word, and what is still on its way is not taken for an answer to what comes next."""
        if self.until is not None:
            self.channel.quiet_until = self.now + self.timeout
            yield self.send(Abort(self.index, self.sub, code).encode())

    def _explain(self) -> str:
        what = f"node {self.channel.node} did not answer the {self.verb} of {self} within {self.timeout:g} s"
        return f"{what}: {self.channel.explain(self.now)}"

    def send(self, data: bytes) -> Send[CanFrame]:
        """Eight bytes to the server."""
        return Send(CanFrame(self.channel.request_id, data, self.channel.request_extended))

    def send_all(self, every: Iterable[bytes]) -> SendAll[CanFrame]:
        """The same for many, as the segments of a block are."""
        return SendAll(CanFrame.each(self.channel.request_id, every, self.channel.request_extended))

    def say(self, data: bytes) -> Conversation[CanFrame, None]:
        """Send; from then on the time to answer runs."""
        sent: Heard[CanFrame] = yield self.send(data)
        self.now = sent.now
        self.until = sent.now + self.timeout

    def ask(self, request: SdoMessage, wanted: tuple[type[M], ...]) -> Conversation[CanFrame, M]:
        """Say a request and return the answer to it: a message of a wanted kind, about the same object."""
        yield from self.say(request.encode())
        return (yield from self.answer(wanted))

    def answer(self, wanted: tuple[type[M], ...]) -> Conversation[CanFrame, M]:
        """Wait for a message of a wanted kind. Raises SdoAbort, and Breach when the time is up."""
        channel, until = self.channel, self.until or 0.0
        while True:
            heard: Heard[CanFrame] = yield Listen(until)
            self.now = heard.now
            if heard.item is not None:
                data = self.hear(heard.item)
                answer = None if data is None else channel.understand(data, wanted)
                if answer is not None:
                    if self._is_about_us(answer):
                        return answer
                    channel.counters.late += 1
            # A bus that never falls silent must not keep us past the time either.
            if heard.now >= until:
                raise ProtocolViolation(AbortCode.TIMED_OUT, "no answer")

    def _is_about_us(self, answer: object) -> bool:
        """Messages without an object belong to the transfer that is going on."""
        return (getattr(answer, "index", self.index), getattr(answer, "sub", self.sub)) == (self.index, self.sub)

    def hear(self, frame: CanFrame) -> bytes | None:
        """What was said on our channel, None if it was elsewhere. Raises SdoAbort if it was an abort."""
        data = self.channel.hear(frame)
        return self.judge(data) if data and data[0] == ABORT else data

    def judge(self, data: bytes) -> bytes | None:
        """The same of what was said on our channel. An abort that cannot be read is none, and counted."""
        if data and data[0] == ABORT:
            try:
                abort = Abort.decode(data)
            except DecodeError:
                self.channel.counters.garbled += 1
                return None
            raise SdoAbort(abort.code, self.index, self.sub, (abort.index, abort.sub))
        return data
