"""The SYNC of a device, as its objects 1005h, 1006h, 1007h and 1019h configure it.   [CiA 301, SYNC]

        1005h  bit 30: this device produces SYNC             1007h  window in us: a synchronous RPDO that arrives
        1006h  period in us                                         later than that after a SYNC is not used
        1019h  0: no counter, else its greatest value

        a SYNC of the wrong length (with or without counter, by 1019h)   ->  emergency 8240h, and the SYNC is ignored

The counter is 1 in the first SYNC after the boot-up and after STOPPED. The first SYNC is sent one period after bit 30
was set.
"""

from __future__ import annotations

from barewire.canopen.abort_codes import AbortCode, SdoAbort
from barewire.canopen.cob_ids import SYNC_KEY, CobEntry
from barewire.canopen.communication_objects import integer_value, validate_cob_id_writes, validate_writes
from barewire.canopen.frame import CanFrame
from barewire.canopen.object_dictionary import ObjectDictionary
from barewire.canopen.sync import COUNTER_MAX, SyncProducer

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

    __slots__ = ("_counts", "_values", "key", "objects", "producer", "window")

    def __init__(self, objects: ObjectDictionary) -> None:
        self.objects = objects
        self.key = SYNC_KEY
        self.window = 0.0
        self.producer: SyncProducer | None = None
        self._counts: int | None = None
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
            return
        before, self._values = self._values, values
        word, period, window, overflow = values
        entry = CobEntry.unpack(word)
        self.key = (entry.identifier, entry.extended)
        self.window = window / 1_000_000
        self._counts = None if overflow < 0 else overflow
        if before is not None and (before[0], before[1], before[3]) == (word, period, overflow):
            return  # a new window does not restart the producer
        self.producer = None
        if entry.bit30 and period:
            counts = overflow if 1 < overflow <= COUNTER_MAX else 0
            self.producer = SyncProducer(period / 1_000_000, overflow=counts, key=self.key)
            self.producer.start(now)

    def feed(self, frame: CanFrame | None, now: float) -> tuple[list[CanFrame], CanFrame | None, bool | None]:
        """Return the frames to send, the SYNC that takes effect now or None, and whether a received SYNC had a wrong
        length (None if the frame was not a SYNC)."""
        if frame is not None and frame.key == self.key and not frame.remote:
            if self._counts is not None and len(frame.data) != (self._counts > 0):
                return [], None, True
            return [], frame, False
        frames = [] if self.producer is None else self.producer.feed(None, now)
        return frames, frames[0] if frames else None, None
