"""PDOs in motion: a device's process data, moved by SYNC, by change, by time and on request.   [CiA 301, PDO]

                              RPDO                                    TPDO
        type 254, 255         into the dictionary at once             out when its data changed, not sooner than
                                                                      the inhibit time, not later than the event timer
        type 0                held, in at the next SYNC               out at the next SYNC if its data changed
        type 1..240           held, in at the next SYNC               out at every n-th SYNC
        type 252, 253         -                                       out when asked by a remote frame, with the data
                                                                      of the last SYNC (252) or of now (253)

At a SYNC first what was received takes effect, then what is sent is sampled. A remote frame is answered by every TPDO
whose COB-ID allows it (bit 30 is 0).

        8210h  an RPDO was shorter than mapped, and not used           info: received, mapped length
        8220h  one was longer: used as far as mapped                   info: received, mapped length
        8250h  no RPDO for the event timer of its record               info: index of the record
        8230h  a DAM MPDO names an object that is not here             info: index, sub-index

Each of these errors is said once; it is gone when a good one came.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial

from barewire.canopen.cob_ids import SYNC_KEY
from barewire.canopen.emcy.producer import EmcyProducer
from barewire.canopen.frame import CanFrame
from barewire.canopen.object_dictionary import ObjectDictionary
from barewire.canopen.pdo.active import ActivePdo
from barewire.canopen.pdo.config import RTR_AT_SYNC, PdoConfig, add_records
from barewire.canopen.pdo.multiplexed import MPDO_SIZE, Mpdo, MpdoConsumer
from barewire.canopen.sync import sync_counter
from barewire.errors import DecodeError, EncodeError

TOO_SHORT, TOO_LONG, MISSED, NO_DESTINATION = 0x8210, 0x8220, 0x8250, 0x8230


class PdoEngine:
    """All PDOs of one device, to be fed while it is operational. A machine.

    The engine puts their records into the dictionary, so they can be changed by SDO; it looks at them again whenever
    one was written. `refused` counts values that the dictionary did not take, `outside_window` synchronous RPDOs that
    came later than `window` seconds after a SYNC (0: any time will do). `sync_key` is what a SYNC looks like.
    """

    __slots__ = ("_live", "_pdos_changed", "_refused", "_running", "_synced_at", "errors", "node", "objects",
                 "outside_window", "pdos", "sync_key", "window")  # fmt: skip

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
        self._live: dict[PdoConfig, ActivePdo] = {}
        self._pdos_changed = True
        numbers = [(pdo.direction, pdo.number) for pdo in self.pdos]
        for direction, number in numbers:
            if numbers.count((direction, number)) > 1:
                raise EncodeError(f"{direction}{number} is there twice")
        for pdo in self.pdos:
            add_records(objects, node, pdo, partial(self._forget, pdo))

    def _forget(self, pdo: PdoConfig) -> None:
        """A record was written: that PDO begins anew, the others go on."""
        gone = self._live.pop(pdo, None)
        self._refused += 0 if gone is None else gone.all_refused
        self._pdos_changed = True

    @property
    def refused(self) -> int:
        """Values that the dictionary did not take from an RPDO, or did not fit the bits of a TPDO."""
        return self._refused + sum(live.all_refused for live in self._live.values())

    @property
    def live(self) -> Iterable[ActivePdo]:
        """Every PDO as configured now, in the order in which the device lists them."""
        if self._pdos_changed:
            self._live = {pdo: self._live.get(pdo) or ActivePdo(pdo, self.objects, self.node) for pdo in self.pdos}
            self._pdos_changed = False
        return self._live.values()

    @property
    def deadline(self) -> float | None:
        """When an inhibit time ends that holds something back, an event timer, or the patience with an RPDO."""
        if not self._running:
            return None
        return min((due for live in self.live if live.is_on and (due := live.due) is not None), default=None)

    def start(self) -> None:
        """The device became operational: every TPDO of type 254 and 255 is due, every count of SYNCs begins."""
        self.stop()
        self._running = True

    def stop(self) -> None:
        """The device is no longer operational: what was held is forgotten."""
        self._refused = self.refused
        self._live.clear()
        self._pdos_changed = True
        self._running = False
        self._synced_at = None

    def feed(self, frame: CanFrame | None, now: float) -> list[CanFrame]:
        """What a frame and the time bring about."""
        if not self._running:
            return []
        said: list[CanFrame] = []
        if frame is not None:
            if frame.remote:
                said += self._asked(frame, now)
            elif frame.key == self.sync_key:
                said += self._sync(frame, now)
            else:
                said += self._receive(frame, now)
        for live in self.live:
            if not live.is_on:
                continue
            due = live.due
            if due is None or now < due:
                continue
            if live.is_tpdo:
                said.append(self._send(live, now))
            else:
                live.heard_at = None
                index = live.pdo.communication.to_bytes(2, "little")
                said += self.errors.error(MISSED, now, source=live.pdo.number, info=index)
        return said

    def _receive(self, frame: CanFrame, now: float) -> list[CanFrame]:
        said: list[CanFrame] = []
        for live in self.live:
            if live.is_tpdo or not live.is_on or frame.key != live.key:
                continue
            size = live.mapping.size if live.into is None else MPDO_SIZE
            said += self._judge(live, len(frame.data), size, now)
            if len(frame.data) < size:
                continue
            live.heard_at = now
            if live.into is not None:
                said += self._dispatch(live, live.into, frame._replace(data=frame.data[:size]), now)
            elif not live.on_sync:
                live.take(frame.data[:size])
            elif self.window and self._synced_at is not None and now > self._synced_at + self.window:
                self.outside_window += 1
            else:
                live.held = frame.data[:size]
        return said

    def _dispatch(self, live: ActivePdo, into: MpdoConsumer, frame: CanFrame, now: float) -> list[CanFrame]:
        """A multiplexed RPDO: to where it says itself, or our list."""
        try:
            message = Mpdo.decode(frame)
        except DecodeError:
            into.refused += 1
            return []
        taken, source = into.take(message), live.pdo.number
        if taken is None or into.addressing == "SAM":
            return []
        if taken:
            return self.errors.error_gone(NO_DESTINATION, now, source=source)
        info = message.index.to_bytes(2, "little") + bytes([message.sub])
        return self.errors.error(NO_DESTINATION, now, source=source, info=info)

    def tell(self, number: int, message: Mpdo, now: float) -> list[CanFrame]:
        """Say something to another node, or to all (node 0), by TPDO `number`, which has to be a DAM MPDO.

        It waits for the inhibit time like any other. EncodeError if there is no such TPDO, or the device is not
        operational.
        """
        for live in self.live if self._running else ():
            out = live.out
            if live.pdo.number == number and live.is_on and out is not None:
                if out.addressing != message.addressing or out.addressing == "SAM":
                    break
                out.tell(message)
                return self.feed(None, now)
        raise EncodeError(f"TPDO{number} is no DAM MPDO that is in use now")

    def _judge(self, live: ActivePdo, length: int, size: int, now: float) -> list[CanFrame]:
        """The errors that an RPDO of this length brings, and those that it takes away."""
        source = live.pdo.number
        wrong = TOO_SHORT if length < size else TOO_LONG if length > size else 0
        said = self.errors.error(wrong, now, source=source, info=bytes([length, size])) if wrong else []
        for code in (TOO_SHORT, TOO_LONG, MISSED):
            if code != wrong and not (code == MISSED and wrong == TOO_SHORT):
                said += self.errors.error_gone(code, now, source=source)
        return said

    def _sync(self, frame: CanFrame, now: float) -> list[CanFrame]:
        try:
            counter = sync_counter(frame.data)
        except DecodeError:
            return []
        self._synced_at = now
        for live in self.live:
            if live.held is not None:
                held, live.held = live.held, None
                live.take(held)
        said: list[CanFrame] = []
        for live in self.live:
            if not live.is_tpdo or not live.is_on:
                continue
            if live.type == RTR_AT_SYNC:
                live.sent = live.sample()
            elif live.on_sync and live.beat(counter):
                said.append(self._send(live, now))
        return said

    def _asked(self, frame: CanFrame, now: float) -> list[CanFrame]:
        """A remote frame: whoever owns its identifier says it."""
        said: list[CanFrame] = []
        for live in self.live:
            if not live.is_tpdo or not live.is_on or live.cob.bit30 or frame.key != live.key or live.out is not None:
                continue
            if live.type != RTR_AT_SYNC:
                said.append(self._send(live, now))
            elif live.sent is not None:
                said.append(CanFrame(live.key[0], live.sent, live.key[1]))
        return said

    def _send(self, live: ActivePdo, now: float) -> CanFrame:
        live.sent, live.sent_at = live.next_data(), now
        return CanFrame(live.key[0], live.sent, live.key[1])
