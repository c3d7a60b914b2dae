"""Frames of the conformance cases as text: requests to one device, and accepted responses.

Examples:

        Sdo(5).upload(0x1000)                 605#4000100000000000        sent
        Sdo(5).value(0x1001, 0, b"\\0")        585#4F01100000......        accepted: reserved bytes may have any value
        Sdo(5).refused(0x1000, 0, 0x06010002) 585#8000100002000106|585#8000100000000008
"""

from __future__ import annotations

import re
from binascii import crc_hqx
from functools import lru_cache
from typing import NamedTuple

from barewire.canopen.sdo.messages import SEGMENT
from barewire.errors import EncodeError, shown
from barewire_workbench.conform.canopen.model import SILENCE, Effect, NodeCase, NodeStep, Subject

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
        return f"{self.response(_UPLOADS[len(data)] + multiplexer(index, sub) + data.hex().upper())}|" + self.response(
            "42" + multiplexer(index, sub) + data.hex().upper()
        )

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


def provides(subject: Subject, need: str) -> bool:
    """Return whether the subject has what a case needs: an object (1019h, 1016h:02), or one of the names below."""
    if need.startswith(OTHER_TYPE):
        return False
    if need == "large object":
        return subject.large is not None
    if need == "text of 8 bytes":
        return subject.has_text
    if need == "text of at most 140 bytes":
        return len(subject.text_object[1]) <= 20 * SEGMENT
    if need == "TPDO":
        return subject.pdo(0x1800, 0x1A00) is not None
    if need == "RPDO":
        return subject.pdo(0x1400, 0x1600) is not None
    if need == "LSS":
        return subject.lss is not None
    if need == "LSS identify remote slave":
        return subject.identifies
    found = _OBJECT.fullmatch(need)
    if found is None:
        raise EncodeError(f"need {shown(need)}: expected an object such as 1017h or 1016h:02", "needs")
    return subject.has(int(found[1], 16), int(found[2] or "0", 16))
