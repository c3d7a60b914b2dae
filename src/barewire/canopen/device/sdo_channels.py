"""The SDO channels of a device, as its objects configure them.   [CiA 301, SDO parameter]

        1200h              the default server of every device               600h + node -> 580h + node
        1201h ... 127Fh    server 2 ... 128                                 01  COB-ID client -> server
        1280h ... 12FFh    client 1 ... 128                                 02  COB-ID server -> client
                                                                            03  node-ID of the other side
        COB-ID             31 | 30 | 29 | 28 ... 0
                           1: not in use   1: temporary   1: 29 bits

A channel is in use if both of its COB-IDs have bit 31 = 0. While a COB-ID has bit 31 = 0, its identifier cannot be
changed, and it can never be a restricted one: both are refused with 0609 0030h. The node-ID of the other side is
information only, because a CAN frame does not contain its sender.

Each server has its own transfer; all use the same dictionary. 1200h, if the dictionary has it, shows the identifiers
that follow from the node-ID.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from barewire.canopen.abort_codes import AbortCode, SdoAbort
from barewire.canopen.cob_ids import NODE_MAX, CobEntry, default_sdo_channel
from barewire.canopen.communication_objects import integer_value, replace_entry, validate_cob_id_writes, validate_writes
from barewire.canopen.frame import CanFrame
from barewire.canopen.nmt.node_monitor import NodeMonitor
from barewire.canopen.object_dictionary import ObjectDictionary
from barewire.canopen.sdo.channel import SERVER_1, SERVERS_MAX, Channel
from barewire.canopen.sdo.dialect import STANDARD, SdoDialect
from barewire.canopen.sdo.server import SdoServer
from barewire.errors import EncodeError

_CLIENT_1 = 0x1280
_CLIENTS_MAX = 128
_REQUEST, _RESPONSE, _NODE = 1, 2, 3
"""Sub-indices."""

_CobIds = tuple[CobEntry, CobEntry]


def validate_channel_writes(objects: ObjectDictionary) -> None:
    """Validate writes to the objects 1201h to 12FFh that the dictionary has."""
    for index in range(SERVER_1 + 1, _CLIENT_1 + _CLIENTS_MAX):
        for sub in (_REQUEST, _RESPONSE):
            validate_cob_id_writes(objects, index, lambda entry: not entry.bit31, sub)

        def node(value: int, index: int = index) -> None:
            if value > NODE_MAX:
                raise SdoAbort(AbortCode.INVALID_VALUE, index, _NODE)

        validate_writes(objects, index, _NODE, node)


def _cob_ids(objects: ObjectDictionary, index: int) -> _CobIds | None:
    """Return the two COB-IDs of a channel, None while it is not in use."""
    words = [integer_value(objects, index, sub, default=-1) for sub in (_REQUEST, _RESPONSE)]
    if -1 in words:
        return None
    request, response = map(CobEntry.unpack, words)
    return None if request.bit31 or response.bit31 else (request, response)


def client_channel(
    objects: ObjectDictionary,
    client: int = 1,
    dialect: SdoDialect = STANDARD,
    *,
    node_monitor: NodeMonitor | None = None,
) -> Channel:
    """Return the channel of SDO client number `client` of a dictionary, for a device that is an SDO client itself.

    >>> from barewire.canopen.object_dictionary import Entry
    >>> words = {1: 0x6A0, 2: 0x5A0 + 0x140, 3: 7}
    >>> objects = ObjectDictionary([Entry(0x1280, sub, "client", "u32", "rw", word) for sub, word in words.items()])
    >>> channel = client_channel(objects)
    >>> channel.node, f"{channel.request_id:X}h {channel.response_id:X}h"
    (7, '6A0h 6E0h')

    Raise EncodeError if there is no such client, or its channel is not in use.
    """
    if not 1 <= client <= _CLIENTS_MAX:
        raise EncodeError(f"SDO client {client}: expected 1..{_CLIENTS_MAX}")
    index = _CLIENT_1 + client - 1
    cob_ids = _cob_ids(objects, index)
    if cob_ids is None:
        raise EncodeError(f"SDO client {client} is not in use: {index:04X}h is missing or has bit 31 set")
    return Channel(integer_value(objects, index, _NODE), dialect, cob_ids=cob_ids, node_monitor=node_monitor)


class AdditionalServers:
    """The SDO servers of a device beyond the first. `follow` reads the objects. A machine.

    `servers` are the servers in use, by number: 2 to 128.

    >>> from barewire.canopen.object_dictionary import Entry
    >>> words = {1: 0x6A0, 2: 0x6A1}
    >>> objects = ObjectDictionary([Entry(0x1201, sub, "server 2", "u32", "rw", word) for sub, word in words.items()])
    >>> more = AdditionalServers(5, objects)
    >>> more.follow()
    >>> [str(frame) for frame in more.feed(CanFrame.parse("6A0#4001120100000000"), 0.0)]
    ['6A1#43011201A0060000']
    """

    __slots__ = ("_in_use", "_indices", "_keys", "_on_failure", "dialect", "node", "objects", "servers")

    def __init__(
        self,
        node: int,
        objects: ObjectDictionary,
        dialect: SdoDialect = STANDARD,
        *,
        on_failure: Callable[[str, Exception], None] | None = None,
    ) -> None:
        self.node = node
        self._on_failure = on_failure
        self.objects = objects
        self.dialect = dialect
        self.servers: dict[int, SdoServer] = {}
        self._indices = [index for index in range(SERVER_1 + 1, SERVER_1 + SERVERS_MAX) if objects.subs(index)]
        self._in_use: list[_CobIds | None] = []
        self._keys: dict[tuple[int, bool], SdoServer] = {}
        for sub, entry in zip((_REQUEST, _RESPONSE), default_sdo_channel(node)):
            self._show(sub, entry.pack())

    def _show(self, sub: int, word: int) -> None:
        if (SERVER_1, sub) in self.objects:
            entry = self.objects.entry(SERVER_1, sub)
            replace_entry(self.objects, replace(entry, access="ro", on_read=lambda: word))

    @property
    def deadline(self) -> float | None:
        """The earliest deadline of the servers."""
        return min((due for server in self.servers.values() if (due := server.deadline) is not None), default=None)

    @property
    def receives(self) -> frozenset[tuple[int, bool]]:
        """The (identifier, extended) of the requests to the servers."""
        return frozenset(self._keys)

    def follow(self) -> None:
        """Read the present values of the objects. A server is replaced only if its channel has changed."""
        if not self._indices:
            return
        channels = [_cob_ids(self.objects, index) for index in self._indices]
        if channels == self._in_use:
            return
        before = dict(zip(self._indices, self._in_use))
        for index, cob_ids in zip(self._indices, channels):
            number = index - SERVER_1 + 1
            if cob_ids is None:
                self.servers.pop(number, None)
            elif before.get(index) != cob_ids:
                self.servers[number] = SdoServer(
                    self.node, self.objects, self.dialect, cob_ids=cob_ids, on_failure=self._on_failure
                )
        self._in_use = channels
        self._keys = {
            (server.request_id, server.request_extended): server for server in reversed(self.servers.values())
        }

    def forget(self) -> None:
        """End all transfers without an abort, because the NMT state does not allow SDO any more."""
        for server in self.servers.values():
            server.forget()

    def reset(self) -> None:
        """End all transfers at a boot; the objects are then read again."""
        self.servers.clear()
        self._keys.clear()
        self._in_use = []

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        """Return the responses of the servers to a frame, or to time passing."""
        frames: list[CanFrame] = []
        addressed = None if frame is None else self._keys.get((frame.id, frame.extended))
        for server in self.servers.values():
            if server is addressed or server.deadline is not None:
                frames += server.feed(frame if server is addressed else None, now)
        return frames
