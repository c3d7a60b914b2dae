"""One PDO of a device as its records configure it now, and its state.   [CiA 301, PDO]

The records (see `config`) are read once; when one of them is written, the engine makes a new `ActivePdo`.
"""

from __future__ import annotations

from contextlib import suppress

from barewire.canopen.cob_ids import CobEntry
from barewire.canopen.object_dictionary import ObjectDictionary
from barewire.canopen.pdo.config import LAST_CYCLIC, RTR_AT_ONCE, RTR_AT_SYNC, PdoConfig, resolve
from barewire.canopen.pdo.mapping import PdoMapping
from barewire.canopen.pdo.multiplexed import MPDO_COUNTS, MpdoConsumer, MpdoProducer
from barewire.codecs import Value
from barewire.errors import BarewireError, EncodeError


class ActivePdo:
    """One PDO: `config` is its factory setting, all other attributes are those of its records."""

    __slots__ = ("_refused", "_start", "_syncs", "_waits_for_start", "cob", "config", "event_timer", "held", "inhibit",
                 "is_on", "is_tpdo", "key", "mapping", "mpdo_consumer", "mpdo_producer", "objects", "received_at",
                 "sent", "sent_at", "type")  # fmt: skip

    def __init__(self, config: PdoConfig, objects: ObjectDictionary, node: int) -> None:
        def number(index: int, sub: int) -> int:
            return int(objects.get(index, sub)) if (index, sub) in objects else 0

        self.config = config
        self.objects = objects
        self.is_tpdo = config.direction == "TPDO"
        self.cob = CobEntry.unpack(number(config.communication, 1))
        self.key = (self.cob.identifier, self.cob.extended)
        self.type = number(config.communication, 2)
        self.inhibit = number(config.communication, 3) / 10_000
        self.event_timer = number(config.communication, 5) / 1000
        self._start = number(config.communication, 6)
        count = number(config.map, 0)
        addressing = MPDO_COUNTS.get(count)
        self.mpdo_producer = MpdoProducer(addressing, node, objects) if addressing and self.is_tpdo else None
        self.mpdo_consumer = MpdoConsumer(addressing, node, objects) if addressing and not self.is_tpdo else None
        words = () if addressing else tuple(number(config.map, sub) for sub in range(1, count + 1))
        self.mapping: PdoMapping = resolve(objects, config.direction, words)
        # The records refuse other types for an MPDO, but the device itself may have set one: the MPDO is then off.
        has_content = self.type > RTR_AT_ONCE if addressing else bool(self.mapping.entries)
        self.is_on = not self.cob.bit31 and has_content
        self.held: bytes | None = None  # the data of an RPDO that waits for SYNC
        self.received_at: float | None = None  # of an RPDO, while its event timer runs
        self.sent: bytes | None = None  # the data that a TPDO sent last, or sampled for a remote request
        self.sent_at: float | None = None
        self._syncs = 0
        self._waits_for_start = self._start != 0
        self._refused = 0

    @property
    def refused(self) -> int:
        """The number of values that were not stored, or could not be sent."""
        mpdos = (self.mpdo_producer, self.mpdo_consumer)
        return self._refused + sum(mpdo.refused for mpdo in mpdos if mpdo is not None)

    @property
    def on_sync(self) -> bool:
        """Whether the type is 0 to 240, driven by SYNC."""
        return self.type <= LAST_CYCLIC

    @property
    def due(self) -> float | None:
        """When a TPDO of type 254 or 255 is sent next, or an RPDO counts as missing; None if no time drives it."""
        if not self.is_tpdo:
            return None if self.received_at is None or not self.event_timer else self.received_at + self.event_timer
        if self.on_sync or self.type in (RTR_AT_SYNC, RTR_AT_ONCE):
            return None
        if self.mpdo_producer is not None and self.mpdo_producer.next() is None:
            return None
        if self.sent_at is None:
            return float("-inf")
        if self.mpdo_producer is not None or self.sample() != self.sent:
            return self.sent_at + self.inhibit
        return self.sent_at + max(self.event_timer, self.inhibit) if self.event_timer else None

    def next_data(self) -> bytes:
        """Return the data of the frame to be sent now."""
        if self.mpdo_producer is None:
            return self.sample()
        data = self.mpdo_producer.next() or b""
        self.mpdo_producer.sent(data)
        return data

    def sample(self) -> bytes:
        """Return the present data of a TPDO. If a value does not fit its bits, count it in `refused` and send zeros."""
        try:
            values: dict[str, Value] = {
                mapped.name: self.objects.get(mapped.index, mapped.sub)
                for mapped in self.mapping.entries
                if not mapped.is_dummy
            }
            return self.mapping.pack(values)
        except BarewireError as error:
            self._refused += 1
            if isinstance(error, EncodeError):
                self._find_misfit()
            return bytes(self.mapping.size)

    def _find_misfit(self) -> None:
        """Read the objects one by one: the dictionary reports the value of the application that does not fit."""
        for mapped in self.mapping.entries:
            if not mapped.is_dummy:
                with suppress(BarewireError):
                    self.objects.read(mapped.index, mapped.sub)

    def store(self, data: bytes) -> None:
        """Write the values of an RPDO to the dictionary. A refused value does not affect the others."""
        values = self.mapping.unpack(data)
        for mapped in self.mapping.entries:
            if mapped.is_dummy:
                continue
            try:
                codec = self.objects.entry(mapped.index, mapped.sub).codec
                self.objects.write(mapped.index, mapped.sub, codec.encode(values[mapped.name]))
            except BarewireError:
                self._refused += 1

    def is_due_at_sync(self, counter: int | None) -> bool:
        """Count a SYNC. Return whether this synchronous TPDO is sent at it."""
        if self._waits_for_start and counter is not None and counter != self._start:
            return False
        self._waits_for_start = False
        if self.type == 0:
            return self.sample() != self.sent
        self._syncs += 1
        if self._syncs < self.type:
            return False
        self._syncs = 0
        return True
