"""The state of the server itself: function codes 07 and 08.

By the standard they are for serial lines only, but many TCP servers have them too. Diagnostics (08) has sub-functions,
in two bytes: 00 is an echo, 01 to 04, 0A and 14 are commands, 0B to 12 read the counters of a serial server.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from barewire.codecs import Field, Layout
from barewire.errors import EncodeError
from barewire.modbus.messages.base import Request, Response, check_bytes, check_range


@dataclass(frozen=True, slots=True)
class ReadExceptionStatusResponse(Response):
    """Eight bits whose meaning is specific to the device.                                 [MB-APP 6.7]

        07 | status

    >>> ReadExceptionStatusResponse(0x6D).encode().hex(" ")
    '07 6d'
    """

    status: int

    name: ClassVar[str] = "Read Exception Status"
    function_code: ClassVar[int] = 0x07
    layout: ClassVar[Layout] = Layout(">BB", "function_code", "status")

    def __post_init__(self) -> None:
        check_range("status", self.status, 0, 0xFF)

    @classmethod
    def fields(cls, pdu: bytes) -> list[Field]:
        """Return the fields, with bits 7 to 0 of the status."""
        fields = cls.layout.fields(pdu)
        if len(fields) > 1:
            fields[1] = fields[1]._replace(meaning=f"bits 7..0: {pdu[1]:08b}")
        return fields


@dataclass(frozen=True, slots=True)
class ReadExceptionStatus(Request[ReadExceptionStatusResponse]):
    """Read the eight exception status bits.                                               [MB-APP 6.7]

        07

    >>> ReadExceptionStatus().encode().hex(" ")
    '07'
    """

    name: ClassVar[str] = "Read Exception Status"
    function_code: ClassVar[int] = 0x07
    layout: ClassVar[Layout] = Layout(">B", "function_code")
    response: ClassVar[type[Response]] = ReadExceptionStatusResponse


RETURN_QUERY_DATA = 0x00
RESTART_COMMUNICATIONS = 0x01
DIAGNOSTIC_REGISTER = 0x02
CHANGE_ASCII_DELIMITER = 0x03
FORCE_LISTEN_ONLY = 0x04
CLEAR_COUNTERS = 0x0A
CLEAR_OVERRUN = 0x14

SUB_FUNCTIONS: dict[int, str] = {
    0x00: "Return Query Data",
    0x01: "Restart Communications Option",
    0x02: "Return Diagnostic Register",
    0x03: "Change ASCII Input Delimiter",
    0x04: "Force Listen Only Mode",
    0x0A: "Clear Counters and Diagnostic Register",
    0x0B: "Return Bus Message Count",
    0x0C: "Return Bus Communication Error Count",
    0x0D: "Return Bus Exception Error Count",
    0x0E: "Return Server Message Count",
    0x0F: "Return Server No Response Count",
    0x10: "Return Server NAK Count",
    0x11: "Return Server Busy Count",
    0x12: "Return Bus Character Overrun Count",
    0x14: "Clear Overrun Counter and Flag",
}
"""The public sub-functions [MB-APP 6.8.1]. The others are reserved."""

WITHOUT_EFFECT = frozenset({0x00, 0x02} | set(range(0x0B, 0x13)))
"""Sub-functions that change nothing in the server. What a reserved one does is not known."""

ECHOED = frozenset({0x00, 0x01, 0x03, 0x0A, 0x14})
"""Sub-functions whose response repeats the request."""


RESTART_AND_CLEAR_LOG = b"\xff\x00"
"""The data of Restart Communications that clears the event log too; zeros keep it."""


def _check_diagnostics(sub_function: int, data: bytes) -> None:
    check_range("sub_function", sub_function, 0, 0xFFFF)
    check_range("data length", len(data), 0, 250)
    # The data of reserved sub-functions are not defined, and a server declines these, so they are not checked.
    if sub_function in SUB_FUNCTIONS and sub_function != RETURN_QUERY_DATA and len(data) != 2:
        raise EncodeError(f"sub-function {sub_function:02X} has 2 bytes of data, got {len(data)}", "data")


def _check_asked(sub_function: int, data: bytes) -> None:
    """Check that the data of a request are 0000, except for query data, restart (or FF00) and delimiter (CHAR 00)."""
    if sub_function == RESTART_COMMUNICATIONS:
        allowed = data in (b"\0\0", RESTART_AND_CLEAR_LOG)
    elif sub_function == CHANGE_ASCII_DELIMITER:
        allowed = data[1:] == b"\0"
    else:
        allowed = sub_function == RETURN_QUERY_DATA or sub_function not in SUB_FUNCTIONS or data == b"\0\0"
    if not allowed:
        expected = {RESTART_COMMUNICATIONS: "00 00 or FF 00", CHANGE_ASCII_DELIMITER: "a character and 00"}
        given, right = data.hex(" ").upper(), expected.get(sub_function, "00 00")
        raise EncodeError(f"data {given} for sub-function {sub_function:02X}: expected {right}", "data")


def _diagnostics_fields(fields: list[Field]) -> list[Field]:
    if len(fields) > 1:
        name = SUB_FUNCTIONS.get(int(str(fields[1].value)), "reserved: no public sub-function")
        fields[1] = fields[1]._replace(meaning=name)
    return fields


@dataclass(frozen=True, slots=True)
class DiagnosticsResponse(Response):
    """The request repeated, or the value asked for.                                       [MB-APP 6.8]

        08 | sub-function 2 | data 2 (Return Query Data: any length)

    >>> DiagnosticsResponse(0x0B, bytes([0, 17])).count
    17
    """

    sub_function: int
    data: bytes

    name: ClassVar[str] = "Diagnostics"
    function_code: ClassVar[int] = 0x08
    layout: ClassVar[Layout] = Layout(">BH", "function_code", "sub_function", tail="data")

    def __post_init__(self) -> None:
        object.__setattr__(self, "data", check_bytes("data", self.data))
        _check_diagnostics(self.sub_function, self.data)

    @property
    def count(self) -> int:
        """The data as a number: the value of a counter."""
        return int.from_bytes(self.data, "big")

    def encode(self) -> bytes:
        return self.layout.pack(self.function_code, self.sub_function, tail=self.data)

    @classmethod
    def measure(cls, pdu: bytes) -> int | None:
        """Return the length with two bytes of data. Query data may be longer: on RTU only silence ends those."""
        return cls.layout.size + 2

    @classmethod
    def fields(cls, pdu: bytes) -> list[Field]:
        """Return the fields, with the name of the sub-function."""
        return _diagnostics_fields(cls.layout.fields(pdu))


@dataclass(frozen=True, slots=True)
class Unanswered(DiagnosticsResponse):
    """The result of `ask` if the standard demands silence and the unit was silent.        [MB-APP 6.8.1]

    That is after Force Listen Only Mode, and after a restart of a unit in that mode. The unit may not exist at all.

    >>> Diagnostics(FORCE_LISTEN_ONLY).without_answer()
    Unanswered(sub_function=4, data=b'')
    """

    data: bytes = b""

    def __post_init__(self) -> None:
        """Skip the checks of a response: there is nothing to check."""

    def encode(self) -> bytes:
        """Raise EncodeError, because this stands for the absence of a message."""
        raise EncodeError("Unanswered stands for silence and cannot be encoded", "data")


@dataclass(frozen=True, slots=True)
class Diagnostics(Request[DiagnosticsResponse]):
    """Read a counter of a server, test the line, or change the server's mode.             [MB-APP 6.8]

        08 | sub-function 2 | data 2 (Return Query Data: any length)

    >>> Diagnostics(RETURN_QUERY_DATA, bytes.fromhex("A537")).encode().hex(" ")
    '08 00 00 a5 37'
    """

    sub_function: int
    data: bytes = b"\0\0"

    name: ClassVar[str] = "Diagnostics"
    function_code: ClassVar[int] = 0x08
    layout: ClassVar[Layout] = Layout(">BH", "function_code", "sub_function", tail="data")
    response: ClassVar[type[Response]] = DiagnosticsResponse

    def __post_init__(self) -> None:
        object.__setattr__(self, "data", check_bytes("data", self.data))
        _check_diagnostics(self.sub_function, self.data)
        _check_asked(self.sub_function, self.data)

    @property
    def writes(self) -> bool:  # type: ignore[override]  # here it is a value
        """Whether the sub-function changes something: it restarts, silences or clears."""
        return self.sub_function not in WITHOUT_EFFECT

    def encode(self) -> bytes:
        return self.layout.pack(self.function_code, self.sub_function, tail=self.data)

    @classmethod
    def measure(cls, pdu: bytes) -> int | None:
        return DiagnosticsResponse.measure(pdu)

    @classmethod
    def fields(cls, pdu: bytes) -> list[Field]:
        """Return the fields, with the name of the sub-function."""
        return _diagnostics_fields(cls.layout.fields(pdu))

    def without_answer(self, *, listens_only: bool = False) -> DiagnosticsResponse | None:
        """Return `Unanswered` for Force Listen Only Mode, and for a restart of a unit in that mode."""
        if self.sub_function == FORCE_LISTEN_ONLY or (listens_only and self.sub_function == RESTART_COMMUNICATIONS):
            return Unanswered(self.sub_function)
        return None

    def fit(self, response: Any, pdu: bytes) -> Any:
        """Check that the response has the same sub-function, and the same data if it is an echo."""
        if response.sub_function != self.sub_function:
            self.refuse(pdu, "sub_function", self.sub_function, response.sub_function)
        if self.sub_function in ECHOED and response.data != self.data:
            self.refuse(pdu, "data", self.data.hex(" ").upper(), response.data.hex(" ").upper())
        return response
