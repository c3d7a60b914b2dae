"""The bytes of a number in two or more registers, in each of the four orders."""

from __future__ import annotations

from barewire.codecs.order import ORDERS, Order
from barewire_workbench.steps.model import StepSection, StepTable, spaced_hex

_ORDER_TEXT: dict[Order, str] = {
    "ABCD": "high word first: big-endian, the usual reading",
    "CDAB": "low word first",
    "BADC": "high word first, bytes swapped",
    "DCBA": "all reversed: little-endian, as on CANopen",
}


def ordered(data: bytes, order: Order) -> bytes:
    """Return big-endian bytes in an order: words reversed for C and D in front, bytes swapped for B in front of A.

    >>> ordered(bytes.fromhex("0A0B0C0D"), "CDAB").hex(" ")
    '0c 0d 0a 0b'
    """
    if len(data) < 2:
        return data
    words = [data[place : place + 2] for place in range(0, len(data), 2)]
    if order in ("CDAB", "DCBA"):
        words = words[::-1]
    return b"".join(word[::-1] if order in ("BADC", "DCBA") else word for word in words)


def order_sections(data: bytes, order: Order) -> list[StepSection]:
    """Return the table of the four orders for big-endian bytes; the one that was asked for is marked."""
    if len(data) == 1:
        return [f"One byte, {spaced_hex(data)}, has no order; in a register it is one half."]
    letters = " ".join(f"{chr(ord('A') + place)} = {byte:02X}h" for place, byte in enumerate(data))
    count = len(data) // 2
    rows = []
    for each in ORDERS if count > 1 else ORDERS[:3:2]:
        sent = ordered(data, each)
        registers = [f"{sent[place]:02X}{sent[place + 1]:02X}h" for place in range(0, len(data), 2)]
        mark = "<--" if ordered(data, each) == ordered(data, order) and _same(each, order, count) else ""
        text = _ORDER_TEXT[each] if count > 1 else ("high byte first" if each == "ABCD" else "bytes swapped")
        rows.append((each if count > 1 else each[:2], spaced_hex(sent), *registers, text, mark))
    header = ("order", "on the wire", *[f"register n+{place}" if place else "register n" for place in range(count)])
    return [
        f"Order. The bytes, the most significant first, are {letters}. A register of Modbus holds two bytes and "
        "is sent "
        "high byte first; which register has which word is not standardised.",
        StepTable("", (*header, "meaning", ""), tuple(rows)),
    ]


def _same(one: Order, other: Order, count: int) -> bool:
    """Whether two orders are one: in a single register only the order of its two bytes is left."""
    swapped = ("BADC", "DCBA")
    return one == other if count > 1 else (one in swapped) == (other in swapped)
