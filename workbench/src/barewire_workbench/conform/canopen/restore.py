"""Give a device the values back that a case of the battery has changed.   [CiA 301]

A reset of the communication restores 1000h to 1FFFh. On a device that keeps its values (reported by NMT-17), the
objects that the case wrote are read back, and those with another value than before the battery are written:

        PDO 1400h ... 1A00h     switched off, the count 0, the entries, the count, the record, switched on
        SYNC 1005h, 1006h       the device stops to produce it, then 1019h and 1007h, the period, 1005h
        1012h, 1014h, 1201h ... switched off, then the value before
        1016h                   all changed entries 0, then their values: no node may be in two

After a case that stores values, all values that were read at first are compared, and those before it are stored again.
A refused write is ignored: this is for the cases that follow, which will report what they find.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TypeAlias

from barewire.canopen.abort_codes import SdoAbort
from barewire.canopen.frame import CanFrame
from barewire.canopen.object_dictionary import ObjectAddress
from barewire.canopen.sdo.channel import Channel
from barewire.canopen.sdo.client import download, upload
from barewire.conversation import Conversation
from barewire.errors import NoAnswer
from barewire_workbench.conform.canopen.model import NODE_ANSWER_TIMEOUT, SAVE, NodeCase, Subject

_NEVER_WRITTEN = (0x1003, 0x1010, 0x1011)
"""The history of errors, and the commands that store and restore: their values are not settings."""
_STORING = 5.0
"""Seconds that a device may take to store its values."""
_SDO_CHANNELS = range(0x1201, 0x1300)
_SYNC_OBJECTS = (0x1019, 0x1007, 0x1006, 0x1005)
_OFF, _PRODUCES, _CONSUMES = 0x8000_0000, 0x4000_0000, 0x8000_0000
"""Flags of a COB-ID in the object dictionary: of a PDO, EMCY or SDO channel; of SYNC and TIME; of TIME."""

_Write: TypeAlias = tuple[ObjectAddress, bytes]


def restore_values(
    subject: Subject, case: NodeCase, *, timeout: float = NODE_ANSWER_TIMEOUT
) -> Conversation[CanFrame, None]:
    """Give the objects that a case wrote the values of the subject, if they have others. Return if nothing answers."""
    channel = Channel(subject.node)
    stores = case.effect in ("stores", "power")
    try:
        changed: list[ObjectAddress] = []
        for place in tuple(subject.values) if stores else _objects_written(case, subject):
            try:
                present = yield from upload(channel, *place, timeout=timeout)
            except SdoAbort:
                continue
            if present != subject.values[place] and place[0] not in _NEVER_WRITTEN:
                changed.append(place)
        for place, data in _in_safe_order(subject, changed):
            try:
                yield from download(channel, *place, data, timeout=timeout)
            except SdoAbort:
                continue
        if stores:
            yield from download(channel, 0x1010, 1, SAVE.to_bytes(4, "little"), timeout=_STORING)
    except (NoAnswer, SdoAbort):
        return


def _objects_written(case: NodeCase, subject: Subject) -> tuple[ObjectAddress, ...]:
    """Return the objects of the subject to which the case sends a download."""
    places: dict[ObjectAddress, None] = {}
    for frame in (CanFrame.parse(text) for step in case.steps for text in step.sends):
        if frame.key != (0x600 + subject.node, False) or len(frame.data) < 4:
            continue
        # The initiate of a download (001x xxxxb) or of one in blocks (110x xxx0b) names an object.
        if frame.data[0] & 0xE0 == 0x20 or frame.data[0] & 0xE1 == 0xC0:
            place = int.from_bytes(frame.data[1:3], "little"), frame.data[3]
            if place in subject.values and place[0] not in _NEVER_WRITTEN:
                places[place] = None
    return tuple(places)


def _in_safe_order(subject: Subject, changed: Sequence[ObjectAddress]) -> Iterator[_Write]:
    """Yield the writes that give these objects their values, each as the standard allows it."""
    for record in sorted({_record_of(index) for index, _ in changed} - {0}):
        yield from _pdo_writes(subject, record, changed)
    others = [place for place in changed if not _record_of(place[0])]
    if any(index in (0x1005, 0x1006, 0x1019) for index, _ in changed):
        yield from _sync_writes(subject)
        others = [place for place in others if place[0] not in _SYNC_OBJECTS]
    for place in others:
        if place[0] == 0x1016:
            yield place, bytes(4)  # a node may be in one entry only, also while they are written one by one
    for place in others:
        index, sub = place
        data = subject.values[place]
        word = int.from_bytes(data, "little")
        if index == 0x1014 or (index in _SDO_CHANNELS and sub in (1, 2)):
            yield place, _u32(word | _OFF)
        elif index == 0x1012:
            yield place, _u32(word & ~(_CONSUMES | _PRODUCES))
        yield place, data


def _record_of(index: int) -> int:
    """Return the index of the communication record of a PDO, from that of either of its records; 0 for others."""
    return index & ~0x0200 if 0x1400 <= index < 0x1C00 else 0


def _pdo_writes(subject: Subject, record: int, changed: Sequence[ObjectAddress]) -> Iterator[_Write]:
    """Yield the writes of one PDO. Its mapping and its type may change only while it is switched off."""
    mapping = record + 0x0200
    word = subject.number(record, 1)
    yield (record, 1), _u32(word | _OFF)
    if any(index == mapping for index, _ in changed):
        yield (mapping, 0), b"\0"  # the entries may change only while their count is 0
        yield from ((place, subject.values[place]) for place in sorted(changed) if place[0] == mapping and place[1])
        yield (mapping, 0), subject.values[mapping, 0]
    yield from ((place, subject.values[place]) for place in sorted(changed) if place[0] == record and place[1] != 1)
    yield (record, 1), _u32(word)


def _sync_writes(subject: Subject) -> Iterator[_Write]:
    if subject.has(0x1005):
        yield (0x1005, 0), _u32(subject.number(0x1005) & ~_PRODUCES)
    if subject.has(0x1006):
        yield (0x1006, 0), bytes(4)  # 1019h is refused while there is a period
    for index in _SYNC_OBJECTS:
        if subject.has(index):
            yield (index, 0), subject.values[index, 0]


def _u32(word: int) -> bytes:
    return word.to_bytes(4, "little")
