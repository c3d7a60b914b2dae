"""The errors of barewire, and the closed list of reasons why bytes cannot be decoded.

    BarewireError
      |- EncodeError    the caller's value has no encoding        text, field
      |- DecodeError    the bytes are not a valid message         reason, data, at, text
      |- Refused        the peer understood and declined          code   (ModbusException, SdoAbort)
      |- NoAnswer       no answer within the time-out
      '- PortError      the port failed                           raised in `io` only

Every error that barewire raises on purpose is a `BarewireError`, so one `except` catches them all. Functions raise;
machines (objects with `feed`) never raise on received data: they report noise as an event.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from typing import Any, Literal

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
    "checksum",  # the CRC-16 or LRC does not fit the bytes before it
    "character",  # a character that is not allowed here (ASCII: not a hex digit)
    "delimiter",  # ':' or CR LF missing or in the wrong place
    "protocol",  # the MBAP protocol identifier is not 0
    "length",  # a length field or a byte count contradicts the bytes that follow
    "function",  # an unknown function code or command byte
    "value",  # a field holds a value that the standard does not allow
    "mismatch",  # a well-formed response, but not to this request
    "silence",  # a gap inside a frame, or a frame without an end
)
"""Why bytes cannot be decoded. `reason` in the vectors has the same words."""


def shown(value: object, most: int = 60) -> str:
    """Return the value as error texts show it: its `repr`, cut to 60 characters, or to `most`.

    >>> shown("x" * 100), shown(1 << 5000)
    ("'xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx...", 'a number of 5001 bits')
    """
    if isinstance(value, int) and value.bit_length() > 256:
        return f"a number of {value.bit_length()} bits"
    try:
        text = repr(value)
    except ValueError:
        return f"a {type(value).__name__} with a number of more than {sys.get_int_max_str_digits()} digits"
    return text if len(text) <= most else f"{text[: most - 3]}..."


def fold(name: str) -> str:
    """Return a name in the form in which names are compared: lower case, single blanks.

    >>> fold("  Thyristors   Temperature ")
    'thyristors temperature'
    """
    return " ".join(name.casefold().split())


def suggest(name: str, known: Iterable[str], title: Any = str) -> str:
    """Return '; did you mean ...?' with up to three similar names, or an empty text. `title` changes how one is shown.

    >>> suggest("abce", ("ABCD", "CDAB"))
    "; did you mean 'ABCD'?"
    """
    from difflib import get_close_matches  # only errors need it

    wanted, by_folded = fold(name), {fold(candidate): candidate for candidate in known}
    similar = get_close_matches(wanted, by_folded, n=3, cutoff=0.6)
    # A part of a long name is not similar to it, and is what people type.
    longer = [folded for folded in by_folded if wanted and wanted in folded and folded not in similar]
    nearest = (similar + longer)[:3]
    return f"; did you mean {' or '.join(repr(title(by_folded[folded])) for folded in nearest)}?" if nearest else ""


class BarewireError(Exception):
    """The base of all errors that barewire raises on purpose."""

    context = ""
    """The end of the text: "; while reading STATUS WORD"."""

    def __str__(self) -> str:
        return super().__str__() + self.context

    def add_context(self, text: str) -> None:
        """Add to the end of the text where the error happened."""
        self.context += f"; {text}"


class EncodeError(BarewireError, ValueError):
    """A value, quantity or address that cannot be encoded.

    The text names in one line what was given and what was expected; `field` is the message field concerned, or None.
    """

    def __init__(self, text: str, field: str | None = None) -> None:
        super().__init__(text)
        self.field = field


class DecodeError(BarewireError, ValueError):
    """Bytes that cannot be decoded.

        reason    one word of `Reason`
        data      all bytes that were given
        at        the offset in `data` of the first wrong byte
        text      the explanation, in one sentence

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
        start = self.data[:32].hex(" ").upper() + (" ..." if len(self.data) > 32 else "")
        return f"{self.text} ({self.reason}, at byte {self.at} of {start or 'nothing'}){self.context}"


class Refused(BarewireError):
    """The peer understood the request and declined it with `code`."""

    code: int


class NoAnswer(BarewireError, TimeoutError):
    """No answer came within the time-out. The text reports what was received meanwhile."""


class PortError(BarewireError, OSError):
    """The port failed: it does not exist, refused the connection, or was unplugged. Raised in `io` only."""
