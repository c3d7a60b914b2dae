"""All messages of SDO in one place, and which of them eight bytes are: that depends on the transfer.

        C1 34 12 ...      the end of a block transfer    if the last segment has been acknowledged
                          segment 41h, the last          inside a block
                          nothing that belongs here      before any transfer

So `decode_one_of` takes the kinds that are possible now. Each tuple below is one such state of a transfer.
"""

from __future__ import annotations

from typing import ClassVar, Protocol, Self, TypeAlias, TypeVar

from barewire.canopen.sdo.messages.block import (
    BlockAck,
    BlockDownloadInitiated,
    BlockEnd,
    BlockEnded,
    BlockSegment,
    BlockUploadInitiated,
    InitiateBlockDownload,
    InitiateBlockUpload,
    StartBlockUpload,
)
from barewire.canopen.sdo.messages.initiate import (
    Abort,
    DownloadInitiated,
    ExpeditedDownload,
    ExpeditedUpload,
    InitiateDownload,
    InitiateUpload,
    UploadInitiated,
    has_reserved_bits,
)
from barewire.canopen.sdo.messages.segment import NextSegment, SdoSegment, SegmentTaken
from barewire.codecs import BitPattern
from barewire.errors import DecodeError

__all__ = [
    "InitiateUpload",
    "ExpeditedUpload",
    "UploadInitiated",
    "NextSegment",
    "SdoSegment",
    "ExpeditedDownload",
    "InitiateDownload",
    "DownloadInitiated",
    "SegmentTaken",
    "InitiateBlockUpload",
    "BlockUploadInitiated",
    "StartBlockUpload",
    "InitiateBlockDownload",
    "BlockDownloadInitiated",
    "BlockSegment",
    "BlockAck",
    "BlockEnd",
    "BlockEnded",
    "Abort",
    "SdoMessage",
    "decode_sdo_request",
    "decode_sdo_response",
    "has_reserved_bits",
    "is_any_response",
    "decode_one_of",
]


class SdoMessage(Protocol):
    """What every SDO message has."""

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

INITIATE_REQUESTS: tuple[type[SdoRequest], ...] = (
    InitiateUpload,
    ExpeditedDownload,
    InitiateDownload,
    InitiateBlockUpload,
    InitiateBlockDownload,
    Abort,
)
UPLOAD_RESPONSES: tuple[type[UploadResponse], ...] = (ExpeditedUpload, UploadInitiated)
BLOCK_UPLOAD_RESPONSES: tuple[type[BlockUploadResponse], ...] = (BlockUploadInitiated, *UPLOAD_RESPONSES)
INITIATE_RESPONSES: tuple[type[SdoResponse], ...] = (
    *BLOCK_UPLOAD_RESPONSES,
    DownloadInitiated,
    BlockDownloadInitiated,
    Abort,
)
RECEIVER_MESSAGES: tuple[type[ReceiverMessage], ...] = (BlockAck, BlockEnded)

_LATE = (SdoSegment, SegmentTaken, BlockAck, BlockEnd, BlockEnded)


def decode_one_of(data: bytes, kinds: tuple[type[M], ...]) -> M:
    """The one of the possible messages that these bytes are.

    >>> decode_one_of(bytes.fromhex("A2 02 7F 00 00 00 00 00"), RECEIVER_MESSAGES)
    BlockAck(sequence=2, blksize=127)

    Raises DecodeError("short") if bytes are missing and ("function") if it is none of them.
    """
    if not data:
        raise DecodeError("short", data, 0, "the command is byte 0, but there are none")
    for kind in kinds:
        if kind.pattern.matches(data[0]):
            return kind.decode(data)
    raise DecodeError("function", data, 0, f"command {data[0]:02X}h is nothing that belongs here")


def decode_sdo_request(data: bytes) -> SdoRequest:
    """What a client said to a server that had no transfer going.

    >>> decode_sdo_request(bytes.fromhex("2B40 6000 0F00 0000"))
    ExpeditedDownload(index=24640, sub=0, data=b'\\x0f\\x00', indicated=True)

    Raises DecodeError as `decode_one_of` does.
    """
    return decode_one_of(data, INITIATE_REQUESTS)


def decode_sdo_response(data: bytes) -> SdoResponse:
    """What a server said to a request. Trailing bytes that the message does not need may be missing: some trim them.

    >>> decode_sdo_response(bytes.fromhex("4B41 6000 3706"))
    ExpeditedUpload(index=24641, sub=0, data=b'7\\x06', indicated=True)

    Raises DecodeError as `decode_one_of` does.
    """
    return decode_one_of(data, INITIATE_RESPONSES)


def is_any_response(data: bytes) -> bool:
    """Whether these bytes could be an answer at all, in whatever state of a transfer: then they came late.

    >>> is_any_response(BlockEnded().encode()), is_any_response(bytes.fromhex("E0 00 00 00 00 00 00 00"))
    (True, False)
    """
    for kinds in (INITIATE_RESPONSES, _LATE):
        try:
            decode_one_of(data, kinds)
        except DecodeError:
            continue
        return True
    return False
