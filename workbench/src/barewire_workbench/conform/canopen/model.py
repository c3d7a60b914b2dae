"""Values of the conformance battery: the device under test, a case, its steps, and its outcome.

The values:

    Subject     the device under test: its node-ID and its objects, as `probe` read them
    NodeCase    a name, the clause, the reason, and the steps; it is not run if the device lacks what it needs
    NodeStep    frames that are sent at once, and the accepted patterns of responses
    pattern     frames as text with a dot for any digit: "585#6017100..."; a comma separates two frames, a bar two
                alternatives; {2,5} after a frame allows two to five of it; SILENCE stands for no frame
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Literal, NamedTuple

from barewire.canopen.cob_ids import CobEntry
from barewire.canopen.lss.messages import LssAddress
from barewire.canopen.sdo.messages import SEGMENT

Effect = Literal["reads", "tries", "writes", "commands", "stores", "power", "application"]
"""What a case does to the device.

reads         nothing changes
tries         needs the values after a reset and changes nothing in a right device: writes what the device has or must
              refuse
writes        writes objects, which a reset of the communication restores
commands      starts, stops and resets it, sends process data, and sends in the name of another node
stores        writes its non-volatile memory
power         does so, and waits until somebody has switched the device off and on
application   writes objects of the application: a machine may move, outputs may switch
"""
SILENCE = ""
NODE_ANSWER_TIMEOUT = 0.5
"""Seconds after which no response is expected any more."""
BOOT = 3.0
"""Seconds that a reset may take."""


class NodeStep(NamedTuple):
    """One step. It ends when a pattern is complete, at the latest after `wait` seconds (None: the time-out of the
    run); with `full_wait` it always lasts that long. `ends` are further accepted patterns, which end the case."""

    sends: tuple[str, ...]
    accepts: tuple[str, ...]
    ends: tuple[str, ...] = ()
    wait: float | None = None
    full_wait: bool = False


class NodeCase(NamedTuple):
    """One case. `listens` are the beginnings of the frames that it compares; `lacks` is what the device is missing."""

    name: str
    title: str
    clause: str
    effect: Effect
    listens: tuple[str, ...]
    steps: tuple[NodeStep, ...]
    why: str = ""
    lacks: str = ""


class NodeOutcome(NamedTuple):
    """The outcome of a case: the frames received in each step, and the difference as a sentence, None if it passed."""

    case: NodeCase
    received: tuple[tuple[str, ...], ...]
    failure: str | None


class SubjectPdo(NamedTuple):
    """A valid PDO: its records, its COB-ID, the bytes that it maps, and how many mapping entries it can have."""

    communication: int
    mapping: int
    cob: CobEntry
    size: int
    slots: int


class Subject(NamedTuple):
    """The device under test and its objects.

    node, values   its node-ID, and what it answered to uploads
    large          an object that accepts 00h, 01h, 02h ... of any length, if the user names one
    lss            its LSS address, if it supports LSS
    identifies     whether it supports the LSS service identify remote slave
    """

    node: int
    values: Mapping[tuple[int, int], bytes]
    large: tuple[int, int] | None = None
    lss: LssAddress | None = None
    identifies: bool = True

    def has(self, index: int, sub: int = 0) -> bool:
        """Return whether the object could be read."""
        return (index, sub) in self.values

    def number(self, index: int, sub: int = 0, size: int = 4) -> int:
        """Return the value of an object as a number of at most `size` bytes, 0 if it could not be read."""
        return int.from_bytes(self.values.get((index, sub), b"")[:size], "little")

    @property
    def text_object(self) -> tuple[int, bytes]:
        """The index and the value of a text of at least two segments: 1008h, 1009h or 100Ah.

        A device without one (`has_text`) gets no case with such a text; the value then only serves to make the cases.
        """
        return next(self._texts, (0x1008, bytes(14)))

    @property
    def has_text(self) -> bool:
        """Whether the device has a text of at least two segments."""
        return next(self._texts, None) is not None

    @property
    def _texts(self) -> Iterator[tuple[int, bytes]]:
        texts = ((index, self.values.get((index, 0), b"")) for index in (0x1008, 0x1009, 0x100A))
        return ((index, value) for index, value in texts if len(value) > SEGMENT)

    @property
    def other_node(self) -> int:
        """The ID of another node, in whose name frames are sent."""
        return 126 if self.node != 126 else 125

    def pdo(self, communication: int, mapping: int) -> SubjectPdo | None:
        """Return the first of four PDOs, from these records on, that is valid, maps bits and has a base identifier."""
        for number in range(4):
            word = self.number(communication + number, 1)
            count = self.number(mapping + number, 0, 1)
            cob = CobEntry.unpack(word)
            if not word or cob.bit31 or cob.extended or not 1 <= count <= 64:
                continue
            bits = sum(self.number(mapping + number, sub) & 0xFF for sub in range(1, count + 1))
            slots = max(sub for index, sub in self.values if index == mapping + number)
            return SubjectPdo(communication + number, mapping + number, cob, (bits + 7) // 8, slots)
        return None
