"""Whole SDO transfers as the steps of a conformance case, by the standard.   [CiA 301 7.2.4.3]

The functions:

    upload_steps, download_steps                  in segments, whatever the length
    block_upload_steps, block_download_steps      in blocks, or a device without them aborts the start with 05040001
"""

from __future__ import annotations

from typing import Literal

from barewire_workbench.conform.canopen.frames import (
    Sdo,
    block_end,
    block_segment,
    little,
    parts,
    segment,
    silence,
)
from barewire_workbench.conform.canopen.model import NodeStep

BlockPart = Literal["begun", "sent", "ended", "done"]
"""How far a block upload goes: its start, its blocks, the end that the device sends, the answer to that."""
NO_BLOCKS = 0x0504_0001


def upload_steps(s: Sdo, place: str, value: bytes, count: int | None = None) -> list[NodeStep]:
    """Return the steps that read a value in segments; with `count` only the first ones. `place` is a multiplexer."""
    pieces = parts(value)
    begin = s.response(f"41{place}{little(len(value), 4)}"), s.response(f"40{place}")
    segments = [
        NodeStep((s.request("70" if number & 1 else "60"),), (s.response(segment(number, piece, piece is pieces[-1])),))
        for number, piece in enumerate(pieces)
    ]
    return [NodeStep((s.request(f"40{place}"),), begin), *segments[:count]]


def download_steps(
    s: Sdo, place: str, value: bytes, count: int | None = None, *, size: int | None = None
) -> list[NodeStep]:
    """Return the steps that write a value in segments; with `count` only the first ones. `size` is announced."""
    pieces = parts(value)
    announced = little(len(value) if size is None else size, 4)
    segments = [
        NodeStep((s.request(segment(number, piece, piece is pieces[-1])),), (s.response("30" if number & 1 else "20"),))
        for number, piece in enumerate(pieces)
    ]
    return [NodeStep((s.request(f"21{place}{announced}"),), (s.response(f"60{place}"),)), *segments[:count]]


def block_upload_steps(
    s: Sdo, place: str, value: bytes, *, crc: bool = True, blksize: int = 20, until: BlockPart = "done"
) -> list[NodeStep]:
    """Return the steps that read a value in blocks of `blksize` segments."""
    sized = s.response(f"C[26]{place}{little(len(value), 4)}")
    request = s.request(f"{'A4' if crc else 'A0'}{place}{blksize:02X}00")
    steps = [NodeStep((request,), (f"{sized}|{s.response(f'C[04]{place}')}",), (s.aborted(NO_BLOCKS),))]
    count, first, sends = len(parts(value)), 1, "A3"
    while first <= count:
        last = min(first + blksize - 1, count)
        steps.append(block_step(s, s.request(sends), value, first, last))
        first, sends = last + 1, f"A2{last - first + 1:02X}{blksize:02X}"
    ends = s.response(block_end(value, 0))
    end = NodeStep((s.request(sends),), (f"{s.response(block_end(value))}|{ends}" if crc else ends,))
    whole = [*steps, end, silence(s.request("A1"), wait=0.02)]
    return whole[: {"begun": 1, "sent": -2, "ended": -1, "done": None}[until]]


def block_step(s: Sdo, request: str, value: bytes, first: int, last: int) -> NodeStep:
    """Return the step that sends a request and expects the segments `first` to `last` of a value, numbered from 1."""
    pieces = parts(value)
    frames = [
        s.response(block_segment(number - first + 1, pieces[number - 1], number == len(pieces)))
        for number in range(first, min(last, len(pieces)) + 1)
    ]
    return NodeStep((request,), (", ".join(frames),))


def block_download_steps(s: Sdo, place: str, value: bytes) -> list[NodeStep]:
    """Return the steps that write a value in one block with a CRC."""
    pieces = parts(value)
    begin = s.request(f"C6{place}{little(len(value), 4)}")
    sends = [s.request(block_segment(number, piece, piece is pieces[-1])) for number, piece in enumerate(pieces, 1)]
    return [
        NodeStep((begin,), (s.response(f"A[04]{place}"),), (s.aborted(NO_BLOCKS),)),
        NodeStep(tuple(sends), (s.response(f"A2{len(pieces):02X}"),)),
        NodeStep((s.request(block_end(value)),), (s.response("A1"),)),
    ]
