"""All SDO channels of a bus: the default ones of each node, and further ones that somebody configures.

605h / 585h        600h and 580h plus the node-ID: known beforehand
1201h:01, :02      the COB-IDs of one more server channel: learned when they are written or read
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

from barewire.canopen.frame import CanFrame
from barewire.explain.can_monitor.channel import SdoTracker
from barewire.explain.can_monitor.events import MonitorEvent, SdoTransferReport
from barewire.explain.can_monitor.pdos import PdoTracker
from barewire.explain.can_monitor.transfer import HeldBytes

CHANNELS_MAX = 512
_OFF_OR_EXTENDED = 0xA000_0000


class SdoChannels:
    """The listeners of all channels, found by the identifier of a frame. A machine."""

    def __init__(
        self, memory: HeldBytes, patience: float, dialects: Mapping[int, tuple[int, ...]], pdos: PdoTracker
    ) -> None:
        self._memory = memory
        self._patience = patience
        self._dialects = dialects
        self._pdos = pdos
        self._channels: dict[int, SdoTracker] = {}  # by the COB-ID of the requests
        self._ids: dict[int, tuple[SdoTracker, bool]] = {}
        self._half: dict[tuple[int, int], dict[int, int]] = {}  # further channels, of which one COB-ID was heard

    def __iter__(self) -> Iterator[SdoTracker]:
        return iter(self._channels.values())

    def find(self, frame: CanFrame) -> tuple[SdoTracker, bool] | None:
        """The channel of a frame, and whether the client says it."""
        return None if frame.extended else self._ids.get(frame.id)

    def channel(self, node: int, request: int | None = None, answer: int | None = None) -> SdoTracker | None:
        """The default channel of a node, or another one. None if there are too many."""
        asks, answers = 0x600 + node if request is None else request, 0x580 + node if answer is None else answer
        if asks not in self._channels and len(self._channels) < CHANNELS_MAX:
            dialect = self._dialects.get(node, ())
            self._channels[asks] = listener = SdoTracker(node, asks, self._memory, self._patience, dialect)
            self._ids[asks], self._ids[answers] = (listener, True), (listener, False)
        return self._channels.get(asks)

    @property
    def deadline(self) -> float | None:
        """When the first transfer is given up."""
        dues = (channel.deadline for channel in self._channels.values() if channel.open is not None)
        return min((due for due in dues if due is not None), default=None)

    @property
    def under_way(self) -> int:
        """How many transfers are under way."""
        return sum(channel.open is not None for channel in self._channels.values())

    def feed(self, channel: SdoTracker, asks: bool, frame: CanFrame, now: float) -> list[MonitorEvent]:
        """A frame of a channel."""
        return self._named(channel.feed(asks, frame, now))

    def pass_time(self, now: float) -> list[MonitorEvent]:
        """Transfers that nobody goes on with."""
        return self._named(
            [event for one in self._channels.values() if one.open is not None for event in one.pass_time(now)]
        )

    def interrupt(self) -> None:
        """The recording has a hole here."""
        for channel in self._channels.values():
            channel.interrupt()

    def end(self, now: float) -> list[MonitorEvent]:
        """The recording is over."""
        return self._named([event for channel in self._channels.values() for event in channel.end(now)])

    def learn(self, node: int, index: int, sub: int, number: int) -> None:
        """An object 1201h to 127Fh of a node has this value."""
        if not 0x1201 <= index <= 0x127F or sub not in (1, 2):
            return
        half = self._half.setdefault((node, index), {}) if len(self._half) < CHANNELS_MAX else {}
        half[sub] = number
        if len(half) == 2 and not any(word & _OFF_OR_EXTENDED for word in half.values()):
            self.channel(node, half[1] & 0x7FF, half[2] & 0x7FF)

    def _named(self, events: list[MonitorEvent]) -> list[MonitorEvent]:
        """Transfers with the name of their object, and their value in words."""
        return [self._with_name(event) if isinstance(event, SdoTransferReport) else event for event in events]

    def _with_name(self, event: SdoTransferReport) -> SdoTransferReport:
        known = self._pdos.object(event.node, event.index, event.sub)
        if known is None:
            return event
        return replace(event, name=known.name, text=known.read(event.data) if event.data is not None else "")
