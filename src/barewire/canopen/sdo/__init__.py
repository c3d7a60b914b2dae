"""SDO: read and write any object of another node, with a confirmation for each.   [CiA 301, SDO]

        600h+n   client -> server          580h+n   server -> client

        | command | index 2 | sub 1 | 4 bytes |        8 bytes, always; numbers little-endian

        1 to 4 bytes         expedited: the value travels in the question or in the answer itself
        any length           segmented: 7 bytes in a frame, each confirmed
        any length, fast     block: up to 127 frames in a row for one acknowledgement, and a CRC over the whole

Files, from the bytes upwards:

    initiate_messages, segment_messages, block_messages      what one frame says
    messages    all of them, and which of them it is, by the state of the transfer
    aborts      why somebody said no
    dialect     how a device departs
    stream      the bytes of a value on their way
    block       the sender and the receiver of blocks, which client and server share     block_segments  their frames
    channel     a client's two identifiers     hearing     what is heard there     options     how it wants its blocks
    transfer    one transfer of a client           upload      read            download    write
    sessions    one transfer of a server           serve       the server      store       what it stands on
    servers     where a device has further servers

I know: SDO frames and that there is an object dictionary.  I never know: PDOs, NMT, types and names of objects.
Who may import me: canopen, devices, shells, cli.
"""

from typing import TYPE_CHECKING

from barewire._lazy import lazy

if TYPE_CHECKING:
    from barewire.canopen.sdo.aborts import AbortCode as AbortCode, SdoAbort as SdoAbort, abort_text as abort_text
    from barewire.canopen.sdo.client.block_options import BlockMode as BlockMode, BlockSettings as BlockSettings
    from barewire.canopen.sdo.client.channel import Channel as Channel
    from barewire.canopen.sdo.client.channel_counters import ChannelCounters as ChannelCounters
    from barewire.canopen.sdo.client.download import download as download
    from barewire.canopen.sdo.client.upload import upload as upload, upload_to as upload_to
    from barewire.canopen.sdo.dialect import STANDARD as STANDARD, SdoDialect as SdoDialect, fit as fit
    from barewire.canopen.sdo.messages.block import (
        BlockAck as BlockAck,
        BlockDownloadInitiated as BlockDownloadInitiated,
        BlockEnd as BlockEnd,
        BlockEnded as BlockEnded,
        BlockSegment as BlockSegment,
        BlockUploadInitiated as BlockUploadInitiated,
        InitiateBlockDownload as InitiateBlockDownload,
        InitiateBlockUpload as InitiateBlockUpload,
        StartBlockUpload as StartBlockUpload,
    )
    from barewire.canopen.sdo.messages.codec import (
        decode_sdo_request as decode_sdo_request,
        decode_sdo_response as decode_sdo_response,
    )
    from barewire.canopen.sdo.messages.initiate import (
        Abort as Abort,
        DownloadInitiated as DownloadInitiated,
        ExpeditedDownload as ExpeditedDownload,
        ExpeditedUpload as ExpeditedUpload,
        InitiateDownload as InitiateDownload,
        InitiateUpload as InitiateUpload,
        UploadInitiated as UploadInitiated,
    )
    from barewire.canopen.sdo.messages.segment import (
        NextSegment as NextSegment,
        SdoSegment as SdoSegment,
        SegmentTaken as SegmentTaken,
    )
    from barewire.canopen.sdo.server.server import SdoServer as SdoServer
    from barewire.canopen.sdo.server.store import ObjectStore as ObjectStore, ServerCounters as ServerCounters

__getattr__, __all__ = lazy(
    __name__,
    {
        "client.upload": "upload upload_to",
        "client.download": "download",
        "client.block_options": "BlockSettings BlockMode",
        "client.channel": "Channel",
        "client.channel_counters": "ChannelCounters",
        "server.server": "SdoServer",
        "server.store": "ServerCounters ObjectStore",
        "dialect": "SdoDialect STANDARD fit",
        "aborts": "SdoAbort AbortCode abort_text",
        "messages.initiate": (
            "InitiateUpload ExpeditedUpload UploadInitiated ExpeditedDownload InitiateDownload DownloadInitiated Abort"
        ),
        "messages.segment": "NextSegment SdoSegment SegmentTaken",
        "messages.block": (
            "InitiateBlockUpload BlockUploadInitiated StartBlockUpload InitiateBlockDownload "
            "BlockDownloadInitiated BlockSegment BlockAck BlockEnd BlockEnded"
        ),
        "messages.codec": "decode_sdo_request decode_sdo_response",
    },
)
