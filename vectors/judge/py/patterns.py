"""Whether what a running server or device sent is accepted: patterns of server-conformance and device-conformance."""

from __future__ import annotations

import re
from typing import Any


def fits_one_row(rows: list[list[str]], texts: Any) -> bool:
    """server-conformance: a row of texts, one for each step; in them .. is any byte, ... any rest."""

    def fits(pattern: str, text: str) -> bool:
        wanted, found = pattern.split(), text.split()
        if wanted[-1:] == ["..."]:
            wanted, found = wanted[:-1], found[: len(wanted) - 1]
        are_same = (byte == other or byte.rstrip(";") == ".." for byte, other in zip(wanted, found))
        return len(wanted) == len(found) and all(are_same)

    is_row = isinstance(texts, list) and all(isinstance(text, str) for text in texts)
    return is_row and any(len(row) == len(texts) and all(map(fits, row, texts)) for row in rows)


def is_accepted(steps: list[dict[str, Any]] | None, received: Any) -> bool:
    """device-conformance: the frames of each step fit a pattern of `accept`; one of `ends` ends the case."""
    if not steps or not isinstance(received, list) or not all(isinstance(frames, list) for frames in received):
        return False
    for count, (step, frames) in enumerate(zip(steps, received), start=1):
        if any(fits_frames(parts(pattern), frames) for pattern in step["ends"]):
            return len(received) == count
        if not any(fits_frames(parts(pattern), frames) for pattern in step["accept"]):
            return False
    return len(received) == len(steps)


def parts(pattern: str) -> list[str]:
    return [part.strip() for part in re.split(r",(?![0-9]+\})", pattern) if part.strip()]


def fits_frames(wanted: list[str], frames: list[Any]) -> bool:
    if not wanted:
        return not frames
    frame, _, counts = wanted[0].rstrip("}").partition("{")
    least, most = map(int, counts.split(",")) if counts else (1, 1)
    for count in range(most + 1):
        if count >= least and fits_frames(wanted[1:], frames[count:]):
            return True
        if count >= len(frames) or not any(fits_frame(pattern, frames[count]) for pattern in frame.split("|")):
            return False
    return False


def fits_frame(pattern: str, text: Any) -> bool:
    return isinstance(text, str) and re.fullmatch(pattern.replace(".", "[0-9A-F]"), text) is not None
