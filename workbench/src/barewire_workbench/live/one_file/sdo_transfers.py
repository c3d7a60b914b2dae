"""Read and write an object of a node: expedited, or in segments.                                  [CiA 301, SDO]

Upload                                         server
40 | 6041h | 00 | 00 00 00 00      ->
                                   <-          4B | 6041h | 00 | 37 06 00 00          the value: 0637h
                                   <-          80 | 6041h | 00 | 00 00 02 06          or an abort: SdoAbort

40 | 1008h | 00 | 00 00 00 00      ->
                                   <-          41 | 1008h | 00 | 10 00 00 00          16 bytes, in segments
60 | 00 ...                        ->
                                   <-          00 | 43 41 4E 6F 70 65 6E
70 | 00 ...                        ->                                                 and so on, toggling

Download                                       server
2B | 6040h | 00 | 0F 00 00 00      ->
                                   <-          60 | 6040h | 00 | 00 00 00 00          done

21 | 2100h | 00 | 09 00 00 00      ->                                                 9 bytes, in segments
                                   <-          60 | 2100h | 00 | 00 00 00 00
00 | 30 31 32 33 34 35 36          ->
                                   <-          20 | 00 ...                            and so on, toggling
"""

from __future__ import annotations

from barewire.canopen.frame import CanFrame
from barewire.canopen.sdo.channel import Channel
from barewire.canopen.sdo.client import _download_expedited, _download_segments, _joined, _upload_segments
from barewire.canopen.sdo.messages import (
    UPLOAD_RESPONSES,
    ExpeditedDownload,
    ExpeditedUpload,
    InitiateDownload,
    InitiateUpload,
)
from barewire.canopen.sdo.stream import LIMIT, Incoming, Outgoing
from barewire.canopen.sdo.transfer import ClientTransfer
from barewire.conversation import DEFAULT_TIMEOUT, Conversation


def upload(
    channel: Channel, index: int, sub: int = 0, *, timeout: float = DEFAULT_TIMEOUT, limit: int | None = LIMIT
) -> Conversation[CanFrame, bytes]:
    """Read the bytes of an object, as many as the server indicated; more than `limit` are refused.

    Raise EncodeError at once for arguments that cannot be encoded; in the conversation SdoAbort and NoAnswer.
    """
    request = InitiateUpload(index, sub)
    request.encode()
    parts: list[bytes] = []
    transfer = ClientTransfer(channel, "upload", index, sub, timeout)
    return _joined(parts, transfer.run(_upload(transfer, request, Incoming(parts.append, limit=limit))))


def _upload(transfer: ClientTransfer, request: InitiateUpload, value: Incoming) -> Conversation[CanFrame, int]:
    response = yield from transfer.request(request, UPLOAD_RESPONSES)
    if isinstance(response, ExpeditedUpload):
        value.announce(len(response.data))
        value.add(response.data)
    else:
        value.announce(response.size)
        yield from _upload_segments(transfer, value)
    return value.count


def download(
    channel: Channel, index: int, sub: int, data: bytes, *, timeout: float = DEFAULT_TIMEOUT
) -> Conversation[CanFrame, None]:
    """Write the bytes of an object: 1 to 4 in one frame, more (or none) in segments.

    The request is never repeated: after NoAnswer it is unknown whether the server has written the value.
    """
    transfer = ClientTransfer(channel, "download", index, sub, timeout)
    if 1 <= len(data) <= 4:
        request = ExpeditedDownload(index, sub, data)
        request.encode()
        return transfer.run(_download_expedited(transfer, request))
    announced = InitiateDownload(index, sub, len(data))
    announced.encode()
    return transfer.run(_download_segments(transfer, announced, Outgoing((data,), len(data))))
