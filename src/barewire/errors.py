"""The four sentences that can go wrong, and the short closed list of reasons.

    EncodeError    I can't say that          the caller asked for bytes that the wire has no way to carry
    DecodeError    I can't read that         these bytes are not what they were taken for: reason, data, at
    Refused        they said no              the other side understood and declined: code
    NoAnswer       nobody answered           the time is up

Everything barewire raises on purpose is a `BarewireError`, so one `except` is enough for a program that only
wants to say what happened. Functions raise; *machines* (whatever has `feed`) never do: noise on a bus is
weather, and weather is reported as an event.

I know: nothing about any protocol.  I may be imported by: everybody.
"""

from __future__ import annotations

from typing import Literal

Reason = Literal[
    "short",
    "long",
    "checksum",
    "character",
    "delimiter",
    "protocol",
    "length",
    "function",
    "value",
    "mismatch",
    "silence",
]

REASONS: tuple[Reason, ...] = (
    "short",  # the bytes end before the value does
    "long",  # bytes are left over behind the value
    "checksum",  # CRC-16 or LRC does not fit the bytes before it
    "character",  # a character that has no place here (ASCII: not a hex digit)
    "delimiter",  # ':' or CR LF missing or in the wrong place
    "protocol",  # MBAP protocol identifier is not 0
    "length",  # a length field or a byte count contradicts the bytes that follow
    "function",  # a function code or command byte that nobody here knows
    "value",  # a field holds what the standard does not allow in it
    "mismatch",  # a well-formed answer, but not to this question
    "silence",  # a gap inside a frame, or a frame that never came to its end
)
"""Why bytes could not be read. The same words stand in the vectors' `reason`."""


def shown(value: object) -> str:
    """A value as an error shows it: one line, and not endless, whatever it is.

    >>> shown("x" * 100), shown(1 << 5000)
    ("'xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx...", 'a number of 5001 bits')
    """
    if isinstance(value, int) and value.bit_length() > 256:
        return f"a number of {value.bit_length()} bits"
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


class BarewireError(Exception):
    """Whatever barewire raises on purpose."""


class EncodeError(BarewireError, ValueError):
    """I can't say that: a value, a quantity or an address that does not fit the wire.

    The text names the thing, what it was and what was expected, in one line; `field` is the field of the message
    that holds it, where there is one.
    """

    def __init__(self, text: str, field: str | None = None) -> None:
        super().__init__(text)
        self.field = field


class DecodeError(BarewireError, ValueError):
    """I can't read that.

    `reason` is one word of `Reason`; `data` is everything that was being read; `at` is the offset of the first
    byte that is wrong, counted in `data`; `text` is the sentence for a person.

    >>> raise DecodeError("short", b"\\x01\\x03", 2, "no CRC")
    Traceback (most recent call last):
    barewire.errors.DecodeError: no CRC (short, at byte 2 of 01 03)
    """

    def __init__(self, reason: Reason, data: bytes, at: int, text: str) -> None:
        super().__init__(reason, data, at, text)
        self.reason: Reason = reason
        self.data = bytes(data)
        self.at = at
        self.text = text

    def __str__(self) -> str:
        shown = self.data[:32].hex(" ").upper() + (" ..." if len(self.data) > 32 else "")
        return f"{self.text} ({self.reason}, at byte {self.at} of {shown or 'nothing'})"


class Refused(BarewireError):
    """They said no: the peer understood the request and declined it with `code`."""

    code: int


class NoAnswer(BarewireError, TimeoutError):
    """Nobody answered in the time given. What *was* heard meanwhile stands in the text."""


class PortError(BarewireError, OSError):
    """The port itself failed: not there, refused, unplugged. Raised by the shells only."""
