"""What one device hears of the others by its objects: what time it is, what is wrong with them.   [CiA 301, TIME, EMCY]

        1012h     COB-ID TIME   31 | 30 | 29 | 28 ... 0     31: hears TIME     30: produces it     29: 29 bits
        1028h:n   COB-ID under which the emergencies of node n are awaited; 31: they are not

While TIME is heard or produced, its identifier stays as it is: 0609 0030h.
"""

from __future__ import annotations

from barewire.canopen.cob_ids import CobEntry
from barewire.canopen.communication_objects import integer_value, validate_cob_id_writes
from barewire.canopen.emcy.consumer import EmcyConsumer
from barewire.canopen.frame import CanFrame
from barewire.canopen.object_dictionary import ObjectDictionary
from barewire.canopen.time_stamp import TimeConsumer, TimeStamp

TIME, EMERGENCIES = 0x1012, 0x1028
TIME_HEARD = 0x8000_0100
"""What stands for 1012h where a device has none: TIME is heard."""
HISTORY = 16


class DeviceConsumers:
    """TIME and the emergencies of others, as a device hears them. `follow` obeys the objects. A machine."""

    __slots__ = ("emergencies", "objects", "time")

    def __init__(self, objects: ObjectDictionary) -> None:
        self.objects = objects
        self.time = TimeConsumer()
        self.emergencies = EmcyConsumer(listed_only=True, history=HISTORY)
        validate_cob_id_writes(objects, TIME, lambda entry: entry.bit30 or entry.bit31)

    def follow(self) -> None:
        """What the objects say now."""
        entry = CobEntry.unpack(integer_value(self.objects, TIME, default=TIME_HEARD))
        self.time.key = (entry.identifier, entry.extended) if entry.bit31 else (-1, False)
        listed = {
            sub: CobEntry.unpack(integer_value(self.objects, EMERGENCIES, sub))
            for sub in self.objects.subs(EMERGENCIES)
        }
        self.emergencies.cob_ids = {
            (entry.identifier, entry.extended): node for node, entry in listed.items() if node and not entry.bit31
        }

    def feed(self, frame: CanFrame | None, now: float) -> None:
        """One frame more; it is kept, and nothing is said to it."""
        self.time.feed(frame, now)
        self.emergencies.feed(frame, now)

    def say_time(self, stamp: TimeStamp) -> list[CanFrame]:
        """The TIME message, if 1012h lets this device produce it."""
        entry = CobEntry.unpack(integer_value(self.objects, TIME))
        return [stamp.encode((entry.identifier, entry.extended))] if entry.bit30 else []
