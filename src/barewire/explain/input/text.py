"""What people paste, as bytes or a frame: every way of writing hexadecimal, and the lines of candump.

    rtu, tcp   01 04 0F B1    01040fb1    0x01,0x04    01-04-0F-B1    01:04    \\x01\\x04    01h 04h
               as a program has them (`dress`)         as xxd, hexdump -C and tshark -x print them (`dump`)
    ascii      :01040FB1000239          with or without \\r\\n, typed or real; or the characters' codes: 3A 30 31 ...
    can        605#4040600000000000     (1234.5) can0 605#...     605#R     605 40 40 60     can0 605 [8] 40 40 60 ...

What cannot be read is one DecodeError that says which character it was, and where.
"""

from __future__ import annotations

import re

from barewire.canopen.frame import CanFrame
from barewire.errors import DecodeError, Reason
from barewire.explain.capture.candump import parse_frame, read_candump
from barewire.explain.capture.model import AnyFrame, Recorded
from barewire.explain.input.hexdump import parse_dump
from barewire.explain.input.source_literals import decimal, quoted, undressed
from barewire.explain.result import counted

_TOKEN = re.compile(r"[^\s,;:|\-_.]+")
_PREFIX = re.compile(r"0[xX]|\\x")
_BUS = re.compile(r"(?i)[vsx]?l?can\d*|[a-z]+\d+")
_ERROR = re.compile(r"[23][0-9A-Fa-f]{7}#")  # bit 29 above the identifier: an error frame
_DIGITS = frozenset("0123456789abcdefABCDEF")
_LINE_ENDS = {r"\r": "\r", r"\n": "\n", "<CR>": "\r", "<LF>": "\n"}


def _wrong(reason: Reason, text: str, at: int, words: str) -> DecodeError:
    return DecodeError(reason, text.encode("latin-1", "replace"), at, words)


def parse_hex(text: str) -> bytes:
    """Hexadecimal digits in any usual dress.

    >>> parse_hex("0x01, 0x4, 0f-b1").hex(" ")
    '01 04 0f b1'
    >>> parse_hex("01 04 0G")
    Traceback (most recent call last):
    barewire.errors.DecodeError: 'G' at 7 is no hexadecimal digit (character, at byte 7 of 30 31 20 30 34 20 30 47)

    A single digit is a byte only behind 0x: in `1 4 FB1` nobody knows where a byte begins. Offsets count from 0.
    """
    dumped = parse_dump(text)
    if dumped is not None:
        return dumped
    text, listed = undressed(text)
    said = quoted(text)
    if said is None:
        said = decimal(text, listed)
    if said is not None:
        return said
    found = bytearray()
    for token in _TOKEN.finditer(text):
        found += _token(text, token.start(), token.group())
    return bytes(found)


def _token(text: str, at: int, token: str) -> bytes:
    # "\x01\x04" has no separators, so a token may hold several bytes, each with its prefix.
    parts = list(_PREFIX.finditer(token))
    if parts and parts[0].start() == 0:
        ends = [part.start() for part in parts[1:]] + [len(token)]
        spans = [(part.end(), end) for part, end in zip(parts, ends)]
        return b"".join(_pairs(text, at + start, token[start:end], lone=True) for start, end in spans)
    digits = token[:-1] if token[-1] in "hH" else token
    return _pairs(text, at, digits, lone=False)


def _pairs(text: str, at: int, digits: str, lone: bool) -> bytes:
    for place, character in enumerate(digits):
        if character not in _DIGITS:
            raise _wrong("character", text, at + place, f"{character!r} at {at + place} is no hexadecimal digit")
    if lone and len(digits) == 1:
        digits = "0" + digits
    if len(digits) % 2 or not digits:
        raise _wrong("length", text, at, f"{digits!r} at {at}: a byte has two hexadecimal digits")
    return bytes.fromhex(digits)


def parse_ascii(text: str) -> bytes:
    """The characters of an ASCII frame, from the frame as it is typed or from their codes.

    >>> parse_ascii(r":01040FB1000239\\r\\n") == parse_ascii("3A 30 31 30 34 30 46 42 31 30 30 30 32 33 39 0D 0A")
    True
    """
    typed = text.strip(" \t")
    for escape, character in _LINE_ENDS.items():
        typed = typed.replace(escape, character)
    typed = _unquoted(typed)
    if not typed.startswith(":"):
        try:
            codes = parse_hex(typed)
        except DecodeError:
            codes = b""
        if codes.startswith(b":"):
            return codes
    return typed.encode("latin-1", "replace")


def _unquoted(typed: str) -> str:
    """The characters in quotes, as a program's source or its log has them: b':0104...'."""
    found = re.fullmatch(r"\s*b?(['\"])(:.*)\1[\s;]*", typed, re.DOTALL)
    return typed if found is None else found[2]


def parse_any_can(text: str) -> AnyFrame:
    """The same, and CAN FD frames and error frames where candump writes them.

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
    """A CAN frame from a line of candump, or from the short forms that people write into their notes.

    >>> str(parse_can("(1234.5) can0 605#40.41.60.00"))
    '605#40416000'
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
        raise _wrong("short", text, len(text), "no CAN frame: expected something like 605#4041600000000000")
    (at, first), rest = tokens[0], tokens[1:]
    if "#" in first:
        if rest and (len(rest) > 1 or rest[0][1] not in ("R", "T")):
            raise _wrong("long", text, rest[0][0], f"{rest[0][1]!r} at {rest[0][0]} is left over behind the frame")
        return _parsed(text, at, first)
    return _in_columns(text, at, first, rest)


def _is_bus(token: str) -> bool:
    """A name such as can0. `CA0` could be both, and is an identifier."""
    return _BUS.fullmatch(token) is not None and not set(token) <= _DIGITS and not token.startswith("0x")


def _in_columns(text: str, at: int, first: str, rest: list[tuple[int, str]]) -> CanFrame:
    """identifier, [length], bytes; each with its place in the text."""
    start = 2 if _PREFIX.match(first) else 0
    identifier = first[start:].removesuffix("h")
    for place, character in enumerate(identifier, start=at + start):
        if character not in _DIGITS:
            raise _wrong("character", text, place, f"{character!r} at {place} is no hexadecimal digit")
    length: int | None = None
    if rest and (told := re.fullmatch(r"\[(\d+)\]", rest[0][1])):
        length, rest = int(told.group(1)), rest[1:]
    if rest and rest[0][1] in ("remote", "R", "RTR"):
        body = f"R{length or 0}"
    else:
        # candump -a prints the characters behind the bytes, in quotes.
        quoted = next((place for place, (_, token) in enumerate(rest) if token.startswith("'")), len(rest))
        data = b"".join(_token(text, place, token) for place, token in rest[:quoted])
        if length is not None and length != len(data):
            words = f"the length is [{length}], but {counted(len(data))} of data follow"
            raise _wrong("length", text, rest[0][0] if rest else len(text), words)
        body = data.hex()
    return _parsed(text, at, f"{identifier.rjust(3, '0')}#{body}")


def _parsed(text: str, at: int, frame: str) -> CanFrame:
    """`CanFrame.parse`, with its complaint placed in the whole text."""
    try:
        return CanFrame.parse(frame)
    except DecodeError as error:
        place = min(at + error.at, len(text))
        words = f"{text[place : place + 1]!r} is no hexadecimal digit" if error.reason == "character" else error.text
        raise _wrong(error.reason, text, place, f"{words}, at {place}") from None
