"""The emergency message: sent once when an error occurs and once when it is cleared.   [CiA 301, EMCY]

        080h+n | error code 2 | error register 1 | manufacturer 5 |      8 bytes, numbers little-endian

        30 81 11 02 00 00 00 00      8130h heartbeat lost, register 11h (generic, communication), node 2 in byte 3

Code 0000h means that an error is cleared. While other errors remain, the register in that message has bits set; only
register 00h means that no error is left.
"""

from __future__ import annotations

from dataclasses import dataclass

from barewire.canopen.cob_ids import classify, cob_id
from barewire.canopen.frame import CanFrame
from barewire.codecs import Layout
from barewire.errors import DecodeError, EncodeError

# Keys are four digits, or the first two: 3210h is found as 32, a voltage inside the device.
ERROR_CODES: dict[str, str] = {
    "00": "no error, or an error is gone",
    "10": "generic error",
    "20": "current",
    "21": "current, on the input side of the device",
    "22": "current, inside the device",
    "23": "current, on the output side of the device",
    "30": "voltage",
    "31": "mains voltage",
    "32": "voltage inside the device",
    "33": "output voltage",
    "40": "temperature",
    "41": "ambient temperature",
    "42": "device temperature",
    "50": "hardware of the device",
    "60": "software of the device",
    "61": "internal software",
    "62": "user software",
    "63": "data set",
    "70": "additional modules",
    "80": "monitoring",
    "81": "communication",
    "8110": "CAN overrun, objects lost",
    "8120": "CAN error passive",
    "8130": "life guarding or heartbeat error",
    "8140": "recovered from bus-off",
    "8150": "CAN-ID collision",
    "82": "protocol error",
    "8210": "PDO not processed: too short",
    "8220": "PDO longer than mapped",
    "8230": "destination of a DAM MPDO not available",
    "8240": "unexpected length of SYNC",
    "8250": "RPDO timeout",
    "90": "external error",
    "F0": "additional functions",
    "FF": "device specific",
}

REGISTER_BITS = ("generic", "current", "voltage", "temperature", "communication", "device profile", "", "manufacturer")
"""The bits of the error register 1001h, bit 0 first. Bit 6 is reserved."""


def error_text(code: int) -> str:
    """Return the meaning of an error code: the most specific entry of the table.

    >>> error_text(0x8130)
    'life guarding or heartbeat error'
    >>> error_text(0x3210)
    'voltage inside the device'
    """
    digits = f"{code:04X}"
    group = f"{digits[0]}0" if digits[0] in "2345678" else ""
    for beginning in (digits, digits[:2], group):
        if beginning in ERROR_CODES:
            return ERROR_CODES[beginning]
    return "unknown error code"


def register_names(register: int) -> tuple[str, ...]:
    """Return the set bits of an error register in words.

    >>> register_names(0x11)
    ('generic', 'communication')
    """
    return tuple(name or "reserved" for bit, name in enumerate(REGISTER_BITS) if register >> bit & 1)


_CLASS_BITS = {2: 1, 3: 2, 4: 3, 8: 4}
"""First digit of a code -> bit of the register; all other classes have only the generic bit."""


def register_of(code: int) -> int:
    """Return the bits of the error register that an error of this code sets: the bit of its class, and the generic bit.

    >>> register_names(register_of(0x3210)), register_names(register_of(0xFF01)), register_names(register_of(0x6100))
    (('generic', 'voltage'), ('generic', 'manufacturer'), ('generic',))
    """
    if code >> 8 == 0xFF:
        return 0x81
    bit = _CLASS_BITS.get(code >> 12)
    return 1 if bit is None or code >> 8 == 0x80 else 1 | 1 << bit


@dataclass(frozen=True, slots=True)
class Emergency:
    """One emergency message of one node.

        080h+n | code 2 | register 1 | info 5

    >>> str(Emergency(5, 0x8130, 0x11, b"\\x02").encode())
    '085#3081110200000000'
    """

    node: int
    code: int
    register: int = 0
    info: bytes = b"\0\0\0\0\0"
    padded: bool = False  # received with fewer than 8 bytes

    layout = Layout("<HB", "code", "register", tail="info")

    @property
    def text(self) -> str:
        """The meaning of the code."""
        return error_text(self.code)

    def encode(self) -> CanFrame:
        """Return the frame on 080h+n. Raise EncodeError for more than 5 bytes of manufacturer information."""
        if len(self.info) > 5:
            raise EncodeError(f"{len(self.info)} bytes of manufacturer information: expected at most 5")
        return CanFrame(
            cob_id("EMCY", self.node), self.layout.pack(self.code, self.register, tail=self.info.ljust(5, b"\0"))
        )

    @classmethod
    def decode(cls, frame: CanFrame) -> Emergency:
        """Decode a frame. A short message, as some devices send it, is filled with zeros and marked `padded`.

        Raise DecodeError for another identifier and for a frame without a whole error code.
        """
        found = classify(frame)
        if found is None or found[0].name != "EMCY" or frame.remote:
            raise DecodeError("mismatch", frame.data, 0, f"{frame} is not an emergency message")
        if len(frame.data) < 2:
            raise DecodeError("short", frame.data, len(frame.data), "the error code needs bytes 0..1")
        code, register, info = cls.layout.unpack(frame.data.ljust(8, b"\0"))
        return cls(found[1], code, register, info, padded=len(frame.data) < 8)
