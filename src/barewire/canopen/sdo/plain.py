"""A plain exchange: an expedited transfer without a conversation, as long as nothing irregular happens.

        605 | 40 | 6041h | 00 | 00 00 00 00      ->                                                        upload
                                                 <-  585 | 4B | 6041h | 00 | 37 06 00 00

        605 | 2B | 6040h | 00 | 0F 00 00 00      ->                                                        download
                                                 <-  585 | 60 | 6040h | 00 | 00 00 00 00

        begin()             -> the request     None: the channel has something to wait for, or to discard  -> whole()
        (the caller sends it and receives a frame)
        answer_in(frame)    -> the result      NOT_PLAIN: the frame is anything but the usual response     -> rest()

It cannot change results: whatever is not exactly the usual response (an abort, segments, another object, reserved bits,
fewer than 8 bytes, a request of another client, no frame) goes to the conversation of the same transfer, which then
listens as if it had sent the request itself. tests/canopen/sdo/test_plain.py compares both, for any frames.
"""

from __future__ import annotations

import struct
from abc import ABC, abstractmethod
from collections.abc import Callable
from enum import Enum
from functools import partial
from struct import Struct
from typing import TYPE_CHECKING, Final, Generic, TypeVar

from barewire.canopen.frame import CanFrame
from barewire.canopen.sdo.channel import Channel
from barewire.canopen.sdo.client import decoded, decoded_value, download, rest_of_download, rest_of_upload, upload
from barewire.canopen.sdo.stream import LIMIT
from barewire.conversation import Conversation

if TYPE_CHECKING:
    from barewire.canopen.object_dictionary import Entry
    from barewire.codecs import Value

T = TypeVar("T")


class NotPlain(Enum):
    """The type of `NOT_PLAIN`: no value of an object is that."""

    NOT_PLAIN = 0


NOT_PLAIN: Final = NotPlain.NOT_PLAIN

_pack_read = Struct("<BHB4x").pack
_pack_write = Struct("<BHB4s").pack
_WRITE_COMMANDS = (0, 0x2F, 0x2B, 0x27, 0x23)  # by the number of bytes
_ENDS = {0x4F: 5, 0x4B: 6, 0x47: 7, 0x43: 8}  # command of a response: where its value ends
_DOWNLOADED = 0x60
_FRAME = 8
_ENDLESS = float("inf")

_new = tuple.__new__


class PlainExchange(ABC, Generic[T]):
    """One request and its usual response. A base class; each kind of transfer adds the four methods at its end."""

    __slots__ = ("channel", "index", "named", "sub", "timeout")

    named: bytes
    """The index and sub-index as they are in the request and in the response."""
    channel: Channel
    index: int
    sub: int
    timeout: float  # each kind sets these four by itself: one call less on the fast path

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {self.index:04X}h:{self.sub:02X}, node {self.channel.node}>"

    def begin(self) -> CanFrame | None:
        """Return the request; None if the transfer needs a conversation from its beginning."""
        data = self._request()
        channel = self.channel
        if data is None or not 0.0 < self.timeout < _ENDLESS or not channel.begin_plain():
            return None
        self.named = data[1:4]
        frame: CanFrame = _new(CanFrame, (channel.request_id, data, channel.request_extended, False, 0))
        return frame

    def cancel(self) -> None:
        """End it before the request was sent."""
        self.channel.restart_counters()
        self.channel.busy = False

    def be_interrupted(self, now: float) -> None:
        """End it after an exception that came where its state was not recorded: the request may have been sent."""
        self.channel.be_interrupted(now, self.timeout, (self.index, self.sub))

    @abstractmethod
    def _request(self) -> bytes | None:
        """Return the bytes of the request; None for arguments that need a conversation, or an error."""

    @abstractmethod
    def answer_in(self, frame: CanFrame) -> T | NotPlain:
        """Return the result, and end the exchange, if the frame is the usual response to the request."""

    @abstractmethod
    def whole(self) -> Conversation[CanFrame, T]:
        """Return the conversation of the transfer. Raise EncodeError for arguments that cannot be encoded."""

    @abstractmethod
    def rest(self, sent_at: float) -> Conversation[CanFrame, T]:
        """Return the conversation of the transfer from the point where it listens; the request was sent then."""


class PlainUpload(PlainExchange[T]):
    """The upload of an object of at most four bytes. `size` and `limit` are those of `upload`; `decode` returns the
    result for the bytes of the value, and may raise DecodeError."""

    __slots__ = ("decode", "limit", "size")

    def __init__(
        self,
        channel: Channel,
        index: int,
        sub: int,
        timeout: float,
        size: int | None,
        limit: int | None,
        decode: Callable[[bytes], T],
    ) -> None:
        self.channel = channel
        self.index = index
        self.sub = sub
        self.timeout = timeout
        self.size = size
        self.limit = limit
        self.decode = decode

    def _request(self) -> bytes | None:
        if (self.limit is not None and self.limit < 4) or self.channel.dialect.read_commands:
            return None
        try:
            return _pack_read(0x40, self.index, self.sub)
        except struct.error:
            return None

    def answer_in(self, frame: CanFrame) -> T | NotPlain:
        """Return the result, if the frame is an expedited response with a size."""
        identifier, data, extended, _, _ = frame
        channel = self.channel
        if identifier != channel.response_id or extended is not channel.response_extended or len(data) != _FRAME:
            return NOT_PLAIN
        end = _ENDS.get(data[0])
        if end is None or data[1:4] != self.named:
            return NOT_PLAIN
        channel.end_plain()
        return self.decode(data[4:end])

    def whole(self) -> Conversation[CanFrame, T]:
        """Return the conversation of the upload."""
        transfer = upload(self.channel, self.index, self.sub, timeout=self.timeout, size=self.size, limit=self.limit)
        return decoded(transfer, self.decode)

    def rest(self, sent_at: float) -> Conversation[CanFrame, T]:
        """Return the conversation of the upload from the point where it listens."""
        self.channel.restart_counters()
        transfer = rest_of_upload(
            self.channel,
            self.index,
            self.sub,
            timeout=self.timeout,
            size=self.size,
            limit=self.limit,
            sent_at=sent_at,
        )
        return decoded(transfer, self.decode)


def plain_read(channel: Channel, entry: Entry, timeout: float) -> PlainUpload[Value]:
    """Return the exchange that does what `read_object` does."""
    return PlainUpload(channel, entry.index, entry.sub, timeout, entry.codec.size, LIMIT, partial(decoded_value, entry))


class PlainDownload(PlainExchange[None]):
    """The download of 1 to 4 bytes."""

    __slots__ = ("data",)

    def __init__(self, channel: Channel, index: int, sub: int, timeout: float, data: bytes) -> None:
        self.channel = channel
        self.index = index
        self.sub = sub
        self.timeout = timeout
        self.data = data

    def _request(self) -> bytes | None:
        data = self.data
        try:
            return _pack_write(_WRITE_COMMANDS[len(data)], self.index, self.sub, data)
        except struct.error:
            return None

    def answer_in(self, frame: CanFrame) -> NotPlain | None:
        """Return None if the frame confirms the download."""
        identifier, data, extended, _, _ = frame
        channel = self.channel
        if identifier != channel.response_id or extended is not channel.response_extended or len(data) != _FRAME:
            return NOT_PLAIN
        if data[0] != _DOWNLOADED or data[1:4] != self.named:
            return NOT_PLAIN
        channel.end_plain()
        return None

    def whole(self) -> Conversation[CanFrame, None]:
        """Return the conversation of the download."""
        return download(self.channel, self.index, self.sub, self.data, timeout=self.timeout)

    def rest(self, sent_at: float) -> Conversation[CanFrame, None]:
        """Return the conversation of the download from the point where it listens."""
        self.channel.restart_counters()
        return rest_of_download(self.channel, self.index, self.sub, self.data, timeout=self.timeout, sent_at=sent_at)
