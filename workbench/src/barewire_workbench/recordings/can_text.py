"""A pasted CAN frame: a line of candump, or one of the short forms used in notes.

    605#4040600000000000     (1234.5) can0 605#...     605#R     605 40 40 60     can0 605 [8] 40 40 60 ...

Raises DecodeError with the character that cannot be read, and its place.
"""

from __future__ import annotations

import re

from barewire.canopen.frame import AnyFrame, CanFrame
from barewire.errors import DecodeError
from barewire_workbench.frames.input import HEX_DIGITS, HEX_PREFIX, parse_hex_token
from barewire_workbench.frames.result import counted, text_error
from barewire_workbench.recordings.candump import parse_frame, read_candump
from barewire_workbench.recordings.model import Recorded

_BUS = re.compile(r"(?i)[vsx]?l?can\d*|[a-z]+\d+")
_ERROR = re.compile(r"[23][0-9A-Fa-f]{7}#")  # bit 29 above the identifier: an error frame


def parse_any_can(text: str) -> AnyFrame:
    """Parse a CAN frame, a CAN FD frame or an error frame.

    >>> str(parse_any_can("(1.5) can0 123##1AABB")), parse_any_can("can0 20000040 [8] 00 00 00 00 00 00 00 00").text
    ('123##1AABB', 'bus off')
    """
    items = list(read_candump(text)) if "\n" not in text.strip() else []
    if len(items) == 1 and isinstance(items[0], Recorded) and not isinstance(items[0].frame, CanFrame):
        return items[0].frame
    stripped = text.strip()
    if "##" in stripped or _ERROR.match(stripped):
        return parse_frame(stripped)
    return parse_can(text)


def parse_can(text: str) -> CanFrame:
    """Parse a classical CAN frame, from a line of candump or from a short form.

    >>> str(parse_can("(1234.5) can0 605#40.41.60.00")), str(parse_can("605# 40 41 60 00"))
    ('605#40416000', '605#40416000')
    >>> str(parse_can("  vcan0  705   [1]  remote request")), str(parse_can("0x80"))
    ('705#R1', '080#')
    """
    body = re.sub(r"^\s*\([^)]*\)", lambda stamp: " " * len(stamp.group()), text)
    tokens = [(token.start(), token.group()) for token in re.finditer(r"\S+", body)]
    if tokens and "#" not in tokens[0][1] and _is_bus(tokens[0][1]):
        tokens = tokens[1:]
        if tokens and tokens[0][1] in ("RX", "TX"):  # candump -x: direction, and two flags
            tokens = tokens[3:]
    if not tokens:
        raise text_error("short", text, len(text), "not a CAN frame: expected something like 605#4041600000000000")
    (position, first), rest = tokens[0], tokens[1:]
    if "#" not in first and rest and rest[0][1].startswith("#"):
        (_, second), rest = rest[0], rest[1:]
        first += second
    if "#" in first:
        first, rest = _joined(first, rest)
        if rest and (len(rest) > 1 or rest[0][1] not in ("R", "T")):
            raise text_error("long", text, rest[0][0], f"{rest[0][1]!r} at {rest[0][0]} is left over after the frame")
        return _parsed(text, position, first)
    return _in_columns(text, position, first, rest)


def _joined(first: str, rest: list[tuple[int, str]]) -> tuple[str, list[tuple[int, str]]]:
    """Return the frame with the bytes that stand behind it, and what is left: 605#40 41 60 00, each with two digits."""
    start = re.sub(r"^#.", "", first.partition("#")[2])  # the flags of CAN FD
    if len(start.replace(".", "")) % 2 or not set(start) <= HEX_DIGITS | {"."}:
        return first, rest
    while rest and len(rest[0][1]) % 2 == 0 and set(rest[0][1]) <= HEX_DIGITS:
        first, rest = first + rest[0][1], rest[1:]
    return first, rest


def _is_bus(token: str) -> bool:
    """Return whether the token is the name of a bus, such as can0. `CA0` could be both and is an identifier."""
    return _BUS.fullmatch(token) is not None and not set(token) <= HEX_DIGITS and not token.startswith("0x")


def _in_columns(text: str, position: int, first: str, rest: list[tuple[int, str]]) -> CanFrame:
    """Parse identifier, [length], bytes; each token comes with its place in the text."""
    start = 2 if HEX_PREFIX.match(first) else 0
    identifier = first[start:].removesuffix("h")
    for place, character in enumerate(identifier, start=position + start):
        if character not in HEX_DIGITS:
            raise text_error("character", text, place, f"{character!r} at {place} is not a hexadecimal digit")
    length: int | None = None
    if rest and (given := re.fullmatch(r"\[(\d+)\]", rest[0][1])):
        length, rest = int(given.group(1)), rest[1:]
    if rest and rest[0][1] in ("remote", "R", "RTR"):
        body = f"R{length or 0}"
    else:
        # candump -a prints the characters in quotes after the bytes.
        quoted = next((place for place, (_, token) in enumerate(rest) if token.startswith("'")), len(rest))
        data = b"".join(parse_hex_token(text, place, token) for place, token in rest[:quoted])
        if length is not None and length != len(data):
            words = f"the length is [{length}], but {counted(len(data))} of data follow"
            raise text_error("length", text, rest[0][0] if rest else len(text), words)
        body = data.hex()
    return _parsed(text, position, f"{identifier.rjust(3, '0')}#{body}")


def _parsed(text: str, position: int, frame: str) -> CanFrame:
    """Parse a frame as `CanFrame.parse` does, with the place of an error in the whole text."""
    try:
        return CanFrame.parse(frame)
    except DecodeError as error:
        letters = [place for place in range(position, len(text)) if not text[place].isspace()]
        place = letters[error.at] if error.at < len(letters) else len(text)
        words = f"{text[place : place + 1]!r} is not a hexadecimal digit" if error.reason == "character" else error.text
        raise text_error(error.reason, text, place, f"{words}, at {place}") from None
