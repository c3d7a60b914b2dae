"""PDOs in motion: a device's process data, moved by SYNC, by change and by time.   [CiA 301, PDO]

                              RPDO                                    TPDO
        type 254, 255         into the dictionary at once             out when its data changed, not sooner than
                                                                      the inhibit time, not later than the event timer
        type 0                held, in at the next SYNC               out at the next SYNC if its data changed
        type 1..240           held, in at the next SYNC               out at every n-th SYNC

At a SYNC first what was received takes effect, then what is sent is sampled. An RPDO that is shorter than mapped is
not processed and an emergency says so (8210h, then the received and the mapped length); one that is longer is used as
far as mapped (8220h). Each is said once, until a good one came.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial

from barewire.canopen.cob import CobEntry, cob_id
from barewire.canopen.dictionary import ObjectDictionary
from barewire.canopen.emcy import Emergency
from barewire.canopen.frame import CanFrame
from barewire.canopen.pdo import PdoMapping
from barewire.canopen.pdo_records import Pdo, add_records, resolve
from barewire.canopen.sync import Sync
from barewire.errors import BarewireError, DecodeError, EncodeError

SYNC_KEY = (cob_id("SYNC"), False)
TOO_SHORT, TOO_LONG = 0x8210, 0x8220


class _Live:
    """One PDO as it is configured now, and what it is in the middle of."""

    __slots__ = ("cob", "complained", "event_timer", "held", "inhibit", "mapping", "pdo", "sent", "sent_at", "start",
                 "syncs", "type", "waits_for_start")  # fmt: skip

    def __init__(self, pdo: Pdo, objects: ObjectDictionary) -> None:
        def number(index: int, sub: int) -> int:
            return int(objects.get(index, sub))

        self.pdo = pdo
        self.cob = CobEntry.unpack(number(pdo.communication, 1))
        self.type = number(pdo.communication, 2)
        self.inhibit = number(pdo.communication, 3) / 10_000
        self.event_timer = number(pdo.communication, 5) / 1000
        self.start = number(pdo.communication, 6)
        words = tuple(number(pdo.map, sub) for sub in range(1, number(pdo.map, 0) + 1))
        self.mapping: PdoMapping = resolve(objects, pdo.direction, words)
        self.complained = 0  # the emergency that was said and still holds
        self.held: bytes | None = None  # an RPDO that waits for SYNC
        self.sent: bytes | None = None
        self.sent_at: float | None = None
        self.syncs = 0
        self.waits_for_start = self.start != 0

    @property
    def is_on(self) -> bool:
        return not self.cob.bit31 and bool(self.mapping.entries)

    @property
    def on_sync(self) -> bool:
        return self.type <= 240


class PdoEngine:
    """All PDOs of one device, to be fed while it is operational. A machine.

    The engine puts their records into the dictionary, so they can be changed by SDO; it looks at them again whenever
    one was written. `refused` counts values that the dictionary did not take.
    """

    __slots__ = ("_live", "_running", "node", "objects", "pdos", "refused")

    def __init__(self, node: int, objects: ObjectDictionary, pdos: Iterable[Pdo]) -> None:
        self.node = node
        self.objects = objects
        self.pdos = tuple(pdos)
        self.refused = 0
        self._running = False
        self._live: dict[Pdo, _Live] = {}
        numbers = [(pdo.direction, pdo.number) for pdo in self.pdos]
        for direction, number in numbers:
            if numbers.count((direction, number)) > 1:
                raise EncodeError(f"{direction}{number} is there twice")
        for pdo in self.pdos:
            add_records(objects, node, pdo, partial(self._live.pop, pdo, None))

    @property
    def live(self) -> list[_Live]:
        """Every PDO as configured now; one whose records were written begins anew, the others go on."""
        for pdo in self.pdos:
            if pdo not in self._live:
                self._live[pdo] = _Live(pdo, self.objects)
        return [self._live[pdo] for pdo in self.pdos]

    @property
    def deadline(self) -> float | None:
        """When an inhibit time ends that holds something back, or an event timer."""
        if not self._running:
            return None
        dues = [self._due(live) for live in self.live if live.pdo.direction == "TPDO" and live.is_on]
        return min((due for due in dues if due is not None), default=None)

    def start(self) -> None:
        """The device became operational: every TPDO of type 254 and 255 is due, every count of SYNCs begins."""
        self._live.clear()
        self._running = True

    def stop(self) -> None:
        """The device is no longer operational: what was held is forgotten."""
        self._live.clear()
        self._running = False

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        """What a frame and the time bring about."""
        if not self._running:
            return []
        said: list[CanFrame] = []
        if frame is not None and not frame.remote:
            said += self._sync(frame, now) if frame.key == SYNC_KEY else self._receive(frame)
        for live in self.live:
            if live.pdo.direction == "TPDO" and live.is_on and not live.on_sync:
                due = self._due(live)
                if due is not None and now >= due:
                    said.append(self._send(live, now))
        return said

    def _receive(self, frame: CanFrame) -> list[CanFrame]:
        said: list[CanFrame] = []
        for live in self.live:
            if live.pdo.direction != "RPDO" or not live.is_on or frame.key != (live.cob.identifier, live.cob.extended):
                continue
            size = live.mapping.size
            wrong = TOO_SHORT if len(frame.data) < size else TOO_LONG if len(frame.data) > size else 0
            if wrong and wrong != live.complained:
                register = int(self.objects.get(0x1001)) if (0x1001, 0) in self.objects else 0
                info = bytes([len(frame.data), size])
                said.append(Emergency(self.node, wrong, register, info).encode())
            live.complained = wrong
            if wrong == TOO_SHORT:
                continue
            if live.on_sync:
                live.held = frame.data[:size]
            else:
                self._take(live, frame.data[:size])
        return said

    def _take(self, live: _Live, data: bytes) -> None:
        """The values of an RPDO into the dictionary, each by itself: one that is refused does not stop the others."""
        values = live.mapping.unpack(data)
        for mapped in live.mapping.entries:
            if mapped.is_dummy:
                continue
            try:
                codec = self.objects.entry(mapped.index, mapped.sub).codec
                self.objects.write(mapped.index, mapped.sub, codec.encode(values[mapped.name]))
            except BarewireError:
                self.refused += 1

    def _sync(self, frame: CanFrame, now: float) -> list[CanFrame]:
        try:
            counter = Sync.decode(frame).counter
        except DecodeError:
            return []
        for live in self.live:
            if live.held is not None:
                held, live.held = live.held, None
                self._take(live, held)
        said: list[CanFrame] = []
        for live in self.live:
            if live.pdo.direction != "TPDO" or not live.is_on or not live.on_sync:
                continue
            if live.waits_for_start and counter is not None and counter != live.start:
                continue
            live.waits_for_start = False
            live.syncs += 1
            if live.syncs == live.type or (live.type == 0 and self._sample(live) != live.sent):
                said.append(self._send(live, now))
            if live.syncs >= live.type:
                live.syncs = 0
        return said

    def _due(self, live: _Live) -> float | None:
        """When a TPDO of type 254 or 255 goes out; None if nothing drives it."""
        if live.on_sync:
            return None
        if live.sent_at is None:
            return float("-inf")
        if self._sample(live) != live.sent:
            return live.sent_at + live.inhibit
        return live.sent_at + max(live.event_timer, live.inhibit) if live.event_timer else None

    def _sample(self, live: _Live) -> bytes:
        """The data of a TPDO as it would be now. With a value that its bits cannot hold all go as 0, counted."""
        try:
            values = {m.name: self.objects.get(m.index, m.sub) for m in live.mapping.entries if not m.is_dummy}
            return live.mapping.pack(values)
        except BarewireError:
            self.refused += 1
            return bytes(live.mapping.size)

    def _send(self, live: _Live, now: float) -> CanFrame:
        live.sent, live.sent_at = self._sample(live), now
        return CanFrame(live.cob.identifier, live.sent, live.cob.extended)
