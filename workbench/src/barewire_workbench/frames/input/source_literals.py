"""Bytes in the notation of programming languages: the syntax around them is removed, string escapes are decoded.

    uint8_t ask[] = {0x01, 0x03};    bytes([1, 3])    bytes.fromhex("0103")    [01][03]    <01> <03>
    b'\\x01\\x03\\n'                   a string of bytes: escapes and plain characters
    [1, 3, 0, 0, 0, 10]    1 3 197 205    {1, 3, -59}        decimal numbers

Digits are hexadecimal unless that is impossible: a number of three digits is not a byte in hexadecimal, and a list in
brackets with commas is from a program, where hexadecimal has 0x. `1 3 10` could be either and raises DecodeError.
Removed characters become blanks, so that places in the text do not change.
"""

from __future__ import annotations

import re

from barewire_workbench.frames.result import text_error

_BEFORE = (
    re.compile(
        r"^\s*[A-Za-z_][\w \t*:&<>]{0,80}(?:\[[ \d]{0,9}\])?[ \t]{0,8}=(?!=)\s*"
    ),  # up to the = of a declaration
    re.compile(
        r"^\s*(?:new\s+)?(?:bytes|bytearray|byte|Uint8Array|vec)(?:\.fromhex)?(?:\[\s*\d*\s*\]|!)?(?=\s*[({\[])"
    ),
    re.compile(r"^\s*&(?=\[)"),
    re.compile(  # TX 01 03, Response: <01>
        r"^\s*(?:tx|rx|send|sent|recv|received|request|response|query|answer)[ \t]*[:=>]{0,2}[ \t]*(?=[0-9a-f<\[\\])",
        re.IGNORECASE,
    ),
    re.compile(r"^\s*b(?=(['\"])[0-9A-Fa-f\s]*\1[\s;)]*$)"),  # b'0103', the output of hexlify
)
_CLOSES = {"{": "}", "[": "]", "(": ")", "<": ">"}
_ONE_BY_ONE = re.compile(r"\s*(?:[<\[({]\s*(?:0[xX])?(?:[0-9A-Fa-f]{2}){1,8}[hH]?\s*[>\])}][\s,;]*)+")
_BUFFER = re.compile(r"\s*<Buffer\s((?:\s*[0-9a-f]{2})*)\s*>\s*")  # as Node.js prints bytes
_QUOTED = re.compile(r"\s*(b?)(['\"])(.*)\2[\s;]*", re.DOTALL)
_ESCAPE = re.compile(r"\\(?:x([0-9A-Fa-f]{2})|([0-7]{1,3})|([abefnrtv\\'\"]))|\\|[^\\]", re.DOTALL)
_LETTERS = {"a": 7, "b": 8, "e": 27, "f": 12, "n": 10, "r": 13, "t": 9, "v": 11, "\\": 92, "'": 39, '"': 34}
_NUMBER = re.compile(r"-?\d+")


def strip_syntax(text: str) -> tuple[str, bool]:
    """Return the text without the syntax around its bytes, and whether it is a list: in brackets, with commas.

    >>> strip_syntax("{0x01, 0x03};")
    (' 0x01, 0x03  ', True)
    >>> strip_syntax("[01][03]"), strip_syntax("[12] 01 03")[0]
    ((' 01  03 ', False), '[12] 01 03')
    """
    listed = False
    if (printed := _BUFFER.fullmatch(text)) is not None:
        return " " * printed.start(1) + printed[1], False
    if _ONE_BY_ONE.fullmatch(text):
        return re.sub(r"[<>\[\](){}]", " ", text), False
    for _ in range(4):  # bytes([...]) has three layers
        before = text
        for form in _BEFORE:
            text = form.sub(lambda found: " " * len(found[0]), text)
        start, end = len(text) - len(text.lstrip()), len(text.rstrip(" \t\r\n;,"))
        first, last = text[start : start + 1], text[end - 1 : end]
        inner = text[start + 1 : end - 1]
        is_pair = end - start > 1 and (_CLOSES.get(first) == last or first == last in ("'", '"'))
        # A pair that closes inside does not enclose all of the text: [12] 01 [03]
        if is_pair and last not in re.sub(r"\(.*\)|\[.*\]", "", inner):
            listed = listed or (first in "{[(" and "," in inner)
            text = text[:start] + " " + inner + " " * (len(text) - end + 1)
        if text == before or parse_string_literal(text) is not None:
            break
    return text, listed


def parse_string_literal(text: str) -> bytes | None:
    """Return the bytes of a string with escapes, or of b'...'; None for other text, such as digits in quotes.

    >>> parse_string_literal(r"b'\\x01\\x03\\n'"), parse_string_literal('"0103"'), parse_string_literal("b'0103'")
    (b'\\x01\\x03\\n', None, None)
    """
    found = _QUOTED.fullmatch(text)
    if found is None or re.search(r"\w['\"]\s", found[3]):
        return None
    prefix, body = found[1], found[3]
    if "\\" not in body and (not prefix or re.fullmatch(r"[0-9A-Fa-f\s]*", body)):
        return None  # hexadecimal digits, the output of hexlify
    data = bytearray()
    for piece in _ESCAPE.finditer(body):
        pair, octal, letter = piece.groups()
        index = found.start(3) + piece.start()
        if pair or octal:
            number = int(pair, 16) if pair else int(octal, 8)
        elif letter:
            number = _LETTERS[letter]
        elif piece[0] == "\\":
            raise text_error(
                "value",
                text,
                index,
                f"{body[piece.start() : piece.start() + 4]!r} at {index} is not an escape of a byte",
            )
        else:
            number = ord(piece[0])
        if number > 255:
            raise text_error("value", text, index, f"{piece[0]!r} at {index} is not a byte")
        data.append(number)
    return bytes(data)


def parse_decimal(text: str, listed: bool) -> bytes | None:
    """Return the bytes of decimal numbers, if the text cannot be hexadecimal; None if it is hexadecimal.

    >>> parse_decimal("1, 3, 0, 0, 0, 10, 197, 205", False).hex(" "), parse_decimal("01 03 10", False)
    ('01 03 00 00 00 0a c5 cd', None)
    """
    tokens = [(found.start(), found[0]) for found in re.finditer(r"[^\s,;]+", text)]
    numbers = [token for _, token in tokens]
    if len(numbers) < 2 or not all(_NUMBER.fullmatch(token) for token in numbers):
        return None
    if any(len(token) > 1 and token.lstrip("-")[0] == "0" for token in numbers):
        return None
    has_three, has_one = any(len(token) == 3 for token in numbers), any(len(token) == 1 for token in numbers)
    if any(token.startswith("-") for token in numbers) and not listed:
        return None
    if max(map(len, numbers)) > 4 or (not has_three and not has_one and not listed):
        return None  # 0103 0000: groups of digits; 10 20 30: two digits are hexadecimal
    shown = text.strip()[:40]
    if not (has_three or (listed and has_one) or max(map(len, numbers)) == 1):
        raise text_error(
            "value", text, tokens[0][0], f"{shown!r}: hexadecimal or decimal? write hexadecimal numbers with 0x"
        )
    for index, token in tokens:
        if not -128 <= int(token) <= 255:
            raise text_error("value", text, index, f"{token!r} at {index}: a byte is a number from 0 to 255")
    return bytes(int(token) & 0xFF for token in numbers)
