"""Bytes from pasted text: every usual notation of hexadecimal, source literals, and dumps.

    rtu, tcp   01 04 0F B1    01040fb1    0x01,0x04    01-04-0F-B1    01:04    \\x01\\x04    01h 04h
               literals of a program (`source_literals`)    xxd, hexdump -C and tshark -x (`hexdump`)
    ascii      :01040FB1000239          with or without \\r\\n, typed or real; or the characters' codes: 3A 30 31 ...

Raises DecodeError with the character that cannot be read, and its place. For CAN frames see `capture.can_text`.
"""

from __future__ import annotations

import re

from barewire.errors import DecodeError
from barewire_workbench.frames.input.hexdump import parse_dump
from barewire_workbench.frames.input.source_literals import parse_decimal, parse_string_literal, strip_syntax
from barewire_workbench.frames.result import text_error

_TOKEN = re.compile(r"[^\s,;:|\-_.]+")
_BYTES_IN_HEX = re.compile(r"(?=.*[a-fA-F])[0-9a-fA-F]{1,2}(?: [0-9a-fA-F]{1,2})+")
HEX_PREFIX = re.compile(r"0[xX]|\\x")
HEX_DIGITS = frozenset("0123456789abcdefABCDEF")
_LINE_ENDS = {r"\r": "\r", r"\n": "\n", "<CR>": "\r", "<LF>": "\n"}


def parse_hex(text: str) -> bytes:
    """Parse hexadecimal digits in any usual notation.

    >>> parse_hex("0x01, 0x4, 0f-b1").hex(" ")
    '01 04 0f b1'
    >>> parse_hex("01 04 0G")
    Traceback (most recent call last):
    barewire.errors.DecodeError: 'G' at 7 is not a hexadecimal digit (character, at byte 7 of 30 31 20 30 34 20 30 47)

    A single digit is a byte after 0x, and where several bytes have one, none more than two, and one is a letter, as in
    `1 3 0 A`: in `1 4 FB1` the bytes are ambiguous. Offsets count from 0.
    """
    dumped = parse_dump(text)
    if dumped is not None:
        return dumped
    text, listed = strip_syntax(text)
    literal = parse_string_literal(text)
    if literal is None:
        literal = parse_decimal(text, listed)
    if literal is not None:
        return literal
    tokens = _TOKEN.findall(text)
    if sum(len(token) == 1 for token in tokens) > 1 and _BYTES_IN_HEX.fullmatch(" ".join(tokens)):
        return bytes(int(token, 16) for token in tokens)
    found = bytearray()
    for token in _TOKEN.finditer(text):
        found += parse_hex_token(text, token.start(), token.group())
    return bytes(found)


def parse_hex_token(text: str, index: int, token: str) -> bytes:
    # "\x01\x04" has no separators, so a token may hold several bytes, each with its prefix.
    parts = list(HEX_PREFIX.finditer(token))
    if parts and parts[0].start() == 0:
        ends = [part.start() for part in parts[1:]] + [len(token)]
        spans = [(part.end(), end) for part, end in zip(parts, ends)]
        return b"".join(_pairs(text, index + start, token[start:end], lone=True) for start, end in spans)
    digits = token[:-1] if token[-1] in "hH" else token
    return _pairs(text, index, digits, lone=False)


def _pairs(text: str, index: int, digits: str, lone: bool) -> bytes:
    for place, character in enumerate(digits):
        if character not in HEX_DIGITS:
            raise text_error(
                "character", text, index + place, f"{character!r} at {index + place} is not a hexadecimal digit"
            )
    if lone and len(digits) == 1:
        digits = "0" + digits
    if len(digits) % 2 or not digits:
        raise text_error("length", text, index, f"{digits!r} at {index}: a byte has two hexadecimal digits")
    return bytes.fromhex(digits)


def parse_ascii(text: str) -> bytes:
    """Return the characters of an ASCII frame, from the frame itself or from the codes of its characters.

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
    """Return the characters without quotes, such as those of b':0104...' in a source or a log."""
    found = re.fullmatch(r"\s*b?(['\"])(:.*)\1[\s;]*", typed, re.DOTALL)
    return typed if found is None else found[2]
