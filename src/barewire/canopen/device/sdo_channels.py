"""The SDO channels of one device, as its objects tell them.   [CiA 301, SDO parameter]

        1200h              the default server, which every device has       600h + node -> 580h + node
        1201h ... 127Fh    server 2 ... 128                                 01  COB-ID client -> server
        1280h ... 12FFh    client 1 ... 128                                 02  COB-ID server -> client
                                                                            03  node-ID of the other side
        COB-ID             31 | 30 | 29 | 28 ... 0
                           1: not in use   1: given for a while   1: 29 bits

A channel is in use while neither of its COB-IDs has bit 31. While one has not, its identifier stays as it is, and never
is it one that belongs to another service: both 0609 0030h. Which node the other side is stands there for people and
for SDO managers; a CAN frame does not say who sent it.

Every server has a transfer of its own, and all stand on the same dictionary. 1200h, where a dictionary lists it, shows
what the node-ID makes of it.
"""

from __future__ import annotations

from dataclasses import replace

from barewire.canopen.bus.node_monitor import NodeMonitor
from barewire.canopen.cob_ids import NODE_MAX, CobEntry, cob_id
from barewire.canopen.communication_objects import integer_value, replace_entry, validate_cob_id_writes, validate_writes
from barewire.canopen.frame import CanFrame
from barewire.canopen.object_dictionary import ObjectDictionary
from barewire.canopen.sdo.aborts import AbortCode, SdoAbort
from barewire.canopen.sdo.client.channel import Channel
from barewire.canopen.sdo.client.find_channel import SERVER_1, SERVERS_MAX
from barewire.canopen.sdo.dialect import STANDARD, SdoDialect
from barewire.canopen.sdo.server.server import SdoServer
from barewire.errors import EncodeError

CLIENT_1 = 0x1280
CLIENTS_MAX = 128
ASKED, ANSWERED, NODE = 1, 2, 3
"""The sub-indices."""

Pair = tuple[CobEntry, CobEntry]


def validate_channel_writes(objects: ObjectDictionary) -> None:
    """The rules for writing 1201h to 12FFh, wherever the dictionary has them."""
    for index in range(SERVER_1 + 1, CLIENT_1 + CLIENTS_MAX):
        for sub in (ASKED, ANSWERED):
            validate_cob_id_writes(objects, index, lambda entry: not entry.bit31, sub)

        def node(value: int, index: int = index) -> None:
            if value > NODE_MAX:
                raise SdoAbort(AbortCode.INVALID_VALUE, index, NODE)

        validate_writes(objects, index, NODE, node)


def _pair(objects: ObjectDictionary, index: int) -> Pair | None:
    """The two COB-IDs of a channel, None while it is not in use."""
    words = [integer_value(objects, index, sub, default=-1) for sub in (ASKED, ANSWERED)]
    if -1 in words:
        return None
    asked, answered = map(CobEntry.unpack, words)
    return None if asked.bit31 or answered.bit31 else (asked, answered)


def client_channel(
    objects: ObjectDictionary,
    client: int = 1,
    dialect: SdoDialect = STANDARD,
    *,
    node_monitor: NodeMonitor | None = None,
) -> Channel:
    """The channel of SDO client number `client` of a dictionary: for a device that asks others.

    >>> from barewire.canopen.object_dictionary import Entry
    >>> words = {1: 0x6A0, 2: 0x5A0 + 0x140, 3: 7}
    >>> objects = ObjectDictionary([Entry(0x1280, sub, "client", "u32", "rw", word) for sub, word in words.items()])
    >>> channel = client_channel(objects)
    >>> channel.node, f"{channel.request_id:X}h {channel.answer_id:X}h"
    (7, '6A0h 6E0h')

    EncodeError if there is no such client, or its channel is not in use.
    """
    if not 1 <= client <= CLIENTS_MAX:
        raise EncodeError(f"SDO client {client}: expected 1..{CLIENTS_MAX}")
    index = CLIENT_1 + client - 1
    pair = _pair(objects, index)
    if pair is None:
        raise EncodeError(f"SDO client {client} is not in use: {index:04X}h is missing or has bit 31 set")
    return Channel(integer_value(objects, index, NODE), dialect, cob_ids=pair, node_monitor=node_monitor)


class AdditionalServers:
    """The SDO servers beyond the first of one device. `follow` obeys the objects. A machine.

    `servers` are those in use now, by number: 2 to 128.

    >>> from barewire.canopen.object_dictionary import Entry
    >>> words = {1: 0x6A0, 2: 0x6A1}
    >>> objects = ObjectDictionary([Entry(0x1201, sub, "server 2", "u32", "rw", word) for sub, word in words.items()])
    >>> more = AdditionalServers(5, objects)
    >>> more.follow()
    >>> [str(frame) for frame in more.feed(CanFrame.parse("6A0#4001120100000000"), 0.0)]
    ['6A1#43011201A0060000']
    """

    __slots__ = ("_indices", "_keys", "_told", "dialect", "node", "objects", "servers")

    def __init__(self, node: int, objects: ObjectDictionary, dialect: SdoDialect = STANDARD) -> None:
        self.node = node
        self.objects = objects
        self.dialect = dialect
        self.servers: dict[int, SdoServer] = {}
        self._indices = [at for at in range(SERVER_1 + 1, SERVER_1 + SERVERS_MAX) if objects.subs(at)]
        self._told: list[Pair | None] = []
        self._keys: dict[tuple[int, bool], SdoServer] = {}
        self._show(ASKED, cob_id("SDO request", node))
        self._show(ANSWERED, cob_id("SDO answer", node))

    def _show(self, sub: int, word: int) -> None:
        if (SERVER_1, sub) in self.objects:
            entry = self.objects.entry(SERVER_1, sub)
            replace_entry(self.objects, replace(entry, access="ro", on_read=lambda: word))

    @property
    def deadline(self) -> float | None:
        """The first of the servers' deadlines."""
        return min((due for server in self.servers.values() if (due := server.deadline) is not None), default=None)

    def follow(self) -> None:
        """What the objects say now. A server whose channel is another one begins anew; the others go on."""
        if not self._indices:
            return
        told = [_pair(self.objects, index) for index in self._indices]
        if told == self._told:
            return
        before = dict(zip(self._indices, self._told))
        for index, pair in zip(self._indices, told):
            place = index - SERVER_1 + 1
            if pair is None:
                self.servers.pop(place, None)
            elif before.get(index) != pair:
                self.servers[place] = SdoServer(self.node, self.objects, self.dialect, cob_ids=pair)
        self._told = told
        self._keys = {(s.request_id, s.request_extended): s for s in reversed(self.servers.values())}

    def forget(self) -> None:
        """End all transfers without a word: the node may not speak any more."""
        for server in self.servers.values():
            server.forget()

    def reset(self) -> None:
        """A boot: no transfer, and the objects are read anew."""
        self.servers.clear()
        self._keys.clear()
        self._told = []

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        """What the servers say to a frame, and to time passing."""
        said: list[CanFrame] = []
        asked = None if frame is None else self._keys.get((frame.id, frame.extended))
        for server in self.servers.values():
            if server is asked or server.deadline is not None:
                said += server.feed(frame if server is asked else None, now)
        return said
