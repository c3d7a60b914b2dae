"""Which SDO messages a client says, which a server, and which answers each request wants.   [CiA 301, SDO]"""

from __future__ import annotations

from barewire.canopen.sdo.messages.block import (
    BlockAck,
    BlockDownloadInitiated,
    BlockEnd,
    BlockEnded,
    BlockUploadInitiated,
    InitiateBlockDownload,
    InitiateBlockUpload,
    StartBlockUpload,
)
from barewire.canopen.sdo.messages.codec import SdoMessage
from barewire.canopen.sdo.messages.initiate import (
    Abort,
    DownloadInitiated,
    ExpeditedDownload,
    ExpeditedUpload,
    InitiateDownload,
    InitiateUpload,
    UploadInitiated,
)
from barewire.canopen.sdo.messages.segment import NextSegment, SdoSegment, SegmentTaken
from barewire.explain.can_monitor.events import TransferDirection, TransferManner

InitiateRequest = InitiateUpload | ExpeditedDownload | InitiateDownload | InitiateBlockUpload | InitiateBlockDownload

InitiateAnswer = ExpeditedUpload | UploadInitiated | DownloadInitiated | BlockUploadInitiated | BlockDownloadInitiated

_UPLOADED = (ExpeditedUpload, UploadInitiated)
BEGINS: dict[type, tuple[TransferDirection, TransferManner, tuple[type, ...]]] = {
    InitiateUpload: ("upload", "expedited", _UPLOADED),
    ExpeditedDownload: ("download", "expedited", (DownloadInitiated,)),
    InitiateDownload: ("download", "segmented", (DownloadInitiated,)),
    InitiateBlockUpload: ("upload", "block", (BlockUploadInitiated, *_UPLOADED)),
    InitiateBlockDownload: ("download", "block", (BlockDownloadInitiated,)),
}
CLIENT_SAYS: tuple[type[SdoMessage], ...] = (
    *(InitiateUpload, ExpeditedDownload, InitiateDownload, NextSegment, SdoSegment, Abort),
    *(InitiateBlockUpload, InitiateBlockDownload, StartBlockUpload, BlockAck, BlockEnd, BlockEnded),
)
SERVER_SAYS: tuple[type[SdoMessage], ...] = (
    *(ExpeditedUpload, UploadInitiated, DownloadInitiated, SdoSegment, SegmentTaken, Abort),
    *(BlockUploadInitiated, BlockDownloadInitiated, BlockAck, BlockEnd, BlockEnded),
)
