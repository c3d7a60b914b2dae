"""The reserved bytes of SDO messages, which are 0.   [CiA 301, SDO]

        initiate upload             40  index  sub  | 0  0  0  0
        request of a segment        60 | 0  0  0  0  0  0  0
        acknowledgement of a block  A2  number  size | 0  0  0  0  0

The unused bytes behind the data of an expedited transfer or of the last segment are not reserved: they may have any
value.
"""

from __future__ import annotations

from barewire.canopen.sdo.messages import (
    BlockAck,
    BlockDownloadInitiated,
    BlockEnd,
    BlockEnded,
    BlockUploadInitiated,
    DownloadInitiated,
    InitiateBlockDownload,
    InitiateBlockUpload,
    InitiateDownload,
    InitiateUpload,
    NextSegment,
    SdoMessage,
    SegmentTaken,
    StartBlockUpload,
    UploadInitiated,
)

_FIRST: dict[type, int] = {
    InitiateUpload: 4,
    DownloadInitiated: 4,
    NextSegment: 1,
    SegmentTaken: 1,
    InitiateBlockUpload: 6,
    StartBlockUpload: 1,
    BlockDownloadInitiated: 5,
    BlockAck: 3,
    BlockEnd: 3,
    BlockEnded: 1,
}
"""Message -> its first reserved byte."""
_SIZED = (InitiateDownload, UploadInitiated, InitiateBlockDownload, BlockUploadInitiated)
"""Messages whose bytes 4 to 7 are the size, or reserved if none is announced."""


def reserved_byte(message: SdoMessage, data: bytes) -> int | None:
    """Return the position of the first reserved byte that is not 0; None if all are.

    >>> reserved_byte(InitiateUpload(0x1000, 0), bytes.fromhex("4000100000000100"))
    6
    """
    first = _FIRST.get(type(message), 8)
    if isinstance(message, _SIZED) and message.size is None:
        first = 4
    return next((place for place in range(first, len(data)) if data[place]), None)
