"""Whether bytes are a good frame, which is the proof of most findings.

Good means more than a fitting checksum: function, length and values must be those of a known Modbus function, too. A
CRC fits one of 65,536 random frames; of those with a known function hardly one has the right length as well.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from barewire.ascii.frame import DIGITS, END, START
from barewire.modbus.adu import PDU_LIMIT
from barewire.modbus.messages.base import EXCEPTION_BIT
from barewire.modbus.messages.registry import ENCAPSULATED, measure_request, measure_response, request_class
from barewire.rtu.crc import crc16
from barewire_workbench.frames.modbus import explain_ascii, explain_pdu, explain_rtu, explain_tcp
from barewire_workbench.frames.result import Explanation, FrameRole, counted

HIGHEST_UNIT = 247
"""The units 248 to 255 are reserved on a serial line [MB-SERIAL 2.2]: no search takes them for an address."""


def good_rtu(frame: bytes, role: FrameRole | None = None) -> Explanation | None:
    """Return the explanation of a good RTU frame, None for any other bytes.

    >>> good_rtu(bytes.fromhex("01 03 00 00 00 0A C5 CD")).summary
    'a request to unit 1, Read Holding Registers, 10 from 0000h; CRC ok'
    """
    return None if crc16(frame) or len(frame) < 4 else _valid(explain_rtu(frame, role))


def good_body(unit_and_pdu: bytes, role: FrameRole | None = None) -> Explanation | None:
    """Return the explanation of unit and PDU with the CRC that fits, None if they are no message."""
    return good_rtu(unit_and_pdu + crc16(unit_and_pdu).to_bytes(2, "little"), role)


def good_ascii(characters: bytes, role: FrameRole | None = None) -> Explanation | None:
    """Return the explanation of a good ASCII frame, None for any other characters. CR LF may be missing."""
    text = characters[1:].rstrip(END)
    if (
        characters[:1] != START
        or len(text) % 2
        or text.translate(None, DIGITS)
        or sum(bytes.fromhex(text.decode())) % 256
    ):
        return None
    return _valid(explain_ascii(characters, role, typed=True))


def good_tcp(frame: bytes, role: FrameRole | None = None) -> Explanation | None:
    """Return the explanation of a good Modbus TCP frame, None for any other bytes."""
    return _valid(explain_tcp(frame, role))


def _valid(explanation: Explanation) -> Explanation | None:
    return explanation if explanation.valid and explanation.role is not None and _is_known(explanation) else None


def _is_known(explanation: Explanation) -> bool:
    """Return whether the function is known. With a given role, `explain` takes any function for a message."""
    pdu = bytes(
        field.value & 0x7F
        for field in explanation.fields
        if field.name in ("function code", "mei type") and isinstance(field.value, int)
    )
    return request_class(pdu) is not None or pdu == bytes((ENCAPSULATED,))


class Missing(NamedTuple):
    """The rest of a frame that was cut: its direction, and how many bytes are to come.

    `is_least`: there may be more, because the byte count is among the bytes to come.
    """

    role: FrameRole
    to_come: int
    is_least: bool

    def text(self, unit: str = "byte", per_byte: int = 1, less: int = 0) -> str:
        """Return the text of a finding. An ASCII frame has two digits `per_byte`, and perhaps one is already there.

        >>> Missing("response", 5, False).text()
        'the beginning of a response, 5 bytes are to come'
        """
        count = self.to_come * per_byte - less
        verb = "is" if count == 1 else "are"
        at_least = "at least " if self.is_least else ""
        return f"the beginning of a {self.role}, {at_least}{counted(count, unit)} {verb} to come"


def missing(unit_and_pdu: bytes, checksum: int, role: FrameRole | None = None) -> list[Missing]:
    """Return for each direction how many bytes are missing to a whole frame, as far as the bytes can begin one.

    >>> missing(bytes.fromhex("01 03 06 02 2B 00"), checksum=2)
    [Missing(role='response', to_come=5, is_least=False)]

    `checksum` is its length. The function must be known and the values so far allowed: the six bytes above are not the
    beginning of a request, since 2B00h registers are more than one may ask for at once.
    """
    found: list[Missing] = []
    pdu = unit_and_pdu[1:]
    if not 1 <= len(pdu) <= PDU_LIMIT or not 1 <= unit_and_pdu[0] <= HIGHEST_UNIT:
        return found
    directions: tuple[tuple[FrameRole, Callable[[bytes], int | None]], ...] = (
        ("request", measure_request),
        ("response", measure_response),
    )
    for which, measure in directions:
        size = measure(pdu)
        if role not in (None, which) or size is None or not len(pdu) < size + checksum or size > PDU_LIMIT:
            continue
        if which == "request" and pdu[0] & EXCEPTION_BIT:
            continue
        # The bytes to come are tried as small numbers. An error in one of them says nothing about those that came.
        tried = [whole for last in range(3) if (whole := _completed(pdu, measure, last)) is not None]
        errors = (explain_pdu(whole, which).error for whole in tried)
        if any(error is None or error.at >= len(pdu) for error in errors):
            is_least = len({len(whole) for whole in tried}) > 1
            found.append(Missing(which, size + checksum + 1 - len(unit_and_pdu), is_least))
    return found


def _completed(pdu: bytes, measure: Callable[[bytes], int | None], last: int) -> bytes | None:
    """Return the PDU with its bytes to come: 0, and the last of each round `last`. None if no length is found."""
    whole = pdu
    for _ in range(3):  # the byte count, and so the length, may be among the bytes to come
        size = measure(whole)
        if size is None or size > PDU_LIMIT:
            return None
        if size > len(whole):
            whole += bytes(size - len(whole) - 1) + bytes((last,))
    return whole


def digits(data: bytes) -> str:
    """Return bytes as the texts of findings show them.

    >>> digits(b"\\x01\\x0a")
    '01 0A'
    """
    return data.hex(" ").upper()


def proof_of(frame: bytes, explanation: Explanation) -> str:
    """Return the proof that is a good frame: its bytes, and what they say."""
    characters = frame.decode("latin-1").replace("\r", "\\r").replace("\n", "\\n")
    return f"{characters if explanation.protocol == 'ascii' else digits(frame)} is {explanation.summary}"


def without_checksum(good: Explanation) -> str:
    """Return the summary of a good frame without the remark on its checksum, which was put in for the trial."""
    return good.summary.replace("; CRC ok", "").replace("; LRC ok", "")
