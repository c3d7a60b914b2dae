"""The frames of a block, all at once.   [CiA 301, SDO block]

        43 41 4E 6F 70 65 6E 33 32                        the bytes of the value

        01 | 43 41 4E 6F 70 65 6E                         number | seven of them
        82 | 33 32 00 00 00 00 00                         bit 7: the last one, filled up

Seen from above, every eighth byte is a number and the others are the value: seven slices, and no loop over segments.
"""

from __future__ import annotations

from struct import unpack

from barewire.canopen.sdo.messages.block import BLOCK_MAX, LAST
from barewire.canopen.sdo.messages.segment import SEGMENT

FRAME = 1 + SEGMENT
_NUMBERS = bytes(range(1, BLOCK_MAX + 1))


def segments(data: bytes, *, last: bool) -> list[bytes]:
    """The frames of a block, made all at once: the numbers and every seventh byte go where every eighth has room.

    >>> [frame.hex(" ") for frame in segments(b"CANopen32", last=True)]
    ['01 43 41 4e 6f 70 65 6e', '82 33 32 00 00 00 00 00']
    """
    count = max(1, -(-len(data) // SEGMENT))
    padded = data.ljust(count * SEGMENT, b"\0")
    block = bytearray(count * FRAME)
    block[::FRAME] = _NUMBERS[:count]
    for place in range(SEGMENT):
        block[place + 1 :: FRAME] = padded[place::SEGMENT]
    if last:
        block[-FRAME] |= LAST
    return list(unpack(f"{FRAME}s" * count, block))


def joined(block: list[bytes]) -> bytes:
    """The data of a block's frames: `segments` backwards, with what fills the last one up.

    >>> joined(segments(b"CANopen32", last=True))
    b'CANopen32\\x00\\x00\\x00\\x00\\x00'
    """
    whole = bytearray(b"".join(block))
    del whole[::FRAME]
    return bytes(whole)
