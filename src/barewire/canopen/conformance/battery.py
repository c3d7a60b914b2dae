"""What every CANopen device must do, as data: what is said to it, and what may come back.   [CiA 301, CiA 305]

    Subject   the device under test: its node-ID, and what it has, as `probe` read it
    Case      a name, the clause, why, and turns; or what the device lacks, and then it is not asked
    Turn      some frames said at once, and the ways in which that may be answered
    way       frames as text with a dot for any digit: "585#6017100...", a comma between two, a bar between two that are
              equally good, {2,5} behind one that may come so often, SILENCE for nothing

The rows stand in `conform_sdo`, `conform_long`, `conform_network`, `conform_pdo` and `conform_lss`, and `cases` makes
them for one device. `run_case` is a conversation: it says the turns of a case, compares, and stops where the device
left the accepted ways. Frames that a case does not listen for (heartbeats, the process data of others) are weather.

Each case says what it does to a device (`effect`): "reads" changes nothing; "writes" needs objects to be written, which
a reset brings back; "commands" starts, stops and resets it, sends process data, and speaks in the name of another node.
`prepare` resets the communication before these two.

I know: what is said and what may be answered.  I never know: buses, clocks, what the device is.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Literal, NamedTuple

from barewire.canopen.cob_ids import CobEntry, check_node
from barewire.canopen.frame import CanFrame
from barewire.canopen.lss.master import identify_slaves
from barewire.canopen.lss.messages import LssAddress
from barewire.canopen.nmt.messages import NmtCommand
from barewire.canopen.sdo.aborts import AbortCode, SdoAbort
from barewire.canopen.sdo.client.channel import Channel
from barewire.canopen.sdo.client.upload import upload
from barewire.conversation import Conversation, Listen, Send

Effect = Literal["reads", "writes", "commands"]
SILENCE = ""
GENERAL = 0x0800_0000
"""An abort without a reason is always accepted: the device said no."""

PATIENCE = 0.5
"""Seconds after which a device that has not answered will not."""
BOOT = 3.0
"""Seconds that a reset may take."""
SETTLE = 0.01
"""Seconds of silence behind the last answer of a case: nobody answers twice."""
FLOOD = 500
"""So many frames in one turn are no answer; the longest, a block, has 128."""
_SHOWN = 8


class NodeStep(NamedTuple):
    """One turn. It is over when a way is complete, at the latest after `wait` seconds (None: the patience of whoever
    asks); a `whole` one listens all that time. `ends` are ways that are accepted as well, and end the case."""

    says: tuple[str, ...]
    ways: tuple[str, ...]
    ends: tuple[str, ...] = ()
    wait: float | None = None
    whole: bool = False


class NodeCase(NamedTuple):
    """One case. `hears` are beginnings of frames as text; `lacks` is what the device would need to have."""

    name: str
    title: str
    clause: str
    effect: Effect
    hears: tuple[str, ...]
    turns: tuple[NodeStep, ...]
    why: str = ""
    lacks: str = ""


class NodeOutcome(NamedTuple):
    """How a case went: what came in each turn, and None or the difference as a sentence."""

    case: NodeCase
    heard: tuple[tuple[str, ...], ...]
    failure: str | None


class PdoSeen(NamedTuple):
    """A PDO that is switched on: its records, its COB-ID and how many bytes it maps."""

    communication: int
    mapping: int
    cob: CobEntry
    size: int
    slots: int


class Subject(NamedTuple):
    """The device under test and what it has. `large` is an object that takes any bytes, if somebody named one."""

    node: int
    values: Mapping[tuple[int, int], bytes]
    large: tuple[int, int] | None = None
    lss: LssAddress | None = None

    def has(self, index: int, sub: int = 0) -> bool:
        """Whether the object could be read."""
        return (index, sub) in self.values

    def number(self, index: int, sub: int = 0) -> int:
        """Its value, 0 if it has none."""
        return int.from_bytes(self.values.get((index, sub), b""), "little")

    @property
    def string(self) -> tuple[int, bytes]:
        """A text of at least two segments that can be read, and its index: 1008h, 1009h or 100Ah."""
        for index in (0x1008, 0x1009, 0x100A):
            if len(value := self.values.get((index, 0), b"")) > 7:
                return index, value
        return 0x1008, bytes(14)

    @property
    def stranger(self) -> int:
        """Another node-ID, in whose name something is said."""
        return 126 if self.node != 126 else 125

    def pdo(self, communication: int, mapping: int) -> PdoSeen | None:
        """The first PDO from these records on that is switched on and maps something, on a base identifier."""
        for number in range(4):
            word = self.number(communication + number, 1)
            count = self.number(mapping + number)
            cob = CobEntry.unpack(word)
            if not word or cob.bit31 or cob.extended or not 1 <= count <= 64:
                continue
            bits = sum(self.number(mapping + number, sub) & 0xFF for sub in range(1, count + 1))
            slots = max(sub for index, sub in self.values if index == mapping + number)
            return PdoSeen(communication + number, mapping + number, cob, (bits + 7) // 8, slots)
        return None


_SINGLES = (0x1000, 0x1001, 0x1002, 0x1005, 0x1006, 0x1007, 0x1008, 0x1009, 0x100A, 0x100C, 0x100D, 0x1012, 0x1014,
            0x1015, 0x1017, 0x1019)  # fmt: skip
_RECORDS = (0x1003, 0x1010, 0x1011, 0x1016, 0x1018, 0x1029, 0x1200)
_PDOS = (0x1400, 0x1600, 0x1800, 0x1A00)


def probe(
    node: int, *, timeout: float = PATIENCE, large: tuple[int, int] | None = None
) -> Conversation[CanFrame, Subject]:
    """Read which communication objects a device has, and whether it knows LSS. Raises NoAnswer where nobody is.

    What is refused counts as not there. Nothing is changed.
    """
    channel = Channel(check_node(node))
    values: dict[tuple[int, int], bytes] = {}
    for index in _SINGLES:
        yield from _look(channel, index, 0, values, timeout)
    for index in (*_RECORDS, *(first + number for first in _PDOS for number in range(4))):
        yield from _look(channel, index, 0, values, timeout)
        highest = 6 if index & 0xFC00 == 0x1400 or 0x1800 <= index < 0x1A00 else 8
        if 0x1600 <= index < 0x1800 or index >= 0x1A00:
            highest = 8  # how many are mapped now says nothing about how many could be
        elif index == 0x1003:
            highest = 0  # what is in the history changes
        elif (index, 0) in values:
            highest = min(highest, values[index, 0][0])
        for sub in range(1, highest + 1 if (index, 0) in values else 1):
            yield from _look(channel, index, sub, values, timeout)
    subject = Subject(node, values, large)
    if not all(subject.has(0x1018, sub) for sub in (1, 2, 3, 4)):
        return subject
    address = LssAddress(*(subject.number(0x1018, sub) for sub in (1, 2, 3, 4)))
    found = yield from identify_slaves(
        address.vendor, address.product, (address.revision,) * 2, (address.serial,) * 2, timeout=timeout
    )
    return subject._replace(lss=address if found else None)


def _look(
    channel: Channel, index: int, sub: int, values: dict[tuple[int, int], bytes], timeout: float
) -> Conversation[CanFrame, None]:
    try:
        values[index, sub] = yield from upload(channel, index, sub, timeout=timeout)
    except SdoAbort:
        return


def is_there(node: int, index: int, sub: int, *, timeout: float = PATIENCE) -> Conversation[CanFrame, bool]:
    """Whether a device has an object: it is asked for, and given up at once, for it may be long."""
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


def cases(subject: Subject) -> tuple[NodeCase, ...]:
    """The whole battery for one device."""
    from barewire.canopen.conformance import (
        lss as conform_lss,
        nmt as conform_network,
        pdo as conform_pdo,
        sdo_expedited as conform_sdo,
        sdo_segmented as conform_long,
    )

    rooms = (conform_sdo, conform_long, conform_network, conform_pdo, conform_lss)
    return tuple(case for room in rooms for case in room.rows(subject))


def wants_reset(case: NodeCase, before: NodeCase | None) -> bool:
    """Whether the device is to be reset before this case: if it is going to be changed, or was."""
    return case.effect != "reads" or (before is not None and before.effect != "reads")


def prepare(subject: Subject, *, boot: float = BOOT) -> Conversation[CanFrame, bool]:
    """Reset the communication of the device and wait for its boot-up message; whether it came.

    A device that says none is told to be pre-operational, so that it can be asked on.
    """
    heard = yield Send(CanFrame(0, bytes([NmtCommand.RESET_COMMUNICATION, subject.node])))
    until = heard.now + boot
    while heard.now < until:
        heard = yield Listen(until)
        frame = heard.item
        if frame is not None and frame.key == (0x700 + subject.node, False) and frame.data == b"\0":
            return True
    yield Send(CanFrame(0, bytes([NmtCommand.ENTER_PRE_OPERATIONAL, subject.node])))
    return False


def run_case(case: NodeCase, *, patience: float = PATIENCE) -> Conversation[CanFrame, NodeOutcome]:
    """Say the turns of a case and compare what comes with the accepted ways."""
    told: list[tuple[str, ...]] = []
    for place, turn in enumerate(case.turns):
        heard = None
        for text in turn.says:
            heard = yield Send(CanFrame.parse(text))
        heard = heard or (yield Listen(float("-inf")))
        came: list[str] = []
        if heard.item is not None and str(heard.item).startswith(case.hears):
            came.append(str(heard.item))
        until = heard.now + (patience if turn.wait is None else turn.wait)
        while heard.now < until:
            if came and not turn.whole and _fits(turn, came):
                if place + 1 < len(case.turns):
                    break
                until = min(until, heard.now + SETTLE)
            if len(came) >= FLOOD:
                return NodeOutcome(case, (*told, tuple(came)), _difference(turn, came))
            heard = yield Listen(until)
            if heard.item is not None and str(heard.item).startswith(case.hears):
                came.append(str(heard.item))
        told.append(tuple(came))
        if any(_matches(way, came) for way in turn.ends):
            break
        if not any(_matches(way, came) for way in turn.ways):
            return NodeOutcome(case, tuple(told), _difference(turn, came))
    return NodeOutcome(case, tuple(told), None)


def _fits(turn: NodeStep, came: list[str]) -> bool:
    return any(_matches(way, came) for way in (*turn.ways, *turn.ends))


def _matches(way: str, came: list[str]) -> bool:
    """Whether what came is this way.

    >>> _matches("705#7F{1,3}, 585#43....", ["705#7F", "705#7F", "585#4318"])
    False
    >>> _matches("705#7F{1,3}, 585#43....|585#60....", ["705#7F", "585#600017"])
    True
    """
    return re.fullmatch("".join(map(_pattern, _frames(way))), "".join(f"{one} " for one in came)) is not None


def _frames(way: str) -> Iterator[str]:
    return (one.strip() for one in re.split(r",(?![0-9]+\})", way) if one.strip())


def _pattern(frame: str) -> str:
    one, brace, often = frame.partition("{")
    return f"(?:(?:{one.replace('.', '[0-9A-F]')}) ){brace}{often}"


def _difference(turn: NodeStep, came: list[str]) -> str:
    said = ", ".join(turn.says) or "a while"
    expected = " or ".join(way or "silence" for way in dict.fromkeys((*turn.ways, *turn.ends)))
    heard = ", ".join(came[:_SHOWN]) or "silence"
    if len(came) > _SHOWN:
        heard += f" ... {len(came)} frames{' and more' if len(came) >= FLOOD else ''}"
    return f"after {said}: {heard}, expected {expected}"
