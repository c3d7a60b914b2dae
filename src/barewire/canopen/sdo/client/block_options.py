"""Options of a client's block transfers, and when `block="auto"` uses them."""

from __future__ import annotations

from typing import Literal, NamedTuple, TypeAlias

from barewire.canopen.sdo.client.channel import Channel
from barewire.canopen.sdo.messages import BLOCK_MAX
from barewire.errors import EncodeError

_WORTH_IT = 28
"""The longest value, in bytes, that takes no more frames in segments than in blocks."""


class BlockSettings(NamedTuple):
    """Options of a block transfer; `block=True` stands for the defaults.

    size         segments in a block of an upload, 1 to 127; in a download the server decides
    crc          offer a CRC
    switch       protocol switch threshold: the server may send values of at most this many bytes without blocks
    falls_back   continue in segments if the server has no block transfer
    """

    size: int = BLOCK_MAX
    crc: bool = True
    switch: int = 0
    falls_back: bool = True


BlockMode: TypeAlias = BlockSettings | bool | Literal["auto"]
"""True requests blocks, False does not. "auto" requests them for values longer than 28 bytes or of unknown length,
until the server has refused a block transfer."""


def block_options(mode: BlockMode, channel: Channel, length: int | None = None) -> BlockSettings | None:
    """Return the options of a block transfer, None for no block transfer. `length` is that of the value, if known.

    >>> channel = Channel(5)
    >>> block_options(True, channel), block_options(False, channel)
    (BlockSettings(size=127, crc=True, switch=0, falls_back=True), None)
    >>> block_options("auto", channel, 4), block_options("auto", channel)
    (None, BlockSettings(size=127, crc=True, switch=28, falls_back=True))
    """
    if isinstance(mode, BlockSettings):
        return mode
    if isinstance(mode, str) and mode != "auto":
        raise EncodeError(f"block = {mode!r}: expected True, False, 'auto' or BlockSettings")
    if mode != "auto":
        return BlockSettings() if mode else None
    small = length is not None and length <= _WORTH_IT
    if small or not channel.blocks or channel.dialect.read_commands:
        return None
    return BlockSettings(switch=_WORTH_IT)
