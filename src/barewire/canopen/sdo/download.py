"""Write an object of another node.   [CiA 301, SDO download]

client                                         server
2B | 6040h | 00 | 0F 00 00 00      ->
                                   <-          60 | 6040h | 00 | 00 00 00 00          done
                                   <-          80 | 6040h | 00 | 30 00 09 06          or no: SdoAbort
"""

from __future__ import annotations

from barewire.canopen.frame import CanFrame
from barewire.canopen.sdo.channel import Channel, channel_to
from barewire.canopen.sdo.dialect import Dialect
from barewire.canopen.sdo.messages import DownloadInitiated, ExpeditedDownload
from barewire.conversation import Conversation


def download(
    node: int | Channel,
    index: int,
    sub: int,
    data: bytes,
    *,
    timeout: float = 1.0,
    indicated: bool = True,
    dialect: Dialect | None = None,
) -> Conversation[CanFrame, None]:
    """Write `data`, 1 to 4 bytes little-endian, to object `index`:`sub`.

    Said once and never repeated: after NoAnswer nobody knows whether the server has taken it. `indicated` false
    sends all four bytes without saying how many count (22h); the server takes the low ones that its object needs.

    >>> from barewire.conversation import play
    >>> server = lambda frame, now: [(now + 0.001, CanFrame.parse("585#6040600000000000"))]
    >>> play(download(5, 0x6040, 0, b"\\x0f\\x00"), server)
    (None, 0.001)

    Raises EncodeError at once for what cannot be said; in the conversation SdoAbort and NoAnswer.
    """
    channel = channel_to(node, dialect)
    request = ExpeditedDownload(index, sub, data, indicated)
    request.encode()
    return _download(channel, request, timeout)


def _download(channel: Channel, request: ExpeditedDownload, timeout: float) -> Conversation[CanFrame, None]:
    yield from channel.ask(request, (DownloadInitiated,), timeout)
