"""Values of the conformance battery: the device under test, a case, its steps, its outcome; and their frames as text.

Subject     the device under test: its node-ID and its objects, as `probe` read them
NodeCase    a name, the clause, the reason, and the steps; it is not run if the device lacks what it needs
NodeStep    frames that are sent at once, and the accepted patterns of responses
pattern     frames as text with a dot for any digit: "585#6017100..."; a comma separates two frames, a bar two
            alternatives; {2,5} after a frame allows two to five of it; SILENCE stands for no frame
Sdo         requests and patterns of one SDO channel, and steps made of them:

    Sdo(5).upload(0x1000)                 605#4000100000000000        sent
    Sdo(5).value(0x1001, 0, b"\\0")        585#4F01100000......        accepted: reserved bytes may have any value
    Sdo(5).refused(0x1000, 0, 0x06010002) 585#8000100002000106|585#8000100000000008
"""

from __future__ import annotations

import re
from binascii import crc_hqx
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Literal, NamedTuple

from barewire.canopen.cob_ids import CobEntry
from barewire.canopen.lss.messages import LssAddress
from barewire.canopen.sdo.messages import SEGMENT
from barewire.errors import EncodeError, shown

Effect = Literal["reads", "tries", "writes", "commands", "stores", "power", "application"]
"""What a case does to the device.

reads         nothing changes
tries         needs the values after a reset and changes nothing in a right device: writes what the device has or must
              refuse
writes        writes objects, which a reset of the communication restores
commands      starts, stops and resets it, sends process data, and sends in the name of another node
stores        writes its non-volatile memory
power         does so, and waits until you have switched the device off and on
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
        return next(iter(self._texts), (0x1008, bytes(14)))

    @property
    def has_text(self) -> bool:
        """Whether the device has a text of at least two segments."""
        return bool(self._texts)

    @property
    def _texts(self) -> list[tuple[int, bytes]]:
        texts = [(index, self.values.get((index, 0), b"")) for index in (0x1008, 0x1009, 0x100A)]
        return [(index, value) for index, value in texts if len(value) > SEGMENT]

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


# Frames as text -----------------------------------------------------------------------------------------------------


_GENERAL = 0x0800_0000
"""An abort with the general error is always accepted as a refusal."""

START, STOP, PRE = "01", "02", "80"
"""NMT commands."""

SAVE = 0x6576_6173
"""The signature "save" of 1010h: 73 61 76 65 in a frame."""

READ_ONLY_CODES = (0x0601_0000, 0x0601_0002)
LENGTH_CODES = (0x0607_0010, 0x0607_0012, 0x0607_0013)
"""Abort codes that are accepted as equal."""
HEARTBEAT = ("1017h",)
"""The need of several cases."""
OTHER_TYPE = "a value of type "
"""The need of a case for an object whose value has another length than the EDS says; the type follows."""

_OBJECT = re.compile("([0-9A-F]{4})h(?::([0-9A-F]{2}))?")
_DOWNLOADS = {1: 0x2F, 2: 0x2B, 3: 0x27, 4: 0x23}
_UPLOADS = {1: "4F", 2: "4B", 3: "47", 4: "43"}


class Sdo(NamedTuple):
    """The default SDO channel of one node: frames, and steps made of them."""

    node: int

    def request(self, text: str) -> str:
        """Return a request of these bytes, padded with 00."""
        return f"{0x600 + self.node:03X}#{text.replace(' ', '').ljust(16, '0')}"

    def response(self, text: str) -> str:
        """Return a response that begins with these digits; [26] is one of the two digits."""
        digits = re.sub(r"\[[^]]*\]", ".", text.replace(" ", ""))
        return f"{0x580 + self.node:03X}#{text.replace(' ', '')}{'.' * (16 - len(digits))}"

    def upload(self, index: int, sub: int = 0) -> str:
        """Return the request to read an object."""
        return self.request("40" + multiplexer(index, sub))

    def download(self, index: int, sub: int, value: int, size: int) -> str:
        """Return the request to write a number."""
        return self.request(f"{_DOWNLOADS[size]:02X}{multiplexer(index, sub)}{little(value, size)}")

    def accepted(self, index: int, sub: int = 0) -> str:
        """Return the response that a download is done, or may continue."""
        return self.response("60" + multiplexer(index, sub))

    def value(self, index: int, sub: int, data: bytes) -> str:
        """Return the expedited response with this value; 42h, without a size, is accepted too."""
        rest = multiplexer(index, sub) + data.hex().upper()
        return f"{self.response(_UPLOADS[len(data)] + rest)}|{self.response('42' + rest)}"

    def any_value(self, index: int, sub: int = 0) -> str:
        """Return the expedited response with any value."""
        return self.response("4[2-9A-F]" + multiplexer(index, sub) + "........")

    def sized(self, index: int, sub: int, size: int) -> str:
        """Return the expedited response with any value of 1 to 4 bytes; 42h, without a size, is accepted too."""
        place = multiplexer(index, sub)
        return f"{self.response(_UPLOADS[size] + place)}|{self.response('42' + place)}"

    def refused(self, index: int, sub: int, *codes: int) -> str:
        """Return an abort with one of these codes, or with the general error."""
        return _aborts(self.node, multiplexer(index, sub), codes)

    def aborted(self, *codes: int) -> str:
        """Return the same with any multiplexer, because devices differ where a request names no object."""
        return _aborts(self.node, "......", codes)

    @property
    def responses(self) -> str:
        """The beginning of all responses."""
        return self.response("")[:4]

    @property
    def abort(self) -> str:
        """The abort of the client."""
        return self.request("80 0010 00 0000 0008")

    # Steps

    @property
    def works(self) -> NodeStep:
        """A step in which the device responds: the device type is read."""
        return NodeStep((self.upload(0x1000),), (self.any_value(0x1000),))

    def read(self, index: int, sub: int, data: bytes) -> NodeStep:
        """Return a step that reads this value."""
        return NodeStep((self.upload(index, sub),), (self.value(index, sub, data),))

    def write(self, index: int, sub: int, value: int, size: int) -> NodeStep:
        """Return a step that writes a number."""
        return NodeStep((self.download(index, sub, value, size),), (self.accepted(index, sub),))

    def refuse_read(self, index: int, sub: int, *codes: int) -> NodeStep:
        """Return a step in which a read is refused with one of these codes."""
        return NodeStep((self.upload(index, sub),), (self.refused(index, sub, *codes),))

    def refuse(self, index: int, sub: int, value: int, size: int, *codes: int) -> NodeStep:
        """Return a step in which a number is refused with one of these codes."""
        return NodeStep((self.download(index, sub, value, size),), (self.refused(index, sub, *codes),))


@lru_cache(maxsize=1024)  # one object is written with hundreds of values, which are refused with the same codes
def _aborts(node: int, place: str, codes: tuple[int, ...]) -> str:
    return "|".join(Sdo(node).response(f"80{place}{little(code, 4)}") for code in (*codes, _GENERAL))


def silence(*sends: str, wait: float | None = None) -> NodeStep:
    """Return a step that sends frames and accepts no response."""
    return NodeStep(sends, (SILENCE,), wait=wait)


def nmt_command(command: str, node: int) -> str:
    """Return the frame of an NMT command."""
    return f"000#{command}{node:02X}"


def multiplexer(index: int, sub: int) -> str:
    """Return index and sub-index as in a frame."""
    return f"{index & 0xFF:02X}{index >> 8:02X}{sub:02X}"


def little(value: int, size: int) -> str:
    """Return a number as in a frame."""
    return value.to_bytes(size, "little").hex().upper()


def parts(value: bytes, size: int = SEGMENT) -> list[bytes]:
    """Return the segments of a value; an empty value has one empty segment."""
    return [value[start : start + size] for start in range(0, len(value), size)] or [b""]


def segment(number: int, data: bytes, last: bool) -> str:
    """Return the download or upload segment of that number, counted from 0, as bytes without padding."""
    return f"{(number & 1) << 4 | (SEGMENT - len(data)) << 1 | last:02X}{data.hex().upper()}"


def block_segment(number: int, data: bytes, last: bool) -> str:
    """Return the segment of a block, counted from 1."""
    return f"{number | last << 7:02X}{data.hex().upper()}"


def block_end(value: bytes, crc: int | None = None) -> str:
    """Return the end of a block transfer: unused bytes of the last segment, and the CRC (0 if none is agreed on)."""
    unused = -len(value) % SEGMENT if value else SEGMENT
    return f"{0xC1 | unused << 2:02X}{little(crc_hqx(value, 0) if crc is None else crc, 2)}"


def make_case(
    subject: Subject,
    clause: str,
    listens: tuple[str, ...],
    name: str,
    title: str,
    *steps: NodeStep,
    effect: Effect,
    needs: tuple[str, ...] = (),
    why: str = "",
) -> NodeCase:
    """Return a case; `lacks` of the case has those of `needs` that the subject does not have."""
    missing = [need for need in needs if not provides(subject, need)]
    return NodeCase(name, title, clause, effect, listens, steps, why, ", ".join(missing))


_FEATURES: dict[str, Callable[[Subject], bool]] = {
    "large object": lambda subject: subject.large is not None,
    "text of 8 bytes": lambda subject: subject.has_text,
    "text of at most 140 bytes": lambda subject: len(subject.text_object[1]) <= 20 * SEGMENT,
    "TPDO": lambda subject: subject.pdo(0x1800, 0x1A00) is not None,
    "RPDO": lambda subject: subject.pdo(0x1400, 0x1600) is not None,
    "LSS": lambda subject: subject.lss is not None,
    "LSS identify remote slave": lambda subject: subject.identifies,
}
"""What a case may need, apart from objects."""


def provides(subject: Subject, need: str) -> bool:
    """Return whether the subject has what a case needs: an object (1019h, 1016h:02), or one of `_FEATURES`."""
    if need.startswith(OTHER_TYPE):
        return False
    if need in _FEATURES:
        return _FEATURES[need](subject)
    place = _OBJECT.fullmatch(need)
    if place is None:
        raise EncodeError(f"need {shown(need)}: expected an object such as 1017h or 1016h:02", "needs")
    return subject.has(int(place[1], 16), int(place[2] or "0", 16))
