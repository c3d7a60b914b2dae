"""The PDO engine: sends and receives the process data of a device.   [CiA 301, PDO]

                              RPDO                                    TPDO
        type 254, 255         stored in the dictionary at once        sent when its data changed, not sooner than
                                                                      the inhibit time, not later than the event timer
        type 0                held, stored at the next SYNC           sent at the next SYNC if its data changed
        type 1..240           held, stored at the next SYNC           sent at every n-th SYNC
        type 252, 253         -                                       sent on a remote request, with the data of the
                                                                      last SYNC (252) or the present data (253)

At a SYNC, received data is stored first, then TPDOs are sampled. A remote frame is answered by every TPDO whose COB-ID
allows it (bit 30 is 0).

        8210h  an RPDO shorter than mapped: ignored                    info: received, mapped length
        8220h  an RPDO longer than mapped: used as far as mapped       info: received, mapped length
        8250h  no RPDO within the event timer of its record            info: index of the record
        8230h  a DAM MPDO addresses an object that does not exist      info: index, sub-index

Each of these errors is reported once, and cleared by the next valid RPDO.
"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from functools import partial

from barewire.canopen.cob_ids import SYNC_KEY, CobEntry
from barewire.canopen.emcy import EmcyProducer
from barewire.canopen.frame import CanFrame
from barewire.canopen.object_dictionary import ObjectDictionary
from barewire.canopen.pdo.config import LAST_CYCLIC, RTR_AT_ONCE, RTR_AT_SYNC, PdoConfig, add_records, resolve
from barewire.canopen.pdo.mapping import PdoMapping
from barewire.canopen.pdo.multiplexed import MPDO_COUNTS, MPDO_SIZE, Mpdo, MpdoConsumer, MpdoProducer
from barewire.canopen.sync import sync_counter
from barewire.codecs import Value
from barewire.errors import BarewireError, DecodeError, EncodeError

_TOO_SHORT, _TOO_LONG, _MISSED, _NO_DESTINATION = 0x8210, 0x8220, 0x8250, 0x8230
_NOTHING: frozenset[tuple[int, bool]] = frozenset()


class ActivePdo:
    """One PDO and its state: `config` is its factory setting, all other attributes are those of its records, which are
    read once. When one of them is written, the engine makes a new one."""

    __slots__ = ("_misfit", "_refused", "_start", "_syncs", "_waits_for_start", "cob", "config", "event_timer", "held",
                 "inhibit", "is_on", "is_tpdo", "key", "mapping", "mpdo_consumer", "mpdo_producer", "objects",
                 "received_at", "sent", "sent_at", "type")  # fmt: skip

    def __init__(self, config: PdoConfig, objects: ObjectDictionary, node: int) -> None:
        def number(index: int, sub: int) -> int:
            return int(objects.get(index, sub)) if (index, sub) in objects else 0

        self.config = config
        self.objects = objects
        self.is_tpdo = config.direction == "TPDO"
        self.cob = CobEntry.unpack(number(config.communication, 1))
        self.key = (self.cob.identifier, self.cob.extended)
        self.type = number(config.communication, 2)
        self.inhibit = number(config.communication, 3) / 10_000  # the object counts in 100 us, the timer in ms
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
        self.is_on = has_content and not (self.cob.bit31 or self.cob.is_restricted)
        self.held: bytes | None = None  # the data of an RPDO that waits for SYNC
        self.received_at: float | None = None  # of an RPDO, while its event timer runs
        self.sent: bytes | None = None  # the data that a TPDO sent last, or sampled for a remote request
        self.sent_at: float | None = None
        self._syncs = 0
        self._waits_for_start = self._start != 0
        self._refused = 0
        self._misfit = ""  # the value that does not fit, which is reported once and not at each look

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
            return float("-inf")  # the first one is sent as soon as the device is operational
        if self.mpdo_producer is not None or self.sample() != self.sent:
            return self.sent_at + self.inhibit
        # An event timer that is shorter than the inhibit time must not break it.
        return self.sent_at + max(self.event_timer, self.inhibit) if self.event_timer else None

    def next_data(self) -> bytes:
        """Return the data of the frame to be sent now."""
        if self.mpdo_producer is None:
            return self.sample(to_send=True)
        data = self.mpdo_producer.next() or b""
        self.mpdo_producer.sent(data)
        return data

    def sample(self, *, to_send: bool = False) -> bytes:
        """Return the present data of a TPDO; zeros if a value does not fit its bits or cannot be read, which `refused`
        counts if the data is to be sent, and not only compared."""
        try:
            values: dict[str, Value] = {
                mapped.name: self.objects.get(mapped.index, mapped.sub)
                for mapped in self.mapping.entries
                if not mapped.is_dummy
            }
            data = self.mapping.pack(values)
        except BarewireError as error:
            self._refused += to_send
            if isinstance(error, EncodeError) and str(error) != self._misfit:
                self._misfit = str(error)
                self._report_misfit()
            return bytes(self.mapping.size)
        self._misfit = ""
        return data

    def _report_misfit(self) -> None:
        # Read one by one, so that the dictionary reports the value of the application that does not fit.
        for mapped in self.mapping.entries:
            if not mapped.is_dummy:
                with suppress(BarewireError):
                    self.objects.read(mapped.index, mapped.sub)

    def store(self, data: bytes) -> None:
        """Write the values of an RPDO to the dictionary. A refused value does not affect the others."""
        refused: list[str] = []
        values = self.mapping.unpack(data, refused=refused)
        self._refused += len(refused)
        for mapped in self.mapping.entries:
            if mapped.is_dummy or mapped.name in refused:
                continue
            try:
                codec = self.objects.entry(mapped.index, mapped.sub).codec
                self.objects.write(mapped.index, mapped.sub, codec.encode(values[mapped.name]))
            except BarewireError:
                self._refused += 1

    def is_due_at_sync(self, counter: int | None) -> bool:
        """Count a SYNC. Return whether this synchronous TPDO is sent at it."""
        if self._waits_for_start and counter is not None and counter != self._start:
            return False  # a SYNC without counter starts it too   [CiA 301, SYNC start value]
        self._waits_for_start = False
        if self.type == 0:
            return self.sample() != self.sent
        self._syncs += 1
        if self._syncs < self.type:
            return False
        self._syncs = 0
        return True


class PdoEngine:
    """All PDOs of one device: a machine that is fed while the device is operational.

    The engine adds the records of the PDOs to the dictionary, so that they can be changed by SDO, and reads them again
    after a write. `outside_window` counts synchronous RPDOs that arrived more than `window` seconds after a SYNC
    (0: no limit). `sync_key` is the (identifier, extended) of SYNC.
    """

    __slots__ = ("_active", "_pdos_changed", "_receives", "_refused", "_running", "_synced_at", "errors", "node",
                 "objects", "outside_window", "pdos", "sync_key", "window")  # fmt: skip

    def __init__(
        self, node: int, objects: ObjectDictionary, pdos: Iterable[PdoConfig], errors: EmcyProducer | None = None
    ) -> None:
        self.node = node
        self.objects = objects
        self.errors = EmcyProducer(node, objects) if errors is None else errors
        self.pdos = tuple(pdos)
        self.sync_key = SYNC_KEY
        self.window = 0.0
        self.outside_window = 0
        self._refused = 0
        self._running = False
        self._synced_at: float | None = None
        self._active: dict[PdoConfig, ActivePdo] = {}
        self._pdos_changed = True
        self._receives: frozenset[tuple[int, bool]] | None = _NOTHING
        numbers = [(config.direction, config.number) for config in self.pdos]
        for direction, number in numbers:
            if numbers.count((direction, number)) > 1:
                raise EncodeError(f"{direction}{number} is defined twice")
        for config in self.pdos:
            add_records(objects, node, config, partial(self._discard, config))

    def _discard(self, config: PdoConfig) -> None:
        old = self._active.pop(config, None)
        self._refused += 0 if old is None else old.refused
        self._pdos_changed = True

    @property
    def refused(self) -> int:
        """The number of values of RPDOs that the dictionary refused, and of TPDOs that did not fit their bits."""
        return self._refused + sum(pdo.refused for pdo in self._active.values())

    @property
    def active(self) -> tuple[ActivePdo, ...]:
        """All PDOs as configured now, in the order of `pdos`. A value that an RPDO stores may change the configuration,
        so this is a copy."""
        self._follow_records()
        return tuple(self._active.values())

    def _follow_records(self) -> None:
        if self._pdos_changed:
            self._active = {
                config: self._active.get(config) or ActivePdo(config, self.objects, self.node) for config in self.pdos
            }
            self._pdos_changed = False
            self._receives = self._identifiers()

    @property
    def receives(self) -> frozenset[tuple[int, bool]] | None:
        """The (identifier, extended) of the RPDOs, and of the TPDOs that a remote frame may request, apart from SYNC.
        None: any, because an RPDO may change the configuration. It is the same object until a record is written."""
        if not self._running:
            return _NOTHING
        self._follow_records()
        return self._receives

    def _identifiers(self) -> frozenset[tuple[int, bool]] | None:
        used = [pdo for pdo in self._active.values() if pdo.is_on and not (pdo.is_tpdo and pdo.cob.bit30)]
        for pdo in used:
            mapped = () if pdo.is_tpdo else pdo.mapping.entries
            if pdo.mpdo_consumer is not None or any(0x1000 <= entry.index < 0x2000 for entry in mapped):
                return None
        return frozenset(pdo.key for pdo in used)

    @property
    def deadline(self) -> float | None:
        """The time at which the next inhibit time or event timer ends."""
        if not self._running:
            return None
        return min((due for pdo in self.active if pdo.is_on and (due := pdo.due) is not None), default=None)

    def start(self) -> None:
        """Start, because the device became operational: TPDOs of type 254 and 255 are due, SYNCs are counted."""
        self.stop()
        self._running = True

    def stop(self) -> None:
        """Stop, because the device is no longer operational, and discard held data."""
        self._refused = self.refused
        self._active.clear()
        self._pdos_changed = True
        self._running = False
        self._synced_at = None

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        """Return the PDOs and emergencies to send after a received frame, or after time passed (None)."""
        if not self._running:
            return []
        frames: list[CanFrame] = []
        if frame is not None:
            if frame.remote:
                frames += self._remote_request(frame, now)
            elif frame.key == self.sync_key:
                frames += self._sync(frame, now)
            else:
                frames += self._receive(frame, now)
        # After the frame, because what it stored may be what a TPDO sends, or its configuration.
        for pdo in self.active:
            due = pdo.due if pdo.is_on else None
            if due is None or now < due:
                continue
            if pdo.is_tpdo:
                frames.append(self._send(pdo, now))
            else:
                pdo.received_at = None  # the timer runs again from the next reception, so that this is reported once
                index = pdo.config.communication.to_bytes(2, "little")
                frames += self.errors.error(_MISSED, now, source=pdo.config.number, info=index)
        return frames

    def _receive(self, frame: CanFrame, now: float) -> list[CanFrame]:
        frames: list[CanFrame] = []
        for pdo in self.active:
            if pdo.is_tpdo or not pdo.is_on or frame.key != pdo.key:
                continue
            size = pdo.mapping.size if pdo.mpdo_consumer is None else MPDO_SIZE
            frames += self._check_length(pdo, len(frame.data), size, now)
            if len(frame.data) < size:
                continue
            pdo.received_at = now
            if pdo.mpdo_consumer is not None:
                frames += self._receive_mpdo(pdo, pdo.mpdo_consumer, frame._replace(data=frame.data[:size]), now)
            elif not pdo.on_sync:
                pdo.store(frame.data[:size])
            elif self.window and self._synced_at is not None and now > self._synced_at + self.window:
                self.outside_window += 1
            else:
                pdo.held = frame.data[:size]
        return frames

    def _receive_mpdo(self, pdo: ActivePdo, consumer: MpdoConsumer, frame: CanFrame, now: float) -> list[CanFrame]:
        try:
            message = Mpdo.decode(frame)
        except DecodeError:
            consumer.refused += 1
            return []
        stored, source = consumer.store(message), pdo.config.number
        if stored is None or consumer.addressing == "SAM":
            return []
        if stored:
            return self.errors.error_gone(_NO_DESTINATION, now, source=source)
        info = message.index.to_bytes(2, "little") + bytes([message.sub])
        return self.errors.error(_NO_DESTINATION, now, source=source, info=info)

    def send_mpdo(self, number: int, message: Mpdo, now: float) -> list[CanFrame]:
        """Queue a DAM message for TPDO `number`. Its node is the destination; 0 stands for all nodes.

        The inhibit time applies as for any TPDO. Return the frames to send now. Raise EncodeError if there is no such
        TPDO, or if the device is not operational.
        """
        for pdo in self.active if self._running else ():
            producer = pdo.mpdo_producer
            if pdo.config.number == number and pdo.is_on and producer is not None:
                if producer.addressing != message.addressing or producer.addressing == "SAM":
                    break
                producer.queue(message)
                return self.feed(None, now)
        raise EncodeError(f"TPDO{number} is not a DAM MPDO in use now")

    def _check_length(self, pdo: ActivePdo, length: int, size: int, now: float) -> list[CanFrame]:
        """Report an RPDO of wrong length, and clear the errors that no longer apply."""
        source = pdo.config.number
        frames: list[CanFrame] = []
        if length < size:
            frames += self.errors.error(_TOO_SHORT, now, source=source, info=bytes([length, size]))
            resolved = [_TOO_LONG]  # it is ignored, so one that was missed is still missing
        elif length > size:
            frames += self.errors.error(_TOO_LONG, now, source=source, info=bytes([length, size]))
            resolved = [_TOO_SHORT, _MISSED]
        else:
            resolved = [_TOO_SHORT, _TOO_LONG, _MISSED]
        for code in resolved:
            frames += self.errors.error_gone(code, now, source=source)
        return frames

    def _sync(self, frame: CanFrame, now: float) -> list[CanFrame]:
        try:
            counter = sync_counter(frame.data)
        except DecodeError:
            return []
        self._synced_at = now
        # Received data takes effect before TPDOs are sampled.   [CiA 301, synchronous PDOs]
        for pdo in self.active:
            if pdo.held is not None:
                held, pdo.held = pdo.held, None
                pdo.store(held)
        frames: list[CanFrame] = []
        for pdo in self.active:
            if not pdo.is_tpdo or not pdo.is_on:
                continue
            if pdo.type == RTR_AT_SYNC:
                pdo.sent = pdo.sample(to_send=True)  # at the next remote request
            elif pdo.on_sync and pdo.is_due_at_sync(counter):
                frames.append(self._send(pdo, now))
        return frames

    def _remote_request(self, frame: CanFrame, now: float) -> list[CanFrame]:
        frames: list[CanFrame] = []
        for pdo in self.active:
            if not pdo.is_tpdo or not pdo.is_on or pdo.cob.bit30 or frame.key != pdo.key:
                continue
            if pdo.mpdo_producer is not None:
                continue  # its frames are for one object each: there is nothing that a request could ask for
            if pdo.type != RTR_AT_SYNC:
                frames.append(self._send(pdo, now))
            elif pdo.sent is not None:
                frames.append(CanFrame(pdo.key[0], pdo.sent, pdo.key[1]))
        return frames

    def _send(self, pdo: ActivePdo, now: float) -> CanFrame:
        pdo.sent, pdo.sent_at = pdo.next_data(), now
        return CanFrame(pdo.key[0], pdo.sent, pdo.key[1])
