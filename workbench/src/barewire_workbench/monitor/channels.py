"""All SDO channels of a bus: the default channel of each node, and further channels that are configured.

605h / 585h        600h and 580h plus the node-ID: predefined
1201h:01, :02      the COB-IDs of one more server channel: learned when they are written or read
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from barewire.canopen.frame import CanFrame
from barewire_workbench.monitor.channel import SdoTracker
from barewire_workbench.monitor.events import MonitorEvent, SdoTransferReport
from barewire_workbench.monitor.pdos import PdoTracker
from barewire_workbench.monitor.transfer import HeldBytes

CHANNELS_MAX = 512
_OFF_OR_EXTENDED = 0xA000_0000


class SdoChannels:
    """The trackers of all channels, found by the identifier of a frame. A machine.

    `dialects` has command bytes with reserved bits by node; `pdos` has the objects of the nodes.
    """

    def __init__(
        self, held: HeldBytes, give_up: float, dialects: Mapping[int, tuple[int, ...]], pdos: PdoTracker
    ) -> None:
        self._held = held
        self._give_up = give_up
        self._dialects = dialects
        self._pdos = pdos
        self._channels: dict[int, SdoTracker] = {}  # by the COB-ID of the requests
        self._ids: dict[int, tuple[SdoTracker, bool]] = {}
        self._half: dict[tuple[int, int], dict[int, int]] = {}  # the COB-IDs learned of further channels

    def find(self, frame: CanFrame) -> tuple[SdoTracker, bool] | None:
        """Return the channel of a frame, and whether the client sent it."""
        return None if frame.extended else self._ids.get(frame.id)

    def channel(self, node: int, request: int | None = None, answer: int | None = None) -> SdoTracker | None:
        """Return the default channel of a node, or the one with these COB-IDs. None if there are too many."""
        requests, answers = 0x600 + node if request is None else request, 0x580 + node if answer is None else answer
        if requests not in self._channels and len(self._channels) < CHANNELS_MAX:
            tracker = SdoTracker(node, requests, self._held, self._give_up, self._dialects.get(node, ()))
            self._channels[requests] = tracker
            self._ids[requests], self._ids[answers] = (tracker, True), (tracker, False)
        return self._channels.get(requests)

    @property
    def deadline(self) -> float | None:
        """When the first transfer is given up."""
        dues = (channel.deadline for channel in self._channels.values())
        return min((due for due in dues if due is not None), default=None)

    @property
    def under_way(self) -> int:
        """The number of transfers under way."""
        return sum(channel.under_way for channel in self._channels.values())

    def feed(self, channel: SdoTracker, from_client: bool, frame: CanFrame, now: float) -> list[MonitorEvent]:
        """Take a frame of a channel."""
        return self._with_names(channel.feed(from_client, frame, now))

    def pass_time(self, now: float) -> list[MonitorEvent]:
        """Give up the transfers whose deadline has passed."""
        under_way = [channel for channel in self._channels.values() if channel.under_way]
        return self._with_names([event for channel in under_way for event in channel.pass_time(now)])

    def interrupt(self) -> None:
        """Note a gap in the recording."""
        for channel in self._channels.values():
            channel.interrupt()

    def end(self, now: float) -> list[MonitorEvent]:
        """End the recording: report the transfers under way as cut."""
        return self._with_names([event for channel in self._channels.values() for event in channel.end(now)])

    def learn(self, node: int, index: int, sub: int, number: int) -> None:
        """Add a channel from the value of an object 1201h to 127Fh."""
        if not 0x1201 <= index <= 0x127F or sub not in (1, 2):
            return
        half = self._half.setdefault((node, index), {}) if len(self._half) < CHANNELS_MAX else {}
        half[sub] = number
        if len(half) == 2 and not any(word & _OFF_OR_EXTENDED for word in half.values()):
            self.channel(node, half[1] & 0x7FF, half[2] & 0x7FF)

    def _with_names(self, events: list[MonitorEvent]) -> list[MonitorEvent]:
        """Return the events; transfers get the name of their object and their value as text."""
        return [self._with_name(event) if isinstance(event, SdoTransferReport) else event for event in events]

    def _with_name(self, event: SdoTransferReport) -> SdoTransferReport:
        known = self._pdos.object(event.node, event.index, event.sub)
        if known is None:
            return event
        return replace(event, name=known.name, text=known.read(event.data) if event.data is not None else "")
