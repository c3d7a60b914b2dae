"""The pictures of one frame: its fields, and its levels on the wire.

The pictures of each protocol:

    protocol     fields    levels
    rtu          yes       the characters of a serial line, 8E1, with the silence on both sides
    ascii        yes       the characters of a serial line, 7E1
    can          yes       the bits of the frame on the bus; not of CAN FD and of error frames
    tcp          yes       -
"""

from __future__ import annotations

import re
from typing import NamedTuple

from barewire.canopen.frame import AnyFrame, CanFrame
from barewire.errors import EncodeError, shown
from barewire_workbench.frames.result import Explanation
from barewire_workbench.pictures.can_frame import CanFramePicture
from barewire_workbench.pictures.fields import FieldsPicture
from barewire_workbench.pictures.levels import frame_levels
from barewire_workbench.pictures.picture import Picture
from barewire_workbench.wire.can_bits import can_bits
from barewire_workbench.wire.uart import CharacterFormat


class SerialLine(NamedTuple):
    """The baud rate and the character format of a serial line."""

    baudrate: int
    form: CharacterFormat

    @classmethod
    def parse(cls, text: str) -> SerialLine:
        """Return the line with this name.

        >>> SerialLine.parse("9600,8N1")
        SerialLine(baudrate=9600, form=CharacterFormat(data_bits=8, parity='N', stop_bits=1))

        Raises EncodeError for any other text, and for a baud rate outside 1 to 10000000.
        """
        rate, _, form = text.partition(",")
        if not re.fullmatch("[0-9]{1,8}", rate.strip()) or not 1 <= int(rate) <= 10_000_000 or not form:
            raise EncodeError(f"line {shown(text)}: expected baud rate and format of the characters, such as 9600,8N1")
        return cls(int(rate), CharacterFormat.parse(form))


def frame_pictures(
    explanation: Explanation, frame: AnyFrame | None = None, line: SerialLine | None = None
) -> dict[str, Picture]:
    """Return the pictures of a frame by name: "fields", and "levels" where they exist.

    `frame` is that of "can". The levels of a serial `line` are those of 19200,8E1 for RTU and 19200,7E1 for ASCII
    unless another is given.

    >>> from barewire_workbench import explain
    >>> list(frame_pictures(explain("rtu", bytes.fromhex("01 03 00 00 00 02 C4 0B"))))
    ['fields', 'levels']

    Raises EncodeError if a byte has more bits than a character of the line.
    """
    pictures: dict[str, Picture] = {"fields": FieldsPicture(explanation)}
    if explanation.protocol in ("rtu", "ascii"):
        pictures["levels"] = frame_levels(explanation, *(() if line is None else (line.form, line.baudrate)))
    elif isinstance(frame, CanFrame):
        try:
            pictures["levels"] = CanFramePicture(can_bits(frame))
        except EncodeError:  # no controller can send it
            return pictures
    return pictures
