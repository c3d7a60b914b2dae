"""The TIME and EMCY consumers of a device, as its objects configure them.   [CiA 301, TIME, EMCY]

        1012h     COB-ID TIME   31 | 30 | 29 | 28 ... 0     31: consumes TIME  30: produces it     29: 29 bits
        1028h:n   COB-ID of the emergencies of node n; 31: not consumed

While TIME is consumed or produced, its identifier cannot be changed: 0609 0030h.
"""

from __future__ import annotations

from barewire.canopen.cob_ids import CobEntry, cob_id
from barewire.canopen.communication_objects import integer_value, validate_cob_id_writes
from barewire.canopen.emcy.consumer import EmcyConsumer
from barewire.canopen.frame import CanFrame
from barewire.canopen.object_dictionary import ObjectDictionary
from barewire.canopen.time_stamp import TimeConsumer, TimeStamp

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
