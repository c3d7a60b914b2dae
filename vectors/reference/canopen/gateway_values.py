"""The values in a line of gateway-309-3: numbers, texts in quotation marks, bytes in base 64."""

from base64 import b64decode, b64encode

from sdo_blocks import Abort
from texts import Refused
from values import number_bytes, number_text

SYNTAX = 101
LENGTH = 0x06070010
NUMBERS = {"b": "bool", "r32": "f32", "r64": "f64"}
NUMBERS |= {f"{sign}{bits}": f"{sign}{bits}" for sign in "ui" for bits in range(8, 65, 8)}
TYPES = (*NUMBERS, "vs", "os", "d")


class Wrong(Exception):
    """An error of the gateway."""


def integer(text, most):
    """Return a decimal or hexadecimal number of the line."""
    try:
        value = int(text, 0)
    except ValueError:
        raise Wrong(SYNTAX) from None
    if not 0 <= value <= most:
        raise Wrong(SYNTAX)
    return value


def text_of(kind, data):
    """Return a value as the gateway writes it."""
    if kind == "vs":
        return f'"{data.decode("latin-1")}"'
    if kind not in NUMBERS:
        return b64encode(data).decode()
    name = NUMBERS[kind]
    if len(data) != (1 if name == "bool" else int(name[1:]) // 8):
        raise Abort(LENGTH)
    return str(data[0]) if name == "bool" else number_text(name, data[::-1])


def bytes_of(kind, text):
    """Return the bytes of a value in the line."""
    if kind == "vs":
        return text.strip('"').encode("latin-1")
    if kind not in NUMBERS:
        return b64decode(text)
    try:
        if kind == "b":
            return bytes([int(text)])
        return number_bytes(NUMBERS[kind], text if kind[0] == "r" else str(int(text, 0)))[::-1]
    except (ValueError, Refused):
        raise Wrong(SYNTAX) from None
