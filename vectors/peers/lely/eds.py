"""Parts of an EDS: what the reader of Lely makes of them.

It reads the objects that the lists of a file name, so the lists are made of the sections. What it does not keep is left
out: a limit that is the end of the type, and whether there is a default value at all.
"""

from __future__ import annotations

import ctypes
import re
import struct
from typing import Any

from adapter import Refused, hexed
from bus import LELY, TYPES

ACCESS = {0x05: "ro", 0x0A: "wo", 0x0F: "rw", 0x07: "rwr", 0x0B: "rww", 0x15: "const"}
DEFAULT_NODE, VALUE_NODE, VALUE = 0x40, 0x80, 0x100
UNCONFIGURED = 0xFF
"""The node-ID that it adds to a formula in a file that has none."""
POINTERS = "co_dev_create_from_dcf_text co_dev_find_obj co_obj_find_sub co_sub_get_name"
for which in ("def", "min", "max", "val"):
    POINTERS += f" co_sub_addressof_{which}"
    getattr(LELY, f"co_sub_sizeof_{which}").restype = ctypes.c_size_t
for name in POINTERS.split():
    getattr(LELY, name).restype = ctypes.c_void_p
LELY.co_sub_get_flags.restype = ctypes.c_uint


def read(question: dict[str, Any]) -> dict[str, Any]:
    """Return the objects of some lines."""
    lines = question["lines"]
    found = [re.fullmatch(r"\s*\[([0-9A-F]{4})(sub[0-9A-F]+)?\]\s*", line, re.IGNORECASE) for line in lines]
    indices = sorted({int(match[1], 16) for match in found if match})
    names = [f"{at}=0x{index:04X}" for at, index in enumerate(indices, 1)]
    head = ["[DeviceInfo]", "[MandatoryObjects]", f"SupportedObjects={len(names)}"]
    text = "\n".join([*head, *names, *lines, ""]).encode("latin-1")
    buffer = ctypes.create_string_buffer(text)
    begin = ctypes.addressof(buffer)
    device = LELY.co_dev_create_from_dcf_text(ctypes.c_void_p(begin), ctypes.c_void_p(begin + len(text)), None)
    if not device:
        raise Refused("no device")
    has_default = any(line.lower().startswith("defaultvalue") for line in lines)
    return {"objects": [row for index in indices for row in subs(ctypes.c_void_p(device), index, has_default)]}


def subs(device: Any, index: int, has_default: bool) -> list[dict[str, Any]]:
    entry = ctypes.c_void_p(LELY.co_dev_find_obj(device, index))
    if not entry.value:
        return []
    numbers = (ctypes.c_uint8 * 255)()
    count = LELY.co_obj_get_subidx(entry, 255, numbers)
    return [described(entry, index, sub, has_default) for sub in numbers[:count]]


def described(entry: Any, index: int, number: int, has_default: bool) -> dict[str, Any]:
    sub = ctypes.c_void_p(LELY.co_obj_find_sub(entry, number))
    kind, flags = LELY.co_sub_get_type(sub), LELY.co_sub_get_flags(sub)
    name = LELY.co_sub_get_name(sub)
    row: dict[str, Any] = {"object": f"{index:04X}:{number:02X}", "type": TYPES[kind - 1]}
    row["name"] = ctypes.string_at(name).decode("latin-1") if name else ""
    row |= {"access": ACCESS.get(LELY.co_sub_get_access(sub)), "mapped": bool(LELY.co_sub_get_pdo_mapping(sub))}
    if has_default:
        row["default"] = value(sub, "def", row["type"], bool(flags & DEFAULT_NODE))
    if flags & VALUE:
        row["value"] = value(sub, "val", row["type"], bool(flags & VALUE_NODE))
    for key, which in (("low", "min"), ("high", "max")):
        limit = value(sub, which, row["type"], False)
        if limit not in ends(row["type"]):
            row[key] = limit
    return row


def ends(kind: str) -> set[str]:
    """Return the least and the greatest number of a type."""
    if not kind.startswith(("UNSIGNED", "INTEGER")):
        return {"0", "1"} if kind == "BOOLEAN" else set()
    bits = int(kind.lstrip("UNSIGEDTR"))
    low, high = (0, 2**bits - 1) if kind.startswith("U") else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    return {str(low), str(high)}


def value(sub: Any, which: str, kind: str, formula: bool) -> str | None:
    size = getattr(LELY, f"co_sub_sizeof_{which}")(sub)
    address = getattr(LELY, f"co_sub_addressof_{which}")(sub)
    data = ctypes.string_at(address, size) if address and size else b""
    if kind == "VISIBLE_STRING":
        return data.decode("latin-1")
    if kind in ("OCTET_STRING", "DOMAIN", "UNICODE_STRING") or kind.startswith("TIME"):
        return data.decode("utf-16-le") if kind == "UNICODE_STRING" else hexed(data)
    if kind.startswith("REAL"):
        return str(struct.unpack("<f" if kind == "REAL32" else "<d", data)[0])
    number = int.from_bytes(data, "little", signed=kind.startswith("INTEGER"))
    return f"$NODEID+{number - UNCONFIGURED}" if formula else str(number)


ANSWERS = {"eds": {"read": read}}
