"""Answers for device-conformance: our devices, on a bus of their own in virtual time, are tested by the case."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import cache, partial
from typing import Final, TypeVar

from barewire.canopen.communication_objects import standard_objects
from barewire.canopen.device.device import LocalNode
from barewire.canopen.frame import CanFrame
from barewire.canopen.lss.messages import LssAddress
from barewire.canopen.lss.slave import LssSlave
from barewire.canopen.object_dictionary import Entry, ObjectDictionary
from barewire.canopen.pdo.config import PdoConfig
from barewire.conversation import Conversation, Heard, Listen
from barewire.errors import EncodeError
from barewire_workbench.conform.canopen.battery import run_case
from barewire_workbench.conform.canopen.model import NodeCase, Subject
from barewire_workbench.conform.canopen.probe import probe
from barewire_workbench.conform.canopen.script import Placeholders, applies, read_node_case
from barewire_workbench.vectors.answers.values import Answers
from barewire_workbench.vectors.questions import Fields
from barewire_workbench.vectors.tested_device import described

NODE: Final = 5
LARGE: Final = (0x2100, 0)
ADDRESS: Final = LssAddress(0x0000_0360, 0x1234, 0x0001_0002, 7)
_RESPONSE_TIME = 0.001
_SWITCHED_OFF_AFTER = 60.0
"""A step that waits longer is for switching the device off and on by hand: it is done after a second."""

Result = TypeVar("Result")


def plain_device(*more: Entry, tpdo: int | None = None, address: LssAddress = ADDRESS) -> LocalNode:
    """Return a device with the objects that most cases need, and `more`; `tpdo` is the COB-ID of its TPDO."""
    objects = [
        *standard_objects(address, device_type=0x0002_0192, name="barewire plain device", servers=4),
        Entry(0x1020, 1, "configuration date", "u32", "rw", 0),
        Entry(0x1020, 2, "configuration time", "u32", "rw", 0),
        *(
            Entry(index, sub, "COB-ID of an SDO client", "u32", "rw", 0x8000_0000)
            for index in (0x1280, 0x1281, 0x1282)
            for sub in (1, 2)
        ),
        Entry(0x1010, 1, "save all", "u32", "rw", 1),
        Entry(0x1011, 1, "restore all", "u32", "rw", 1),
        Entry(*LARGE, "anything", "domain", "rw", b""),
        Entry(0x6040, 0, "controlword", "u16", "rw", 0),
        Entry(0x6041, 0, "statusword", "u16", "ro", 0x0637),
        *more,
    ]
    pdos = [PdoConfig("RPDO", 1, (0x60400010,)), PdoConfig("TPDO", 1, (0x60410010,), type=1, cob_id=tpdo)]
    return LocalNode(NODE, ObjectDictionary(objects), pdos, lss=LssSlave(address))


def _run_on_device(given: Fields) -> Fields:
    """Run the case against the first of our devices that it is for; return that device and what it sent."""
    case, kind = _case_and_device(given)
    return described(_subject(kind), _Bus(_DEVICES[kind]()).run(run_case(case)).received)


def case_on_device(given: Fields) -> NodeCase:
    """Return the case for the first of our devices that it is for, with their values in its frames."""
    return _case_and_device(given)[0]


def _case_and_device(given: Fields) -> tuple[NodeCase, str]:
    lacks = ""
    for kind in _DEVICES:
        device = Placeholders(_subject(kind))
        case = read_node_case(given, device)
        if applies(given, device) and not case.lacks:
            return case, kind
        lacks = lacks or case.lacks
    raise EncodeError(f"case {given['name']}: our devices have no {lacks or 'such property'}", "needs")


_DEVICES: dict[str, Callable[[], LocalNode]] = {
    "plain": plain_device,
    "no remote frames": partial(plain_device, tpdo=0x4000_0180 + NODE),
    "highest revision": partial(plain_device, address=ADDRESS._replace(revision=0xFFFF_FFFF)),
}


@cache
def _subject(kind: str) -> Subject:
    return _Bus(_DEVICES[kind]()).run(probe(NODE, timeout=0.1, large=LARGE))


class _Bus:
    """A bus with one device that has booted, on which conversations are run."""

    def __init__(self, device: LocalNode) -> None:
        self._device = device
        self._now = 0.0
        self._coming: deque[tuple[float, CanFrame]] = deque()
        self._device.start(0.0)

    def run(self, conversation: Conversation[CanFrame, Result]) -> Result:
        """Run a conversation to its end."""
        try:
            step = next(conversation)
            while True:
                frame = None
                if isinstance(step, Listen):
                    frame = self._received(step.until)
                else:
                    for sent in step.items:
                        self._feed(sent)
                step = conversation.send(Heard(frame, self._now))
        except StopIteration as stop:
            result: Result = stop.value
            return result

    def _received(self, until: float) -> CanFrame | None:
        """Let time pass until a frame arrives, at most until then."""
        if until - self._now > _SWITCHED_OFF_AFTER:
            self._now += 1
            self._feed(CanFrame(0, bytes((0x81, NODE))))
        while True:
            arrives = self._coming[0][0] if self._coming else float("inf")
            due = self._device.deadline
            if due is not None and due < arrives and due <= until:
                self._now = max(self._now, due)
                self._feed(None)
            elif arrives <= max(until, self._now):
                self._now = max(self._now, arrives)
                return self._coming.popleft()[1]
            else:
                self._now = max(self._now, until)
                return None

    def _feed(self, frame: CanFrame | None) -> None:
        sent = self._device.feed(frame, self._now)
        self._coming.extend((self._now + _RESPONSE_TIME, answer) for answer in sent)


ANSWERS: Answers = {"device-conformance": {"run": _run_on_device}}
