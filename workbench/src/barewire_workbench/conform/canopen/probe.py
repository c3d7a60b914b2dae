"""Reads which objects a device has, so that the battery has only cases that can be run; the pause between LSS requests.

        7E5# ->          13.5 ms          7E5# ->          13.5 ms          7E5# ->

LSS answers only some requests, so a tester cannot wait for an answer before the next one, and two frames one after the
other overwrite each other in a device with one receive buffer that a main loop empties. The pause is the time of a
frame at the slowest bit rate of CiA 301, which such a device keeps up with.   [CiA 305]
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import TypeVar

from barewire.canopen.abort_codes import AbortCode, SdoAbort
from barewire.canopen.cob_ids import check_node
from barewire.canopen.eds.objects import REFUSES_READ, EdsItem, EdsObject, every_item
from barewire.canopen.frame import CanFrame
from barewire.canopen.lss.master import identify_slaves, switch_global, switch_selective
from barewire.canopen.lss.messages import REQUEST_KEY, LssAddress, LssState
from barewire.canopen.sdo.channel import Channel
from barewire.canopen.sdo.client import upload
from barewire.conversation import Conversation, Heard, Listen, Send
from barewire_workbench.conform.canopen.model import NODE_ANSWER_TIMEOUT, Subject

Result = TypeVar("Result")

LSS_PAUSE = 135 / 10_000
"""Seconds: a frame of eight bytes has at most 135 bits, with stuff bits, at 10 kbit/s."""


def with_lss_pauses(conversation: Conversation[CanFrame, Result]) -> Conversation[CanFrame, Result]:
    """Carry out a conversation, each LSS request `LSS_PAUSE` after the one before.

    Frames that arrive in a pause are received when the conversation listens next.
    """
    early: deque[CanFrame] = deque()
    may_send_at = now = float("-inf")
    try:
        step = next(conversation)
        while True:
            if isinstance(step, Listen):
                heard = Heard(early.popleft(), now) if early else (yield step)
            elif any(frame.key == REQUEST_KEY for frame in step.items):
                for frame in step.items:
                    while now < may_send_at:
                        heard = yield Listen(may_send_at)
                        now = heard.now
                        if heard.item is not None:
                            early.append(heard.item)
                    heard = yield Send(frame)
                    may_send_at = heard.now + LSS_PAUSE
            else:
                heard = yield step
            now = heard.now
            step = conversation.send(heard)
    except StopIteration as stop:
        result: Result = stop.value
        return result


_SINGLES = (0x1000, 0x1001, 0x1002, 0x1005, 0x1006, 0x1007, 0x1008, 0x1009, 0x100A, 0x100C, 0x100D, 0x1012, 0x1014,
            0x1015, 0x1017, 0x1019, 0x1F80)  # fmt: skip
_RECORDS = (0x1003, 0x1010, 0x1011, 0x1016, 0x1018, 0x1020, 0x1029, 0x1200, 0x1201, 0x1280)
_PDOS = (0x1400, 0x1600, 0x1800, 0x1A00)

_FURTHER_CHANNELS = (0x1202, 0x1281)
"""SDO servers 1202h to 127Fh, and clients 1281h to 12FFh: those after the first ones of `_RECORDS`."""

_DIFFERENT = ((0x1018, 4), (0x1000, 0), (0x1018, 1))
_SECOND = 0.1
"""Seconds in which the second of two devices answers the same request."""

STANDARD_OBJECTS = (*_SINGLES, *_RECORDS, *(first + number for first in _PDOS for number in range(4)))
"""The communication objects that are looked for in every device."""


def probe(
    node: int,
    *,
    timeout: float = NODE_ANSWER_TIMEOUT,
    large: tuple[int, int] | None = None,
    objects: Mapping[int, EdsObject] | None = None,
) -> Conversation[CanFrame, Subject]:
    """Read the communication objects of a device, and whether it supports LSS. Raise NoAnswer if there is no node.

    An object whose upload is refused counts as missing. No value is changed. With `objects`, those of its EDS, what
    they describe as readable is read as well, except domains, which may be long.
    """
    channel = Channel(check_node(node))
    values: dict[tuple[int, int], bytes] = {}
    for index in _SINGLES:
        yield from _read(channel, index, 0, values, timeout)
    for index in STANDARD_OBJECTS[len(_SINGLES) :]:
        yield from _read(channel, index, 0, values, timeout)
        for sub in range(1, _highest_sub(index, values) + 1):
            yield from _read(channel, index, sub, values, timeout)
    for first in _FURTHER_CHANNELS:
        # They are numbered without gaps: the first that is missing is the end.
        index = first
        while index & 0x7F and (index - 1, 0) in values:
            for sub in range(4):
                yield from _read(channel, index, sub, values, timeout)
            index += 1
    for described, item in every_item((objects or {}).values()):
        unread = (described.index, item.sub) not in values and described.index not in _SINGLES
        if unread and may_be_read(item) and item.type != "domain":
            yield from _read(channel, described.index, item.sub, values, timeout)
    return (yield from _with_lss(Subject(node, values, large), timeout))


def _highest_sub(index: int, values: Mapping[tuple[int, int], bytes]) -> int:
    """Return the last sub-index of a record that is read; 0 if the device does not have the record."""
    if (index, 0) not in values or index == 0x1003:  # the history changes
        return 0
    if 0x1600 <= index < 0x1800 or index >= 0x1A00:
        return 8  # the number of mapped entries is not the number of possible ones
    return min(6 if 0x1400 <= index < 0x1A00 else 8, values[index, 0][0])


def _with_lss(subject: Subject, timeout: float) -> Conversation[CanFrame, Subject]:
    """Return the subject with its LSS address, if it answers to that."""
    if not all(subject.has(0x1018, sub) for sub in (1, 2, 3, 4)):
        return subject
    address = LssAddress(*(subject.number(0x1018, sub) for sub in (1, 2, 3, 4)))
    is_identified = yield from with_lss_pauses(
        identify_slaves(
            address.vendor, address.product, (address.revision,) * 2, (address.serial,) * 2, timeout=timeout
        )
    )
    if is_identified:
        return subject._replace(lss=address)
    # A device may have LSS without the service identify remote slave.
    selected = yield from with_lss_pauses(switch_selective(address, timeout=timeout))
    if selected:
        yield from switch_global(LssState.WAITING)
    return subject._replace(lss=address if selected else None, identifies=False)


def second_answer(
    node: int, *, timeout: float = NODE_ANSWER_TIMEOUT
) -> Conversation[CanFrame, tuple[CanFrame, CanFrame] | None]:
    """Return two answers to one request if two devices have the node-ID, or None.

        605#4018100400000000  ->           serial number: the objects in which two devices of one type differ come first
                              <-  585#4318100407000000
                              <-  585#4318100408000000    within `_SECOND` seconds

    An answer to an earlier run may come late, so it must happen with two requests of three.
    """
    answered_twice: list[tuple[CanFrame, CanFrame]] = []
    for place in _DIFFERENT:
        data = b"\x40" + place[0].to_bytes(2, "little") + bytes((place[1], 0, 0, 0, 0))
        heard = yield Send(CanFrame(0x600 + check_node(node), data))
        until, answers = heard.now + timeout, list[CanFrame]()
        while heard.now < until:
            heard = yield Listen(until)
            frame = heard.item
            if frame is None or frame.key != (0x580 + node, False) or frame.data[1:4] != data[1:4]:
                continue
            if not answers:
                until = min(until, heard.now + _SECOND)
            answers.append(frame)
        if len(answers) > 1:
            answered_twice.append((answers[0], answers[1]))
    return answered_twice[0] if len(answered_twice) > 1 else None


def may_be_read(item: EdsItem) -> bool:
    """Return whether the EDS allows to read an item: it is not write-only, and bit 1 of its ObjFlags is 0."""
    return item.access != "wo" and not item.flags & REFUSES_READ


def _read(
    channel: Channel, index: int, sub: int, values: dict[tuple[int, int], bytes], timeout: float
) -> Conversation[CanFrame, None]:
    try:
        values[index, sub] = yield from upload(channel, index, sub, timeout=timeout)
    except SdoAbort:
        return


def is_there(node: int, index: int, sub: int, *, timeout: float = NODE_ANSWER_TIMEOUT) -> Conversation[CanFrame, bool]:
    """Return whether a device has an object: its upload is requested and aborted at once, since it may be long."""
    place = bytes((index & 0xFF, index >> 8, sub))
    heard = yield Send(CanFrame(0x600 + check_node(node), b"\x40" + place + bytes(4)))
    until = heard.now + timeout
    while heard.now < until:
        heard = yield Listen(until)
        frame = heard.item
        if frame is None or frame.key != (0x580 + node, False) or frame.data[1:4] != place:
            continue
        if frame.data[0] == 0x80:
            return int.from_bytes(frame.data[4:], "little") not in (AbortCode.NO_OBJECT, AbortCode.NO_SUB)
        if not frame.data[0] & 2:
            yield Send(CanFrame(0x600 + node, b"\x80" + place + AbortCode.GENERAL.to_bytes(4, "little")))
        return True
    return False
