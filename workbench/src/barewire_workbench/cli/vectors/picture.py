"""`barewire vectors show --format svg`: the picture of a case.

one frame                    its bytes and fields; on a page of a whole frame also its levels on the wire
several frames               a sequence diagram
words of a CiA 402 drive     the state machine with the path
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from barewire.canopen.frame import CanFrame
from barewire.errors import EncodeError
from barewire_workbench import Explanation
from barewire_workbench.cli.vectors.frames import FrameOfCase, frames_of_case
from barewire_workbench.pictures.fields import FieldsPicture
from barewire_workbench.pictures.levels import frame_pictures
from barewire_workbench.pictures.picture import Picture
from barewire_workbench.pictures.recordings import CLIENT, MASTER, can_stations, explained_message
from barewire_workbench.pictures.sequence import SequenceMessage, SequencePicture
from barewire_workbench.pictures.states import DriveWord, StatesPicture
from barewire_workbench.vectors.questions import Case

_TIME = re.compile(r"at (\d+) us")
_SIDES = ("", "client", "server", "request", "response")
"""Places of a frame that its arrow shows."""
_WHOLE = ("rtu-frame", "ascii-frame", "tcp-frame")


def pictures_of_case(kind: str, case: Case) -> list[Picture]:
    """Return the pictures of a case, the most telling first. Raise EncodeError for a case without any."""
    words = [*_drive_words(kind, case)]
    if words:
        return [StatesPicture(words, str(case["id"]))]
    frames = [*frames_of_case(kind, case)]
    if not frames:
        raise EncodeError(f"{case['id']}: a case of kind {kind} has no frames that can be drawn")
    if len(frames) > 1:
        return [SequencePicture(f"{case['id']}: {kind}", _messages(frames), [CLIENT, MASTER])]
    explanation = frames[0].explanation
    if explanation.protocol != "can" and kind not in _WHOLE:
        return [FieldsPicture(explanation, "PDU")]
    return list(frame_pictures(explanation, _can_frame(explanation)).values())


def _drive_words(kind: str, case: Case) -> Iterator[DriveWord]:
    """Yield the words of a case about a drive: each status word that is seen, and the control word that is written."""
    if kind == "drive-state" and "word" in case:
        yield DriveWord("status", int(case["word"], 16))
    elif kind == "drive-command" and "word" in case:
        yield DriveWord("control", int(case["word"], 16))
    elif kind == "drive-path" and "seen" in case:
        for seen, written in zip(case["seen"], [*case.get("words", []), *[None] * len(case["seen"])]):
            yield DriveWord("status", int(seen, 16))
            if isinstance(written, str):
                yield DriveWord("control", int(written, 16))


def _messages(frames: Sequence[FrameOfCase]) -> Iterator[SequenceMessage]:
    for frame in frames:
        explanation, timed = frame.explanation, _TIME.search(frame.place)
        source, target = _stations(explanation)
        message = explained_message(source, target, explanation)
        if timed is not None:
            yield message._replace(at=int(timed[1]) / 1e6)
        else:
            yield message._replace(text=message.text if frame.place in _SIDES else f"{frame.place}: {message.text}")


def _stations(explanation: Explanation) -> tuple[str, str]:
    if explanation.protocol == "can":
        frame = _can_frame(explanation)
        return (MASTER, "") if frame is None else can_stations(frame)
    return ("server", CLIENT) if explanation.role == "response" else (CLIENT, "server")


def _can_frame(explanation: Explanation) -> CanFrame | None:
    """Return the frame of an explanation, if its fields have all of it."""
    if explanation.protocol != "can" or not explanation.fields or explanation.fields[0].name != "COB-ID":
        return None
    identifier, *fields = explanation.fields
    if not fields and "remote" in explanation.verdict:
        return None
    data = bytes.fromhex("".join(field.hex for field in fields if field.length))
    return CanFrame(int(identifier.hex, 16), data, extended=len(identifier.hex) > 3)
