"""Error control of one device: what it says of itself, whom it misses, and what it does then.   [CiA 301]

        1017h  heartbeat time      > 0: says its state by itself; then nobody guards it
        100Ch  guard time          x 100Dh: the life time within which the master must ask
        1016h  whom to watch       00 | node | time in ms, an entry for each
        1029h  error behaviour     of a device that is operational: 0 pre-operational, 1 no change, 2 stopped

        a watched node is silent, or the master does not ask       ->  emergency 8130h, then what 1029h says
        it is heard again                                          ->  emergency 0000h

This file holds the four together as a device needs them; how each works stands in `heartbeat` and `guarding`.
"""

from __future__ import annotations

from typing import NamedTuple

from barewire.canopen.communication_objects import integer_value, validate_writes
from barewire.canopen.frame import CanFrame
from barewire.canopen.nmt.heartbeat import HeartbeatConsumer, HeartbeatProducer, consumer_entry
from barewire.canopen.nmt.messages import NmtState
from barewire.canopen.nmt.node_guarding import GuardedNode
from barewire.canopen.object_dictionary import ObjectDictionary
from barewire.canopen.sdo.aborts import AbortCode, SdoAbort

HEARTBEAT_TIME, CONSUMER, GUARD_TIME, LIFE_FACTOR, BEHAVIOUR = 0x1017, 0x1016, 0x100C, 0x100D, 0x1029
HEARTBEAT_ERROR = 0x8130
_LEADS_TO = {0: NmtState.PRE_OPERATIONAL, 2: NmtState.STOPPED}


class ErrorControlEvent(NamedTuple):
    """A node that is missed, or heard again (`gone`: the error is gone). Node 0 is the master that guards us."""

    node: int
    gone: bool


def validate_consumer_writes(objects: ObjectDictionary) -> None:
    """No node twice in 1016h: 0604 0043h."""
    for sub in objects.subs(CONSUMER)[1:]:

        def check(word: int, sub: int = sub) -> None:
            entry = consumer_entry(word)
            others = [integer_value(objects, CONSUMER, other) for other in objects.subs(CONSUMER)[1:] if other != sub]
            if entry is not None and entry[0] in {other[0] for other in map(consumer_entry, others) if other}:
                raise SdoAbort(AbortCode.INCOMPATIBLE_PARAMETER, CONSUMER, sub)

        validate_writes(objects, CONSUMER, sub, check)


class ErrorControl:
    """The four of one device. `follow` obeys the objects, `feed` says frames and whom it misses. A machine.

    `liveness` and `state` of other nodes are known to `consumer`.
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
        """The next heartbeat of our own, or the end of somebody's silence."""
        dues = (self.heartbeat.deadline, self.consumer.deadline, self._guarding_deadline)
        return min((due for due in dues if due is not None), default=None)

    @property
    def _guarding_deadline(self) -> float | None:
        return None if self.heartbeat.period else self.guarded.deadline

    def boot(self, now: float) -> CanFrame:
        """Everything begins anew, with the boot-up message."""
        self.guarded.reset()
        self.consumer = HeartbeatConsumer({})
        self._missing.clear()
        self.follow(now)
        return self.heartbeat.boot_up(now)

    def be(self, state: NmtState) -> None:
        """The state that is told from now on."""
        self.heartbeat.state = self.guarded.state = state

    def follow(self, now: float) -> None:
        """What the objects say now."""
        objects = self.objects
        self.heartbeat.set_period(integer_value(objects, HEARTBEAT_TIME) / 1000, now)
        self.guarded.life_time = integer_value(objects, GUARD_TIME) * integer_value(objects, LIFE_FACTOR) / 1000
        subs = objects.subs(CONSUMER)
        if subs:
            entries = [consumer_entry(integer_value(objects, CONSUMER, sub)) for sub in subs if sub]
            times = dict(entry for entry in reversed(entries) if entry is not None)
            if times != self.consumer.times:
                self.consumer.watch(times)

    def after_error(self, state: NmtState) -> NmtState:
        """Where an error of the communication leads a device in this state."""
        if state is not NmtState.OPERATIONAL:
            return state
        return _LEADS_TO.get(integer_value(self.objects, BEHAVIOUR, 1), state)

    def feed(self, frame: CanFrame | None, now: float) -> tuple[list[CanFrame], list[ErrorControlEvent]]:
        """Frames to say, and who is missed or heard again."""
        said: list[CanFrame] = []
        missed: list[ErrorControlEvent] = []
        if frame is None or frame.id >> 7 == 0x700 >> 7 or self.consumer.deadline is not None:
            for event in self.consumer.feed(frame, now):
                if event.kind == "lost":
                    self._missing.add(event.node)
                    missed.append(ErrorControlEvent(event.node, gone=False))
                elif event.kind == "active" and event.node in self._missing:
                    self._missing.discard(event.node)
                    missed.append(ErrorControlEvent(event.node, gone=True))
        if not self.heartbeat.period:
            for item in self.guarded.feed(frame, now):
                if isinstance(item, CanFrame):
                    said.append(item)
                else:
                    missed.append(ErrorControlEvent(0, gone=item.kind == "resolved"))
        said += self.heartbeat.feed(None, now)
        return said, missed
