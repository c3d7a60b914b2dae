"""Hexadecimal, registers, bits and numbers as the vectors write them, both ways.

>>> octets("01 04"), hexed(b"\\x01\\x04"), words("022B 0000"), bits("101")
(b'\\x01\\x04', '01 04', (555, 0), (True, False, True))
"""

from __future__ import annotations

from collections.abc import Iterable


def octets(text: str) -> bytes:
    """Return the bytes of a text of hexadecimal digits."""
    return bytes.fromhex(text)


def hexed(data: bytes) -> str:
    """Return bytes as hexadecimal digits, a blank between two bytes."""
    return data.hex(" ").upper()


def words(text: str) -> tuple[int, ...]:
    """Return the registers of a text."""
    return tuple(int(word, 16) for word in text.split())


def worded(registers: Iterable[int]) -> str:
    """Return registers as four digits each."""
    return " ".join(f"{register:04X}" for register in registers)


def bits(text: str) -> tuple[bool, ...]:
    """Return a row of bits, the first one first."""
    return tuple(place == "1" for place in text.replace(" ", ""))


def bitted(row: Iterable[bool]) -> str:
    """Return bits as a text, in groups of eight."""
    text = "".join("1" if bit else "0" for bit in row)
    return " ".join(text[at : at + 8] for at in range(0, len(text), 8))


def number(text: str) -> int | float:
    """Return a number that is written as text."""
    try:
        return int(text)
    except ValueError:
        return float(text)


def latin(characters: str) -> bytes:
    """Return the bytes of a text of an ASCII line, one for each character."""
    return characters.encode("latin-1")
