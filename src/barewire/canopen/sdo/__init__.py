"""SDO: read and write the objects of another node, each with a confirmation.   [CiA 301, SDO]

        600h+n   client -> server          580h+n   server -> client

        | command | index 2 | sub 1 | 4 bytes |        8 bytes, always; numbers little-endian

        1 to 4 bytes         expedited: the request or the response itself has the value
        any length           segmented: 7 bytes in a frame, and a confirmation for each frame
        any length, fast     block: up to 127 frames in a row for one acknowledgement, and a CRC over the whole value

Files, in reading order:

    messages               the messages of the three kinds of transfer; eight bytes <-> a message, by the state of one
    dialect                how a device departs from the standard
    stream                 the bytes of a value, as they are sent or received
    block_transfer         sender and receiver of blocks, used by client and server
    server                 the server and its transfers
    channel                a client's channel: identifiers, counters, what it waits for
    transfer               a client's transfer: requests, responses, how it ends
    client                 read and write an object
    plain                  one request and its response, without a conversation
"""

from typing import TYPE_CHECKING

from barewire._lazy import lazy

if TYPE_CHECKING:
    from barewire.canopen.sdo.channel import Channel as Channel, ChannelCounters as ChannelCounters
    from barewire.canopen.sdo.client import (
        BlockMode as BlockMode,
        BlockSettings as BlockSettings,
        download as download,
        upload as upload,
        upload_to as upload_to,
    )
    from barewire.canopen.sdo.dialect import STANDARD as STANDARD, SdoDialect as SdoDialect, fit as fit
    from barewire.canopen.sdo.messages import (
        Abort as Abort,
        BlockAck as BlockAck,
        BlockDownloadInitiated as BlockDownloadInitiated,
        BlockEnd as BlockEnd,
        BlockEnded as BlockEnded,
        BlockSegment as BlockSegment,
        BlockUploadInitiated as BlockUploadInitiated,
        DownloadInitiated as DownloadInitiated,
        ExpeditedDownload as ExpeditedDownload,
        ExpeditedUpload as ExpeditedUpload,
        InitiateBlockDownload as InitiateBlockDownload,
        InitiateBlockUpload as InitiateBlockUpload,
        InitiateDownload as InitiateDownload,
        InitiateUpload as InitiateUpload,
        NextSegment as NextSegment,
        SdoSegment as SdoSegment,
        SegmentTaken as SegmentTaken,
        StartBlockUpload as StartBlockUpload,
        UploadInitiated as UploadInitiated,
        decode_sdo_request as decode_sdo_request,
        decode_sdo_response as decode_sdo_response,
    )
    from barewire.canopen.sdo.server import (
        ObjectStore as ObjectStore,
        SdoServer as SdoServer,
        ServerCounters as ServerCounters,
    )

__getattr__, __dir__, __all__ = lazy(
    __name__,
    {
        "client": "upload upload_to download BlockSettings BlockMode",
        "channel": "Channel ChannelCounters",
        "server": "SdoServer ServerCounters ObjectStore",
        "dialect": "SdoDialect STANDARD fit",
        "messages": (
            "InitiateUpload ExpeditedUpload UploadInitiated ExpeditedDownload InitiateDownload "
            "DownloadInitiated Abort NextSegment SdoSegment SegmentTaken InitiateBlockUpload "
            "BlockUploadInitiated StartBlockUpload InitiateBlockDownload BlockDownloadInitiated BlockSegment "
            "BlockAck BlockEnd BlockEnded decode_sdo_request decode_sdo_response"
        ),
    },
)
