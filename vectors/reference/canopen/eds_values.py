"""The values of an EDS: numbers, formulas, floating point, bytes; and whether they are written as they should be."""

import re

from texts import hexed
from values import number_text

INTEGERS = {2: 8, 3: 16, 4: 32, 0x10: 24, 0x12: 40, 0x13: 48, 0x14: 56, 0x15: 64}
UNSIGNED = {5: 8, 6: 16, 7: 32, 0x16: 24, 0x18: 40, 0x19: 48, 0x1A: 56, 0x1B: 64}
TYPES = {1: "BOOLEAN", 8: "REAL32", 0x11: "REAL64", 9: "VISIBLE_STRING", 0x0A: "OCTET_STRING", 0x0F: "DOMAIN"}
TYPES |= {0x0B: "UNICODE_STRING", 0x0C: "TIME_OF_DAY", 0x0D: "TIME_DIFFERENCE"}
TYPES |= {code: f"INTEGER{bits}" for code, bits in INTEGERS.items()}
TYPES |= {code: f"UNSIGNED{bits}" for code, bits in UNSIGNED.items()}


def whole(text):
    """Return a whole number and whether it is written as CiA 306 demands; None if it is none."""
    if re.fullmatch(r"0[xX][0-9A-Fa-f]+", text):
        return int(text, 16), True
    if re.fullmatch(r"0[0-7]+", text):
        return int(text, 8), True
    if re.fullmatch(r"-?[0-9]+", text):
        return int(text), not re.match(r"-?0[0-9]", text)  # 08: meant as decimal
    return None, False


def formula(text):
    """Return $NODEID+number, and whether it is written as CiA 306 demands."""
    parts = [part.strip() for part in text.upper().split("+")]
    if parts.count("$NODEID") != 1 or len(parts) > 2:
        return None, False
    value, right = whole(parts[parts[0] == "$NODEID"]) if len(parts) == 2 else (0, True)
    if value is None or value < 0:
        return None, False
    return f"$NODEID+{value}", right and text.startswith("$NODEID")


def integer(code, text):
    """Return a number of a type. An INTEGER may be its pattern of bits in hexadecimal."""
    value, right = whole(text)
    if value is None:
        return None, False
    bits = 1 if code == 1 else INTEGERS.get(code) or UNSIGNED[code]
    if code in INTEGERS and text[:2] in ("0x", "0X") and value < 1 << bits:
        value -= value >> bits - 1 << bits
    lowest = -(1 << bits - 1) if code in INTEGERS else 0
    return (str(value), right) if lowest <= value < lowest + (1 << bits) else (None, False)


def real(code, text):
    """Return a number of floating point: decimal, or its bits in hexadecimal."""
    size = 4 if code == 8 else 8
    value, _ = whole(text)
    if value is not None and text[:2] in ("0x", "0X"):
        return number_text(f"f{8 * size}", value.to_bytes(size, "big")), True
    try:
        return repr(float(text.replace(",", "."))), "," not in text
    except ValueError:
        return None, False


def read(code, text):
    """Return a value as the vectors write it, None without one, and whether the file has it as it should be."""
    if not text or code not in TYPES:
        return None, True
    if "$" in text and code in UNSIGNED:
        return formula(text)
    if code == 1 or code in INTEGERS or code in UNSIGNED:
        return integer(code, text)
    if code in (8, 0x11):
        return real(code, text)
    if code in (0x0A, 0x0F):
        try:
            return hexed(bytes.fromhex(text)), " " not in text
        except ValueError:
            return None, False
    return text, True
