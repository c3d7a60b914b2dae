"""Bytes from pasted text: every usual notation of hexadecimal, source literals, and dumps.

    rtu, tcp   01 04 0F B1    01040fb1    0x01,0x04    01-04-0F-B1    01:04    \\x01\\x04    01h 04h
    ascii      :01040FB1000239          with or without \\r\\n, typed or real; or the characters' codes: 3A 30 31 ...

    a program  uint8_t ask[] = {0x01, 0x03};    bytes([1, 3])    bytes.fromhex("0103")    [01][03]    <01> <03>
               b'\\x01\\x03\\n'                   a string of bytes: escapes and plain characters
               [1, 3, 0, 0, 0, 10]    1 3 197 205    {1, 3, -59}        decimal numbers

    a dump     00000000: 0103 0000 000a c5cd  ........        xxd (not xxd -b)
               0000   01 03 00 00 00 0a c5 cd    ........     tshark -x, Wireshark
               0000000 01 03 00 00 00 0a c5 cd                od -t x1 (its offsets are octal)

Raises DecodeError with the character that cannot be read, and its place. For CAN frames see `recordings.candump`.
"""

from __future__ import annotations

import re
from typing import NamedTuple

from barewire.errors import DecodeError
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
    # From the strictest form to the loosest: the offsets of a dump, and decimal numbers, are hexadecimal digits too.
    dumped = parse_dump(text)
    if dumped is not None:
        return dumped
    text, listed = strip_syntax(text)
    literal = parse_string_literal(text)
    if literal is not None:
        return literal
    decimal = parse_decimal(text, listed)
    if decimal is not None:
        return decimal
    tokens = _TOKEN.findall(text)
    if sum(len(token) == 1 for token in tokens) > 1 and _BYTES_IN_HEX.fullmatch(" ".join(tokens)):
        return bytes(int(token, 16) for token in tokens)
    data = bytearray()
    for token in _TOKEN.finditer(text):
        data += parse_hex_token(text, token.start(), token.group())
    return bytes(data)


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
    for place, character in enumerate(digits, start=index):
        if character not in HEX_DIGITS:
            raise text_error("character", text, place, f"{character!r} at {place} is not a hexadecimal digit")
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
    quoted = re.fullmatch(r"\s*b?(['\"])(:.*)\1[\s;]*", typed, re.DOTALL)
    return typed if quoted is None else quoted[2]


# Literals of a program ----------------------------------------------------------------------------------------------


# What may stand before the bytes. The repetitions are bounded: with * a long text would take quadratic time.
_DECLARATION = re.compile(r"^\s*[A-Za-z_][\w \t*:&<>]{0,80}(?:\[[ \d]{0,9}\])?[ \t]{0,8}=(?!=)\s*")
_CONSTRUCTOR = re.compile(
    r"^\s*(?:new\s+)?(?:bytes|bytearray|byte|Uint8Array|vec)(?:\.fromhex)?(?:\[\s*\d*\s*\]|!)?(?=\s*[({\[])"
)
_REFERENCE = re.compile(r"^\s*&(?=\[)")  # &[0x01, 0x03] in Rust
_LABEL = re.compile(  # TX 01 03, Response: <01>
    r"^\s*(?:tx|rx|send|sent|recv|received|request|response|query|answer)[ \t]*[:=>]{0,2}[ \t]*(?=[0-9a-f<\[\\])",
    re.IGNORECASE,
)
_HEXLIFIED = re.compile(r"^\s*b(?=(['\"])[0-9A-Fa-f\s]*\1[\s;)]*$)")  # the b of b'0103', the output of hexlify
_BEFORE = (_DECLARATION, _CONSTRUCTOR, _REFERENCE, _LABEL, _HEXLIFIED)

_CLOSES = {"{": "}", "[": "]", "(": ")", "<": ">", "'": "'", '"': '"'}
_EACH_ENCLOSED = re.compile(r"\s*(?:[<\[({]\s*(?:0[xX])?(?:[0-9A-Fa-f]{2}){1,8}[hH]?\s*[>\])}][\s,;]*)+")
_BUFFER = re.compile(r"\s*<Buffer\s((?:\s*[0-9a-f]{2})*)\s*>\s*")  # as Node.js prints bytes
_QUOTED = re.compile(r"\s*(b?)(['\"])(.*)\2[\s;]*", re.DOTALL)
_ESCAPE = re.compile(r"\\(?:x([0-9A-Fa-f]{2})|([0-7]{1,3})|([abefnrtv\\'\"]))|\\|[^\\]", re.DOTALL)
_LETTERS = {"a": 7, "b": 8, "e": 27, "f": 12, "n": 10, "r": 13, "t": 9, "v": 11, "\\": 92, "'": 39, '"': 34}
_NUMBER = re.compile(r"-?\d+")


def strip_syntax(text: str) -> tuple[str, bool]:
    """Return the text without the syntax around its bytes, and whether it is a list: in brackets, with commas.

    Blanks replace the syntax, so that an error still names the place in the text as it was typed.

    >>> strip_syntax("{0x01, 0x03};")
    (' 0x01, 0x03  ', True)
    >>> strip_syntax("[01][03]"), strip_syntax("[12] 01 03")[0]
    ((' 01  03 ', False), '[12] 01 03')
    """
    listed = False
    if (printed := _BUFFER.fullmatch(text)) is not None:
        return " " * printed.start(1) + printed[1], False
    if _EACH_ENCLOSED.fullmatch(text):
        return re.sub(r"[<>\[\](){}]", " ", text), False
    for _ in range(4):  # bytes([...]) has three layers
        before = text
        for form in _BEFORE:
            text = form.sub(lambda match: " " * len(match[0]), text)
        start, end = len(text) - len(text.lstrip()), len(text.rstrip(" \t\r\n;,"))
        opening, closing = text[start : start + 1], text[end - 1 : end]
        inner = text[start + 1 : end - 1]
        is_pair = end - start > 1 and _CLOSES.get(opening) == closing
        # A pair that closes inside does not enclose all of the text: [12] 01 [03]
        if is_pair and closing not in re.sub(r"\(.*\)|\[.*\]", "", inner):
            listed = listed or (opening in "{[(" and "," in inner)
            text = text[:start] + " " + inner + " " * (len(text) - end + 1)
        if text == before or parse_string_literal(text) is not None:
            break
    return text, listed


def parse_string_literal(text: str) -> bytes | None:
    """Return the bytes of a string with escapes, or of b'...'; None for other text, such as digits in quotes.

    >>> parse_string_literal(r"b'\\x01\\x03\\n'"), parse_string_literal('"0103"'), parse_string_literal("b'0103'")
    (b'\\x01\\x03\\n', None, None)
    """
    quoted = _QUOTED.fullmatch(text)
    if quoted is None or re.search(r"\w['\"]\s", quoted[3]):
        return None
    prefix, body = quoted[1], quoted[3]
    if "\\" not in body and (not prefix or re.fullmatch(r"[0-9A-Fa-f\s]*", body)):
        return None  # hexadecimal digits, the output of hexlify
    data = bytearray()
    for piece in _ESCAPE.finditer(body):
        pair, octal, letter = piece.groups()
        index = quoted.start(3) + piece.start()
        if pair or octal:
            number = int(pair, 16) if pair else int(octal, 8)
        elif letter:
            number = _LETTERS[letter]
        elif piece[0] == "\\":
            shown = body[piece.start() : piece.start() + 4]
            raise text_error("value", text, index, f"{shown!r} at {index} is not an escape of a byte")
        else:
            number = ord(piece[0])
        if number > 255:
            raise text_error("value", text, index, f"{piece[0]!r} at {index} is not a byte")
        data.append(number)
    return bytes(data)


def _may_be_decimal(numbers: list[str], listed: bool) -> bool:
    if len(numbers) < 2 or not all(_NUMBER.fullmatch(token) for token in numbers):
        return False
    if any(len(token) > 1 and token.lstrip("-")[0] == "0" for token in numbers):
        return False  # 01 03: decimal numbers are not written with zeros in front
    if any(token.startswith("-") for token in numbers) and not listed:
        return False  # 01 -03: a dash between bytes
    if max(map(len, numbers)) > 4:
        return False  # 10300: groups of hexadecimal digits; a byte has at most four characters, -128
    return listed or any(len(token) in (1, 3) for token in numbers)  # 10 20 30: two digits are hexadecimal


def parse_decimal(text: str, listed: bool) -> bytes | None:
    """Return the bytes of decimal numbers, if the text cannot be hexadecimal; None if it is hexadecimal.

    >>> parse_decimal("1, 3, 0, 0, 0, 10, 197, 205", False).hex(" "), parse_decimal("01 03 10", False)
    ('01 03 00 00 00 0a c5 cd', None)
    """
    tokens = [(match.start(), match[0]) for match in re.finditer(r"[^\s,;]+", text)]
    numbers = [token for _, token in tokens]
    if not _may_be_decimal(numbers, listed):
        return None
    lengths = {len(token) for token in numbers}
    # Three digits are no hexadecimal byte; single ones mean the same in both; two, as in 1 3 10, leave it open.
    if not (3 in lengths or (listed and 1 in lengths) or lengths == {1}):
        shown = text.strip()[:40]
        message = f"{shown!r}: hexadecimal or decimal? write hexadecimal numbers with 0x"
        raise text_error("value", text, tokens[0][0], message)
    for index, token in tokens:
        if not -128 <= int(token) <= 255:
            raise text_error("value", text, index, f"{token!r} at {index}: a byte is a number from 0 to 255")
    return bytes(int(token) & 0xFF for token in numbers)


# Dumps --------------------------------------------------------------------------------------------------------------


_PAIRS = r"[0-9A-Fa-f]{2}(?: [0-9A-Fa-f]{2})*"
_GROUPS = r"(?:[0-9A-Fa-f]{2})+(?: (?:[0-9A-Fa-f]{2})+)*"
_XXD = re.compile(rf"\s*(?:0x)?([0-9A-Fa-f]{{4,8}}): {{1,3}}({_GROUPS})(?:\s*$|  )")
_COLUMNS = re.compile(rf"\s*([0-9A-Fa-f]{{4,8}})(?: {{2,4}}|\t)({_PAIRS}(?:  {_PAIRS})?)(?:\s*$| {{2,}})")
_OD = re.compile(rf"\s*([0-7]{{7}}) ({_PAIRS})\s*$")
_END = re.compile(r"\s*[0-9A-Fa-f]{6,8}\s*$")  # hexdump and od print the end offset in the last line
# The first line of hexdump and od without options: words, hexadecimal or octal.
_WORDS = re.compile(r"\s*0{7} (?:[0-9A-Fa-f]{4}(?: |\s*$)|[0-7]{6}(?: |\s*$))")
_LINE_MAX = 256
"""Bytes in one line; no program prints more."""


class DumpLine(NamedTuple):
    """One line: its offset, as od counts it (`octal`) if the digits allow that, and its bytes."""

    offset: int
    octal: int | None
    data: bytes


def dump_line(line: str) -> DumpLine | None:
    """Parse one line of a dump; None if it is not one.

    >>> dump_line("00000010: 0103 0002  ....")
    DumpLine(offset=16, octal=8, data=b'\\x01\\x03\\x00\\x02')
    >>> dump_line("0000 0000 0006 01 03 0000 0001")  # a frame with blanks between its fields
    """
    for form in (_XXD, _COLUMNS, _OD):
        if match := form.match(line):
            digits, data = match[1], bytes.fromhex(match[2])
            octal = int(digits, 8) if set(digits) <= set("01234567") else None
            return DumpLine(int(digits, 16), octal, data) if len(data) <= _LINE_MAX else None
    return None


def parse_dump(text: str) -> bytes | None:
    """Return the bytes of a dump; None if the text is not a dump.

    >>> parse_dump("00000000  01 03 00 00  |....|\\n00000004  00 0a c5 cd  |....|\\n00000008").hex(" ")
    '01 03 00 00 00 0a c5 cd'

    Raises DecodeError if a line of the dump is missing, and for words of two bytes, whose byte order is unknown.
    """
    lines = [(number, line) for number, line in enumerate(text.splitlines(), start=1) if line.strip()]
    if not lines:
        return None
    first_line = lines[0][1]
    if _WORDS.match(first_line):
        raise _wrong(text, 1, "hexdump and od without options print words with unknown byte order: use hexdump -C")
    first = dump_line(first_line)
    if first is None:
        return None
    # If line 1 may be something else, so may the whole text: a line that does not continue the dump is no error then.
    is_certain = _is_certain(first, first_line)
    if not is_certain and len(lines) == 1:
        return None
    data, in_octal = first.data, False
    for number, line in lines[1:]:
        parsed = dump_line(line)
        offset, octal = first.offset + len(data), (first.octal or 0) + len(data)
        if not is_certain and (parsed is None or parsed.offset != offset):
            return None
        if parsed is None:
            if _END.match(line) and number == lines[-1][0]:
                break
            raise _wrong(text, number, f"{line.strip()[:24]!r} is not a line of the dump that begins in line 1")
        # od counts in octal, which shows in the first line whose offset fits that way only: 0000020 is 16.
        if parsed.offset != offset and parsed.octal == octal:
            in_octal = True
        if in_octal and parsed.octal != octal:
            place = "" if parsed.octal is None else f" at octal {parsed.octal:o}"
            raise _wrong(text, number, f"the dump continues{place}, expected octal {octal:o}")
        if not in_octal and parsed.offset != offset:
            raise _wrong(text, number, f"the dump continues at {parsed.offset:X}h, expected {offset:X}h")
        data += parsed.data
    return data


def _is_certain(parsed: DumpLine, line: str) -> bool:
    """Return whether one line alone is certainly a dump: four digits and two blanks may be a transaction number."""
    if len(line.split()[0].rstrip(":").removeprefix("0x")) > 4:
        return True
    characters = "".join(chr(byte) if 0x20 <= byte < 0x7F else "." for byte in parsed.data)
    return parsed.offset == 0 or line.rstrip().endswith(characters)


def _wrong(text: str, number: int, message: str) -> DecodeError:
    return text_error("value", text, 0, f"line {number}: {message}")
