"""The state of an SDO transfer in the monitor, and the messages that begin one.   [CiA 301, SDO]

        request                 transfer                possible answers
        initiate upload         upload, expedited       the value, or the announcement of segments
        initiate download       download, expedited     confirmation (expedited: the value is in the request)
        initiate block ...      upload or download      confirmation; a block upload may be answered as an ordinary one

The bytes that all transfers hold together are bounded (`HeldBytes`).
"""

from __future__ import annotations

from binascii import crc_hqx
from typing import Literal

from barewire.canopen.sdo.messages import (
    Abort,
    BlockAck,
    BlockDownloadInitiated,
    BlockEnd,
    BlockEnded,
    BlockUploadInitiated,
    DownloadInitiated,
    ExpeditedDownload,
    ExpeditedUpload,
    InitiateBlockDownload,
    InitiateBlockUpload,
    InitiateDownload,
    InitiateUpload,
    NextSegment,
    SdoMessage,
    SdoSegment,
    SegmentTaken,
    StartBlockUpload,
    UploadInitiated,
)
from barewire_workbench.monitor.events import (
    SdoTransferReport,
    TransferDirection,
    TransferManner,
    TransferOutcome,
)

SdoSide = Literal["client", "server"]

InitiateRequest = InitiateUpload | ExpeditedDownload | InitiateDownload | InitiateBlockUpload | InitiateBlockDownload
InitiateAnswer = ExpeditedUpload | UploadInitiated | DownloadInitiated | BlockUploadInitiated | BlockDownloadInitiated

_UPLOADED = (ExpeditedUpload, UploadInitiated)
TRANSFER_OF: dict[type, tuple[TransferDirection, TransferManner, tuple[type, ...]]] = {
    InitiateUpload: ("upload", "expedited", _UPLOADED),
    ExpeditedDownload: ("download", "expedited", (DownloadInitiated,)),
    InitiateDownload: ("download", "segmented", (DownloadInitiated,)),
    InitiateBlockUpload: ("upload", "block", (BlockUploadInitiated, *_UPLOADED)),
    InitiateBlockDownload: ("download", "block", (BlockDownloadInitiated,)),
}
"""Request -> direction and kind of the transfer that it begins, and its possible answers."""
CLIENT_MESSAGES: tuple[type[SdoMessage], ...] = (
    *(InitiateUpload, ExpeditedDownload, InitiateDownload, NextSegment, SdoSegment, Abort),
    *(InitiateBlockUpload, InitiateBlockDownload, StartBlockUpload, BlockAck, BlockEnd, BlockEnded),
)
SERVER_MESSAGES: tuple[type[SdoMessage], ...] = (
    *(ExpeditedUpload, UploadInitiated, DownloadInitiated, SdoSegment, SegmentTaken, Abort),
    *(BlockUploadInitiated, BlockDownloadInitiated, BlockAck, BlockEnd, BlockEnded),
)

VALUE_MAX = 1 << 20
"""The longest value that is held, in bytes; of a longer one the bytes are only counted."""
HELD_MAX = 16 << 20
"""The most bytes that all transfers under way hold together."""


class HeldBytes:
    """The number of bytes held by all transfers together; `refused` counts bytes above the limit."""

    def __init__(self, limit: int = HELD_MAX) -> None:
        self.limit = limit
        self.used = 0
        self.refused = 0

    def take(self, count: int) -> bool:
        """Reserve `count` more bytes; return False if they exceed the limit."""
        if self.used + count > self.limit:
            self.refused += count
            return False
        self.used += count
        return True


def object_name(index: int | None, sub: int | None) -> str:
    """Return index and sub-index in the usual notation.

    >>> object_name(0x6041, 0), object_name(None, None)
    ('6041h:00', 'an object')
    """
    return "an object" if index is None else f"{index:04X}h:{sub or 0:02X}"


class OpenTransfer:
    """The state of one transfer. `began` is None if its beginning is not in the recording."""

    def __init__(
        self,
        direction: TransferDirection,
        manner: TransferManner,
        place: tuple[int, int] | None,
        began: float | None,
        held: HeldBytes,
    ) -> None:
        self.direction = direction
        self.manner: TransferManner = manner
        self.index = None if place is None else place[0]
        self.sub = None if place is None else place[1]
        self.began = began
        self.last_frame_at = 0.0
        self.request = b""  # until its answer arrives
        self.answers: tuple[type, ...] = ()  # that the request can have
        self.next_sender: SdoSide = "server"
        self.toggle = 0  # of the segment that is under way, or comes next
        self.last_sent = False  # whether the last segment of a download was sent
        self.previous = b""  # the data of the segment before
        self.switch: int | None = None  # the protocol switch threshold of a block upload
        self.blksize: int | None = None  # that the client requested
        self.size: int | None = None  # as announced
        self.count = 0
        self.data = bytearray()
        self.crc = 0
        self.client_crc: bool | None = None  # whether the client supports a CRC; None if its request was not recorded
        self.crc_result: Literal["ok", "wrong", "unused", "unknown", ""] = ""
        self.complete = began is not None  # no byte of the value is missing so far
        self.gapped = False  # the recording has a gap within this transfer
        self.doubt: Literal["", "toggle", "unasked"] = ""  # a fault that the next frame proves or disproves
        self.repeats = self.lost = self.missing = 0
        self._held = held
        self._holds = True

    def __str__(self) -> str:
        return object_name(self.index, self.sub)

    def take(self, data: bytes) -> None:
        """Append the next bytes of the value."""
        self.count += len(data)
        self.crc = crc_hqx(data, self.crc)
        if self._holds and (self.count > VALUE_MAX or not self._held.take(len(data))):
            self.forget()
        if self._holds:
            self.data += data

    def forget(self) -> None:
        """Release the bytes that are held; later ones are only counted."""
        self._held.used -= len(self.data)
        self.data.clear()
        self._holds = False

    def note_missing(self, frames: int, *, data: bool = True) -> None:
        """Count frames that are not in the recording; with `data`, they carried bytes of the value."""
        self.missing += frames
        if data:
            self.complete = False

    def report(
        self,
        at: float,
        node: int,
        channel: int,
        outcome: TransferOutcome,
        *,
        blocks: int = 0,
        abort: int | None = None,
        by: SdoSide | None = None,
    ) -> SdoTransferReport:
        """End the transfer and return its report. The bytes that it held are released."""
        proved = self.crc_result == "ok" or (self.size is not None and self.size == self.count)
        known = self._holds and self.complete and (proved or not self.gapped)
        report = SdoTransferReport(
            *(at, node, channel, self.direction, self.manner, self.index, self.sub, outcome, self.began),
            data=bytes(self.data) if known and (self.count or outcome == "done") else None,
            count=self.count,
            size=self.size,
            abort=abort,
            by=by or "",
            crc=self.crc_result,
            blocks=blocks,
            again=self.repeats,
            lost=self.lost,
            missing=self.missing,
        )
        self.forget()
        return report
