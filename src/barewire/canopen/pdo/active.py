"""One PDO as its records say now, and what it is in the middle of.   [CiA 301, PDO]

The records (see `pdo_records`) are read once; when one of them is written, the engine makes a new `ActivePdo`.
"""

from __future__ import annotations

from barewire.canopen.cob_ids import CobEntry
from barewire.canopen.object_dictionary import ObjectDictionary
from barewire.canopen.pdo.config import LAST_CYCLIC, RTR_AT_ONCE, RTR_AT_SYNC, PdoConfig, resolve
from barewire.canopen.pdo.mapping import PdoMapping
from barewire.canopen.pdo.multiplexed import MPDO_COUNTS, MpdoConsumer, MpdoProducer
from barewire.codecs import Value
from barewire.errors import BarewireError


class ActivePdo:
    """One PDO at work."""

    __slots__ = ("cob", "event_timer", "heard_at", "held", "inhibit", "into", "is_on", "is_tpdo", "key", "mapping",
                 "objects", "out", "pdo", "refused", "sent", "sent_at", "start", "syncs", "type",
                 "waits_for_start")  # fmt: skip

    def __init__(self, pdo: PdoConfig, objects: ObjectDictionary, node: int) -> None:
        def number(index: int, sub: int) -> int:
            return int(objects.get(index, sub))

        self.pdo = pdo
        self.objects = objects
        self.is_tpdo = pdo.direction == "TPDO"
        self.cob = CobEntry.unpack(number(pdo.communication, 1))
        self.key = (self.cob.identifier, self.cob.extended)
        self.type = number(pdo.communication, 2)
        self.inhibit = number(pdo.communication, 3) / 10_000
        self.event_timer = number(pdo.communication, 5) / 1000
        self.start = number(pdo.communication, 6)
        count = number(pdo.map, 0)
        kind = MPDO_COUNTS.get(count)
        self.out = MpdoProducer(kind, node, objects) if kind and self.is_tpdo else None
        self.into = MpdoConsumer(kind, node, objects) if kind and not self.is_tpdo else None
        words = () if kind else tuple(number(pdo.map, sub) for sub in range(1, count + 1))
        self.mapping: PdoMapping = resolve(objects, pdo.direction, words)
        # The rules of the records let no other type be multiplexed; a value set past them must not bring it to SYNC.
        has_content = self.type > RTR_AT_ONCE if kind else bool(self.mapping.entries)
        self.is_on = not self.cob.bit31 and has_content
        self.held: bytes | None = None  # an RPDO that waits for SYNC
        self.heard_at: float | None = None  # an RPDO that has a deadline
        self.sent: bytes | None = None  # what a TPDO said last, or sampled for who will ask
        self.sent_at: float | None = None
        self.syncs = 0
        self.waits_for_start = self.start != 0
        self.refused = 0

    @property
    def all_refused(self) -> int:
        """Values that were not taken, or could not be said."""
        return self.refused + sum(one.refused for one in (self.out, self.into) if one is not None)

    @property
    def on_sync(self) -> bool:
        """Type 0 to 240: SYNC moves it."""
        return self.type <= LAST_CYCLIC

    @property
    def due(self) -> float | None:
        """When a TPDO of type 254 or 255 goes out, or an RPDO is missed; None if no time drives it."""
        if not self.is_tpdo:
            return None if self.heard_at is None or not self.event_timer else self.heard_at + self.event_timer
        if self.on_sync or self.type in (RTR_AT_SYNC, RTR_AT_ONCE):
            return None
        if self.out is not None and self.out.next() is None:
            return None
        if self.sent_at is None:
            return float("-inf")
        if self.out is not None:
            return self.sent_at + self.inhibit
        if self.sample() != self.sent:
            return self.sent_at + self.inhibit
        return self.sent_at + max(self.event_timer, self.inhibit) if self.event_timer else None

    def next_data(self) -> bytes:
        """The data of the frame that goes out now."""
        if self.out is None:
            return self.sample()
        data = self.out.next() or b""
        self.out.said(data)
        return data

    def sample(self) -> bytes:
        """The data of a TPDO as it would be now. With a value that its bits cannot hold all go as 0, counted."""
        try:
            values: dict[str, Value] = {
                m.name: self.objects.get(m.index, m.sub) for m in self.mapping.entries if not m.is_dummy
            }
            return self.mapping.pack(values)
        except BarewireError:
            self.refused += 1
            return bytes(self.mapping.size)

    def take(self, data: bytes) -> None:
        """The values of an RPDO into the dictionary, each by itself: one that is refused does not stop the others."""
        values = self.mapping.unpack(data)
        for mapped in self.mapping.entries:
            if mapped.is_dummy:
                continue
            try:
                codec = self.objects.entry(mapped.index, mapped.sub).codec
                self.objects.write(mapped.index, mapped.sub, codec.encode(values[mapped.name]))
            except BarewireError:
                self.refused += 1

    def beat(self, counter: int | None) -> bool:
        """A SYNC came: whether this synchronous TPDO goes out now."""
        if self.waits_for_start and counter is not None and counter != self.start:
            return False
        self.waits_for_start = False
        if self.type == 0:
            return self.sample() != self.sent
        self.syncs += 1
        if self.syncs < self.type:
            return False
        self.syncs = 0
        return True
