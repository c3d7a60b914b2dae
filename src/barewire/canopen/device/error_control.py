"""Error control of a device: heartbeat producer and consumer, life guarding, error behaviour.   [CiA 301]

        1017h  producer heartbeat time      > 0: the device sends heartbeats and is not guarded
        100Ch  guard time                   x 100Dh: the life time within which the master must send a request
        1016h  consumer heartbeat time      00 | node | time in ms, one entry for each monitored node
        1029h  error behaviour              of an operational device: 0 pre-operational, 1 no change, 2 stopped

        a monitored node is lost or boots, or the master sends no request in time   ->  emergency 8130h, then behaviour
        its heartbeat, or a request, arrives again                                  ->  emergency 0000h       1029h

This file combines the machines of `nmt.error_control` as the objects configure them.

The TIME and EMCY consumers of a device, as its objects configure them.   [CiA 301, TIME, EMCY]

        1012h     COB-ID TIME   31 | 30 | 29 | 28 ... 0     31: consumes TIME  30: produces it     29: 29 bits
        1028h:n   COB-ID of the emergencies of node n; 31: not consumed

While TIME is consumed or produced, its identifier cannot be changed: 0609 0030h.
"""

from __future__ import annotations

from typing import NamedTuple

from barewire.canopen.abort_codes import AbortCode, SdoAbort
from barewire.canopen.cob_ids import CobEntry, cob_id
from barewire.canopen.communication_objects import integer_value, validate_cob_id_writes, validate_writes
from barewire.canopen.emcy import EmcyConsumer
from barewire.canopen.frame import CanFrame
from barewire.canopen.nmt.error_control import GuardedNode, HeartbeatConsumer, HeartbeatProducer
from barewire.canopen.nmt.messages import NmtState, consumer_entry
from barewire.canopen.object_dictionary import ObjectDictionary
from barewire.canopen.time_stamp import TimeConsumer, TimeStamp

_HEARTBEAT_TIME, _CONSUMER, _GUARD_TIME, _LIFE_FACTOR, _BEHAVIOR = 0x1017, 0x1016, 0x100C, 0x100D, 0x1029
HEARTBEAT_ERROR = 0x8130
_STATE_AFTER_ERROR = {0: NmtState.PRE_OPERATIONAL, 2: NmtState.STOPPED}


class ErrorControlEvent(NamedTuple):
    """A node was lost, or is back (`resolved`). Node 0 is the master in life guarding."""

    node: int
    resolved: bool


def validate_consumer_writes(objects: ObjectDictionary) -> None:
    """Refuse with 0604 0043h to write a node-ID to more than one entry of 1016h."""
    for sub in objects.subs(_CONSUMER)[1:]:

        def check(word: int, sub: int = sub) -> None:
            entry = consumer_entry(word)
            words = [integer_value(objects, _CONSUMER, other) for other in objects.subs(_CONSUMER)[1:] if other != sub]
            if entry is not None and entry[0] in {other[0] for other in map(consumer_entry, words) if other}:
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
        dues = (self.heartbeat.deadline, self.consumer.deadline, self._guarding_deadline)
        return min((due for due in dues if due is not None), default=None)

    @property
    def _guarding_deadline(self) -> float | None:
        return None if self.heartbeat.period else self.guarded.deadline

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
        if frame is None or frame.id >> 7 == 0x700 >> 7 or self.consumer.deadline is not None:
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


_TIME, _EMERGENCIES = 0x1012, 0x1028
_DEFAULT_TIME = 0x8000_0100
"""The value of 1012h if the object is missing: TIME is consumed."""
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
        entry = CobEntry.unpack(integer_value(self.objects, _TIME, default=_DEFAULT_TIME))
        self.time.key = (entry.identifier, entry.extended) if entry.bit31 else (-1, False)
        listed = {
            sub: CobEntry.unpack(integer_value(self.objects, _EMERGENCIES, sub))
            for sub in self.objects.subs(_EMERGENCIES)
        }
        self.emergencies.cob_ids = {
            (entry.identifier, entry.extended): node for node, entry in listed.items() if node and not entry.bit31
        }

    def feed(self, frame: CanFrame | None, now: float) -> None:
        """Feed both consumers; their state is read from `time` and `emergencies`."""
        self.time.feed(frame, now)
        self.emergencies.feed(frame, now)

    def time_message(self, stamp: TimeStamp) -> list[CanFrame]:
        """Return the TIME message, if 1012h makes this device a producer."""
        entry = CobEntry.unpack(integer_value(self.objects, _TIME))
        return [stamp.encode((entry.identifier, entry.extended))] if entry.bit30 else []
