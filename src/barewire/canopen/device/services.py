"""The services of a device, as the communication objects in its dictionary configure them.   [CiA 301]

        1005h  SYNC: bit 30: this device produces it         1007h  window in us: a synchronous RPDO that arrives
        1006h  period in us                                         later than that after a SYNC is not used
        1019h  0: no counter, else its greatest value

        1017h  producer heartbeat time      > 0: the device sends heartbeats and is not guarded
        100Ch  guard time                   x 100Dh: the life time within which the master must send a request
        1016h  consumer heartbeat time      00 | node | time in ms, one entry for each monitored node
        1029h  error behaviour              of an operational device: 0 pre-operational, 1 no change, 2 stopped

        1012h     COB-ID TIME   31 | 30 | 29 | 28 ... 0     31: consumes TIME  30: produces it     29: 29 bits
        1028h:n   COB-ID of the emergencies of node n; 31: not consumed

        1200h              the default SDO server of every device           600h + node -> 580h + node
        1201h ... 127Fh    server 2 ... 128                                 01  COB-ID client -> server
        1280h ... 12FFh    client 1 ... 128                                 02  COB-ID server -> client
                                                                            03  node-ID of the other side
        COB-ID             31 | 30 | 29 | 28 ... 0
                           1: not in use   1: temporary   1: 29 bits

While a service is in use, its identifier cannot be changed, and an SDO channel can never have a restricted one: both
are refused with 0609 0030h. An SDO channel is in use if both of its COB-IDs have bit 31 = 0. The node-ID of the other
side is information only, because a CAN frame does not contain its sender.

A device may be made with a restricted identifier: one that its description leaves out is 0, that of NMT. Then SYNC,
TIME and EMCY have their default ones, and an SDO channel, an entry of 1028h and a PDO are not in use.

        a SYNC of the wrong length (with or without counter, by 1019h)   ->  emergency 8240h, and the SYNC is ignored
        a monitored node is lost or boots, or the master sends no request in time   ->  emergency 8130h, then 1029h
        its heartbeat, or a request, arrives again                                  ->  emergency 0000h

Each class has `follow`, which reads the present values of the objects. It is called after a write to any object.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

from barewire.canopen.abort_codes import AbortCode, SdoAbort
from barewire.canopen.cob_ids import NODE_MAX, SYNC_KEY, TIME_KEY, CobEntry, cob_id, default_sdo_channel
from barewire.canopen.communication_objects import (
    integer_value,
    replace_entry,
    service_cob_id,
    validate_cob_id_writes,
    validate_writes,
)
from barewire.canopen.emcy import EmcyConsumer
from barewire.canopen.frame import CanFrame
from barewire.canopen.nmt.error_control import GuardedNode, HeartbeatConsumer, HeartbeatProducer
from barewire.canopen.nmt.messages import NmtState, consumer_entry
from barewire.canopen.nmt.node_monitor import NodeMonitor
from barewire.canopen.object_dictionary import ObjectDictionary
from barewire.canopen.sdo.channel import NOT_IN_USE, SERVER_1, SERVERS_MAX, Channel
from barewire.canopen.sdo.dialect import STANDARD, SdoDialect
from barewire.canopen.sdo.server import SdoServer
from barewire.canopen.sync import COUNTER_MAX, SyncProducer
from barewire.canopen.time_stamp import TimeConsumer, TimeStamp
from barewire.errors import EncodeError

# SYNC -----------------------------------------------------------------------------------------------------------------

_COB_ID, _PERIOD, _WINDOW, _OVERFLOW = 0x1005, 0x1006, 0x1007, 0x1019
WRONG_LENGTH = 0x8240


def validate_sync_writes(objects: ObjectDictionary) -> None:
    """Validate writes: 1019h can be changed only while the period is 0, to 0 or 2..240."""

    def overflow(value: int) -> None:
        if integer_value(objects, _PERIOD):
            raise SdoAbort(AbortCode.DEVICE_STATE, _OVERFLOW, 0)
        if value == 1 or value > COUNTER_MAX:
            raise SdoAbort(AbortCode.INVALID_VALUE, _OVERFLOW, 0)

    validate_writes(objects, _OVERFLOW, 0, overflow)
    validate_cob_id_writes(objects, _COB_ID, lambda entry: entry.bit30, always_received=True)


class DeviceSync:
    """The SYNC of a device, produced or consumed. `follow` reads the objects."""

    __slots__ = ("_length", "_values", "key", "objects", "producer", "window")

    def __init__(self, objects: ObjectDictionary) -> None:
        self.objects = objects
        self.key = SYNC_KEY
        self.window = 0.0
        self.producer: SyncProducer | None = None
        self._length: int | None = None  # of a received SYNC: 1 with a counter, 0 without; None: either, without 1019h
        self._values: tuple[int, int, int, int] | None = None

    @property
    def deadline(self) -> float | None:
        """When this device sends the next SYNC."""
        return None if self.producer is None else self.producer.deadline

    def stop(self) -> None:
        """Stop at a boot or in STOPPED. When SYNC is allowed again, the counter starts with 1."""
        self.producer = None
        self._values = None

    def follow(self, now: float) -> None:
        """Read the present values of the objects."""
        objects = self.objects
        values = (
            integer_value(objects, _COB_ID, default=SYNC_KEY[0]),
            integer_value(objects, _PERIOD),
            integer_value(objects, _WINDOW),
            integer_value(objects, _OVERFLOW, default=-1),
        )
        if values == self._values:
            return  # another object was written: the producer must not start again
        before, self._values = self._values, values
        word, period, window, overflow = values
        entry = service_cob_id(objects, _COB_ID, SYNC_KEY[0])
        self.key = (entry.identifier, entry.extended)
        self.window = window / 1_000_000
        self._length = None if overflow < 0 else int(overflow > 0)
        if before is not None and (before[0], before[1], before[3]) == (word, period, overflow):
            return  # a new window does not restart the producer
        self.producer = None
        if entry.bit30 and period:
            # Writes of other values are refused, but the application itself may set one.
            counter_max = overflow if 1 < overflow <= COUNTER_MAX else 0
            self.producer = SyncProducer(period / 1_000_000, overflow=counter_max, key=self.key)
            self.producer.start(now)

    def is_sync(self, frame: CanFrame) -> bool:
        """Return whether a received frame is a SYNC, of any length."""
        return frame.key == self.key and not frame.remote

    def has_wrong_length(self, sync: CanFrame) -> bool:
        """Return whether a SYNC has a counter that 1019h does not announce, or lacks one."""
        return self._length is not None and len(sync.data) != self._length

    def produce(self, now: float) -> list[CanFrame]:
        """Return the SYNC that this device sends now, if one is due."""
        return [] if self.producer is None else self.producer.feed(None, now)


# Error control --------------------------------------------------------------------------------------------------------

_HEARTBEAT_TIME, _CONSUMER, _GUARD_TIME, _LIFE_FACTOR, _BEHAVIOR = 0x1017, 0x1016, 0x100C, 0x100D, 0x1029
HEARTBEAT_ERROR = 0x8130
_ERROR_CONTROL = 0b1110
"""The function code of heartbeats and node guarding: bits 10 to 7 of 700h + node."""
_STATE_AFTER_ERROR = {0: NmtState.PRE_OPERATIONAL, 2: NmtState.STOPPED}


class ErrorControlEvent(NamedTuple):
    """A node was lost, or is back (`resolved`). Node 0 is the master in life guarding."""

    node: int
    resolved: bool


def validate_consumer_writes(objects: ObjectDictionary) -> None:
    """Refuse with 0604 0043h to write a node-ID to more than one entry of 1016h."""
    subs = objects.subs(_CONSUMER)[1:]
    for sub in subs:

        def check(word: int, sub: int = sub) -> None:
            written = consumer_entry(word)
            others = [consumer_entry(integer_value(objects, _CONSUMER, other)) for other in subs if other != sub]
            if written is not None and written[0] in {entry[0] for entry in others if entry is not None}:
                raise SdoAbort(AbortCode.INCOMPATIBLE_PARAMETER, _CONSUMER, sub)

        validate_writes(objects, _CONSUMER, sub, check)


class ErrorControl:
    """The error control of one device. `follow` reads the objects; `feed` returns frames and events.

    `heartbeat` is fed by its owner, so that it beats whatever happens to the rest.
    `liveness` and `state` of other nodes are in `consumer`.
    """

    __slots__ = ("_missing", "consumer", "guarded", "heartbeat", "objects")

    def __init__(self, node: int, objects: ObjectDictionary) -> None:
        self.objects = objects
        self.heartbeat = HeartbeatProducer(node)
        self.guarded = GuardedNode(node)
        self.consumer = HeartbeatConsumer({})
        self._missing: set[int] = set()

    @property
    def deadline(self) -> float | None:
        """When the next heartbeat is due, or a monitored node or the master counts as lost."""
        guarding = None if self.heartbeat.period else self.guarded.deadline
        dues = (self.heartbeat.deadline, self.consumer.deadline, guarding)
        return min((due for due in dues if due is not None), default=None)

    @property
    def receives(self) -> frozenset[tuple[int, bool]]:
        """The (identifier, extended) of the requests of node guarding, and of the heartbeats of the nodes in 1016h, or
        that were lost while they were there."""
        nodes = self.heartbeat.node, *self.consumer.times, *self._missing
        return frozenset((cob_id("error control", node), False) for node in nodes)

    def boot(self, now: float) -> CanFrame:
        """Reset everything, and return the boot-up message."""
        self.guarded.reset()
        self.consumer = HeartbeatConsumer({})
        self._missing.clear()
        self.follow(now)
        return self.heartbeat.boot_up(now)

    def set_state(self, state: NmtState) -> None:
        """Set the NMT state that heartbeats and responses to node guarding report."""
        self.heartbeat.state = self.guarded.state = state

    def follow(self, now: float) -> None:
        """Read the present values of the objects."""
        objects = self.objects
        self.heartbeat.set_period(integer_value(objects, _HEARTBEAT_TIME) / 1000, now)
        self.guarded.life_time = integer_value(objects, _GUARD_TIME) * integer_value(objects, _LIFE_FACTOR) / 1000
        subs = objects.subs(_CONSUMER)
        if subs:
            entries = [consumer_entry(integer_value(objects, _CONSUMER, sub)) for sub in subs if sub]
            # Of two entries for one node, which only a default can have, the first one counts.
            times = dict(entry for entry in reversed(entries) if entry is not None)
            if times != self.consumer.times:
                self.consumer.watch(times)

    def after_error(self, state: NmtState) -> NmtState:
        """Return the NMT state that follows a communication error in `state`, by 1029h."""
        if state is not NmtState.OPERATIONAL:
            return state
        return _STATE_AFTER_ERROR.get(integer_value(self.objects, _BEHAVIOR, 1), state)

    def feed(self, frame: CanFrame | None, now: float) -> tuple[list[CanFrame], list[ErrorControlEvent]]:
        """Return the frames to send, and the nodes that were lost or are back."""
        frames: list[CanFrame] = []
        events: list[ErrorControlEvent] = []
        # Any other frame tells the consumer the time only, which it needs while it waits for heartbeats.
        if frame is None or frame.id >> 7 == _ERROR_CONTROL or self.consumer.deadline is not None:
            for event in self.consumer.feed(frame, now):
                monitored = event.node in self.consumer.times  # the consumer follows all nodes
                if monitored and event.kind in ("lost", "rebooted"):
                    self._missing.add(event.node)  # a boot-up ends the monitoring until the next heartbeat
                    events.append(ErrorControlEvent(event.node, resolved=False))
                elif event.kind == "active" and event.node in self._missing:
                    self._missing.discard(event.node)
                    events.append(ErrorControlEvent(event.node, resolved=True))
        if not self.heartbeat.period:
            for item in self.guarded.feed(frame, now):
                if isinstance(item, CanFrame):
                    frames.append(item)
                else:
                    events.append(ErrorControlEvent(0, resolved=item.kind == "resolved"))
        return frames, events


# Consumers of TIME and EMCY -------------------------------------------------------------------------------------------

_TIME, _EMERGENCIES = 0x1012, 0x1028
_DEFAULT_TIME = 0x8000_0100
"""What a device without 1012h does: it consumes TIME."""
_HISTORY = 16


class DeviceConsumers:
    """The TIME consumer and the EMCY consumer of a device. `follow` reads the objects."""

    __slots__ = ("emergencies", "objects", "time")

    def __init__(self, objects: ObjectDictionary) -> None:
        self.objects = objects
        self.time = TimeConsumer()
        self.emergencies = EmcyConsumer(listed_only=True, history=_HISTORY)
        validate_cob_id_writes(objects, _TIME, lambda entry: entry.bit30 or entry.bit31, always_received=True)

    @property
    def receives(self) -> frozenset[tuple[int, bool]]:
        """The (identifier, extended) of TIME, and of the emergencies and boot-up messages of the nodes in 1028h."""
        nodes = self.emergencies.cob_ids
        return frozenset({self.time.key, *nodes, *((cob_id("error control", node), False) for node in nodes.values())})

    def follow(self) -> None:
        """Read the present values of the objects."""
        entry = service_cob_id(self.objects, _TIME, _DEFAULT_TIME)
        self.time.key = (entry.identifier, entry.extended) if entry.bit31 else (-1, False)  # no frame has it
        listed = {
            sub: CobEntry.unpack(integer_value(self.objects, _EMERGENCIES, sub))
            for sub in self.objects.subs(_EMERGENCIES)
        }
        self.emergencies.cob_ids = {
            (entry.identifier, entry.extended): node
            for node, entry in listed.items()
            if node and not (entry.bit31 or entry.is_restricted)
        }

    def feed(self, frame: CanFrame | None, now: float) -> None:
        """Feed both consumers; their state is read from `time` and `emergencies`."""
        self.time.feed(frame, now)
        self.emergencies.feed(frame, now)

    def time_message(self, stamp: TimeStamp) -> list[CanFrame]:
        """Return the TIME message, if 1012h makes this device a producer."""
        entry = service_cob_id(self.objects, _TIME, TIME_KEY[0])
        return [stamp.encode((entry.identifier, entry.extended))] if entry.bit30 else []


# SDO channels ---------------------------------------------------------------------------------------------------------

_CLIENT_1 = 0x1280
_CLIENTS_MAX = 128
_REQUEST, _RESPONSE, _NODE = 1, 2, 3
"""Sub-indices."""

_CobIds = tuple[CobEntry, CobEntry]


def validate_channel_writes(objects: ObjectDictionary) -> None:
    """Validate writes to the objects 1201h to 12FFh that the dictionary has."""
    for index in filter(objects.subs, range(SERVER_1 + 1, _CLIENT_1 + _CLIENTS_MAX)):
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
    return (request, response) if request.carries_sdo and response.carries_sdo else None


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
        raise EncodeError(f"SDO client {client} is not in use: {index:04X}h is missing, or {NOT_IN_USE}")
    return Channel(integer_value(objects, index, _NODE), dialect, cob_ids=cob_ids, node_monitor=node_monitor)


class AdditionalServers:
    """The SDO servers of a device beyond the first: a machine. `follow` reads the objects.

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
            self._fix_default_channel(sub, entry.pack())

    def _fix_default_channel(self, sub: int, word: int) -> None:
        # 1200h follows from the node-ID and is read-only, whatever the EDS says.   [CiA 301, 1200h]
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
        # Of two servers with one identifier the first one answers.
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
