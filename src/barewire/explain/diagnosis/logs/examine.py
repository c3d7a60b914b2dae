"""Diagnosis of many damaged pieces of one log, with a bound on its cost.

The search for a wrong baud rate takes a fifth of a second for some bytes. It is made for the first pieces of a log;
what is wrong with the whole line shows in them. Later ones get the trials that take little time, and equal bytes are
tried once.

Depends on: diagnosis.modbus. Used by: modbus_log.
"""

from __future__ import annotations

from barewire.explain.diagnosis.modbus import checksum, one_change
from barewire.explain.diagnosis.modbus.ascii import diagnose_ascii
from barewire.explain.diagnosis.modbus.resample import misread_parity
from barewire.explain.diagnosis.modbus.rtu import diagnose_rtu, first_findings, seven_bit
from barewire.explain.diagnosis.modbus.tcp import diagnose_tcp
from barewire.explain.findings import Finding
from barewire.explain.result import FrameRole, ProtocolName

THOROUGH = 12
"""So many different pieces of a log get all trials."""
_REMEMBERED = 512
_LONGEST = 300
"""Bytes: a longer piece is not one frame with a fault."""
_QUICK = (
    (seven_bit, checksum.swapped),
    (checksum.span, checksum.kind),
    (one_change.byte_count, one_change.one_bit, one_change.one_less, one_change.one_more),
)
_DOUBTFUL = frozenset({"baud-rate", "inverted"})
"""Codes of other readings of the line. Most pieces decide which one is right."""
_FRAMINGS = {"rtu": diagnose_rtu, "ascii": diagnose_ascii, "tcp": diagnose_tcp}


class Examiner:
    """Returns what is wrong with pieces of one log, in one framing.

    >>> Examiner("rtu").findings(bytes.fromhex("01 03 00 00 00 0A CD C5"), "request")[0].code
    'crc-swapped'
    """

    def __init__(self, protocol: ProtocolName) -> None:
        self._protocol = protocol
        self._left = THOROUGH
        self._known: dict[tuple[bytes, FrameRole | None], list[Finding]] = {}

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self._protocol}, {self._left} thorough trials left>"

    def findings(self, data: bytes, role: FrameRole | None) -> list[Finding]:
        """Return what is wrong with bytes that should be one frame; the role is that which the log lets expect."""
        key = data, role
        if key not in self._known:
            found = self._tried(data, role)
            if len(self._known) >= _REMEMBERED:
                return found
            self._known[key] = found
        return self._known[key]

    def _tried(self, data: bytes, role: FrameRole | None) -> list[Finding]:
        if len(data) > _LONGEST:
            return []
        if self._protocol != "rtu":
            return _FRAMINGS[self._protocol](data, role)  # these are cheap
        if not self._left:
            return first_findings(_QUICK, data, role)
        self._left -= 1
        found = diagnose_rtu(data, role) or (diagnose_rtu(data) if role is not None else [])
        if not found or found[0].code in _DOUBTFUL:
            found += misread_parity(data, role)
        return found
