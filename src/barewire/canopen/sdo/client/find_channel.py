"""The further SDO channels of a device: identifiers of its servers 2 to 128.   [CiA 301, SDO server parameter]

        1200h          the default server: 600h + node, 580h + node
        1201h ... 127Fh, server 2 ... 128:      01  COB-ID client -> server     02  COB-ID server -> client

If bit 31 of either COB-ID is set, the channel is not in use.
"""

from __future__ import annotations

from barewire.canopen.cob_ids import CobEntry
from barewire.canopen.frame import CanFrame
from barewire.canopen.sdo.client.channel import Channel
from barewire.canopen.sdo.client.upload import upload
from barewire.conversation import DEFAULT_TIMEOUT, Conversation
from barewire.errors import EncodeError

SERVER_1 = 0x1200
SERVERS_MAX = 128


def find_channel(default: Channel, server: int, *, timeout: float = DEFAULT_TIMEOUT) -> Conversation[CanFrame, Channel]:
    """Return the channel to server number `server` of a device, read over its default channel, which is number 1.

    Raise SdoAbort if there is no such server, and EncodeError if its channel is not in use.
    """
    if not 1 <= server <= SERVERS_MAX:
        raise EncodeError(f"SDO server {server}: expected 1..{SERVERS_MAX}")
    return _find(default, server, timeout)


def _find(default: Channel, server: int, timeout: float) -> Conversation[CanFrame, Channel]:
    if server == 1:
        return default
    index = SERVER_1 + server - 1
    cob_ids = []
    for sub in (1, 2):
        word = yield from upload(default, index, sub, timeout=timeout, size=4)
        cob_ids.append(CobEntry.unpack(int.from_bytes(word[:4], "little")))
    if any(entry.bit31 for entry in cob_ids):
        raise EncodeError(f"SDO server {server} of node {default.node} is not in use: {index:04X}h has bit 31 set")
    channel = Channel(
        default.node,
        default.dialect,
        cob_ids=(cob_ids[0], cob_ids[1]),
        node_monitor=default.node_monitor,
        own_frames=default.own_frames,
    )
    channel.timeout = default.timeout
    return channel
