"""SYNC, TIME, emergencies and LSS.   [CiA 301; CiA 305]

A SYNC counter that jumps is compared with the time: a step of four after four periods means that three SYNCs are not in
the recording; a step of four after one period is the producer's fault.
"""

from __future__ import annotations

from statistics import median
from typing import Literal

from barewire.canopen.emcy import Emergency
from barewire.canopen.frame import CanFrame
from barewire.canopen.lss.messages import BEGIN, REQUEST_KEY, Fastscan, LssAddress, LssMessage, LssService
from barewire.canopen.sync import sync_counter
from barewire.canopen.time_stamp import TimeStamp
from barewire.errors import DecodeError
from barewire_workbench.frames.can import explain_lss
from barewire_workbench.monitor.events import (
    EmcyReport,
    Gap,
    LssReport,
    MonitorEvent,
    SyncReport,
    TimeReport,
    Violation,
)

_RESERVED_CLASSES = frozenset((*range(0x01, 0x10), *range(0xA0, 0xF0)))
"""First bytes of error codes that no table of CiA 301 or of a profile has."""
_RESERVED_BIT = 0x40
_MISSING = 2.5
"""Periods without a SYNC after which it is missing."""
_INTERVALS = 7
"""The number of intervals whose median is the period; at least three are needed."""


class SyncTracker:
    """SYNC: period, jitter, counter. A machine."""

    def __init__(self) -> None:
        self.beats = 0
        self.shortest: float | None = None
        self.longest: float | None = None
        self._intervals: list[float] = []
        self._last: float | None = None
        self._counter: int | None = None
        self._highest = 0
        self._missing = False

    @property
    def period(self) -> float | None:
        """The period; None until three intervals were recorded."""
        return median(self._intervals) if len(self._intervals) >= 3 else None

    @property
    def deadline(self) -> float | None:
        """When SYNC counts as missing."""
        period = self.period
        return None if period is None or self._last is None or self._missing else self._last + _MISSING * period

    def pass_time(self, now: float) -> list[MonitorEvent]:
        """Report SYNC as missing if its deadline has passed."""
        due = self.deadline
        if due is None or now < due:
            return []
        self._missing = True
        return [SyncReport(due, "missing", self._counter, self.beats, self.period, self.shortest, self.longest)]

    def interrupt(self) -> None:
        """Note a gap in the recording."""
        self._last, self._counter, self._missing = None, None, False

    def feed(self, frame: CanFrame, now: float) -> list[MonitorEvent]:
        """Take a SYNC frame."""
        try:
            counter = sync_counter(frame.data)
        except DecodeError as error:
            rule = "SYNC-LENGTH" if error.reason == "long" else "SYNC-COUNTER"
            return [Violation(now, rule, 0, error.text, str(frame))]
        events: list[MonitorEvent] = []
        since = None if self._last is None else now - self._last
        if self._last is not None and (counter is None) is not (self._counter is None):
            text = "with a counter, the one before without" if counter else "without a counter, the one before with one"
            events.append(Violation(now, "SYNC-LENGTH", 0, text, str(frame)))
        elif counter is not None and self._counter is not None and since is not None:
            events += self._judge(counter, self._counter, since, frame, now)
        kind: Literal["back", "beat", "first"] = "back" if self._missing else "beat" if self.beats else "first"
        self.beats += 1
        if since is not None and not self._missing:  # the silence of a missing SYNC is no jitter
            self.shortest = since if self.shortest is None else min(self.shortest, since)
            self.longest = since if self.longest is None else max(self.longest, since)
            self._intervals = [*self._intervals[1 - _INTERVALS :], since]
        self._last, self._counter, self._missing = now, counter, False
        self._highest = max(self._highest, counter or 0)
        events.append(SyncReport(now, kind, counter, self.beats, self.period, self.shortest, self.longest))
        return events

    def _judge(self, counter: int, before: int, since: float, frame: CanFrame, now: float) -> list[MonitorEvent]:
        """Check that a counter follows `before`. 1 is always allowed: the producer starts again."""
        if counter in (1, before + 1):
            return []
        step = counter - before if counter > before else counter - before + self._highest
        period = self.period
        if period and step > 1 and abs(since / period - step) < 0.5:
            text = f"the SYNC counter goes from {before} to {counter}, and so does the time"
            return [Gap(now, now - since, step - 1, text, rule="SYNC-COUNTER")]
        return [Violation(now, "SYNC-COUNTER", 0, f"{counter} after {before}", str(frame))]

    def end(self, now: float) -> list[MonitorEvent]:
        """Return a summary if there were at least two SYNCs."""
        if self.beats < 2:
            return []
        return [SyncReport(now, "summary", self._counter, self.beats, self.period, self.shortest, self.longest)]


def emergency_events(node: int, frame: CanFrame, now: float) -> list[MonitorEvent]:
    """Take an emergency. One with a wrong length is reported, and decoded as far as possible."""
    events: list[MonitorEvent] = []
    if len(frame.data) != 8:
        events.append(Violation(now, "EMCY-LENGTH", node, f"{len(frame.data)} bytes", str(frame)))
    try:
        message = Emergency.decode(frame._replace(data=frame.data[:8]))
    except DecodeError:
        return events
    events += [Violation(now, rule, node, text, str(frame)) for rule, text in _emergency_faults(message)]
    return [*events, EmcyReport(now, node, message.code, message.register, message.info)]


def _emergency_faults(message: Emergency) -> list[tuple[str, str]]:
    """Return the rules that the contents of an emergency break, each with a text."""
    faults = []
    if message.code >> 8 in _RESERVED_CLASSES:
        faults.append(("EMCY-CODE", f"{message.code:04X}h is in a class that has no errors"))
    if message.code >> 8 and not message.register & 1:
        text = f"error {message.code:04X}h with register {message.register:02X}h: bit 0, generic, is not set"
        faults.append(("EMCY-REGISTER", text))
    if message.register & _RESERVED_BIT:
        faults.append(("EMCY-REGISTER", f"register {message.register:02X}h: bit 6 is reserved"))
    return faults


def time_events(frame: CanFrame, now: float) -> list[MonitorEvent]:
    """Take a TIME frame."""
    try:
        stamp = TimeStamp.decode(frame)
    except DecodeError as error:
        return [Violation(now, "TIME-VALUE" if error.reason == "value" else "TIME-LENGTH", 0, error.text, str(frame))]
    return [TimeReport(now, int(stamp.moment), f"{stamp.moment.datetime.isoformat(' ', 'milliseconds')}")]


class LssTracker:
    """LSS: each message as text, and a whole fastscan as one event."""

    def __init__(self) -> None:
        self._requests = self._answers = 0
        self._began = 0.0
        self._scan_request: Fastscan | None = None
        self._parts: dict[int, int] = {}

    def feed(self, frame: CanFrame, now: float) -> list[MonitorEvent]:
        """Take a message of the master or of a device."""
        answer = frame.key != REQUEST_KEY
        try:
            message = LssMessage.decode(frame)
        except DecodeError as error:
            rule = "LSS-SERVICE" if error.reason == "function" else "LSS-LENGTH"
            return [*self.end(now), Violation(now, rule, 0, error.text, str(frame))]
        if message.service == LssService.FASTSCAN and not answer:
            return self._scan(message.body, now)
        if self._scan_request is not None and answer and message.service == LssService.IDENTIFIED:
            self._answers += 1
            if self._scan_request.bit == 0:
                self._parts[self._scan_request.sub] = self._scan_request.number
            return []
        return [*self.end(now), LssReport(now, answer, message.service, _text(frame, answer))]

    def _scan(self, body: bytes, now: float) -> list[MonitorEvent]:
        events: list[MonitorEvent] = []
        try:
            request = Fastscan.of_body(body)
        except DecodeError as error:
            return [
                *self.end(now),
                LssReport(now, False, LssService.FASTSCAN, f"fastscan that no device answers: {error.text}"),
            ]
        if self._scan_request is None or request.bit == BEGIN:
            events = self.end(now)
            self._began = now
        self._scan_request = request
        self._requests += 1
        return events

    def end(self, now: float) -> list[MonitorEvent]:
        """End the fastscan under way and return its event."""
        if self._scan_request is None:
            return []
        text = f"fastscan, {self._requests} requests in {now - self._began:.3f} s, {self._answers} answers: "
        if len(self._parts) == 4:
            found = f"found {LssAddress(*(self._parts[part] for part in range(4)))}"
        else:
            found = "no device" if not self._answers else "not finished"
        self._requests = self._answers = 0
        self._scan_request, self._parts = None, {}
        return [LssReport(self._began, False, LssService.FASTSCAN, text + found)]


def _text(frame: CanFrame, answer: bool) -> str:
    fields, _, summary = explain_lss(frame.data, "response" if answer else "request")
    texts = []
    for field in fields[1:]:
        if field.name != "reserved":
            number = f"{field.value:08X}h" if field.length == 4 and isinstance(field.value, int) else field.value
            texts.append(f"{field.name} {number}" + (f" ({field.meaning})" if field.meaning else ""))
    return ", ".join([summary, *texts])
