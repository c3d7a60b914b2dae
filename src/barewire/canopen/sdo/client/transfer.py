"""One transfer of a client: requests, responses, and an end that is reported to the server.

        response  request -> ... -> a response of a wanted kind, about the same object          `request`
        refused   an abort arrived, whatever object it names                                    SdoAbort
        broken    the server broke the protocol: the client sends the abort code for it         SdoAbort, with `why`
        silent    the time-out passed: the client sends abort 0504 0000h                        NoAnswer
        left      abandoned, or the caller's data or sink failed: it sends abort 0800 0000h     as it was raised
        disputed  another client sent a request on this channel: the client sends nothing more   NoAnswer

A request is never repeated automatically: after a time-out it is unknown whether the first one arrived.

A server that aborts because it is out of step (0503 0000h, 0504 0000h, 0504 0001h, 0504 0003h) has received something
unintended, perhaps a frame twice, and may respond to that too. So the channel is quiet for a time before the next
transfer, as after a time-out; otherwise this response could confirm the next request.

An abort would end the transfer of another client that the server may have begun, so a disputed transfer ends silently.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypeVar

from barewire.canopen.abort_codes import AbortCode, ProtocolViolation, SdoAbort
from barewire.canopen.frame import CanFrame
from barewire.canopen.sdo.client.channel import Channel, OtherClient
from barewire.canopen.sdo.messages.codec import M, SdoMessage
from barewire.canopen.sdo.messages.initiate import Abort
from barewire.conversation import Conversation, Heard, Listen, Send, SendAll
from barewire.errors import DecodeError, EncodeError, NoAnswer

_Result = TypeVar("_Result")

ABORT = 0x80
# A server that aborts with one of these was not in the state that the client assumed.
_OUT_OF_STEP = frozenset({AbortCode.COMMAND, AbortCode.TOGGLE, AbortCode.SEQUENCE_NUMBER, AbortCode.TIMED_OUT})


class ClientTransfer:
    """One transfer on a channel. `until` is the end of the present wait, None before the first request; `now` is the
    time of the last frame sent or received."""

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

    def run(self, body: Conversation[CanFrame, _Result]) -> Conversation[CanFrame, _Result]:
        """Run the body of a transfer: wait for a quiet channel first, and send an abort if the body fails."""
        channel = self.channel
        channel.begin(str(self))
        try:
            yield from channel.settle(self.timeout)
            return (yield from body)
        except OtherClient as other:
            outcome = "nothing was sent"
            if self.until is not None:
                self.stay_quiet()
                outcome = f"whether the {self.verb} of {self} was carried out is unknown"
            raise NoAnswer(f"{other}, and a response may be the one to it: {outcome}") from None
        except SdoAbort as refusal:
            if refusal.code in _OUT_OF_STEP:
                self.stay_quiet()
            raise
        except ProtocolViolation as breach:
            yield from self._abort(breach.code)
            if breach.code == AbortCode.TIMED_OUT:
                raise NoAnswer(self._explain()) from None
            raise SdoAbort(breach.code, self.index, self.sub, why=breach.why, node=channel.node) from None
        except GeneratorExit:
            raise  # the conversation is closed: nothing can be sent any more
        except BaseException:
            # Abandoned, or the caller's data or sink failed (also by Ctrl-C). The server must not be left waiting.
            yield from self._abort(AbortCode.GENERAL)
            raise
        finally:
            channel.busy = False

    def stay_quiet(self) -> None:
        """Set `quiet_until`: the last request and its response may each be late by one time-out."""
        self.channel.quiet_until = max(self.now, self.until or self.now) + self.timeout

    def _abort(self, code: AbortCode) -> Conversation[CanFrame, None]:
        """Send an abort, and set `quiet_until` so that late responses do not reach the next transfer."""
        if self.until is not None:
            self.stay_quiet()
            yield self.send(Abort(self.index, self.sub, code).encode())

    def _explain(self) -> str:
        text = f"node {self.channel.node} did not answer the {self.verb} of {self} within {self.timeout:g} s"
        return f"{text}: {self.channel.explain(self.now)}"

    def send(self, data: bytes) -> Send[CanFrame]:
        """Send eight bytes to the server."""
        if self.channel.own_frames is None:
            self.channel.sent.append(data)
        return Send(CanFrame(self.channel.request_id, data, self.channel.request_extended))

    def send_all(self, every: Iterable[bytes]) -> SendAll[CanFrame]:
        """Send many frames, such as the segments of a block."""
        if self.channel.own_frames is None:
            every = [*every]
            self.channel.sent += every
        return SendAll(CanFrame.each(self.channel.request_id, every, self.channel.request_extended))

    def send_request(self, data: bytes) -> Conversation[CanFrame, None]:
        """Send a request; its time-out starts when it is sent."""
        sent: Heard[CanFrame] = yield self.send(data)
        self.now = sent.now
        self.until = sent.now + self.timeout

    def request(self, message: SdoMessage, wanted: tuple[type[M], ...]) -> Conversation[CanFrame, M]:
        """Send a request and return its response: a message of a wanted kind, about the same object."""
        data = message.encode()
        yield from self.send_request(data)
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
                        return response
                    channel.counters.late += 1
            # Checked after frames too, because a busy bus must not extend the time-out.
            if heard.now >= until:
                raise ProtocolViolation(AbortCode.TIMED_OUT, "no response")

    def _concerns_object(self, response: object) -> bool:
        """Return whether a response names the object of this transfer, or none."""
        return (getattr(response, "index", self.index), getattr(response, "sub", self.sub)) == (self.index, self.sub)

    def receive(self, frame: CanFrame) -> bytes | None:
        """Return the data of a frame on this channel, None for other frames. Raise SdoAbort for an abort."""
        data = self.channel.receive(frame)
        return self.check_abort(data) if data and data[0] == ABORT else data

    def check_abort(self, data: bytes) -> bytes | None:
        """Raise SdoAbort if the data is an abort. Return None for an abort that cannot be decoded, which is counted."""
        if data and data[0] == ABORT:
            try:
                abort = Abort.decode(data)
            except DecodeError:
                self.channel.counters.garbled += 1
                return None
            raise SdoAbort(abort.code, self.index, self.sub, (abort.index, abort.sub), node=self.channel.node)
        return data
