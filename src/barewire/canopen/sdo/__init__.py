"""SDO: read and write any object of another node, with a confirmation for each.   [CiA 301, SDO]

        600h+n   client -> server          580h+n   server -> client

        | command | index 2 | sub 1 | 4 bytes |        8 bytes, always; numbers little-endian

Files, from the bytes upwards:

    messages    what one frame says          aborts      why somebody said no
    dialect     how a device departs         channel     one question, one answer, and what else was heard
    upload      read, as a client            download    write, as a client            serve    both, as a server

I know: SDO frames and that there is an object dictionary.  I never know: PDOs, NMT, types and names of objects.
Who may import me: canopen, devices, shells, cli.
"""

from barewire.canopen.sdo.aborts import AbortCode, SdoAbort, abort_text
from barewire.canopen.sdo.channel import Channel, Hearing
from barewire.canopen.sdo.dialect import AZ3, STANDARD, Dialect, fit
from barewire.canopen.sdo.download import download
from barewire.canopen.sdo.messages import (
    Abort,
    DownloadInitiated,
    ExpeditedDownload,
    ExpeditedUpload,
    InitiateDownload,
    InitiateUpload,
    UploadInitiated,
    decode_answer,
    decode_request,
)
from barewire.canopen.sdo.serve import ObjectStore, SdoServer, ServerCounters
from barewire.canopen.sdo.upload import upload

__all__ = [
    "upload",
    "download",
    "Channel",
    "Hearing",
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
    "ExpeditedDownload",
    "InitiateDownload",
    "DownloadInitiated",
    "Abort",
    "decode_request",
    "decode_answer",
]
