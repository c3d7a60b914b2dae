"""How a client wants its block transfer."""

from __future__ import annotations

from typing import Literal, NamedTuple, TypeAlias

from barewire.canopen.sdo.client.channel import Channel
from barewire.canopen.sdo.messages.block import BLOCK_MAX
from barewire.errors import EncodeError

WORTH_IT = 28
"""The longest value, in bytes, that needs no more frames in segments than in blocks."""


class BlockSettings(NamedTuple):
    """What there is to choose about block transfers; `block=True` means this as it stands.

    `size` is how many segments of an upload we want in a row, 1 to 127; in a download the server decides.
    `crc` says that we can calculate one. `switch` is the protocol switch threshold of uploads: a value of at most so
    many bytes may come as an ordinary upload. `falls_back` goes on in segments with a server that has no blocks.
    """

    size: int = BLOCK_MAX
    crc: bool = True
    switch: int = 0
    falls_back: bool = True


BlockMode: TypeAlias = BlockSettings | bool | Literal["auto"]
"""`True` asks for blocks, `False` does not; `"auto"` does for values that are longer than `WORTH_IT`, as far as that is
known, and no longer with a server that has said that it has none."""


def block_options(wish: BlockMode, channel: Channel, length: int | None = None) -> BlockSettings | None:
    """How to ask for blocks, None for not at all. `length` is that of the value, where it is known.

    >>> channel = Channel(5)
    >>> block_options(True, channel), block_options(False, channel)
    (BlockSettings(size=127, crc=True, switch=0, falls_back=True), None)
    >>> block_options("auto", channel, 4), block_options("auto", channel)
    (None, BlockSettings(size=127, crc=True, switch=28, falls_back=True))
    """
    if isinstance(wish, BlockSettings):
        return wish
    if isinstance(wish, str) and wish != "auto":
        raise EncodeError(f"block = {wish!r}: expected True, False, 'auto' or a Block")
    if wish != "auto":
        return BlockSettings() if wish else None
    small = length is not None and length <= WORTH_IT
    if small or not channel.blocks or channel.dialect.read_commands:
        return None
    return BlockSettings(switch=WORTH_IT)
