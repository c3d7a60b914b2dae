"""One transfer of a client: requests, responses, and an end that is reported to the server.

        response  request -> ... -> a response of a wanted kind, about the same object          `request`
        refused   an abort of this transfer arrived (see below)                                 SdoAbort
        broken    the server broke the protocol: the client sends the abort code for it         SdoAbort, with `why`
        silent    the time-out passed: the client sends abort 0504 0000h                        NoAnswer
        left      abandoned, or the caller's data or sink failed: it sends abort 0800 0000h     as it was raised
        disputed  another client sent a request on this channel: the client sends nothing more   NoAnswer

A response of another kind, or about another object, may be the late answer to an earlier transfer. It is counted and
ignored, and the client waits on until the time-out. CiA 301 has abort 0504 0001h for an invalid command specifier, and
other clients send it at once; then an answer that is late ends the wrong transfer.

A request is never repeated automatically: after a time-out it is unknown whether the first one arrived.

A server that aborts because it is out of step (0503 0000h, 0504 0000h, 0504 0001h, 0504 0003h) has received something
unintended, perhaps a frame twice, and may respond to that too. So the channel is quiet for a time before the next
transfer, as after a time-out; otherwise this response could confirm the next request.

An abort names an object [CiA 301, abort SDO transfer], but not every device names the right one: many send 0000h:00,
and after a segment some send its data. And an abort may come late, from a server that received the last frame
of the transfer before twice. So it depends on the time of its arrival:

        before the server has answered the first request
            it names the object of the transfer           this transfer is refused
            it names 0000h:00, code of a refusal          this transfer is refused
            it names 0000h:00, out of step                in doubt: to a first request it is no answer, except that
                                                          0504 0001h is one to a request for blocks
            it names another object                       in doubt
        after that                                        this transfer is refused, whatever it names: CAN frames do
                                                          not overtake each other, so it is not from before

An abort in doubt is counted as late, and the client waits on, for the response or an abort without doubt. If none comes
before the time-out, the transfer fails with the abort in doubt, so a device that names wrong objects costs a time-out.

An abort would end the transfer of another client that the server may have begun, so a disputed transfer ends silently.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypeVar

from barewire.canopen.abort_codes import AbortCode, ProtocolViolation, SdoAbort
from barewire.canopen.frame import CanFrame
from barewire.canopen.sdo.channel import OUT_OF_STEP, Channel, OtherClient
from barewire.canopen.sdo.messages import ABORT, Abort, M, SdoMessage
from barewire.conversation import Conversation, Heard, Listen, SendAll, check_request_timeout
from barewire.errors import DecodeError, NoAnswer

_Result = TypeVar("_Result")

_NO_OBJECT = (0, 0)


class ClientTransfer:
    """One transfer on a channel. `until` is the end of the present wait, None before the first request; `now` is the
    time of the last frame sent or received. `sent_at`: the first request was sent at that time, without a conversation
    (see `plain`), which only listens for the response."""

    __slots__ = ("_begun", "_doubted", "channel", "in_blocks", "index", "now", "pending", "requests_blocks", "sent_at",
                 "sub", "timeout", "until", "verb")  # fmt: skip

    def __init__(
        self, channel: Channel, verb: str, index: int, sub: int, timeout: float, sent_at: float | None = None
    ) -> None:
        check_request_timeout(timeout)
        self.channel = channel
        self.verb = verb
        self.index = index
        self.sub = sub
        self.timeout = timeout
        self.sent_at = sent_at
        self.now = 0.0 if sent_at is None else sent_at
        self.until: float | None = None if sent_at is None else sent_at + timeout
        self.pending = sent_at is not None
        """Whether a request was sent, and the channel does not know yet that its response may be late."""
        self.in_blocks = False
        """Whether the server sends segments of blocks."""
        self.requests_blocks = False
        """Whether the first request is one for blocks, which servers without them refuse as an unknown command."""
        self._begun = False  # the server has answered the first request
        self._doubted: SdoAbort | None = None

    def __str__(self) -> str:
        return f"{self.index:04X}h:{self.sub:02X}"

    def run(self, body: Conversation[CanFrame, _Result]) -> Conversation[CanFrame, _Result]:
        """Run the body of a transfer: wait for a quiet channel first, and send an abort if the body fails."""
        channel = self.channel
        if self.sent_at is None:
            channel.check_free(self)
        try:
            if self.sent_at is None:
                channel.begin()
                self.now = yield from channel.settle(self.timeout, self.index, self.sub)
            result = yield from body
            self.pending = False
            return result
        except OtherClient as other:
            outcome = "nothing was sent"
            if self.until is not None:
                self.channel.be_quiet(self._last_response(), None, None)
                self.pending = False
                outcome = f"whether the {self.verb} of {self} was carried out is unknown"
            raise NoAnswer(f"{other}, and a response may be the one to it: {outcome}") from None
        except SdoAbort as refusal:
            if refusal.code in OUT_OF_STEP:
                self.stay_quiet()
            self.pending = False
            raise
        except ProtocolViolation as breach:
            if self.until is not None:
                self.stay_quiet()
            yield from self._abort(breach.code)
            if breach.code == AbortCode.TIMED_OUT:
                if self._doubted is not None:
                    raise self._doubted from None
                raise NoAnswer(self._explain()) from None
            raise SdoAbort(breach.code, self.index, self.sub, why=breach.why, node=channel.node) from None
        except GeneratorExit:
            self.pending = False
            raise  # the conversation is closed: nothing can be sent any more
        except BaseException:
            # Abandoned, or the caller's data or sink failed (also by Ctrl-C). The server must not be left waiting.
            if self.until is not None:
                self._leave()
            yield from self._abort(AbortCode.GENERAL)
            raise
        finally:
            try:
                self._end()
            except BaseException:
                self._end()
                raise

    def _end(self) -> None:
        # An exception may have come at any line of `run`, or here: then nothing has recorded yet that a response may
        # be late.
        if self.pending:
            self.stay_quiet()
        self.channel.busy = False

    def stay_quiet(self) -> None:
        """Make the channel quiet: the last request and its response may each be late by one time-out."""
        self.channel.be_quiet(self._last_response(), None, (self.index, self.sub))
        self.pending = False

    def _leave(self) -> None:
        """Make the channel quiet after a transfer that was abandoned while everything was in order."""
        # The server answers in the order of the requests, so only an answer that names the object of the next transfer
        # could be mistaken: that to the first request. Segments of blocks name nothing, and any of them may look so.
        place = (self.index, self.sub)
        named = None if self.in_blocks else () if self._begun else (place,)
        self.channel.be_quiet(self._last_response(), named, place, self.now)
        self.channel.probes = self.in_blocks
        self.pending = False

    def _last_response(self) -> float:
        late = self.channel.latest(self.timeout)
        sent_at = self.now if self.until is None else self.until - self.timeout
        return max(self.now + late, sent_at + 2 * late)

    def _abort(self, code: AbortCode) -> Conversation[CanFrame, None]:
        if self.until is not None:
            yield self.channel.send(Abort(self.index, self.sub, code).encode())

    def _explain(self) -> str:
        text = f"node {self.channel.node} did not answer the {self.verb} of {self} within {self.timeout:g} s"
        return f"{text}: {self.channel.explain(self.now)}"

    def send_all(self, every: Iterable[bytes]) -> SendAll[CanFrame]:
        """Send many frames, such as the segments of a block."""
        if self.channel.own_frames is None:
            every = [*every]
            self.channel.sent += every
        return SendAll(CanFrame.each(self.channel.request_id, every, self.channel.request_extended))

    def send_request(self, data: bytes) -> Conversation[CanFrame, None]:
        """Send a request; its time-out starts when it is sent. It is pending before: an exception may come between."""
        self.until = self.now + self.timeout
        self.pending = True
        sent: Heard[CanFrame] = yield self.channel.send(data)
        self.now = sent.now
        self.until = sent.now + self.timeout

    def request(self, message: SdoMessage, wanted: tuple[type[M], ...]) -> Conversation[CanFrame, M]:
        """Send a request and return its response: a message of a wanted kind, about the same object."""
        data = message.encode()
        if self.sent_at is None:
            yield from self.send_request(data)
        else:
            self.sent_at = None
        response = yield from self.response(wanted)
        if self.channel.own_frames is None:
            self.channel.learn_own_frames(data)
        return response

    def response(self, wanted: tuple[type[M], ...]) -> Conversation[CanFrame, M]:
        """Wait for a message of a wanted kind. Raise SdoAbort, and ProtocolViolation at the time-out."""
        channel, until = self.channel, self.until or 0.0
        while True:
            heard: Heard[CanFrame] = yield Listen(until)
            self.now = heard.now
            if heard.item is not None:
                data = self.receive(heard.item)
                response = None if data is None else channel.decode(data, wanted)
                if response is not None:
                    if self._concerns_object(response):
                        if not self._begun:
                            self._begun, self._doubted = True, None
                            channel.be_settled()
                        return response
                    channel.counters.late += 1
            # Checked after frames too, because a busy bus must not extend the time-out.
            if heard.now >= until:
                raise ProtocolViolation(AbortCode.TIMED_OUT, "no response")

    def _concerns_object(self, response: object) -> bool:
        # A response that names no object can only be about that of the transfer.
        return (getattr(response, "index", self.index), getattr(response, "sub", self.sub)) == (self.index, self.sub)

    def receive(self, frame: CanFrame) -> bytes | None:
        """Return the data of a frame on this channel, None for other frames. Raise SdoAbort for an abort of this
        transfer."""
        data = self.channel.receive(frame)
        return self.check_abort(data) if data and data[0] == ABORT else data

    def check_abort(self, data: bytes) -> bytes | None:
        """Raise SdoAbort if the data is an abort of this transfer.

        Return None for an abort that cannot be decoded, or that may be for an earlier transfer; both are counted.
        """
        if data and data[0] == ABORT:
            try:
                abort = Abort.decode(data)
            except DecodeError:
                self.channel.counters.garbled += 1
                return None
            named = (abort.index, abort.sub)
            refusal = SdoAbort(abort.code, self.index, self.sub, named, node=self.channel.node)
            if self._begun or self._is_own(abort.code, named):
                raise refusal
            self._doubted = refusal
            self.channel.counters.late += 1
            return None
        return data

    def _is_own(self, code: int, named: tuple[int, int]) -> bool:
        """Return whether an abort that comes before the first response is the answer to the first request."""
        if code == AbortCode.COMMAND and self.requests_blocks and named in ((self.index, self.sub), _NO_OBJECT):
            return True
        if code in OUT_OF_STEP:
            return named == (self.index, self.sub) and self.channel.quiet_until is None
        return named in ((self.index, self.sub), _NO_OBJECT)
