"""Exception codes: the table of the standard, and the error that a client raises for an exception response.

An exception response:

    | function code + 80h | exception code |                                   [MB-APP 7]
"""

from __future__ import annotations

from typing import NamedTuple

from barewire.errors import Refused


class ExceptionCode(NamedTuple):
    """One row of the table: the name in the standard, and its usual cause in practice."""

    name: str
    hint: str


EXCEPTIONS: dict[int, ExceptionCode] = {
    0x01: ExceptionCode("illegal function", "this server does not support the function code"),
    0x02: ExceptionCode("illegal data address", "the address, or the address plus quantity, does not exist there"),
    0x03: ExceptionCode("illegal data value", "a quantity, value or length the server does not accept"),
    0x04: ExceptionCode("server device failure", "the server failed while carrying it out"),
    0x05: ExceptionCode("acknowledge", "accepted, but it takes long: ask later whether it is done"),
    0x06: ExceptionCode("server device busy", "ask again later"),
    0x07: ExceptionCode("negative acknowledge", "an older code that the tables of V1.1b3 no longer list"),
    0x08: ExceptionCode("memory parity error", "file records only: the stored record is damaged"),
    0x0A: ExceptionCode("gateway path unavailable", "the gateway has no path to that unit"),
    0x0B: ExceptionCode("gateway target device failed to respond", "the unit behind the gateway did not respond"),
}

ILLEGAL_FUNCTION = 0x01
ILLEGAL_DATA_ADDRESS = 0x02
ILLEGAL_DATA_VALUE = 0x03
SERVER_DEVICE_FAILURE = 0x04
SERVER_DEVICE_BUSY = 0x06


def exception_name(code: int) -> str:
    """Return the name of an exception code: 'illegal data address' for 2, 'undefined exception code' for 9."""
    known = EXCEPTIONS.get(code)
    return known.name if known else "undefined exception code"


class ModbusException(Refused):
    """An exception response. A client raises it on receiving one; a unit of a server raises it to send one.

    >>> error = ModbusException(2, function_code=3)
    >>> str(error)
    'exception 02 (illegal data address) to function 03'
    >>> error.add_place(unit=7, address=100)  # clients do it
    >>> str(error)
    'unit 7, address 100: exception 02 (illegal data address) to function 03'
    """

    unit: int | None = None
    """The unit that declined, if a client raised the error."""
    address: int | None = None
    """The address in the request, if it has one."""
    pdu: bytes | None = None
    """The whole exception response, if it answers a `RawRequest`: some devices add bytes to it."""

    def __init__(self, code: int, function_code: int | None = None) -> None:
        super().__init__(code, function_code)
        self.code = code
        self.function_code = function_code

    def __str__(self) -> str:
        place = "" if self.unit is None else f"unit {self.unit}"
        place += "" if self.address is None else f", address {self.address}" if place else f"address {self.address}"
        to = "" if self.function_code is None else f" to function {self.function_code:02X}"
        text = f"exception {self.code:02X} ({exception_name(self.code)}){to}{self.context}"
        return f"{place}: {text}" if place else text

    def add_place(self, unit: int | None, address: int | None = None) -> None:
        """Record the unit that declined and the address of the request, unless they are known already."""
        self.unit = unit if self.unit is None else self.unit
        self.address = address if self.address is None else self.address
