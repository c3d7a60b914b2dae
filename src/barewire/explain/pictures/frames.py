"""The pictures of one frame: its fields, and its levels on the wire.

    protocol     fields    levels
    rtu          yes       the characters of a serial line, 8E1, with the silence on both sides
    ascii        yes       the characters of a serial line, 7E1
    can          yes       the bits of the frame on the bus; not of CAN FD and of error frames
    tcp          yes       -

Depends on: the pictures. Used by: the command `explain`, the explorer.
"""

from __future__ import annotations

from barewire.canopen.frame import AnyFrame, CanFrame
from barewire.errors import EncodeError
from barewire.explain.pictures.can_frame import CanFramePicture
from barewire.explain.pictures.fields import FieldsPicture
from barewire.explain.pictures.levels import frame_levels
from barewire.explain.pictures.picture import Picture
from barewire.explain.result import Explanation
from barewire.explain.wire.can_bits import can_bits


def frame_pictures(explanation: Explanation, frame: AnyFrame | None = None) -> dict[str, Picture]:
    """Return the pictures of a frame by name: "fields", and "levels" where they exist. `frame` is that of "can".

    >>> from barewire.explain import explain
    >>> list(frame_pictures(explain("rtu", bytes.fromhex("01 03 00 00 00 02 C4 0B"))))
    ['fields', 'levels']
    """
    pictures: dict[str, Picture] = {"fields": FieldsPicture(explanation)}
    if explanation.protocol in ("rtu", "ascii"):
        pictures["levels"] = frame_levels(explanation)
    elif isinstance(frame, CanFrame):
        try:
            pictures["levels"] = CanFramePicture(can_bits(frame))
        except EncodeError:  # no controller can send it
            return pictures
    return pictures
