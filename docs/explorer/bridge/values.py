"""Registers as numbers: every type in every order, and where the bytes of a value lie.

registers  3F8C CCCD        f32 ABCD 1.1    CDAB -107609184    BADC ...    DCBA ...
"""

from __future__ import annotations

import math
from typing import Any

from barewire.codecs import ORDERS, codec, to_registers
from barewire.errors import EncodeError
from barewire_workbench.frames.input import parse_hex

TYPES = ("u16", "i16", "u32", "i32", "f32", "u64", "i64", "f64")
_MOST = 125
"""The most registers: those of one read."""


def values(text: str, start: int = 0) -> dict[str, Any]:
    """Return the registers, and what those from number `start` on are in each type and order."""
    registers = _registers(text)
    if not 0 <= start < len(registers):
        raise EncodeError(f"register {start}: there are {len(registers)}, counted from 0")
    data = b"".join(register.to_bytes(2, "big") for register in registers[start:])
    rows = []
    for name in TYPES:
        size = codec(name).size
        whole = data[:size] if len(data) >= size else None
        cells = [None if whole is None else _shown(codec(name, order).decode(whole)) for order in ORDERS]
        rows.append({"type": name, "registers": size // 2, "values": cells})
    return {
        "registers": [
            {"hex": f"{register:04X}", "u16": register, "i16": codec("i16").decode(register.to_bytes(2, "big")),
             "bits": f"{register:016b}", "text": _letters(register)}
            for register in registers
        ],
        "orders": list(ORDERS),
        "rows": rows,
    }  # fmt: skip


def placed(type: str, value: str) -> dict[str, Any]:  # the word of the page
    """Return the registers of a value in each order."""
    number: int | float
    try:
        number = int(value, 0)
    except ValueError:
        try:
            number = float(value.replace(",", "."))
        except ValueError:
            raise EncodeError(f"{value!r} is not a number") from None
    if type not in TYPES:
        raise EncodeError(f"type {type!r}: expected one of {', '.join(TYPES)}")
    made = {order: codec(type, order).encode(number) for order in ORDERS}
    exact = codec(type).decode(made["ABCD"])
    return {
        "stored": _shown(exact),
        "exact": math.isfinite(exact) and exact == number,
        "rows": [{"order": order, "registers": _words(data)} for order, data in made.items()],
    }


def _words(data: bytes) -> list[str]:
    return [f"{register:04X}" for register in to_registers(data)]


def _registers(text: str) -> list[int]:
    """Return registers: four hexadecimal digits each, or the bytes of any notation, two to a register."""
    if not text.strip():
        raise EncodeError("no registers: type them in hexadecimal, such as 3F8C CCCD")
    data = parse_hex(text)
    if len(data) % 2:
        raise EncodeError(f"{len(data)} bytes are not whole registers of two bytes")
    registers = list(to_registers(data))
    if len(registers) > _MOST:
        raise EncodeError(f"{len(registers)} registers: at most {_MOST} fit into one read")
    return registers


def _shown(value: int | float) -> str:
    """Return a number as text: JavaScript has no integers of 64 bits, and JSON no infinity."""
    return repr(value) if isinstance(value, float) else str(value)


def _letters(register: int) -> str:
    return "".join(chr(byte) if 0x20 <= byte < 0x7F else "·" for byte in divmod(register, 256))
