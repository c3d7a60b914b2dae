"""Messages of ISO-TP (ISO 15765-2) on a bus without CANopen: cars and their testers send them.

    7E0#0322F19000000000    one frame: 3 bytes
    7E8#101462F190574241    the first of several: 20 bytes in all
    7E0#3000000000000000    flow control: go on
    7E8#2155415A5A5A38    consecutive frames, numbered 1 to F, 0, 1 ...

Frames of other protocols may begin with the same bytes. So a message counts only if the flow control of another
identifier and the first consecutive frame follow.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from barewire.canopen.frame import CanFrame
from barewire_workbench.frames.findings import Finding

_FIRST, _CONSECUTIVE, _CONTROL = 1, 2, 3
_IN_FIRST, _IN_CONSECUTIVE = 6, 7
"""Bytes of a message in a frame."""
_KEPT = 64
"""Messages that are open at once."""


@dataclass(slots=True)
class _Message:
    """A message of several frames; `rest` is how many bytes are to come."""

    size: int
    rest: int
    last: int = 0  # the number of the last frame
    controls: list[CanFrame] = field(default_factory=list)  # since the last frame


class IsoTp:
    """The messages of several frames on one bus, by the identifiers of their senders.

    >>> iso, said = IsoTp(), []
    >>> for text in ("7E8#100A000102030405", "7E0#3000000000000000", "7E0#300A140000000000", "7E8#21060708090A0000"):
    ...     said += iso.take(CanFrame.parse(text))
    >>> said[0].text
    'two different flow controls answer one frame, as of two programs that receive the message'
    """

    def __init__(self) -> None:
        self._open: dict[int, _Message] = {}

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {len(self._open)} open>"

    def take(self, frame: CanFrame) -> Iterator[Finding]:
        """Take the next frame of any identifier; yield what is wrong with the message that it belongs to."""
        kind, number = frame.data[0] >> 4, frame.data[0] & 0x0F
        if kind == _CONTROL and number < 3 and len(frame.data) > 2 and len({*frame.data[3:]}) < 2:
            if self._open and frame.id not in self._open:
                waiting = next(reversed(self._open.values()))
                if frame not in waiting.controls:  # which a program prints twice
                    waiting.controls.append(frame)
        elif (message := self._open.pop(frame.id, None)) is not None and kind == _CONSECUTIVE:
            yield from self._goes_on(message, frame, number)
        elif kind == _FIRST and len(frame.data) == 8 and len(self._open) < _KEPT:
            size = int.from_bytes(frame.data[:2], "big") & 0x0FFF
            if size > _IN_CONSECUTIVE:
                self._open[frame.id] = _Message(size, size - _IN_FIRST)

    def _goes_on(self, message: _Message, frame: CanFrame, number: int) -> Iterator[Finding]:
        expected = message.last + 1 & 0x0F
        is_known = message.rest < message.size - _IN_FIRST
        if not is_known and (number != expected or not message.controls):
            return  # no message of ISO-TP
        if is_known and number == message.last:  # which a program prints twice
            self._open[frame.id] = message
            return
        if len(message.controls) > 1:
            text = "two different flow controls answer one frame, as of two programs that receive the message"
            yield Finding("two-answers", text, " and ".join(map(str, message.controls[:2])))
        if number != expected:
            text = f"consecutive frame {0x20 + expected:02X} of a message of {message.size} bytes is missing here"
            yield Finding("lost-frame", text, f"{frame} follows number {message.last:X}h")
        message.rest -= _IN_CONSECUTIVE * ((number - message.last) % 16 or 16)
        message.last, message.controls = number, []
        if message.rest > 0:
            self._open[frame.id] = message

    def open(self) -> Iterator[str]:
        """Yield the messages of which nothing came after their flow control."""
        for identifier, message in self._open.items():
            if message.controls and message.last == 0 and message.rest == message.size - _IN_FIRST:
                what = f"message of {identifier:X}h, {message.size} bytes"
                yield f"{what}, whose second frame does not follow the flow control"
