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
from barewire.canopen.sdo.client.download import download
from barewire.canopen.sdo.client.upload import upload, upload_to

if TYPE_CHECKING:
    from barewire.canopen.sdo.aborts import AbortCode, SdoAbort, abort_text
    from barewire.canopen.sdo.client.block_options import BlockMode, BlockSettings
    from barewire.canopen.sdo.client.channel import Channel
    from barewire.canopen.sdo.client.channel_counters import ChannelCounters
    from barewire.canopen.sdo.dialect import AZ3, STANDARD, Dialect, fit
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
    from barewire.canopen.sdo.messages.codec import decode_answer, decode_request
    from barewire.canopen.sdo.messages.initiate import (
        Abort,
        DownloadInitiated,
        ExpeditedDownload,
        ExpeditedUpload,
        InitiateDownload,
        InitiateUpload,
        UploadInitiated,
    )
    from barewire.canopen.sdo.messages.segment import NextSegment, Segment, SegmentTaken
    from barewire.canopen.sdo.server.server import SdoServer
    from barewire.canopen.sdo.server.store import ObjectStore, ServerCounters

__all__ = [
    "upload",
    "upload_to",
    "download",
    "BlockSettings",
    "BlockMode",
    "Channel",
    "ChannelCounters",
    "SdoServer",
    "ServerCounters",
    "ObjectStore",
    "Dialect",
    "STANDARD",
    "AZ3",
    "fit",
    "SdoAbort",
    "AbortCode",
    "abort_text",
    "InitiateUpload",
    "ExpeditedUpload",
    "UploadInitiated",
    "NextSegment",
    "Segment",
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
    "decode_request",
    "decode_answer",
]

# Which file holds what. Only that one is loaded, with what it needs. `upload` and `download` are loaded at once: they
# have the names of their files, and a file that is loaded later would take the place of its function.
_FILES = {
    "aborts": "AbortCode SdoAbort abort_text",
    "messages.block": (
        "BlockAck BlockDownloadInitiated BlockEnd BlockEnded "
        "BlockSegment BlockUploadInitiated InitiateBlockDownload InitiateBlockUpload StartBlockUpload"
    ),
    "client.channel": "Channel",
    "dialect": "AZ3 STANDARD Dialect fit",
    "client.channel_counters": "ChannelCounters",
    "messages.initiate": (
        "Abort DownloadInitiated ExpeditedDownload ExpeditedUpload InitiateDownload InitiateUpload UploadInitiated"
    ),
    "messages.codec": "decode_answer decode_request",
    "client.block_options": "BlockSettings BlockMode",
    "messages.segment": "NextSegment Segment SegmentTaken",
    "server.server": "SdoServer",
    "server.store": "ObjectStore ServerCounters",
}

__getattr__ = lazy(__name__, _FILES)
