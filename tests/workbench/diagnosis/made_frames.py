"""Valid Modbus messages, made from a seed: all public functions, in both directions; and frames around them."""

from __future__ import annotations

import random
from collections.abc import Iterator

from barewire import ascii as ascii_room, rtu, tcp
from barewire_workbench import FrameRole


def made_pdu(dice: random.Random) -> tuple[bytes, FrameRole]:
    """Return one valid PDU as devices send them, with its direction: most of them read or write registers."""

    def number(low: int = 0, high: int = 0xFFFF) -> bytes:
        return dice.choice((dice.randint(low, min(high, low + 9)), dice.randint(low, high))).to_bytes(2, "big")

    def data(count: int) -> bytes:
        return bytes(dice.choice((0, dice.randrange(256))) for _ in range(count))

    def registers(high: int) -> int:
        return dice.choice((1, 2, 2, 4, 10, dice.randint(1, high)))

    kind = dice.choice((*("read request", "read response") * 5, *("write request", "write response") * 3, *_REST))
    match kind:
        case "read request":
            code = dice.randint(1, 4)
            return bytes((code,)) + number() + number(1, 2000 if code < 3 else 125), "request"
        case "read response":
            code = dice.randint(1, 4)
            count = dice.randint(1, 250) if code < 3 and dice.random() < 0.1 else registers(125 if code > 2 else 9)
            count *= 2 if code > 2 else 1
            return bytes((code, count)) + data(count), "response"
        case "write request":
            code = dice.choice((5, 6, 15, 16))
            if code < 7:
                value = number() if code == 6 else dice.choice((b"\xff\0", b"\0\0"))
                return bytes((code,)) + number() + value, "request"
            count = registers(123)
            size = 2 * count if code == 16 else (count + 7) // 8
            content = data(size) if code == 16 else data(size - 1) + bytes((dice.randrange(1 << (count % 8 or 8)),))
            return bytes((code,)) + number() + bytes((0, count, size)) + content, "request"
        case "write response":
            return bytes((dice.choice((15, 16)),)) + number() + number(1, 123), "response"
        case "exception":
            return bytes((0x80 | dice.choice((1, 2, 3, 4, 5, 6, 15, 16)), dice.randint(1, 4))), "response"
        case "mask":
            return b"\x16" + number() + number() + number(), dice.choice(("request", "response"))
        case "read and write":
            count = registers(121)
            if dice.random() < 0.5:
                return bytes((0x17, 2 * count)) + data(2 * count), "response"
            return b"\x17" + number() + number(1, 125) + number() + bytes((0, count, 2 * count)) + data(
                2 * count
            ), "request"
        case "status":
            return dice.choice(((b"\x07", "request"), (b"\x07" + data(1), "response"), (b"\x11", "request")))
        case "diagnostics":
            return b"\x08\0\0" + data(2), dice.choice(("request", "response"))
        case "identification":
            return b"\x2b\x0e\x01\0", "request"
        case "identification response":
            text = dice.choice((b"barewire", b"TEM", b"Easy Rider"))
            return b"\x2b\x0e\x01\x01\0\0\x01\0" + bytes((len(text),)) + text, "response"
        case "fifo":
            if dice.random() < 0.5:
                return b"\x18" + number(), "request"
            count = dice.randint(0, 31)
            return b"\x18" + (2 * count + 2).to_bytes(2, "big") + count.to_bytes(2, "big") + data(2 * count), "response"
        case _:
            return b"\x14\x07\x06" + number(1) + number(0, 9999) + number(1, 20), "request"


_REST = (
    *("exception", "exception", "mask", "read and write", "status", "diagnostics"),
    *("identification", "identification response", "fifo", "file"),
)


def made_frames(framing: str, count: int, seed: int) -> Iterator[tuple[bytes, FrameRole]]:
    """Yield valid frames of one framing, "rtu", "ascii" or "tcp"."""
    dice = random.Random(seed)
    for _ in range(count):
        unit, (pdu, role) = dice.choice((1, 1, 2, 5, dice.randint(1, 247))), made_pdu(dice)
        match framing:
            case "rtu":
                yield rtu.encode(unit, pdu), role
            case "ascii":
                yield ascii_room.encode(unit, pdu), role
            case _:
                yield tcp.encode(unit, pdu, dice.randrange(0x10000)), role
