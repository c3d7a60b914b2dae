"""What `barewire diagnose` would say of the last frames of the panel's own line.

The frames are diagnosed anew each time, as a log of so many frames: a fault that is over leaves the verdict with them.
"""

from __future__ import annotations

import threading
from collections import deque
from typing import TYPE_CHECKING, Any, Literal, cast

from barewire.devices import Device
from barewire.io.endpoint import Endpoint
from barewire_workbench.diagnosis.can_log import CanLogDiagnosis
from barewire_workbench.diagnosis.modbus_log import ModbusLogDiagnosis
from barewire_workbench.diagnosis.verdict import LineVerdict, LogFinding
from barewire_workbench.monitor import of_device
from barewire_workbench.recordings.modbus_log import LoggedBytes, ModbusLog
from barewire_workbench.recordings.model import Recorded

if TYPE_CHECKING:
    from barewire.io.ports.base import Direction

_ITEMS = 300
"""Frames, and pieces of frames, of a line that are diagnosed."""
_FINDINGS = 5
"""The latest findings that are shown."""


class LastFrames:
    """The last frames of one line; `diagnosis` says what is wrong with it.

    >>> from barewire import load
    >>> last = LastFrames(load("adxl"), "rtu:///dev/x")
    >>> last.take("sent", bytes.fromhex("01 04 0F 83 00 02 83 37"), 0.0)
    >>> last.take("received", bytes.fromhex("01 84 06 C3 02"), 0.1)
    >>> last.diagnosis()["verdicts"][0][0]
    'a device refused or reported something [refused]'
    """

    def __init__(self, device: Device, endpoint: str) -> None:
        self._device, self._endpoint = device, Endpoint.parse(endpoint)
        self._items: deque[tuple[float, bool, Any]] = deque(maxlen=_ITEMS)
        self._lock = threading.Lock()  # frames of a bus come in a thread of their own
        self.taken = 0
        """How many there were."""

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {len(self._items)}>"

    def take(self, direction: Direction, item: Any, at: float) -> None:
        """Take what was sent or received at a time in seconds."""
        with self._lock:
            self._items.append((at, direction == "sent", item if self._endpoint.scheme == "can" else bytes(item)))
            self.taken += 1

    def diagnosis(self) -> dict[str, Any]:
        """Return the number of exchanges, the verdicts on the line if something is wrong, and the latest findings."""
        with self._lock:
            items = list(self._items)
        # What answers a request that is no longer kept would be a response without its request.
        items = items[next((place for place, (_, sent, _) in enumerate(items) if sent), len(items)) :]
        findings, verdicts = self._of_can(items) if self._endpoint.scheme == "can" else self._of_modbus(items)
        wrong = [verdict for verdict in verdicts if verdict.code != "nothing-wrong"] if items else []
        return {
            "exchanges": sum(sent for _, sent, _ in items),
            "verdicts": [
                (f"{verdict.text} [{verdict.code}]", verdict.sentence.partition(f"[{verdict.code}]: ")[2])
                for verdict in wrong
            ],
            "findings": [(round(found.at, 3), found._replace(timed=False).sentence) for found in findings[-_FINDINGS:]],
        }

    def _of_modbus(self, items: list[tuple[float, bool, bytes]]) -> tuple[list[LogFinding], list[LineVerdict]]:
        framing = cast("Literal['rtu', 'ascii', 'tcp']", self._endpoint.framing)
        log = ModbusLog(tuple(LoggedBytes(at, data, 0, sent, framing) for at, sent, data in items), "panel", True)
        diagnosis = ModbusLogDiagnosis(log, self._endpoint.timeout, None if framing == "tcp" else framing)
        return list(diagnosis.findings()), [verdict for _, verdict in diagnosis.verdicts()]

    def _of_can(self, items: list[tuple[float, bool, Any]]) -> tuple[list[LogFinding], list[LineVerdict]]:
        node = self._endpoint.integer("node", 0) or None
        known = [of_device(self._device, node)] if self._device.canopen is not None else []
        diagnosis = CanLogDiagnosis(known)
        findings = [
            found for at, sent, frame in items for found in diagnosis.feed(Recorded(at, "", frame, sent=sent))
        ] + diagnosis.end()
        return findings, [verdict for _, verdict in diagnosis.verdicts()]
