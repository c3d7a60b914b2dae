"""SDO abort codes, and the exception that carries one.   [CiA 301, SDO abort codes]

        80 | index 2 | sub 1 | abort code 4 |        0602 0000h is sent as 00 00 02 06

The parts of a code are class, kind and detail. Class 05 concerns the protocol, 06 the object, 08 the device.
"""

from __future__ import annotations

from enum import IntEnum

from barewire.errors import BarewireError, Refused


class AbortCode(IntEnum):
    """Every abort code of the standard, with its meaning as `text`."""

    text: str

    def __new__(cls, code: int, text: str) -> AbortCode:
        member = int.__new__(cls, code)
        member._value_ = code
        member.text = text
        return member

    TOGGLE = 0x05030000, "toggle bit not alternated"
    TIMED_OUT = 0x05040000, "SDO protocol timed out"
    COMMAND = 0x05040001, "command specifier not valid or unknown"
    BLOCK_SIZE = 0x05040002, "invalid block size"
    SEQUENCE_NUMBER = 0x05040003, "invalid sequence number"
    CRC = 0x05040004, "CRC error"
    OUT_OF_MEMORY = 0x05040005, "out of memory"
    UNSUPPORTED_ACCESS = 0x06010000, "unsupported access to an object"
    WRITE_ONLY = 0x06010001, "attempt to read a write-only object"
    READ_ONLY = 0x06010002, "attempt to write a read-only object"
    NO_OBJECT = 0x06020000, "object does not exist"
    NOT_MAPPABLE = 0x06040041, "object cannot be mapped to the PDO"
    PDO_TOO_LONG = 0x06040042, "mapped objects would exceed the length of the PDO"
    INCOMPATIBLE_PARAMETER = 0x06040043, "general parameter incompatibility"
    INCOMPATIBLE_INTERNALLY = 0x06040047, "general internal incompatibility in the device"
    HARDWARE = 0x06060000, "access failed because of a hardware error"
    LENGTH = 0x06070010, "data type does not match, length of parameter does not match"
    TOO_LONG = 0x06070012, "data type does not match, length of parameter too high"
    TOO_SHORT = 0x06070013, "data type does not match, length of parameter too low"
    NO_SUB = 0x06090011, "sub-index does not exist"
    INVALID_VALUE = 0x06090030, "invalid value for parameter"
    TOO_HIGH = 0x06090031, "value of parameter written too high"
    TOO_LOW = 0x06090032, "value of parameter written too low"
    MAXIMUM_BELOW_MINIMUM = 0x06090036, "maximum value is less than minimum value"
    NO_CONNECTION = 0x060A0023, "resource not available: SDO connection"
    GENERAL = 0x08000000, "general error"
    NOT_STORED = 0x08000020, "data cannot be transferred or stored to the application"
    LOCAL_CONTROL = 0x08000021, "data cannot be transferred or stored because of local control"
    DEVICE_STATE = 0x08000022, "data cannot be transferred or stored in the present device state"
    NO_DICTIONARY = 0x08000023, "object dictionary not present or its dynamic generation failed"
    NO_DATA = 0x08000024, "no data available"


_TEXTS = {int(code): code.text for code in AbortCode}


def abort_text(code: int) -> str:
    """Return the code as the standard prints it, and its meaning if it is known.

    >>> abort_text(0x06020000)
    '0602 0000h object does not exist'
    >>> abort_text(0x08001234)
    '0800 1234h unknown abort code'
    """
    return f"{code >> 16:04X} {code & 0xFFFF:04X}h {_TEXTS.get(code, 'unknown abort code')}"


class ProtocolViolation(BarewireError):
    """The peer broke the protocol or did not respond in time; `code` is the abort code to send.

    Callers never see it: the client turns it into SdoAbort or NoAnswer, the server into an abort message.
    """

    def __init__(self, code: AbortCode, why: str) -> None:
        super().__init__(code, why)
        self.code = code
        self.why = why

    def __str__(self) -> str:
        return self.why


class SdoAbort(Refused):
    """An access was refused by the server, by the local dictionary, or by the client if the server broke the rules.

    `index` and `sub` are the object of the request, `named` is the object in the abort message. Some servers send a
    wrong one; which of these aborts end a transfer at once is in `sdo.transfer`. `why` is the reason if the
    client ended the transfer, and empty if the server ended it. `node` is the node of the server, if a client raised
    the error.

    >>> raise SdoAbort(0x06020000, 0x6041, 0)
    Traceback (most recent call last):
    barewire.canopen.abort_codes.SdoAbort: 6041h:00: 0602 0000h object does not exist
    """

    def __init__(
        self,
        code: int,
        index: int,
        sub: int,
        named: tuple[int, int] | None = None,
        *,
        why: str = "",
        node: int | None = None,
    ) -> None:
        super().__init__(code, index, sub, named)
        self.code = int(code)
        self.index = index
        self.sub = sub
        self.named = named or (index, sub)
        self.why = why
        self.node = node

    @property
    def text(self) -> str:
        """The code and its meaning: `0602 0000h object does not exist`."""
        return abort_text(self.code)

    def __str__(self) -> str:
        more = ""
        if self.named != (self.index, self.sub):
            more = f" (the abort names {self.named[0]:04X}h:{self.named[1]:02X})"
        if self.why:
            more = f", so the client ended it: {self.why}"
        place = "" if self.node is None else f"node {self.node}, "
        return f"{place}{self.index:04X}h:{self.sub:02X}: {self.text}{more}{self.context}"
