"""Diagnosis of many damaged pieces of one log, with a bound on its cost.

The search for a wrong baud rate takes a tenth of a second for some bytes. It is made for the first pieces of a log
that no other trial explains; what is wrong with the whole line shows in them. Equal bytes are tried once.
"""

from __future__ import annotations

from barewire_workbench.diagnosis.modbus.ascii import diagnose_ascii
from barewire_workbench.diagnosis.modbus.resample import misread, misread_parity
from barewire_workbench.diagnosis.modbus.rtu import RTU_TRIALS, diagnose_rtu, first_findings
from barewire_workbench.diagnosis.modbus.tcp import diagnose_tcp
from barewire_workbench.frames.findings import Finding
from barewire_workbench.frames.result import FrameRole, ProtocolName

THOROUGH, THOROUGH_BESIDE = 8, 3
"""So many different pieces of a log get all trials: if no frame is good, and if some are. Then the line is read as it
is sent, and at most one unit has other settings."""
_REMEMBERED = 512
_LONGEST = 300
"""Bytes: a longer piece is not one frame with a fault."""
_QUICK = tuple(trials for trials in RTU_TRIALS if misread not in trials)
_DOUBTFUL = frozenset({"baud-rate", "inverted"})
"""Codes of other readings of the line. Most pieces decide which one is right."""
_WEAK = "cut-frame"
"""The code whose only proof is a length; another reading of the line is tried first."""
_FRAMINGS = {"rtu": diagnose_rtu, "ascii": diagnose_ascii, "tcp": diagnose_tcp}


class Examiner:
    """Returns what is wrong with pieces of one log, in one framing.

    >>> Examiner("rtu").findings(bytes.fromhex("01 03 00 00 00 0A CD C5"), "request")[0].code
    'crc-swapped'
    """

    def __init__(self, protocol: ProtocolName) -> None:
        self._protocol = protocol
        self._thorough = 0
        self._known: dict[tuple[bytes, FrameRole | None], list[Finding]] = {}

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self._protocol}, {self._thorough} thorough trials made>"

    def findings(self, data: bytes, role: FrameRole | None, *, good: bool = False) -> list[Finding]:
        """Return what is wrong with bytes that should be one frame; the role is that which the log lets expect.

        `good`: frames of this line are read as they were sent.
        """
        key = data, role
        if key not in self._known:
            found = self._tried(data, role, THOROUGH_BESIDE if good else THOROUGH)
            if len(self._known) >= _REMEMBERED:
                return found
            self._known[key] = found
        return self._known[key]

    def _tried(self, data: bytes, role: FrameRole | None, limit: int) -> list[Finding]:
        if len(data) > _LONGEST:
            return []
        if self._protocol != "rtu":
            return _FRAMINGS[self._protocol](data, role)  # these are cheap
        found = first_findings(_QUICK, data, role) or first_findings(_QUICK, data, None)
        if (found and found[0].code != _WEAK) or self._thorough >= limit:
            return found
        self._thorough += 1
        found = diagnose_rtu(data, role) or (diagnose_rtu(data) if role is not None else [])
        if not found or found[0].code in _DOUBTFUL:
            found += misread_parity(data, role)
        return found
