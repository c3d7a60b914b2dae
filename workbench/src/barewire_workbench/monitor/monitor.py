"""The monitor of one CAN bus: frames in, events out. A machine that never sends.

    monitor = CanMonitor([of_device(load("az3"), 5)])
    events = monitor.feed(frame, now)            CanFrame, FdFrame, ErrorFrame, Dropped; None: time has passed
    events = monitor.end(now)

With `complete` the caller promises that the recording has every frame: what would be a gap is a violation.

**A gap in the recording is not silence on the bus.** A live caller feeds None at every `deadline`, so no frame is
unrecorded, and a late heartbeat is missing. A caller with a recording feeds only frames: if two or more periodic
messages (heartbeats, SYNC) or transfers under way stop at once, the recorder has stopped, not the bus. A report of the
recorder about lost frames (`Dropped`, an overrun of its controller) is a gap too.

Memory is bounded: 127 nodes, `CHANNELS_MAX` SDO channels, `HELD_MAX` bytes of values, and the limits
of the parts.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from barewire.canopen.cob_ids import CobService, classify, is_restricted
from barewire.canopen.frame import AnyFrame, CanFrame, ErrorFrame, FdFrame
from barewire_workbench.frames.can import error_frame_text, explain_can, explain_segment, is_overrun
from barewire_workbench.frames.known_node import KnownNode
from barewire_workbench.frames.result import Explanation
from barewire_workbench.monitor.events import (
    BusErrorReport,
    ForeignFrameReport,
    Gap,
    MonitorEvent,
    NodeReport,
    SdoTransferReport,
    Summary,
    Violation,
)
from barewire_workbench.monitor.nodes import NodeTracker
from barewire_workbench.monitor.pdos import PdoTracker
from barewire_workbench.monitor.sdo_channel import GIVE_UP, SdoChannels, SdoTracker
from barewire_workbench.monitor.sdo_transfer import HELD_MAX, HeldBytes
from barewire_workbench.monitor.services import (
    LssTracker,
    SyncTracker,
    emergency_events,
    time_events,
)
from barewire_workbench.recordings.model import Dropped

_VIOLATIONS_MAX = 4096
"""The most different violations that are kept to find repeated ones."""
_HEARTBEAT_TIME = 0x1017
_WITNESSES = 2
"""The number of silent nodes, SYNC and transfers that proves a gap in the recording."""
_TRANSFER_SILENT = 1.0
"""Seconds after which a transfer counts as silent."""
_BACKWARDS = 1.0
"""Seconds: a clock that goes back by less means two frames in the wrong order."""
_GFC = 0x001
"""The global fail-safe command of CiA 304: the only identifier of the reserved range that has a use."""


class CanMonitor:
    """One bus. `known` describes its nodes; `give_up` is in seconds, `held` in bytes.

    >>> monitor = CanMonitor()
    >>> [event.kind for event in monitor.feed(CanFrame.parse("705#00"), 0.0)]
    ['boot-up']
    >>> _ = monitor.feed(CanFrame.parse("605#4041600000000000"), 0.1)
    >>> [(event.direction, event.data) for event in monitor.feed(CanFrame.parse("585#4B41600037060000"), 0.101)]
    [('upload', b'7\\x06')]
    """

    def __init__(
        self, known: Iterable[KnownNode] = (), *, give_up: float = GIVE_UP, held: int = HELD_MAX, complete: bool = False
    ) -> None:
        self.frames = 0
        self.counts: Counter[str] = Counter()
        self.held = HeldBytes(held)
        self.nodes = NodeTracker()
        described = tuple(known)
        self.pdos = PdoTracker(described)
        self.sync = SyncTracker()
        self.lss = LssTracker()
        dialects = {node.node: node.commands for node in described}
        self.channels = SdoChannels(self.held, give_up, dialects, self.pdos)
        self.violations: Counter[str] = Counter()
        self._reported: set[tuple[str, int, str]] = set()
        self._complete = complete
        self._first: float | None = None
        self._last = 0.0
        self._foreign: set[str] = set()
        self._error: ErrorFrame | None = None
        self._last_frame = ""

    @property
    def now(self) -> float:
        """The time of the last frame."""
        return self._last

    @property
    def deadline(self) -> float | None:
        """When the first of nodes, SYNC and transfers counts as missing."""
        dues = (self.channels.deadline, self.nodes.deadline, self.sync.deadline)
        return min((due for due in dues if due is not None), default=None)

    def feed(self, item: AnyFrame | Dropped | None, now: float) -> list[MonitorEvent]:
        """Take an item (None: only time has passed). Returns its events, after the events that were due before."""
        frame = str(item) if isinstance(item, CanFrame) else ""
        events = [self._judged(event, frame) for event in self._feed(item, now)]
        return [self._count(event) if isinstance(event, Violation) else event for event in events]

    def _judged(self, event: MonitorEvent, frame: str) -> MonitorEvent:
        """Return a gap within a complete recording as the violation that it is."""
        if not self._complete or not isinstance(event, Gap) or not event.rule:
            return event
        return Violation(event.at, event.rule, event.node, event.evidence, frame)

    def _count(self, violation: Violation) -> Violation:
        """Count a violation, and mark it if the same was reported before."""
        self.violations[violation.rule] += 1
        same = violation.rule, violation.node, violation.text
        if same in self._reported:
            return violation._replace(repeated=True)
        if len(self._reported) < _VIOLATIONS_MAX:
            self._reported.add(same)
        return violation

    def _feed(self, item: AnyFrame | Dropped | None, now: float) -> list[MonitorEvent]:
        events: list[MonitorEvent] = []
        if self._first is None:
            self._first = self._last = now
        # A time that goes back a little is that of a frame in the wrong order; more than that, a clock that was set.
        if now < self._last:
            if self._last - now > _BACKWARDS:
                events.append(Gap(now, self._last, None, f"the clock goes back by {self._last - now:.3f} s"))
                self._interrupt(now)
                self._last = now
            now = self._last
        elif item is not None and not self._complete and (gap := self._silence(now)) is not None:
            events.append(gap)
            self._interrupt(now)
        events += self._pass_time(now)  # before the frame: what was due is not caused by it
        if item is None:
            return events
        self._last = now
        if isinstance(item, Dropped):
            self._interrupt(now)  # a heartbeat or an end of a transfer may be among the lost frames
            lost = "the recorder lost frames" if not item.frames else f"the recorder reports {item.frames} lost"
            return [*events, Gap(now, None, item.frames or None, lost)]
        self.frames += 1
        self._last_frame = str(item)
        if isinstance(item, CanFrame):
            events += self._classical(item, now)
        elif isinstance(item, ErrorFrame):
            events += self._error_frame(item, now)
        else:
            events += self._report_foreign("CAN FD", item, now)
        return events

    def end(self, now: float) -> list[MonitorEvent]:
        """End the recording: report the transfers under way, and a summary."""
        now = max(now, self._last)
        events = self._pass_time(now)
        events += [*self.channels.end(now), *self.lss.end(now), *self.sync.end(now)]
        counts = dict(sorted(self.counts.items()))
        if self.held.refused:
            counts["bytes not held"] = self.held.refused
        seconds = 0.0 if self._first is None else now - self._first
        events = [self._judged(event, self._last_frame) for event in events]
        events = [self._count(event) if isinstance(event, Violation) else event for event in events]
        return [*events, Summary(now, self.frames, seconds, counts, dict(sorted(self.violations.items())))]

    def takes_segment(self, frame: CanFrame) -> bool:
        """Return whether this frame, coming now, would be a segment of a block. Its bytes alone do not show it."""
        found = self.channels.find(frame)
        return found is not None and found[0].takes_segment(found[1], frame.data)

    def explain(self, frame: AnyFrame) -> Explanation:
        """Explain a frame that comes now: in a block transfer it may be a segment, and a PDO has a mapping."""
        if isinstance(frame, CanFrame) and self.takes_segment(frame):
            return explain_segment(frame)
        return explain_can(frame, self.pdos)

    # Time

    def _pass_time(self, now: float) -> list[MonitorEvent]:
        due = self.deadline
        if due is None or due > now:
            return []
        events = [*self.nodes.pass_time(now), *self.sync.pass_time(now), *self.channels.pass_time(now)]
        return sorted(events, key=lambda event: event.at)

    def _silence(self, now: float) -> Gap | None:
        """Return a gap if the recorder was silent before this frame."""
        silent = now - self._last
        if silent <= 0 or ((self.deadline or now) > now and silent < _TRANSFER_SILENT):
            return None
        nodes = self.nodes.overdue(now)
        sync = self.sync.deadline is not None and now >= self.sync.deadline
        waiting = self.channels.under_way if silent >= _TRANSFER_SILENT else 0
        if nodes + sync + waiting < _WITNESSES:
            return None
        silent_ones = [f"{nodes} heartbeat{'s' if nodes > 1 else ''}"] if nodes else []
        silent_ones += ["SYNC"] if sync else []
        silent_ones += [f"{waiting} transfer{'s' if waiting > 1 else ''}"] if waiting else []
        return Gap(now, self._last, None, f"{', '.join(silent_ones)}: all silent at once for {silent:.3f} s")

    def _interrupt(self, now: float) -> None:
        self.nodes.interrupt(now)
        self.sync.interrupt()
        self.channels.interrupt()

    # Frames

    def _classical(self, frame: CanFrame, now: float) -> list[MonitorEvent]:
        channel = self.channels.find(frame)
        owner = classify(frame)
        if frame.extended and self.pdos.owner(frame) is None:
            return self._report_foreign("extended identifier", frame, now)
        if channel is None and owner is None and not frame.extended and is_restricted(frame.id):
            self.counts["reserved"] += 1
            if frame.id == _GFC:
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

    def _service(self, service: CobService, node: int, frame: CanFrame, now: float) -> list[MonitorEvent]:
        self.counts[service.name.removesuffix(" request").removesuffix(" answer")] += 1
        match service.name:
            case "SDO request" | "SDO answer":
                channel = self.channels.channel(node)
                return [] if channel is None else self._sdo(channel, service.name == "SDO request", frame, now)
            case "NMT":
                return self.nodes.command(frame, now)
            case "SYNC":
                return self.sync.feed(frame, now)
            case "TIME":
                return time_events(frame, now)
            case "EMCY":
                return [*self.nodes.check_allowed(node, "EMCY", True, frame, now), *emergency_events(node, frame, now)]
            case "error control" if frame.remote:
                self.nodes.guarding_request(node)
                return []
            case "error control":
                events = self.nodes.feed(node, frame, now)
                if any(isinstance(event, NodeReport) and event.kind == "boot-up" for event in events):
                    events += self.pdos.reset(node, now)
                return events
        return self.lss.feed(frame, now)

    def _process_data(self, frame: CanFrame, now: float) -> list[MonitorEvent]:
        self.counts["PDO"] += 1
        pdo = self.pdos.owner(frame)
        events: list[MonitorEvent] = []
        if pdo is not None and pdo.name.startswith("T") and not frame.remote:
            events += self.nodes.check_allowed(pdo.node, pdo.name, True, frame, now)
        return [*events, *self.pdos.feed(frame, now)]

    # SDO, and the configuration that it shows

    def _sdo(self, channel: SdoTracker, from_client: bool, frame: CanFrame, now: float) -> list[MonitorEvent]:
        events = self.nodes.check_allowed(channel.node, "SDO", not from_client, frame, now)
        events += self.channels.feed(channel, from_client, frame, now)
        for event in list(events):
            if isinstance(event, SdoTransferReport) and event.outcome == "done" and event.data is not None:
                events += self._learn(event, event.data, now)
        return events

    def _learn(self, event: SdoTransferReport, data: bytes, now: float) -> list[MonitorEvent]:
        """Take the value of an object that configures a service."""
        node, index, sub = event.node, event.index or 0, event.sub or 0
        number = int.from_bytes(data[:8], "little")
        if index == _HEARTBEAT_TIME:
            self.nodes.set_period(node, (number & 0xFFFF) / 1000)
        self.channels.learn(node, index, sub, number)
        return self.pdos.learn(node, index, sub, data, now)

    # Frames that are not classical CAN

    def _report_foreign(self, what: str, frame: CanFrame | FdFrame, now: float) -> list[MonitorEvent]:
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
