"""Listening in on a CAN bus: every frame in, what it means out. A machine that never speaks.

    listener = Listener([of_device(load("az3"), 5)])
    events = listener.feed(frame, now)            CanFrame, FdFrame, ErrorFrame, Dropped; None: time has passed
    events = listener.end(now)

**A hole in the recording is not silence on the bus.** Live, whoever feeds None at every `deadline` was there all the
time: what is missing then is missing. In a recording nobody knows, so frames alone are fed; and when everything that
beats (heartbeats, SYNC) and everything under way (transfers) fell silent at once, it was the recorder that fell silent.
Two witnesses are enough. A recorder that says so itself (`Dropped`, an overrun of its controller) is believed.

Memory is bounded: 127 nodes, `channels.CHANNELS_MAX` SDO channels, `transfer.HELD_MAX` bytes of values, and what the
parts say.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from barewire.canopen.cob_ids import Service, classify, is_restricted
from barewire.canopen.frame import AnyFrame, CanFrame, ErrorFrame, FdFrame
from barewire.explain.can_monitor.channel import GIVE_UP, SdoTracker
from barewire.explain.can_monitor.channels import SdoChannels
from barewire.explain.can_monitor.events import (
    BusErrorReport,
    ForeignFrameReport,
    Gap,
    MonitorEvent,
    NodeReport,
    SdoTransferReport,
    Summary,
    Violation,
)
from barewire.explain.can_monitor.nodes import NodeTracker
from barewire.explain.can_monitor.pdos import PdoTracker
from barewire.explain.can_monitor.services import (
    LssTracker,
    SyncTracker,
    hear_emergency,
    hear_time,
)
from barewire.explain.can_monitor.transfer import HELD_MAX, HeldBytes
from barewire.explain.canopen.frame import error_frame_text, is_overrun
from barewire.explain.canopen.known_node import KnownNode
from barewire.explain.capture.model import Dropped

BROKEN_MAX = 4096
"""So many different violations are told apart from repeated ones."""
HEARTBEAT_TIME = 0x1017
WITNESSES = 2
BACKWARDS = 1.0
"""A clock that goes back by less is a recorder that mixed up two frames."""
GFC = 0x001
"""The global fail-safe command of CiA 304: the one identifier in the reserved range that has a use of its own."""
SILENT = 1.0
"""A transfer is a witness when it did not go on for so many seconds."""


class CanMonitor:
    """One bus.

    >>> listener = CanMonitor()
    >>> [event.kind for event in listener.feed(CanFrame.parse("705#00"), 0.0)]
    ['boot-up']
    >>> _ = listener.feed(CanFrame.parse("605#4041600000000000"), 0.1)
    >>> [(event.direction, event.data) for event in listener.feed(CanFrame.parse("585#4B41600037060000"), 0.101)]
    [('upload', b'7\\x06')]
    """

    def __init__(self, known: Iterable[KnownNode] = (), *, give_up: float = GIVE_UP, held: int = HELD_MAX) -> None:
        self.frames = 0
        self.counts: Counter[str] = Counter()
        self.memory = HeldBytes(held)
        self.nodes = NodeTracker()
        described = tuple(known)
        self.pdos = PdoTracker(described)
        self.sync = SyncTracker()
        self.lss = LssTracker()
        dialects = {one.node: one.commands for one in described}
        self.channels = SdoChannels(self.memory, give_up, dialects, self.pdos)
        self.violations: Counter[str] = Counter()
        self._broken: set[tuple[str, int, str]] = set()
        self._first: float | None = None
        self._last = 0.0
        self._foreign: set[str] = set()
        self._error: ErrorFrame | None = None

    @property
    def now(self) -> float:
        """When the last frame came."""
        return self._last

    @property
    def deadline(self) -> float | None:
        """When something is missing if nothing comes."""
        dues = (self.channels.deadline, self.nodes.deadline, self.sync.deadline)
        return min((due for due in dues if due is not None), default=None)

    def feed(self, item: AnyFrame | Dropped | None, now: float) -> list[MonitorEvent]:
        """What the item tells, and before that what was due."""
        return [self._judged(event) if isinstance(event, Violation) else event for event in self._feed(item, now)]

    def _judged(self, violation: Violation) -> Violation:
        """Counted; and marked if the same was told before."""
        self.violations[violation.rule] += 1
        same = violation.rule, violation.node, violation.text
        if same in self._broken:
            return violation._replace(repeated=True)
        if len(self._broken) < BROKEN_MAX:
            self._broken.add(same)
        return violation

    def _feed(self, item: AnyFrame | Dropped | None, now: float) -> list[MonitorEvent]:
        events: list[MonitorEvent] = []
        if self._first is None:
            self._first = self._last = now
        if now < self._last:
            if self._last - now > BACKWARDS:
                events.append(Gap(now, self._last, None, f"the clock goes back by {self._last - now:.3f} s"))
                self._interrupt(now)
                self._last = now
            now = self._last
        elif item is not None and (gap := self._silence(now)) is not None:
            events.append(gap)
            self._interrupt(now)
        events += self._pass_time(now)
        if item is None:
            return events
        self._last = now
        if isinstance(item, Dropped):
            self._interrupt(now)
            lost = "the recorder lost frames" if not item.frames else f"the recorder says that it lost {item.frames}"
            return [*events, Gap(now, None, item.frames or None, lost)]
        self.frames += 1
        if isinstance(item, CanFrame):
            events += self._hear(item, now)
        elif isinstance(item, ErrorFrame):
            events += self._error_frame(item, now)
        else:
            events += self._strange("CAN FD", item, now)
        return events

    def end(self, now: float) -> list[MonitorEvent]:
        """The recording is over: what was still under way, and how it was on the whole."""
        now = max(now, self._last)
        events = self._pass_time(now)
        events += [*self.channels.end(now), *self.lss.end(now), *self.sync.end(now)]
        counts = dict(sorted(self.counts.items()))
        if self.memory.refused:
            counts["bytes not held"] = self.memory.refused
        seconds = 0.0 if self._first is None else now - self._first
        return [*events, Summary(now, self.frames, seconds, counts, dict(sorted(self.violations.items())))]

    def takes_segment(self, frame: CanFrame) -> bool:
        """Whether this frame, coming now, would be a segment of a block: by its bytes alone nobody can tell."""
        found = self.channels.find(frame)
        return found is not None and found[0].takes_segment(found[1], frame.data)

    # Time

    def _pass_time(self, now: float) -> list[MonitorEvent]:
        due = self.deadline
        if due is None or due > now:
            return []
        events = [*self.nodes.pass_time(now), *self.sync.pass_time(now), *self.channels.pass_time(now)]
        return sorted(events, key=lambda event: event.at)

    def _silence(self, now: float) -> Gap | None:
        """Whether the silence before this frame was the recorder's."""
        silent = now - self._last
        if silent <= 0 or ((self.deadline or now) > now and silent < SILENT):
            return None
        nodes = self.nodes.overdue(now)
        beat = self.sync.deadline is not None and now >= self.sync.deadline
        waiting = self.channels.under_way if silent >= SILENT else 0
        if nodes + beat + waiting < WITNESSES:
            return None
        who = [f"{nodes} heartbeat{'s' if nodes > 1 else ''}"] if nodes else []
        who += ["SYNC"] if beat else []
        who += [f"{waiting} transfer{'s' if waiting > 1 else ''}"] if waiting else []
        return Gap(now, self._last, None, f"{', '.join(who)}: all silent at once for {silent:.3f} s")

    def _interrupt(self, now: float) -> None:
        self.nodes.interrupt(now)
        self.sync.interrupt()
        self.channels.interrupt()

    # Frames

    def _hear(self, frame: CanFrame, now: float) -> list[MonitorEvent]:
        channel = self.channels.find(frame)
        owner = classify(frame)
        if frame.extended and self.pdos.owner(frame) is None:
            return self._strange("extended identifier", frame, now)
        if channel is None and owner is None and not frame.extended and is_restricted(frame.id):
            self.counts["reserved"] += 1
            if frame.id == GFC:
                return []
            return [Violation(now, "ID-RESERVED", 0, f"{frame.id:03X}h is reserved", str(frame))]
        name = "SDO" if channel is not None else "other" if owner is None else owner[0].name
        if frame.remote and name not in ("other", "error control") and "PDO" not in name:
            self.counts["remote"] += 1
            return [Violation(now, "REMOTE-REQUEST", owner[1] if owner else 0, f"of {name}", str(frame))]
        if channel is not None:
            self.counts["SDO"] += 1
            return self._sdo(*channel, frame, now)
        if owner is None or "PDO" in owner[0].name:
            return self._process_data(frame, now)
        return self._service(owner[0], owner[1], frame, now)

    def _service(self, service: Service, node: int, frame: CanFrame, now: float) -> list[MonitorEvent]:
        self.counts[service.name.removesuffix(" request").removesuffix(" answer")] += 1
        match service.name:
            case "SDO request" | "SDO answer":
                channel = self.channels.channel(node)
                return [] if channel is None else self._sdo(channel, service.name == "SDO request", frame, now)
            case "NMT":
                return self.nodes.command(frame, now)
            case "SYNC":
                return self.sync.hear(frame, now)
            case "TIME":
                return hear_time(frame, now)
            case "EMCY":
                return [*self.nodes.allowed(node, "EMCY", True, frame, now), *hear_emergency(node, frame, now)]
            case "error control" if frame.remote:
                self.nodes.guard(node)
                return []
            case "error control":
                events = self.nodes.hear(node, frame, now)
                if any(isinstance(event, NodeReport) and event.kind == "boot-up" for event in events):
                    events += self.pdos.reset(node, now)
                return events
        return self.lss.hear(frame, now)

    def _process_data(self, frame: CanFrame, now: float) -> list[MonitorEvent]:
        self.counts["PDO"] += 1
        owner = self.pdos.owner(frame)
        events: list[MonitorEvent] = []
        if owner is not None and owner[1].startswith("T") and not frame.remote:
            events += self.nodes.allowed(owner[0], owner[1], True, frame, now)
        return [*events, *self.pdos.hear(frame, now)]

    # SDO, and what it teaches

    def _sdo(self, channel: SdoTracker, asks: bool, frame: CanFrame, now: float) -> list[MonitorEvent]:
        events = self.nodes.allowed(channel.node, "SDO", not asks, frame, now)
        events += self.channels.feed(channel, asks, frame, now)
        for event in list(events):
            if isinstance(event, SdoTransferReport) and event.outcome == "done" and event.data is not None:
                events += self._learn(event, event.data, now)
        return events

    def _learn(self, event: SdoTransferReport, data: bytes, now: float) -> list[MonitorEvent]:
        """Objects that say how the bus is used."""
        node, index, sub = event.node, event.index or 0, event.sub or 0
        number = int.from_bytes(data[:8], "little")
        if index == HEARTBEAT_TIME:
            self.nodes.tell_period(node, (number & 0xFFFF) / 1000)
        self.channels.learn(node, index, sub, number)
        return self.pdos.learn(node, index, sub, data, now)

    # What is no classical frame

    def _strange(self, what: str, frame: CanFrame | FdFrame, now: float) -> list[MonitorEvent]:
        self.counts[what] += 1
        if what in self._foreign:
            return []
        self._foreign.add(what)
        return [ForeignFrameReport(now, what, str(frame))]

    def _error_frame(self, frame: ErrorFrame, now: float) -> list[MonitorEvent]:
        self.counts["error frame"] += 1
        repeated, self._error = frame == self._error, frame
        events: list[MonitorEvent] = [BusErrorReport(now, frame.classes, error_frame_text(frame), repeated)]
        if is_overrun(frame):
            events.append(Gap(now, None, None, "the controller of the recorder was overrun"))
            self.channels.interrupt()
        return events
