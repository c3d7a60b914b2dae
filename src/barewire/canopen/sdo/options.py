"""How a client wants its block transfer."""

from __future__ import annotations

from typing import NamedTuple

from barewire.canopen.sdo.block_messages import BLOCK_MAX


class Block(NamedTuple):
    """What there is to choose about block transfers; `block=True` means this as it stands.

    `size` is how many segments of an upload we want in a row, 1 to 127; in a download the server decides.
    `crc` says that we can calculate one. `switch` is the protocol switch threshold of uploads: a value of at most so
    many bytes may come as an ordinary upload. `falls_back` goes on in segments with a server that has no blocks.
    """

    size: int = BLOCK_MAX
    crc: bool = True
    switch: int = 0
    falls_back: bool = True


def block_options(block: bool | Block) -> Block | None:
    """None for no block transfer.

    >>> block_options(True), block_options(False)
    (Block(size=127, crc=True, switch=0, falls_back=True), None)
    """
    if isinstance(block, Block):
        return block
    return Block() if block else None
