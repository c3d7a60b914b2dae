"""Decodes eight bytes as a message, which depends on the state of the transfer.

        C1 34 12 ...      the end of a block transfer    if the last segment is acknowledged
                          segment 41h, the last          inside a block
                          not a valid message            outside a transfer

So `decode_one_of` takes the message types that are possible now. The tuples below are such states.
"""

from __future__ import annotations

from typing import ClassVar, Protocol, Self, TypeAlias, TypeVar

from barewire.canopen.sdo.messages.block import (
    BlockAck,
    BlockDownloadInitiated,
    BlockEnd,
    BlockEnded,
    BlockUploadInitiated,
    InitiateBlockDownload,
    InitiateBlockUpload,
)
from barewire.canopen.sdo.messages.initiate import (
    Abort,
    DownloadInitiated,
    ExpeditedDownload,
    ExpeditedUpload,
    InitiateDownload,
    InitiateUpload,
    UploadInitiated,
)
from barewire.canopen.sdo.messages.segment import SdoSegment, SegmentTaken
from barewire.codecs import BitPattern
from barewire.errors import DecodeError


class SdoMessage(Protocol):
    """The interface of every SDO message."""

    pattern: ClassVar[BitPattern]

    def encode(self) -> bytes: ...

    @classmethod
    def decode(cls, data: bytes) -> Self: ...


M = TypeVar("M", bound=SdoMessage)

SdoRequest: TypeAlias = (
    InitiateUpload | ExpeditedDownload | InitiateDownload | InitiateBlockUpload | InitiateBlockDownload | Abort
)
UploadResponse: TypeAlias = ExpeditedUpload | UploadInitiated
BlockUploadResponse: TypeAlias = BlockUploadInitiated | ExpeditedUpload | UploadInitiated
SdoResponse: TypeAlias = BlockUploadResponse | DownloadInitiated | BlockDownloadInitiated | Abort
ReceiverMessage: TypeAlias = BlockAck | BlockEnded

_INITIATE_REQUESTS: tuple[type[SdoRequest], ...] = (
    InitiateUpload,
    ExpeditedDownload,
    InitiateDownload,
    InitiateBlockUpload,
    InitiateBlockDownload,
    Abort,
)
UPLOAD_RESPONSES: tuple[type[UploadResponse], ...] = (ExpeditedUpload, UploadInitiated)
BLOCK_UPLOAD_RESPONSES: tuple[type[BlockUploadResponse], ...] = (BlockUploadInitiated, *UPLOAD_RESPONSES)
_INITIATE_RESPONSES: tuple[type[SdoResponse], ...] = (
    *BLOCK_UPLOAD_RESPONSES,
    DownloadInitiated,
    BlockDownloadInitiated,
    Abort,
)
RECEIVER_MESSAGES: tuple[type[ReceiverMessage], ...] = (BlockAck, BlockEnded)

_LATE = (SdoSegment, SegmentTaken, BlockAck, BlockEnd, BlockEnded)


def decode_one_of(data: bytes, types: tuple[type[M], ...]) -> M:
    """Decode the bytes as a message of one of these types.

    >>> decode_one_of(bytes.fromhex("A2 02 7F 00 00 00 00 00"), RECEIVER_MESSAGES)
    BlockAck(sequence=2, blksize=127)

    Raise DecodeError("short") if bytes are missing, and ("function") if the message is not of these types.
    """
    if not data:
        raise DecodeError("short", data, 0, "the command is byte 0, but there are none")
    for type in types:
        if type.pattern.matches(data[0]):
            return type.decode(data)
    raise DecodeError("function", data, 0, f"command {data[0]:02X}h is not possible here")


def decode_sdo_request(data: bytes) -> SdoRequest:
    """Decode a client's request to a server without a running transfer.

    >>> decode_sdo_request(bytes.fromhex("2B40 6000 0F00 0000"))
    ExpeditedDownload(index=24640, sub=0, data=b'\\x0f\\x00', indicated=True)

    Raise DecodeError as `decode_one_of` does.
    """
    return decode_one_of(data, _INITIATE_REQUESTS)


def decode_sdo_response(data: bytes) -> SdoResponse:
    """Decode a server's response to a request. Trailing bytes that the message does not use may be missing.

    >>> decode_sdo_response(bytes.fromhex("4B41 6000 3706"))
    ExpeditedUpload(index=24641, sub=0, data=b'7\\x06', indicated=True)

    Raise DecodeError as `decode_one_of` does.
    """
    return decode_one_of(data, _INITIATE_RESPONSES)


def is_any_response(data: bytes) -> bool:
    """Return whether these bytes are a response in any state of a transfer. An unexpected response is a late one.

    >>> is_any_response(BlockEnded().encode()), is_any_response(bytes.fromhex("E0 00 00 00 00 00 00 00"))
    (True, False)
    """
    for types in (_INITIATE_RESPONSES, _LATE):
        try:
            decode_one_of(data, types)
        except DecodeError:
            continue
        return True
    return False
