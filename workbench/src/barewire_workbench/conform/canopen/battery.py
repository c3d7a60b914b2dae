"""The conformance battery of CANopen devices: all cases in their order, and how one is run.   [CiA 301, CiA 305]

    all_cases     all cases for one device: those of the vectors, in random order, and those of an EDS
    prepare       resets the communication of the device, before and after a case that changes it, and enters
                  PRE-OPERATIONAL; undoes what the case before has written
    run_case      sends the steps of a case, compares received frames with the accepted patterns, stops at a difference

Frames that a case does not listen for (heartbeats, process data of other nodes) are ignored.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import lru_cache

from barewire.canopen.eds.objects import EdsObject
from barewire.canopen.frame import CanFrame
from barewire.canopen.nmt.messages import NmtCommand
from barewire.conversation import Conversation, Listen, Send
from barewire_workbench.conform.canopen.eds_objects import application_cases, object_cases, random_cases
from barewire_workbench.conform.canopen.model import (
    BOOT,
    NODE_ANSWER_TIMEOUT,
    NodeCase,
    NodeOutcome,
    NodeStep,
    Subject,
)
from barewire_workbench.conform.canopen.probe import with_lss_pauses
from barewire_workbench.conform.canopen.restore import restore_values
from barewire_workbench.conform.canopen.script import CaseFields, Placeholders, applies, read_node_case

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
    return len(frames) < FLOOD and _matches_any(step.ends, frames)


def _is_accepted(step: NodeStep, frames: Sequence[str]) -> bool:
    return len(frames) < FLOOD and _matches_any(step.accepts, frames)


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
        if frames and not step.full_wait and _matches_any((*step.accepts, *step.ends), frames):
            if not is_last:
                return frames
            until = min(until, heard.now + _SETTLE)
        if len(frames) >= FLOOD:
            return frames
        heard = yield Listen(until)


def _matches_any(patterns: Iterable[str], frames: Sequence[str]) -> bool:
    return any(_matches(pattern, frames) for pattern in patterns)


def _matches(pattern: str, frames: Sequence[str]) -> bool:
    """Return whether the received frames match this pattern.

    >>> _matches("705#7F{1,3}, 585#43....", ["705#7F", "705#7F", "585#4318"])
    False
    >>> _matches("705#7F{1,3}, 585#43....|585#60....", ["705#7F", "585#600017"])
    True
    """
    return _compiled(pattern).fullmatch("".join(f"{frame} " for frame in frames)) is not None


@lru_cache(1024)  # a pattern is asked after each frame of its step
def _compiled(pattern: str) -> re.Pattern[str]:
    return re.compile("".join(map(_regex, _split(pattern))))


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
