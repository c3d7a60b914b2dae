"""The conformance battery of CANopen devices: all cases in their order, and how one is run.   [CiA 301, CiA 305]

    all_cases     all cases for one device: those of the vectors, in random order, and those of an EDS
    prepare       resets the communication of the device, before and after a case that changes it, and enters
                  PRE-OPERATIONAL; undoes what the case before has written
    run_case      sends the steps of a case, compares received frames with the accepted patterns, stops at a difference

Frames that a case does not listen for (heartbeats, process data of other nodes) are ignored.

A reset of the communication restores 1000h to 1FFFh. On a device that keeps its values (reported by NMT-17), the
objects that the case wrote are read back, and those with another value than before the battery are written:

        PDO 1400h ... 1A00h     switched off, the count 0, the entries, the count, the record, switched on
        SYNC 1005h, 1006h       the device stops to produce it, then 1019h and 1007h, the period, 1005h
        1012h, 1014h, 1201h ... switched off, then the value before
        1016h                   all changed entries 0, then their values: no node may be in two

After a case that stores values, all values that the battery knows are compared, and those before it are stored again.
A refused write is ignored: this is for the cases that follow, which will report what they find.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence

from barewire.canopen.abort_codes import SdoAbort
from barewire.canopen.eds.objects import EdsObject
from barewire.canopen.frame import CanFrame
from barewire.canopen.nmt.messages import NmtCommand
from barewire.canopen.object_dictionary import ObjectAddress
from barewire.canopen.sdo.channel import Channel
from barewire.canopen.sdo.client import download, upload
from barewire.conversation import Conversation, Listen, Send
from barewire.errors import NoAnswer
from barewire_workbench.conform.canopen.eds_objects import application_cases, object_cases, random_cases
from barewire_workbench.conform.canopen.model import (
    BOOT,
    NODE_ANSWER_TIMEOUT,
    SAVE,
    NodeCase,
    NodeOutcome,
    NodeStep,
    Subject,
)
from barewire_workbench.conform.canopen.probe import with_lss_pauses
from barewire_workbench.conform.canopen.script import CaseFields, Placeholders, applies, read_node_case

_NEVER_WRITTEN = (0x1003, 0x1010, 0x1011)
"""The history of errors, and the commands that store and restore: their values are not settings."""
_STORING = 5.0
"""Seconds that a device may take to store its values."""
_SDO_CHANNELS = range(0x1201, 0x1300)
_OFF, _PRODUCES, _CONSUMES = 0x8000_0000, 0x4000_0000, 0x8000_0000


def restore_values(
    subject: Subject, case: NodeCase, *, timeout: float = NODE_ANSWER_TIMEOUT
) -> Conversation[CanFrame, None]:
    """Give the objects that a case wrote the values of the subject, if they have others. Return if nothing answers."""
    channel = Channel(subject.node)
    try:
        changed: dict[ObjectAddress, bytes] = {}
        stores = case.effect in ("stores", "power")
        for place in tuple(subject.values) if stores else _written(case, subject):
            try:
                present = yield from upload(channel, *place, timeout=timeout)
            except SdoAbort:
                continue
            if present != subject.values[place] and place[0] not in _NEVER_WRITTEN:
                changed[place] = subject.values[place]
        for place, data in _in_safe_order(subject, changed):
            try:
                yield from download(channel, *place, data, timeout=timeout)
            except SdoAbort:
                continue
        if stores:
            yield from download(channel, 0x1010, 1, SAVE.to_bytes(4, "little"), timeout=_STORING)
    except (NoAnswer, SdoAbort):
        return


def _written(case: NodeCase, subject: Subject) -> tuple[ObjectAddress, ...]:
    """Return the objects of the subject to which the case sends a download."""
    places: dict[ObjectAddress, None] = {}
    for text in (text for step in case.steps for text in step.sends):
        frame = CanFrame.parse(text)
        if frame.key != (0x600 + subject.node, False) or len(frame.data) < 4:
            continue
        # The initiate of a download (001x xxxxb) or of one in blocks (110x xxx0b) names an object.
        if frame.data[0] & 0xE0 == 0x20 or frame.data[0] & 0xE1 == 0xC0:
            place = int.from_bytes(frame.data[1:3], "little"), frame.data[3]
            if place in subject.values and place[0] not in _NEVER_WRITTEN:
                places[place] = None
    return tuple(places)


def _in_safe_order(subject: Subject, changed: Mapping[ObjectAddress, bytes]) -> Iterator[tuple[ObjectAddress, bytes]]:
    """Yield the writes that give these objects their values, each as the standard allows it."""
    rest = dict(changed)
    for communication in sorted({_record_of(index) for index, _ in changed if _record_of(index)}):
        yield from _pdo(subject, communication, rest)
    if any(index in (0x1005, 0x1006, 0x1019) for index, _ in changed):
        yield from _sync(subject, rest)
    for place in [place for place in rest if place[0] == 0x1016]:
        yield place, bytes(4)  # a node may be in one entry only, also while they are written one by one
    for place, data in rest.items():
        word = int.from_bytes(data, "little")
        if place[0] == 0x1014 or (place[0] in _SDO_CHANNELS and place[1] in (1, 2)):
            yield place, _four(word | _OFF)
        elif place[0] == 0x1012:
            yield place, _four(word & ~(_CONSUMES | _PRODUCES))
        yield place, data


def _record_of(index: int) -> int:
    """Return the index of the communication record of a PDO, from that of either of its records; 0 for others."""
    return index & ~0x0200 if 0x1400 <= index < 0x1C00 else 0


def _pdo(
    subject: Subject, communication: int, rest: dict[ObjectAddress, bytes]
) -> Iterator[tuple[ObjectAddress, bytes]]:
    mapping = communication + 0x0200
    word = subject.number(communication, 1)
    yield (communication, 1), _four(word | _OFF)
    entries = {sub: rest.pop((mapping, sub)) for index, sub in sorted(rest) if index == mapping}
    if entries:
        yield (mapping, 0), b"\0"
        yield from (((mapping, sub), data) for sub, data in entries.items() if sub)
        yield (mapping, 0), subject.values[mapping, 0]
    record = {sub: rest.pop((communication, sub)) for index, sub in sorted(rest) if index == communication}
    yield from (((communication, sub), data) for sub, data in record.items() if sub != 1)
    yield (communication, 1), _four(word)


def _sync(subject: Subject, rest: dict[ObjectAddress, bytes]) -> Iterator[tuple[ObjectAddress, bytes]]:
    if subject.has(0x1005):
        yield (0x1005, 0), _four(subject.number(0x1005) & ~_PRODUCES)
    if subject.has(0x1006):
        yield (0x1006, 0), bytes(4)  # 1019h is refused while there is a period
    for index in (0x1019, 0x1007, 0x1006, 0x1005):
        rest.pop((index, 0), None)
        if subject.has(index):
            yield (index, 0), subject.values[index, 0]


def _four(word: int) -> bytes:
    return word.to_bytes(4, "little")


# Running cases ------------------------------------------------------------------------------------------------------


_SETTLE = 0.01
"""Seconds of silence after the last response of a case, in which a repeated one is noticed."""
FLOOD = 500
"""A step ends after this many frames: the longest accepted response, a block, has 128."""
_SHOWN = 8
"""The text of a difference shows at most this many received frames."""


def all_cases(
    subject: Subject,
    scripts: Iterable[CaseFields],
    objects: Mapping[int, EdsObject] | None = None,
    dummies: Iterable[int] = (),
) -> tuple[NodeCase, ...]:
    """Return all cases for one device, in order. A case that needs something the device lacks names it in `lacks`.

    `scripts` are the cases of the vectors. `objects` and `dummies` are those of the EDS of the device, which add the
    cases of `eds_objects`. They come first, while all objects have the values that they have after a reset; those of
    `application` come last.
    """
    device = Placeholders(subject)
    return (
        *(() if objects is None else object_cases(subject, objects, dummies)),
        *(read_node_case(fields, device) for fields in scripts if applies(fields, device)),
        *random_cases(subject),
        *(() if objects is None else application_cases(subject, objects)),
    )


def needs_reset(case: NodeCase, previous: NodeOutcome | None) -> bool:
    """Return whether the device must be reset before this case: this case changes it, or the previous one did."""
    return case.effect not in ("reads", "tries") or (previous is not None and may_have_changed(previous))


def may_have_changed(outcome: NodeOutcome) -> bool:
    """Return whether a case may have left the device with other values or in another state."""
    effect = outcome.case.effect
    return effect not in ("reads", "tries") or (effect == "tries" and outcome.failure is not None)


def prepare(
    subject: Subject,
    *,
    after: NodeCase | None = None,
    command: NmtCommand = NmtCommand.RESET_COMMUNICATION,
    boot: float = BOOT,
    timeout: float = NODE_ANSWER_TIMEOUT,
) -> Conversation[CanFrame, bool]:
    """Reset the communication of the device, enter PRE-OPERATIONAL, and undo what the case `after` wrote.

        000#8205  ->            reset communication
                  <-  705#00    its boot-up message, within `boot` seconds
        000#8005  ->            enter pre-operational: for a device that starts itself, or sends no boot-up message
        605#...   <->           objects that keep the value that `after` wrote are written

    `command` may be RESET_NODE, which restores 2000h to 9FFFh as well. Return whether the boot-up message was received.
    """
    heard = yield Send(CanFrame(0, bytes([command, subject.node])))
    until, booted = heard.now + boot, False
    while heard.now < until:
        heard = yield Listen(until)
        frame = heard.item
        if not booted and frame is not None and frame.key == (0x700 + subject.node, False) and frame.data == b"\0":
            booted, until = True, heard.now + _SETTLE  # a device that starts itself may do so a moment later
    yield Send(CanFrame(0, bytes([NmtCommand.ENTER_PRE_OPERATIONAL, subject.node])))
    if after is not None:
        yield from restore_values(subject, after, timeout=timeout)
    return booted


def run_case(case: NodeCase, *, timeout: float = NODE_ANSWER_TIMEOUT) -> Conversation[CanFrame, NodeOutcome]:
    """Send the steps of a case and compare the responses with the accepted patterns. `timeout` is in seconds."""
    return with_lss_pauses(_run_steps(case, timeout))


def _run_steps(case: NodeCase, timeout: float) -> Conversation[CanFrame, NodeOutcome]:
    received: list[tuple[str, ...]] = []
    for number, step in enumerate(case.steps, start=1):
        frames = yield from _run_step(case, step, timeout, is_last=number == len(case.steps))
        received.append(tuple(frames))
        if _ends(step, frames) or not _is_accepted(step, frames):
            break
    return NodeOutcome(case, tuple(received), failure_of(case, received))


def failure_of(case: NodeCase, received: Sequence[Sequence[str]]) -> str | None:
    """Return how the frames received in each step differ from what the case accepts; None if they do not."""
    if not case.steps:
        return "the case has no step for this device"
    for number, step in enumerate(case.steps, start=1):
        if number > len(received):
            return f"step {number} of {len(case.steps)} was not carried out: {', '.join(step.sends) or 'a while'}"
        frames = received[number - 1]
        if _ends(step, frames):
            break
        if not _is_accepted(step, frames):
            return _difference(step, frames)
    return None if len(received) == number else f"frames of {len(received)} steps, and the case ends after {number}"


def _ends(step: NodeStep, frames: Sequence[str]) -> bool:
    return len(frames) < FLOOD and any(_matches(pattern, frames) for pattern in step.ends)


def _is_accepted(step: NodeStep, frames: Sequence[str]) -> bool:
    return len(frames) < FLOOD and any(_matches(pattern, frames) for pattern in step.accepts)


def _run_step(case: NodeCase, step: NodeStep, timeout: float, *, is_last: bool) -> Conversation[CanFrame, list[str]]:
    """Send the frames of a step. Return the frames received: at most FLOOD, after which it does not wait."""
    heard = None
    for text in step.sends:
        heard = yield Send(CanFrame.parse(text))
    if heard is None:
        heard = yield Listen(float("-inf"))  # returns at once, with the time
    until = heard.now + (timeout if step.wait is None else step.wait)
    frames: list[str] = []
    while True:
        if heard.item is not None and str(heard.item).startswith(case.listens):
            frames.append(str(heard.item))
        if heard.now >= until:
            return frames
        if frames and not step.full_wait and _fits(step, frames):
            if not is_last:
                return frames
            until = min(until, heard.now + _SETTLE)
        if len(frames) >= FLOOD:
            return frames
        heard = yield Listen(until)


def _fits(step: NodeStep, frames: list[str]) -> bool:
    return any(_matches(pattern, frames) for pattern in (*step.accepts, *step.ends))


def _matches(pattern: str, frames: Sequence[str]) -> bool:
    """Return whether the received frames match this pattern.

    >>> _matches("705#7F{1,3}, 585#43....", ["705#7F", "705#7F", "585#4318"])
    False
    >>> _matches("705#7F{1,3}, 585#43....|585#60....", ["705#7F", "585#600017"])
    True
    """
    regex = "".join(map(_regex, _split(pattern)))
    return re.fullmatch(regex, "".join(f"{frame} " for frame in frames)) is not None


def _split(pattern: str) -> Iterator[str]:
    """Return the parts between commas, but not at the comma in {1,3}."""
    return (part.strip() for part in re.split(r",(?![0-9]+\})", pattern) if part.strip())


def _regex(part: str) -> str:
    frame, brace, count = part.partition("{")
    return f"(?:(?:{frame.replace('.', '[0-9A-F]')}) ){brace}{count}"


def _difference(step: NodeStep, frames: Sequence[str]) -> str:
    sent = ", ".join(step.sends) or "a while"
    expected = " or ".join(pattern or "silence" for pattern in dict.fromkeys((*step.accepts, *step.ends)))
    responses = ", ".join(frames[:_SHOWN]) or "silence"
    if len(frames) > _SHOWN:
        responses += f" ... {len(frames)} frames{' and more' if len(frames) >= FLOOD else ''}"
    return f"after {sent}: {responses}, expected {expected}"
