"""The identification objects of a server (2B/0E), at all three levels, in one or more responses.          [MB-APP 6.21]

basic      00 VendorName, 01 ProductCode, 02 MajorMinorRevision       mandatory
regular    03 VendorUrl ... 06 UserApplicationName                    includes the basic ones
extended   80 ... FF, device-specific                                 includes all others
"""

from __future__ import annotations

from collections.abc import Mapping

from barewire.codecs.order import is_whole
from barewire.errors import EncodeError, shown
from barewire.modbus.adu import PDU_LIMIT
from barewire.modbus.exceptions import ILLEGAL_DATA_ADDRESS, ModbusException
from barewire.modbus.messages.identification import (
    BASIC,
    EXTENDED,
    INDIVIDUAL,
    OBJECT_LIMIT,
    REGULAR,
    SINGLE_ACCESS,
    ReadDeviceIdentification,
    ReadDeviceIdentificationResponse,
    object_texts,
)

_LAST = {BASIC: 0x02, REGULAR: 0x06, EXTENDED: 0xFF}
_ROOM = PDU_LIMIT - 7  # bytes for objects in a response


class Identity:
    """The objects of one device by number; text is sent as UTF-8.

    >>> identity = Identity({0: "ACME", 1: "bench", 2: "1.0", 0x80: "serial 42"})
    >>> identity.answer(ReadDeviceIdentification(4, 0x80)).objects
    ((128, b'serial 42'),)

    Raises EncodeError for a reserved number, a missing basic object, and a value longer than 244 bytes, which could
    never be sent.
    """

    def __init__(self, objects: Mapping[int, str | bytes]) -> None:
        for number, value in objects.items():
            if not is_whole(number, 0, 0xFF):
                text = "expected a number in 00h..06h or 80h..FFh"
                raise EncodeError(f"object {shown(number)}: {text}", "objects")
            if not isinstance(value, (str, bytes, bytearray)):
                raise EncodeError(f"object {number:02X}h is {value!r}: expected text or bytes", "objects")
        self.objects = {
            number: value.encode() if isinstance(value, str) else bytes(value)
            for number, value in sorted(objects.items())
        }
        for number, value in self.objects.items():
            if not (0 <= number <= 6 or 0x80 <= number <= 0xFF):
                raise EncodeError(f"object {number:02X}h is reserved: expected 00h..06h or 80h..FFh", "objects")
            if len(value) > OBJECT_LIMIT:
                text = f"object {number:02X}h has {len(value)} bytes: more than {OBJECT_LIMIT} never fit a PDU"
                raise EncodeError(text, "objects")
        if not {0, 1, 2} <= set(self.objects):
            raise EncodeError("objects 00h, 01h and 02h (vendor, product, revision) are not optional", "objects")

    def __repr__(self) -> str:
        return f"<Identity: {', '.join(f'{name} {text!r}' for name, text in object_texts(self.objects).items())}>"

    @property
    def conformity(self) -> int:
        """The conformity level: the highest level with an object, and the flag for individual access."""
        highest = max(self.objects)
        return min(level for level, last in _LAST.items() if highest <= last) | SINGLE_ACCESS

    def answer(self, request: ReadDeviceIdentification) -> ReadDeviceIdentificationResponse:
        """Return one object, or as many as fit, beginning with the requested one.                   [MB-APP 6.21]

        A stream that starts at an unknown object begins at 0; an unknown individual object is exception 02. For a level
        above that of the device all objects are returned.
        """
        code, first = request.read_code, request.object_id
        if code == INDIVIDUAL:
            if first not in self.objects:
                raise ModbusException(ILLEGAL_DATA_ADDRESS)
            return ReadDeviceIdentificationResponse(code, self.conformity, ((first, self.objects[first]),))
        stream = [(number, value) for number, value in self.objects.items() if number <= _LAST[code]]
        rest = [pair for pair in stream if pair[0] >= first] if (first, self.objects.get(first)) in stream else stream
        fitting, used = 0, 0
        while fitting < len(rest) and used + 2 + len(rest[fitting][1]) <= _ROOM:
            used += 2 + len(rest[fitting][1])
            fitting += 1
        more = fitting < len(rest)
        following = rest[fitting][0] if more else 0
        return ReadDeviceIdentificationResponse(code, self.conformity, tuple(rest[:fitting]), more, following)
