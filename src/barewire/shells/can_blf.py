"""BLF, Vector's binary recordings, read by python-can; all other forms are read without it: `explain.can_recording`."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator

from barewire.canopen.frame import EXTENDED_MAX, CanFrame, ErrorFrame, FdFrame
from barewire.errors import PortError
from barewire.explain.recorded import AnyFrame, Item, Recorded, unread

try:
    import can
except ModuleNotFoundError as missing:  # pragma: no cover - tried by CI in an environment without it
    raise PortError("BLF files need python-can: pip install 'barewire[can]'") from missing


def read_blf(data: bytes) -> Iterator[Item]:
    """The frames of a BLF file; where it is damaged it ends, and the last item says so."""
    at, number = 0.0, 0
    try:
        for message in can.BLFReader(io.BytesIO(data)):
            at, number = float(message.timestamp), number + 1
            yield Recorded(at, "" if message.channel is None else str(message.channel), _frame(message), number)
    except (can.CanError, OSError, ValueError, IndexError, EOFError, struct.error, zlib.error) as error:
        why = " ".join(str(error).split()) or type(error).__name__
        yield unread(at, number + 1, f"the BLF file is damaged here: {why}", "")


def _frame(message: can.Message) -> AnyFrame:
    if message.is_error_frame:
        return ErrorFrame(message.arbitration_id & EXTENDED_MAX, bytes(message.data))
    if message.is_fd:
        flags = bool(message.bitrate_switch) | bool(message.error_state_indicator) << 1
        return FdFrame(message.arbitration_id, bytes(message.data), message.is_extended_id, flags)
    if message.is_remote_frame:
        return CanFrame(message.arbitration_id, b"", message.is_extended_id, True, min(message.dlc, 8))
    return CanFrame(message.arbitration_id, bytes(message.data), message.is_extended_id)
