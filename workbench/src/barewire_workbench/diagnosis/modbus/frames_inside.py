"""Good RTU frames inside the bytes: one behind the other, or with other bytes before and behind them."""

from __future__ import annotations

from collections.abc import Iterator

from barewire.modbus.messages.base import EXCEPTION_BIT
from barewire.modbus.messages.registry import measure_request, measure_response
from barewire.rtu.crc import crc16
from barewire.rtu.frame import LONGEST, SHORTEST
from barewire_workbench.diagnosis.modbus.good import HIGHEST_UNIT, digits, good_rtu, missing, proof_of
from barewire_workbench.frames.findings import Finding
from barewire_workbench.frames.modbus import explain_rtu
from barewire_workbench.frames.result import Explanation, FrameRole, counted

_SHOWN = 8
"""So many bytes of noise are in the text of a finding."""


def frames_inside(data: bytes, role: FrameRole | None) -> Iterator[Finding]:
    """Find good frames with other bytes around them, or one behind the other."""
    first, frames = _good_frames(data)
    if not frames:
        return
    end = first + sum(len(frame) for frame, _ in frames)
    rest, proof = data[end:], "; ".join(proof_of(frame, good) for frame, good in frames)
    begun = missing(rest, 2) if len(rest) >= SHORTEST else []
    if begun:
        proof += f"; {digits(rest)} is {begun[0].text()}"
    if len(frames) + bool(begun) > 1:
        text = (
            f"{counted(len(frames), 'frame')} one behind the other" if not begun else "a frame, and a part of another"
        )
        yield Finding("two-frames", text, proof)
    if first:
        yield Finding("noise-before", f"{counted(first)} before the frame: {clipped_digits(data[:first])}", proof)
    if rest and not begun:
        yield Finding("noise-after", f"{counted(len(rest))} behind the frame: {clipped_digits(rest)}", proof)


def clipped_digits(data: bytes) -> str:
    """Return bytes for the text of a finding, which is one line."""
    return digits(data) if len(data) <= _SHOWN else f"{digits(data[: _SHOWN - 1])} ..."


def _good_frames(data: bytes) -> tuple[int, list[tuple[bytes, Explanation]]]:
    """Return where the first good frame begins, and all good frames that follow one another from there."""
    for first in range(len(data) - SHORTEST + 1):
        frames = list(_frames_from(data, first))
        if frames:
            return first, frames
    return 0, []


def _frames_from(data: bytes, at: int) -> Iterator[tuple[bytes, Explanation]]:
    while (found := _frame_at(data, at)) is not None:
        yield found
        at += len(found[0])


def _frame_at(data: bytes, at: int) -> tuple[bytes, Explanation] | None:
    if at + SHORTEST > len(data) or data[at] > HIGHEST_UNIT:
        return None
    for measure in (measure_request, measure_response):
        size = measure(data[at + 1 : at + LONGEST])
        if size is not None and size + 3 >= SHORTEST and at + size + 3 <= len(data):
            frame = data[at : at + size + 3]
            if (good := good_rtu(frame)) is not None:
                return frame, good
            if data[at + 1] & EXCEPTION_BIT and crc16(frame) == 0:  # to a function that the standard does not have
                return frame, explain_rtu(frame, "response")
    return None
