"""Read an object of another node.   [CiA 301, SDO upload]

client                                         server
40 | 6041h | 00 | 00 00 00 00      ->
                                   <-          4B | 6041h | 00 | 37 06 00 00          the value itself
                                   <-          80 | 6041h | 00 | 00 00 02 06          or no: SdoAbort
"""

from __future__ import annotations

from barewire.canopen.frame import CanFrame
from barewire.canopen.sdo.aborts import AbortCode
from barewire.canopen.sdo.channel import Channel, channel_to
from barewire.canopen.sdo.dialect import Dialect
from barewire.canopen.sdo.messages import ExpeditedUpload, InitiateUpload, UploadInitiated
from barewire.conversation import Conversation
from barewire.errors import DecodeError


def upload(
    node: int | Channel,
    index: int,
    sub: int = 0,
    *,
    timeout: float = 1.0,
    size: int | None = None,
    dialect: Dialect | None = None,
) -> Conversation[CanFrame, bytes]:
    """The bytes of object `index`:`sub`, little-endian as they travelled and as many as the server said.

    `size` is how many bytes the type of the object has, if the caller knows. Two servers need it: one whose dialect
    asks with the size, and one that answers with 42h, four bytes of which it does not say how many count. Then the
    low `size` bytes are the value, or all four if nobody knows, and `Channel.heard.unsized` says so. A size that
    the server did indicate is never overruled here: see `fit`.

    >>> from barewire.conversation import play
    >>> server = lambda frame, now: [(now + 0.001, CanFrame.parse("585#4B41600037060000"))]
    >>> play(upload(5, 0x6041), server)
    (b'7\\x06', 0.001)

    Raises EncodeError at once for what cannot be asked; in the conversation SdoAbort, NoAnswer, and DecodeError for
    an object that does not fit an expedited answer.
    """
    channel = channel_to(node, dialect)
    request = InitiateUpload(index, sub, channel.dialect.read_command(size))
    request.encode()
    return _upload(channel, request, size, timeout)


def _upload(
    channel: Channel, request: InitiateUpload, size: int | None, timeout: float
) -> Conversation[CanFrame, bytes]:
    wanted: tuple[type[ExpeditedUpload | UploadInitiated], ...] = (ExpeditedUpload, UploadInitiated)
    answer = yield from channel.ask(request, wanted, timeout)
    if isinstance(answer, ExpeditedUpload):
        return answer.data if answer.indicated or size is None else answer.data[:size]
    yield from channel.refuse(request, AbortCode.COMMAND)
    size_text = "a length that it does not tell" if answer.size is None else f"{answer.size} bytes"
    raise DecodeError(
        "function",
        answer.encode(),
        0,
        f"{request.index:04X}h:{request.sub:02X} has {size_text}: the server wants to send it in segments, "
        "and an expedited answer carries 1 to 4 bytes",
    )
